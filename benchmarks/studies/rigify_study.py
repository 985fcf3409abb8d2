"""A study of a person tracked on a generated Rigify rig, compared with the same person on the program's own body.

python -m kfmocap.benchmarks.studies.rigify_study
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import bpy
import numpy as np
from mathutils import Vector
from scipy.spatial.transform import Rotation

from ...cli.example_footage import example_folder
from ...core.body import Body, part_poses
from ...core.body.inverse_kinematics import fit_poses
from ...core.body.motion import Motion
from ...core.body.skeleton_motion import SkeletonMotion, motion_of_body
from ...core.formats import Landmarks, read_trc
from ...core.numerics.arrays import Array, Ints
from ...core.retargeting.transfer import RetargetOptions
from ...core.review.scoring import Score, joint_error
from ...core.shot.shot import KeyPoses, Shot
from ...core.tracking.prepare import load_shot
from ...kfmocap_addon.registration import registered
from ...kfmocap_addon.retargeting.send import SendOptions, send_to_rig
from ...kfmocap_addon.scene_io import fcurves, scene
from ...kfmocap_addon.scene_io.body import body_armature
from ...kfmocap_addon.scene_io.keys import key_pose_curves
from ..tables import markdown
from .rig_study import done

BAR = 1.1
"""Largest acceptable ratio of the error on the rig to that on the program's own body."""
BENT: Mapping[str, tuple[str, float]] = MappingProxyType(
    {"upper_arm": ("z", -40.0), "forearm": ("x", 12.0), "thigh": ("x", 5.0), "shin": ("x", -10.0)}
)
"""Axes of the body's parts about which limbs of the rig are turned at rest, and degrees: Rigify asks for bent elbows
and knees. Those of the right upper arm are the other way round."""
PARTS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {"pelvis": ("spine",), "spine": ("spine.001", "spine.002"), "chest": ("spine.003",),
     "head": ("spine.004", "spine.005", "spine.006")}
    | {f"{name}.{side}": (f"{name}.{side}",) for side in "LR"
       for name in ("shoulder", "upper_arm", "forearm", "hand", "thigh", "shin", "foot")}
)  # fmt: skip
"""The bones of the metarig that divide each part of the body between them, from its joint to its tip."""
NECK = 0.12
"""Share of the head's length that each of the two bones of the neck has."""
SHOWN: Mapping[str, str] = MappingProxyType(
    {"Shoulder": "upper_arm", "Elbow": "forearm", "Wrist": "hand", "Hip": "thigh", "Knee": "shin", "Ankle": "foot"}
)
"""Deforming bones whose heads are joints."""
HEADS = ["tracked on", "parts", "all joints, mm", "hips", "knees", "ankles", "shoulders", "elbows", "wrists"]


def bent_pose(body: Body) -> Motion:
    """Return the pose that the rig has at rest, one frame."""
    Q = np.broadcast_to(np.eye(3), (1, len(body), 3, 3)).copy()
    for i, name in enumerate(body.names):
        part, _, side = name.partition(".")
        if part in BENT:
            axis, degrees = BENT[part]
            degrees *= -1.0 if (part, side) == ("upper_arm", "R") else 1.0
            Q[0, i] = Rotation.from_euler(axis, degrees, degrees=True).as_matrix()
    return Motion(body.parts[0].head_world[None], Q)


def generated_rig(body: Body) -> bpy.types.Object:
    """Generate Rigify's human with the joints and the skin of a body; the skin is bound to the deforming bones."""
    R, T = (each[0] for each in part_poses(body, bent_pose(body)))
    done(lambda: bpy.ops.preferences.addon_enable(module="rigify"))
    bpy.ops.object.armature_human_metarig_add()
    bpy.ops.object.mode_set(mode="OBJECT")
    joints = _joints(body, R, T)
    _move_bones(bpy.context.object, joints)
    done(bpy.ops.pose.rigify_generate)
    rig = next(owner for owner in bpy.data.objects if owner.type == "ARMATURE" and "rig_id" in owner.data)
    clouds: dict[str, list[Array]] = {}
    for i, part in enumerate(body.parts):
        for bone, points in divided(part.vertices @ R[i].T + T[i], PARTS[part.name], joints):
            clouds.setdefault(f"DEF-{bone}", []).append(points)
    _bind(rig, {name: np.concatenate(points) for name, points in clouds.items()})
    return rig


def _joints(body: Body, R: Array, T: Array) -> dict[str, tuple[Array, Array]]:
    """Return heads and tails of the metarig's bones."""
    found = {}
    for i, part in enumerate(body.parts):
        tip = T[i] + R[i] @ part.R_world_rest.T @ (part.tail_world - part.head_world)
        bones = PARTS[part.name]
        ends = [0.0, NECK, 2 * NECK, 1.0] if part.name == "head" else np.linspace(0, 1, len(bones) + 1).tolist()
        places = [T[i] + end * (tip - T[i]) for end in ends]
        found |= {bone: (places[k], places[k + 1]) for k, bone in enumerate(bones)}
    return found


