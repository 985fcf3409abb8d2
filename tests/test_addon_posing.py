"""Posing in Blender: clicked joints, and poses made of other poses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from addon_shots import blender, video  # noqa: E402, F401
from keypoint_shots import cameras, person, strolling  # noqa: E402
from kfmocap.core.body import landmark_positions  # noqa: E402
from kfmocap.core.motion import Motion  # noqa: E402
from kfmocap.core.shot import KeyPoses, Performer, Shot, View  # noqa: E402
from kfmocap.kfmocap_addon import curves, marks, placing, rig, scene  # noqa: E402

pytestmark = pytest.mark.blender

BODY = person()
WALK = strolling(BODY, 30)
LIMBS = [side + joint for side in "LR" for joint in ("Shoulder", "Elbow", "Wrist", "Hip", "Knee", "Ankle")]
BENT = (-0.2, 0.05, 0.001, 0.002)


def walk_scene(folder: Path, keys: tuple[int, ...] = (0, 29), tracked: bool = False):
    """A stroll before two cameras with bent pictures, key poses on some frames; its performer's slot."""
    from dataclasses import replace

    views = tuple(
        View(replace(camera, distortions=np.array(BENT)), video(folder / f"{camera.name}.mp4", size=camera.size))
        for camera in cameras(2)
    )
    key_poses = KeyPoses.whole(list(keys), WALK[list(keys)])
    shot = Shot("walk", 30.0, (0, 29), views, (Performer("man", BODY, key_poses),))
    bpy.context.window.scene = scene.build_scene(shot, [WALK] if tracked else None)
    return bpy.context.scene.kfmocap.performers[0]


def mark_joints(slot, frame: int, truth: Motion, views: tuple[str, ...], noise: float = 1.0) -> None:
    """Marks on the joints of a pose, on a scene frame."""
    rng = np.random.default_rng(frame)
    points = landmark_positions(BODY, truth, LIMBS)[0]
    by_name = {camera.name: camera for camera in cameras(2)}
    found = {
        (view, name): tuple(by_name[view].project(point) + rng.normal(0, noise, 2))
        for view in views
        for name, point in zip(LIMBS, points, strict=True)
    }
    marks.put(slot, frame, found)


def error(slot, truth: Motion) -> float:
    """Mean distance of the limbs' joints from where they should be, metres."""
    shown = landmark_positions(BODY, curves.shown_pose(slot.armature), LIMBS)
    return float(np.linalg.norm(shown - landmark_positions(BODY, truth, LIMBS), axis=-1).mean())


def keyed(slot) -> dict[int, bool]:
    """Shot frames with a key pose, and whether it fixes the whole body."""
    found = curves.read_key_poses(slot.armature, 1, 30)
    return {int(frame): bool(fixed.all()) for frame, fixed in zip(found.frames, found.fixed, strict=True)}


def test_marks_in_two_views_become_a_key_pose(blender, tmp_path):  # noqa: F811
    slot = walk_scene(tmp_path)
    bpy.context.scene.frame_set(13)
    assert error(slot, WALK[[12]]) > 0.06
    mark_joints(slot, 13, WALK[[12]], ("cam01", "cam02"))
    assert bpy.ops.kfmocap.place_joints() == {"FINISHED"}
    assert error(slot, WALK[[12]]) < 0.02
    assert keyed(slot) == {0: True, 12: True, 29: True}
    bpy.context.scene.frame_set(5)
    bpy.context.scene.frame_set(13)
    assert error(slot, WALK[[12]]) < 0.02


def test_marks_of_other_frames_do_not_count(blender, tmp_path):  # noqa: F811
    slot = walk_scene(tmp_path)
    mark_joints(slot, 20, WALK[[19]], ("cam01",))
    bpy.context.scene.frame_set(13)
    with pytest.raises(RuntimeError, match="no joint is marked"):
        bpy.ops.kfmocap.place_joints()
    assert keyed(slot) == {0: True, 29: True}


def test_an_arm_alone_is_posed_and_keyed(blender, tmp_path):  # noqa: F811
    slot = walk_scene(tmp_path)
    bpy.context.scene.frame_set(13)
    before = curves.shown_pose(slot.armature)
    placed = placing.Placing(bpy.context.scene, slot, {"upper_arm.L", "forearm.L"})
    placed.remember()
    placed.mark("cam01", "LWrist", (0.1, -0.1))
    placed.key()
    moved = before.difference(curves.shown_pose(slot.armature))[0, 3:].reshape(-1, 3)
    parts = {BODY.names[i] for i in np.flatnonzero(np.abs(moved).max(axis=1) > 1e-5)}
    assert parts == {"upper_arm.L", "forearm.L"}
    assert keyed(slot) == {0: True, 12: False, 29: True}


def state(slot) -> list:
    return [curves.shown_values(slot.armature), marks.everything(slot)]


def test_what_is_cancelled_leaves_pose_and_marks_to_the_last_bit(blender, tmp_path):  # noqa: F811
    slot = walk_scene(tmp_path)
    mark_joints(slot, 7, WALK[[6]], ("cam02",))
    mark_joints(slot, 13, WALK[[12]], ("cam01",))
    bpy.context.scene.frame_set(13)
    before = state(slot)
    placed = placing.Placing(bpy.context.scene, slot)
    placed.mark("cam01", "LWrist", (0.1, -0.1))
    placed.mark("cam02", "Head", (0.0, -0.2))
    placed.unmark("cam01", "RWrist")
    placed.flip("cam01", "LWrist")
    assert state(slot) != before
    placed.restore()
    assert state(slot) == before


def test_undo_takes_back_one_mark_at_a_time(blender, tmp_path):  # noqa: F811
    slot = walk_scene(tmp_path)
    placed = placing.Placing(bpy.context.scene, slot)
    poses = []
    for name, place in (("LWrist", (0.1, -0.1)), ("RWrist", (-0.1, 0.0)), ("LAnkle", (0.0, 0.2))):
        placed.remember()
        placed.mark("cam01", name, place)
        poses.append(placed.pose)
    assert placed.undo() and [name for _, name in placed.marks] == ["LWrist", "RWrist"]
    assert np.abs(placed.pose.difference(poses[1])).max() < 1e-2
    assert placed.undo() and placed.undo() and not placed.undo()
    assert marks.on_frame(slot, 1) == {}
    assert np.abs(placed.pose.difference(WALK[[0]])).max() < 1e-5


def test_joints_are_asked_for_limb_by_limb_with_names_that_people_say():
    names = placing.order(BODY)
    assert names[:3] == ["LShoulder", "LElbow", "LWrist"] and sorted(names) == sorted(BODY.landmarks)
    assert [placing.spoken(n) for n in ("LBigToe", "Neck", "RHip")] == ["Left Big Toe", "Neck", "Right Hip"]


def test_a_body_of_another_origin_is_posed_by_its_bones(blender, tmp_path):  # noqa: F811
    slot = walk_scene(tmp_path)
    for bone in slot.armature.data.bones:
        del bone[rig.LANDMARKS]
    placed = placing.Placing(bpy.context.scene, slot)
    assert placed.landmarks == BODY.names
    placed.mark("cam01", "hand.L", (0.1, -0.1))
    assert placed.fitted.misfit < 0.01
