"""Bake and Simplify: tracked keys become ordinary ones, or fewer, within a tolerance that holds on every frame."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from addon_shots import person, shot  # noqa: E402
from kfmocap.core.body.motion import Motion  # noqa: E402
from kfmocap.core.numerics import rotations  # noqa: E402
from kfmocap.core.shot.shot import KeyPoses, Shot  # noqa: E402
from kfmocap.kfmocap_addon.editing import simplification  # noqa: E402
from kfmocap.kfmocap_addon.scene_io import fcurves, scene  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.body import body_channels  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.keys import key_ownership, key_pose_curves, motion_curves  # noqa: E402

pytest_plugins = ("addon_fixtures",)

pytestmark = pytest.mark.blender

FRAMES, START = 60, 1
BODY = person(1.7)


def smooth_motion(noise: float = 0.0) -> Motion:
    rng = np.random.default_rng(1)
    time = np.linspace(0, 2 * np.pi, FRAMES)[:, None]
    path = np.array([0.5, 0.2, 0.03]) * np.concatenate([time, np.sin(time), np.cos(3 * time)], axis=1) + [0, 0, 1]
    turns = 0.6 * np.sin(time[:, None] * rng.uniform(0.5, 1.5, (1, len(BODY), 1)) + rng.normal(size=(1, len(BODY), 3)))
    return Motion(path + rng.normal(0, noise, path.shape), rotations.exp(turns + rng.normal(0, noise, turns.shape)))


def smooth_shot(folder: Path) -> Shot:
    """With key poses that the motion passes through."""
    original = shot(folder, frames=FRAMES)
    keys = KeyPoses.whole([0, 25, FRAMES - 1], smooth_motion()[[0, 25, FRAMES - 1]])
    return replace(original, performers=(replace(original.performers[0], key_poses=keys),))


@pytest.fixture
def armature(blender, tmp_path):
    built = scene.build_scene(smooth_shot(tmp_path), [smooth_motion(0.0005)], bpy.context.scene)
    return built.kfmocap.performers[0].armature


def read(armature) -> Motion:
    return motion_curves.read_motion(armature, START, FRAMES)


def apart(a: Motion, b: Motion) -> tuple[float, float]:
    """Largest angle in radians of any bone, and distance in metres of the root, on any frame."""
    difference = a.difference(b)
    turns = np.linalg.norm(difference[:, 3:].reshape(len(a), -1, 3), axis=-1)
    return float(turns.max()), float(np.linalg.norm(difference[:, :3], axis=-1).max())


def keys_of(armature) -> dict:
    bag, channels = fcurves.find_channelbag(armature), body_channels.list_channels(armature)
    return {c.key: fcurves.get_keys(bag.fcurves.find(c.path, index=c.index)) for c in channels}


def animators(armature) -> dict:
    channels = body_channels.list_channels(armature)
    rows = key_ownership.channel_keys(armature, channels)
    return {
        channels[c].key: [keys[own][f].tolist() for f in ("co", "type", "interpolation")] for c, _, keys, own in rows
    }


@pytest.mark.parametrize(("degrees", "millimetres"), [(0.2, 1.0), (1.0, 5.0), (5.0, 30.0)])
def test_no_frame_strays_farther_than_the_tolerance(armature, degrees, millimetres):
    before = read(armature)
    had, left = simplification.simplify(armature, np.radians(degrees), millimetres / 1000)
    angle, distance = apart(before, read(armature))
    assert 0 < angle <= np.radians(degrees) * 1.001 + 1e-6
    assert 0 < distance <= millimetres / 1000 * 1.001
    assert left < had


def test_a_larger_tolerance_leaves_fewer_keys(blender, tmp_path):
    left = []
    for degrees, millimetres in [(0.3, 0.5), (1, 2), (3, 10)]:
        built = scene.build_scene(smooth_shot(tmp_path), [smooth_motion()])
        thinned = built.kfmocap.performers[0].armature
        left.append(simplification.simplify(thinned, np.radians(degrees), millimetres / 1000)[1])
    assert left[0] > left[1] > left[2]
    assert left[1] < FRAMES * (3 + 4 * len(BODY)) / 3


def test_with_no_tolerance_the_motion_stays(armature):
    before = read(armature)
    simplification.simplify(armature, 0.0, 0.0)
    angle, distance = apart(before, read(armature))
    assert angle < 1e-6 and distance < 1e-7


def test_the_animators_keys_stay_as_they_are(armature):
    bone = armature.pose.bones["hand.L"]
    bone.rotation_quaternion = (0.5, 0.5, 0.5, 0.5)
    key_pose_curves.key_current_pose(armature, START + 30, {"hand.L"})
    before, poses = animators(armature), key_pose_curves.read_key_poses(armature, START, FRAMES)
    simplification.simplify(armature, np.radians(2), 0.01)
    assert animators(armature) == before
    after = key_pose_curves.read_key_poses(armature, START, FRAMES)
    np.testing.assert_array_equal(after.frames, poses.frames)
    np.testing.assert_array_equal(after.fixed, poses.fixed)
    held = poses.fixed[:, 3:].reshape(len(poses.frames), -1, 3).all(axis=2)
    np.testing.assert_allclose(after.poses.rotations[held], poses.poses.rotations[held], atol=1e-6)


def test_kept_keys_are_still_the_trackers_and_tracking_replaces_them(armature):
    simplification.simplify(armature, np.radians(2), 0.01)
    assert key_pose_curves.read_key_poses(armature, START, FRAMES).frames.tolist() == [0, 25, FRAMES - 1]
    motion_curves.write_motion(armature, smooth_motion(), START)
    angle, distance = apart(smooth_motion()[[20]], read(armature)[[20]])
    assert angle < 1e-5 and distance < 1e-6


def test_simplifying_some_bones_leaves_the_keys_of_others(armature):
    before = {name: keys.tobytes() for name, keys in keys_of(armature).items()}
    simplification.simplify(armature, np.radians(2), 0.01, {"hand.L"})
    changed = {name for name, keys in keys_of(armature).items() if keys.tobytes() != before[name]}
    assert changed and all("hand.L" in name for name in changed)


def test_baked_keys_are_the_animators_and_have_the_same_values(armature):
    before, motion = keys_of(armature), read(armature)
    assert motion_curves.bake(armature) == FRAMES - 3
    after = keys_of(armature)
    assert all((keys["type"] == fcurves.enum_value("type", "KEYFRAME")).all() for keys in after.values())
    assert all((after[name]["co"] == keys["co"]).all() for name, keys in before.items())
    assert key_pose_curves.read_key_poses(armature, START, FRAMES).frames.tolist() == list(range(FRAMES))
    motion_curves.write_motion(armature, smooth_motion(), START)
    assert apart(motion, read(armature)) < (1e-5, 1e-6)
    assert motion_curves.bake(armature) == 0


def test_some_bones_are_baked_alone(armature):
    motion_curves.bake(armature, {"hand.L"})
    fixed = key_pose_curves.read_key_poses(armature, START, FRAMES).fixed
    hand = 3 + 3 * BODY.index("hand.L")
    assert fixed[:, hand].all() and not fixed[1, hand + 3]


def test_the_tools_say_what_is_left_or_missing(blender, tmp_path):
    built = scene.build_scene(smooth_shot(tmp_path), scene=bpy.context.scene)
    for tool in (bpy.ops.kfmocap.bake, bpy.ops.kfmocap.simplify):
        with pytest.raises(RuntimeError, match="Nothing is tracked yet"):
            tool()
    scene.write_motions(built, [smooth_motion()])
    assert bpy.ops.kfmocap.simplify(angle=np.radians(1), distance=2) == {"FINISHED"}
    assert bpy.ops.kfmocap.bake() == {"FINISHED"}
    assert bpy.ops.kfmocap.bake() == {"CANCELLED"} and bpy.ops.kfmocap.simplify() == {"CANCELLED"}


def test_undo_takes_both_back(blender, tmp_path):
    scene.build_scene(smooth_shot(tmp_path), [smooth_motion()], bpy.context.scene)
    name = bpy.context.scene.kfmocap.performers[0].armature.name
    before = {key: keys.tobytes() for key, keys in keys_of(bpy.data.objects[name]).items()}
    for tool in (bpy.ops.kfmocap.simplify, bpy.ops.kfmocap.bake):
        bpy.ops.ed.undo_push(message="before")
        assert tool() == {"FINISHED"}
        bpy.ops.ed.undo_push(message="after")
        assert {key: keys.tobytes() for key, keys in keys_of(bpy.data.objects[name]).items()} != before
        bpy.ops.ed.undo()
        assert {key: keys.tobytes() for key, keys in keys_of(bpy.data.objects[name]).items()} == before