def _move_bones(metarig: bpy.types.Object, joints: Mapping[str, tuple[Array, Array]]) -> None:
    """Move the bones of a metarig to joints; those that hang on them (fingers, toes, face) move along."""
    with body_armature.edit_bones(metarig) as bones:
        frames = {bone.name: (np.array(bone.head), np.array(bone.tail)) for bone in bones}
        above = {bone.name: [p.name for p in bone.parent_recursive] for bone in bones}
        connected = [bone.name for bone in bones if bone.use_connect]
        for bone in bones:
            bone.use_connect = False
        for bone in bones:
            head, tail = frames[bone.name]
            if bone.name in joints:
                ends = joints[bone.name]
            else:
                carrier = next((name for name in above[bone.name] if name in joints), "spine")
                ends = _carried(np.stack([head, tail]), frames[carrier], joints[carrier])
            bone.head, bone.tail = Vector(ends[0].tolist()), Vector(ends[1].tolist())
        for name in connected:
            bones[name].use_connect = True


def _carried(points: Array, before: tuple[Array, Array], after: tuple[Array, Array]) -> Array:
    """Return points (N, 3) turned and moved as a bone from one place to another."""
    old, new = before[1] - before[0], after[1] - after[0]
    turned, _ = Rotation.align_vectors(new[None], old[None])
    return turned.apply(points - before[0]) * (np.linalg.norm(new) / np.linalg.norm(old)) + after[0]


def divided(corners: Array, bones: Sequence[str], joints: Mapping[str, tuple[Array, Array]]) -> list[tuple[str, Array]]:
    """Divide a solid with these corners among the bones along it, as points of it."""
    first, second = np.triu_indices(len(corners))
    share = np.linspace(0, 1, 9)[:, None, None]
    points = np.unique((share * corners[first] + (1 - share) * corners[second]).reshape(-1, 3).round(6), axis=0)
    start, end = joints[bones[0]][0], joints[bones[-1]][1]
    along = (points - start) @ (end - start) / np.sum((end - start) ** 2)
    ends = [float((joints[b][1] - start) @ (end - start) / np.sum((end - start) ** 2)) for b in bones[:-1]]
    owner = np.searchsorted(ends, along)
    return [(bone, points[owner == k]) for k, bone in enumerate(bones) if (owner == k).any()]


def _bind(rig: bpy.types.Object, clouds: Mapping[str, Array]) -> None:
    """Bind a skin of points to deforming bones, each cloud (V, 3) to its own."""
    mesh = bpy.data.meshes.new("skin")
    mesh.from_pydata(np.concatenate(list(clouds.values())).tolist(), [], [])
    skin = bpy.data.objects.new("skin", mesh)
    bpy.context.scene.collection.objects.link(skin)
    skin.parent = rig
    modifier = skin.modifiers.new("Armature", "ARMATURE")
    modifier.object = rig
    start = 0
    for name, points in clouds.items():
        skin.vertex_groups.new(name=name).add(range(start, start + len(points)), 1.0, "REPLACE")
        start += len(points)


def with_landmarks(body: Body, own: Body) -> Body:
    """Return the body of a rig with the landmarks of the body that it was made for, where that has them at rest."""
    R, T = (each[0] for each in part_poses(own, bent_pose(own)))
    carriers = {name: _carrier(body, bones) for name, bones in PARTS.items()}
    found = {}
    for name, (owner, point) in own.landmarks.items():
        part = body.parts[i := carriers[own.names[owner]]]
        found[name] = (i, part.R_world_rest.T @ (R[owner] @ point + T[owner] - part.head_world))
    return replace(body, landmarks=found)


def _carrier(body: Body, bones: Sequence[str]) -> int:
    """Return the part of a rig's body that turns the last of some bones: its FK control."""
    bone = bones[-1]
    stem, dot, rest = bone.partition(".")
    names = (f"{stem}_fk{dot}{rest}", bone, {"spine": "torso", "spine.006": "head"}.get(bone, ""))
    return next(body.index(name) for name in names if name in body.names)


def heads_on_frames(armature: bpy.types.Object, bones: Sequence[str], frames: Sequence[int]) -> Array:
    """Return where Blender shows the heads of bones, metres, shape (F, B, 3)."""
    shown = []
    for frame in frames:
        bpy.context.scene.frame_set(frame)
        posed = armature.evaluated_get(bpy.context.evaluated_depsgraph_get())
        shown.append([posed.matrix_world @ posed.pose.bones[name].head for name in bones])
    return np.array(shown)


def on_own_body(shot: Shot, truth: Landmarks) -> tuple[int, Score]:
    """Track a shot in Blender on the program's own body; returns the number of its parts, and the errors."""
    with registered():
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        scene.build_scene(shot, scene=bpy.context.scene)
        armature = bpy.context.scene.kfmocap.performers[0].armature
        body = body_armature.body_from_armature(armature)
        done(bpy.ops.kfmocap.track)
        return len(body), _scored(armature, _joint_bones(""), shot, truth)


