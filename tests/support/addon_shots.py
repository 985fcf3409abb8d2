"""Shots for the tests of the add-on."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import addon_utils
import bpy
import cv2
import numpy as np
from kfmocap.core.body import Body, human, part_poses
from kfmocap.core.body.motion import Motion
from kfmocap.core.cameras.camera import Camera
from kfmocap.core.keypoints.observations import ShotKeypoints
from kfmocap.core.numerics import rotations
from kfmocap.core.shot.shot import KeyPoses, Performer, Shot, View
from kfmocap.core.tracking.expected_errors.uncertainty import JointErrors
from kfmocap.kfmocap_addon.scene_io import fcurves

SIZE = (320, 240)
FIRST, FRAMES = 5, 12
"""First frame of the shot in its footage's count, and its length."""
PARTS = len(human(solid=False))
LENS = (0.1, -0.05, 0.002, -0.003, 0.01)


def video(path: Path, frames: int = 30, size: tuple[int, int] = SIZE, fps: float = 25.0) -> Path:
    """A small video whose frame i is grey of level 8 i."""
    path.write_bytes(_encoded(frames, size, fps))
    return path


@cache
def _encoded(frames: int, size: tuple[int, int], fps: float) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "grey.mp4")
        writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"mp4v"), fps, size)
        for i in range(frames):
            writer.write(np.full((size[1], size[0], 3), 8 * i % 256, np.uint8))
        writer.release()
        return path.read_bytes()


def camera(seed: int, poses: int = 1, distortions: tuple[float, ...] = LENS, fisheye: bool = False) -> Camera:
    """A camera some 5 m from the origin that sees it; its pixels are not square."""
    rng = np.random.default_rng(seed)
    turn = rotations.exp(np.array([np.pi / 2, 0.0, 0.0]) + rng.normal(0, 0.2, (poses, 3)))
    matrix = [[410.3, 0, 155.2], [0, 402.1 + 10 * seed, 125.7], [0, 0, 1]]
    place = np.array([0, 0, 5.0]) + rng.normal(0, 0.3, (poses, 3))
    return Camera.create(f"cam{seed:02d}", SIZE, matrix, turn, place, distortions=distortions, fisheye=fisheye)


def motion(frames: int, seed: int = 0, parts: int = PARTS) -> Motion:
    """A wild motion with big rotations, several metres long, around 5 m from the origin."""
    rng = np.random.default_rng(seed)
    path = np.cumsum(rng.normal(0, 0.3, (frames, 3)), axis=0) + [4.0, 3.0, 1.0]
    return Motion(path, rotations.exp(np.cumsum(rng.normal(0, 0.4, (frames, parts, 3)), axis=0)))


@cache
def person(height: float = 1.75) -> Body:
    """A person who is made once: computing the hulls of the parts takes a good part of building an armature."""
    return human(height)


def shot(folder: Path, performers: tuple[str, ...] = ("man",), fps: float = 60.0, frames: int = FRAMES) -> Shot:
    """A fixed and a moving camera, key poses at the first, sixth and last frame."""
    length = max(30, FIRST + frames + 3)
    views = (
        View(camera(1), video(folder / "cam01.mp4", length), 2.0, keypoints=folder / "pose" / "cam01_json"),
        View(camera(2, frames), video(folder / "cam02.mp4", length)),
    )
    people = []
    for seed, name in enumerate(performers):
        keys = [0, 5, frames - 1]
        people.append(Performer(name, person(1.7 + 0.1 * seed), KeyPoses.whole(keys, motion(frames, seed)[keys])))
    return Shot("walk", fps, (FIRST, FIRST - 1 + frames), views, tuple(people))


def sights(given: Shot) -> tuple[np.ndarray, ...]:
    """What a tracker reports of a shot in which every camera sees everything."""
    return tuple(np.ones((len(given.views), given.length, len(p.body))) for p in given.performers)


def deviations(given: Shot, error: float = 0.01) -> tuple[np.ndarray, ...]:
    """How far off a tracker reports the parts of a shot to be, metres."""
    return tuple(np.full((given.length, len(p.body)), error) for p in given.performers)


def track_result(
    given: Shot,
    motions: Sequence[Motion],
    visible: tuple[np.ndarray, ...] | None = None,
    footage_offset: float = 0.0,
    unknown: tuple[tuple[str, ...], ...] | None = None,
) -> SimpleNamespace:
    """What of a tracker's result goes into a scene."""
    return SimpleNamespace(
        motions=tuple(motions),
        visible=sights(given) if visible is None else visible,
        deviation=deviations(given),
        errors=tuple(JointErrors(error, 1.5 * error, np.zeros_like(error)) for error in deviations(given)),
        seconds={"solve": 1.0},
        footage_offset=footage_offset,
        observed=ShotKeypoints(),
        torn=(),
        gaps=(),
        turns=(),
        late=(),
        planted=(),
        rates=(),
        patterns=(),
        pictures=(),
        damage=(),
        unknown=tuple(() for _ in given.performers) if unknown is None else unknown,
    )


def keys_of(armature: bpy.types.Object) -> dict[tuple[str, int], bytes]:
    """All keys of an object's F-curves."""
    return {
        (curve.data_path, curve.array_index): fcurves.get_keys(curve).tobytes()
        for curve in fcurves.find_channelbag(armature).fcurves
    }


def joint_error(armature: bpy.types.Object, body: Body, truth: Motion, first: float = 1, step: float = 1) -> float:
    """Largest distance in mm between joints as Blender evaluates them and as the core does.

    The truth's frame f is compared with scene frame first + step f.
    """
    scene, joints = bpy.context.scene, part_poses(body, truth)[1]
    worst = 0.0
    for f in range(len(truth)):
        whole, part = divmod(first + step * f, 1)
        scene.frame_set(int(whole), subframe=part)
        posed = armature.evaluated_get(bpy.context.evaluated_depsgraph_get())
        heads = [posed.matrix_world @ posed.pose.bones[name].head for name in body.names]
        worst = max(worst, np.linalg.norm(np.array(heads) - joints[f], axis=1).max())
    return 1000 * worst


def metarig() -> bpy.types.Object:
    """Rigify's human metarig, its left side turned by Euler angles and the rest by quaternions."""
    addon_utils.enable("rigify", default_set=True)
    bpy.ops.object.armature_human_metarig_add()
    bpy.ops.object.mode_set(mode="OBJECT")
    rig = bpy.context.object
    for bone in rig.pose.bones:
        bone.rotation_mode = "XYZ" if bone.name.endswith(".L") else "QUATERNION"
    return rig