def on_rigify(shot: Shot, truth: Landmarks, save: Path | None = None, *, by_goals: bool = False) -> tuple[int, Score]:
    """Track a shot in Blender on a generated Rigify rig, with key poses on the same frames, fitted to the same
    landmarks; see `on_own_body`. With `by_goals` they are set with the controls of inverse kinematics, before the rig
    becomes a performer.
    """
    performer = shot.performers[0]
    with registered():
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        current = bpy.context.scene
        scene.build_scene(shot, scene=current)
        own = current.kfmocap.performers[0].armature
        done(lambda: bpy.ops.kfmocap.remove_performer(performer=0))
        bpy.data.objects.remove(own)
        rig = generated_rig(performer.body)
        frames = performer.key_poses.full()
        if by_goals:
            poses = fit_poses(performer.body, truth.names, truth.points_world[frames])
            _key_goals(rig, motion_of_body(performer.body, poses, "man", shot.fps), frames)
        bpy.context.view_layer.objects.active = rig
        done(bpy.ops.kfmocap.use_armature)
        body = body_armature.body_from_armature(rig)
        if not by_goals:
            shown = with_landmarks(body, performer.body)
            poses = fit_poses(shown, truth.names, truth.points_world[frames])
            key_pose_curves.write_key_poses(rig, KeyPoses.whole(frames, poses), current.kfmocap.frame_start)
        done(bpy.ops.kfmocap.track)
        score = _scored(rig, _joint_bones("DEF-"), shot, truth)
        if save is not None:
            bpy.ops.wm.save_as_mainfile(filepath=str(save))
        return len(body), score


def _key_goals(rig: bpy.types.Object, poses: SkeletonMotion, frames: Ints) -> None:
    """Key a rig's controls, those of inverse kinematics in its limbs, with poses on frames of the shot, (K,)."""
    scene = bpy.context.scene
    as_they_are = RetargetOptions(feet="off", scale=1.0)
    send_to_rig(scene, poses, rig, 0, SendOptions(preset="rigify-ik", retarget=as_they_are))
    for curve in fcurves.find_channelbag(rig).fcurves:
        keys = fcurves.get_keys(curve)
        there = scene.kfmocap.frame_start + frames[fcurves.frames_of(keys)]
        fcurves.set_keys(curve, [fcurves.new_keys(there, keys["co"][:, 1], "KEYFRAME", "BEZIER")])


def _joint_bones(prefix: str) -> dict[str, str]:
    return {f"{side}{joint}": f"{prefix}{bone}.{side}" for joint, bone in SHOWN.items() for side in "LR"}


def _scored(armature: bpy.types.Object, bones: Mapping[str, str], shot: Shot, truth: Landmarks) -> Score:
    """Compare the heads of bones, which are joints, with the true ones, as Blender shows them."""
    first = bpy.context.scene.kfmocap.frame_start
    shown = heads_on_frames(armature, list(bones.values()), range(first, first + shot.length))
    keys = shot.performers[0].key_poses.full().tolist()
    return joint_error(Landmarks(tuple(bones), shown, shot.fps), truth, keys)


def cells(name: str, parts: int, score: Score) -> list[str]:
    """Return the cells of a row."""
    both = [np.mean([score.per_landmark[f"{side}{joint}"] for side in "LR"])
            for joint in ("Hip", "Knee", "Ankle", "Shoulder", "Elbow", "Wrist")]  # fmt: skip
    return [name, str(parts), f"{score.mean:.2f}", *(f"{error:.1f}" for error in both)]


def main(argv: Sequence[str] | None = None) -> int:
    """Track the example `walk` on both, and print the table."""
    parser = argparse.ArgumentParser(prog="python -m kfmocap.benchmarks.studies.rigify_study", description=__doc__)
    parser.add_argument("--shot", type=Path, help="another shot's folder, by default the example walk")
    parser.add_argument("--save", type=Path, metavar="FILE.blend", help="save the tracked rig there")
    args = parser.parse_args(argv)
    folder = example_folder("walk") if args.shot is None else args.shot.resolve()
    shot, truth = load_shot(folder / "shot.toml"), read_trc(folder / "landmarks.trc")
    own, rig = on_own_body(shot, truth), on_rigify(shot, truth, None if args.save is None else args.save.resolve())
    by_goals = on_rigify(shot, truth, by_goals=True)
    rows = {"the program's body": own, "Rigify": rig, "Rigify, key poses set with IK": by_goals}
    print(markdown(HEADS, [cells(name, *row) for name, row in rows.items()]))
    ratio = max(rig[1].mean, by_goals[1].mean) / own[1].mean
    print(f"\nratio {ratio:.3f}, {bpy.app.version_string}, {shot.length} frames, {len(shot.views)} cameras")
    return int(ratio > BAR)


if __name__ == "__main__":
    raise SystemExit(main())
