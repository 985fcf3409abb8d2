"""Tracked keys come and go; the animator's keys stay, and are the key poses."""

from __future__ import annotations

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings

bpy = pytest.importorskip("bpy")

from addon_shots import joint_error, motion, person  # noqa: E402
from kfmocap.core.errors import BodyError, ShotError  # noqa: E402
from kfmocap.core.shot.shot import KeyPoses  # noqa: E402
from kfmocap.kfmocap_addon.scene_io import fcurves  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.body import body_armature, body_channels  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.keys import key_pose_curves, motion_curves  # noqa: E402

pytest_plugins = ("addon_fixtures",)

pytestmark = pytest.mark.blender

FRAMES, START = 12, 3
KEYS = [0, 5, 11]
GENERATED, KEYFRAME, BREAKDOWN = 5, 0, 2


def build(key_frames=KEYS, fixed=None):
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    armature = body_armature.build_armature(person(), "man", bpy.context.scene.collection)
    if key_frames:
        poses = motion(FRAMES)[key_frames]
        keys = KeyPoses.whole(key_frames, poses)
        if fixed is not None:
            keys = KeyPoses(keys.frames, poses, fixed)
        key_pose_curves.write_key_poses(armature, keys, START)
    return armature


def all_curves(armature):
    bag = fcurves.find_channelbag(armature)
    return {(curve.data_path, curve.array_index): curve for curve in bag.fcurves}


def key_at(curve, frame):
    return next(key for key in curve.keyframe_points if round(key.co.x) == frame)


def test_key_poses_are_keyframes_and_tracked_frames_are_generated():
    armature = build()
    motion_curves.write_motion(armature, motion(FRAMES), START)
    assert len(all_curves(armature)) == 3 + 4 * len(person())
    for curve in all_curves(armature).values():
        keys = fcurves.get_keys(curve)
        assert np.array_equal(keys["co"][:, 0], START + np.arange(FRAMES))
        assert np.flatnonzero(keys["type"] == KEYFRAME).tolist() == KEYS
        assert (np.delete(keys["type"], KEYS) == GENERATED).all()


def test_the_evaluated_motion_is_the_tracked_one():
    armature = build()
    truth = motion(FRAMES)
    motion_curves.write_motion(armature, truth, START)
    assert joint_error(armature, person(), truth, first=START) < 0.05


def test_key_poses_come_back_as_they_were_set():
    armature = build()
    for _ in range(2):  # before and after tracking
        read = key_pose_curves.read_key_poses(armature, START, FRAMES)
        assert read.frames.tolist() == KEYS and read.fixed.all()
        assert np.abs(read.poses.difference(motion(FRAMES)[KEYS])).max() < 1e-5
        motion_curves.write_motion(armature, motion(FRAMES), START)


def test_tracking_again_replaces_tracked_keys_alone():
    armature = build()
    motion_curves.write_motion(armature, motion(FRAMES, seed=0), START)
    before = {k: fcurves.get_keys(c)[KEYS] for k, c in all_curves(armature).items()}
    second = motion(FRAMES, seed=0).replaced(1, motion(4, seed=7)).replaced(6, motion(5, seed=8))
    motion_curves.write_motion(armature, second, START)
    for k, c in all_curves(armature).items():
        for field in ("co", "type", "interpolation", "handle_left_type", "handle_right_type"):
            assert np.array_equal(fcurves.get_keys(c)[KEYS][field], before[k][field])
    assert joint_error(armature, person(), second, first=START) < 0.05
    assert key_pose_curves.read_key_poses(armature, START, FRAMES).frames.tolist() == KEYS


def test_key_poses_of_the_trackers_type_are_the_animators_as_blender_lets_them_choose_it():
    armature = build()
    for curve in all_curves(armature).values():
        for key in curve.keyframe_points:
            key.type = "GENERATED"
    before = {k: fcurves.get_keys(c)["co"] for k, c in all_curves(armature).items()}
    for _ in range(2):  # before and after tracking
        assert key_pose_curves.read_key_poses(armature, START, FRAMES).frames.tolist() == KEYS
        motion_curves.write_motion(armature, motion(FRAMES, seed=7), START)
        for k, c in all_curves(armature).items():
            assert np.array_equal(fcurves.get_keys(c)["co"][KEYS], before[k])


def test_proposals_are_breakdowns_and_hold_nothing():
    armature = build(key_frames=[])
    motion_curves.write_motion(armature, motion(FRAMES), START, START + np.array([2, 7]))
    for curve in all_curves(armature).values():
        assert np.flatnonzero(fcurves.get_keys(curve)["type"] == BREAKDOWN).tolist() == [2, 7]
    read = key_pose_curves.read_key_poses(armature, START, FRAMES)
    assert read.frames.tolist() == read.proposals().tolist() == [2, 7]
    assert np.abs(read.poses.difference(motion(FRAMES)[[2, 7]])).max() < 1e-5


def test_tracking_again_moves_proposals_and_they_stay_proposals():
    armature = build(key_frames=[])
    motion_curves.write_motion(armature, motion(FRAMES), START, START + np.array([2, 7]))
    motion_curves.write_motion(armature, motion(FRAMES, seed=7), START)
    read = key_pose_curves.read_key_poses(armature, START, FRAMES)
    assert read.proposals().tolist() == [2, 7]
    assert np.abs(read.poses.difference(motion(FRAMES, seed=7)[[2, 7]])).max() < 1e-5


def test_a_key_pose_set_over_a_proposal_is_the_animators():
    armature = build(key_frames=[])
    motion_curves.write_motion(armature, motion(FRAMES), START, START + np.array([2, 7]))
    bpy.context.scene.frame_set(START + 7)
    key_pose_curves.key_current_pose(armature, START + 7)
    read = key_pose_curves.read_key_poses(armature, START, FRAMES)
    assert read.full().tolist() == [7] and read.proposals().tolist() == [2]
    edited = all_curves(armature)['pose.bones["forearm.L"].rotation_quaternion', 1]
    key_at(edited, START + 2).co.y += 0.2  # dragged: Blender keeps the key's type
    edited.update()
    read = key_pose_curves.read_key_poses(armature, START, FRAMES)
    assert read.frames.tolist() == [2, 7] and read.fixed[0].sum() == 3


edits = st.lists(
    st.tuples(
        st.integers(0, 66),  # channel
        st.integers(START - 2, START + FRAMES + 1),  # frame
        st.floats(-1, 1, width=32),
        st.sampled_from(["KEYFRAME", "EXTREME", "BREAKDOWN", "JITTER", "MOVING_HOLD", "GENERATED"]),
        st.sampled_from(["CONSTANT", "LINEAR", "BEZIER", "BOUNCE", "ELASTIC"]),
        st.sampled_from(["FREE", "ALIGNED"]),
    ),
    max_size=8,
)


@settings(max_examples=settings.default.max_examples // 4)
@given(edits)
def test_whatever_the_animator_keys_is_kept_bit_for_bit(changes):
    armature = build()
    motion_curves.write_motion(armature, motion(FRAMES), START)
    channels = body_channels.list_channels(armature)
    bag = fcurves.find_channelbag(armature)
    armature.pose.bones["hand.L"]["strength"] = 0.5
    armature.pose.bones["hand.L"].keyframe_insert('["strength"]', frame=4)
    armature.pose.bones["spine"].keyframe_insert("scale", frame=6)
    touched = {}
    for c, frame, value, kind, interpolation, handle in changes:
        curve = bag.fcurves.find(channels[c].path, index=channels[c].index)
        old = next((k for k in curve.keyframe_points if round(k.co.x) == frame), None)
        if old is not None and old.co.y == np.float32(value):
            continue
        # Inserting over a tracked key keeps its type GENERATED, as the application does it.
        key = curve.keyframe_points.insert(frame, value)
        if old is None and kind == "GENERATED":
            kind = "KEYFRAME"
        key.type, key.interpolation, key.easing = kind, interpolation, "EASE_OUT"
        key.back, key.amplitude, key.period = 1.25, 0.75, 3.5
        key.handle_left_type = key.handle_right_type = handle
        key.handle_left, key.handle_right = (frame - 0.25, value - 0.125), (frame + 0.25, value + 0.125)
        curve.update()
        touched[channels[c].path, channels[c].index, frame] = None
    for path, index, frame in touched:
        keys = fcurves.get_keys(bag.fcurves.find(path, index=index))
        touched[path, index, frame] = keys[np.rint(keys["co"][:, 0]) == frame].tobytes()
    others = {
        (f.data_path, f.array_index): fcurves.get_keys(f).tobytes()
        for f in bag.fcurves
        if "strength" in f.data_path or "scale" in f.data_path
    }

    motion_curves.write_motion(armature, motion(FRAMES, seed=3), START)
    motion_curves.write_motion(armature, motion(FRAMES, seed=4), START)

    for (path, index, frame), stored in touched.items():
        keys = fcurves.get_keys(bag.fcurves.find(path, index=index))
        assert keys[np.rint(keys["co"][:, 0]) == frame].tobytes() == stored
    for (path, index), stored in others.items():
        assert fcurves.get_keys(bag.fcurves.find(path, index=index)).tobytes() == stored
    assert armature.pose.bones["hand.L"]["strength"] == 0.5
    expected = {f for _, _, f in touched if START <= f < START + FRAMES}
    read = key_pose_curves.read_key_poses(armature, START, FRAMES)
    assert set(read.frames + START) == expected | {START + k for k in KEYS}


def test_an_edited_tracked_key_is_a_key_pose_though_blender_calls_it_generated():
    armature = build()
    motion_curves.write_motion(armature, motion(FRAMES), START)
    hand = armature.pose.bones["hand.L"]
    hand.rotation_quaternion = (0.6, 0.0, 0.8, 0.0)
    hand.keyframe_insert("rotation_quaternion", frame=START + 8)
    curve = all_curves(armature)[f'pose.bones["{hand.name}"].rotation_quaternion', 0]
    assert key_at(curve, START + 8).type == "GENERATED"
    read = key_pose_curves.read_key_poses(armature, START, FRAMES)
    assert read.frames.tolist() == [0, 5, 8, 11]
    part = person().index("hand.L")
    assert np.flatnonzero(read.fixed[2]).tolist() == list(range(3 + 3 * part, 6 + 3 * part))
    motion_curves.write_motion(armature, motion(FRAMES, seed=2), START)
    assert key_at(curve, START + 8).co.y == pytest.approx(0.6)


def test_the_record_survives_saving(tmp_path):
    armature = build()
    motion_curves.write_motion(armature, motion(FRAMES), START)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "shot.blend"))
    armature = bpy.data.objects["man"]
    assert key_pose_curves.read_key_poses(armature, START, FRAMES).frames.tolist() == KEYS
    key_at(all_curves(armature)['pose.bones["spine"].rotation_quaternion', 1], START + 2).co.y += 0.01
    assert key_pose_curves.read_key_poses(armature, START, FRAMES).frames.tolist() == [0, 2, 5, 11]


def test_a_partial_key_pose_fixes_only_what_is_keyed():
    armature = build(key_frames=[])
    arm, root = armature.pose.bones["upper_arm.R"], armature.pose.bones["pelvis"]
    arm.rotation_quaternion = (0.8, 0.6, 0, 0)
    arm.keyframe_insert("rotation_quaternion", index=1, frame=START + 4)
    root.location = (1, 2, 3)
    root.keyframe_insert("location", index=1, frame=START + 7)  # the pelvis' y points up
    arm.keyframe_insert("location", frame=START + 9)  # moves no part of the body
    read = key_pose_curves.read_key_poses(armature, START, FRAMES)
    part = person().index("upper_arm.R")
    assert read.frames.tolist() == [4, 7]
    assert np.flatnonzero(read.fixed[0]).tolist() == list(range(3 + 3 * part, 6 + 3 * part))
    assert np.flatnonzero(read.fixed[1]).tolist() == [2]
    rest = person().parts[0].head_world
    assert read.poses.translations[1] - rest == pytest.approx([1, -3, 2], abs=1e-6)


@pytest.mark.parametrize("axes", [[0], [1, 2], [0, 1, 2]])
def test_partial_key_poses_are_written_and_read_alike(axes):
    fixed = np.zeros((3, person().dof), bool)
    fixed[0, axes] = True
    fixed[1, 12:15] = fixed[2, 30:33] = True
    armature = build(fixed=fixed)
    read = key_pose_curves.read_key_poses(armature, START, FRAMES)
    assert np.array_equal(read.fixed, fixed)


def test_quaternions_do_not_flip_between_tracked_frames_and_keys():
    """Where the animator's quaternion is -q, its neighbours follow; a flip that stays is held."""
    armature = build()
    bag = fcurves.find_channelbag(armature)
    for index in range(4):
        curve = bag.fcurves.find('pose.bones["chest"].rotation_quaternion', index=index)
        key_at(curve, START + 5).co.y *= -1
        curve.update()
    truth = motion(FRAMES)
    motion_curves.write_motion(armature, truth, START)
    assert joint_error(armature, person(), truth, first=START) < 0.05
    q = np.array(
        [
            [bag.fcurves.find('pose.bones["chest"].rotation_quaternion', index=k).evaluate(t) for k in range(4)]
            for t in np.arange(START, START + FRAMES - 1, 0.25)
        ]
    )
    assert (np.linalg.norm(q, axis=1) > 0.9).all()


def test_keys_outside_the_tracked_frames_stay():
    armature = build()
    motion_curves.write_motion(armature, motion(FRAMES), START)
    before = {k: fcurves.get_keys(c)["co"][8:] for k, c in all_curves(armature).items()}
    motion_curves.write_motion(armature, motion(4, seed=5), START + 1)
    for k, c in all_curves(armature).items():
        assert np.array_equal(fcurves.get_keys(c)["co"][8:], before[k])
    assert key_pose_curves.read_key_poses(armature, START, FRAMES).frames.tolist() == KEYS


def test_what_cannot_be_a_key_pose_is_named():
    armature = build()
    key_at(all_curves(armature)['pose.bones["head"].rotation_quaternion', 0], START + 5).co.x += 0.5
    with pytest.raises(ShotError, match=r"bone head.*between frames"):
        key_pose_curves.read_key_poses(armature, START, FRAMES)
    armature.pose.bones["head"].rotation_mode = "XYZ"
    with pytest.raises(BodyError, match=r"bone head.*Quaternion"):
        key_pose_curves.read_key_poses(armature, START, FRAMES)


def test_a_motion_of_another_body_is_refused():
    with pytest.raises(BodyError, match="armature man"):
        motion_curves.write_motion(build(), motion(FRAMES, parts=3), START)


@given(st.lists(st.integers(-40, 40)), st.lists(st.integers(-40, 40) | st.integers(-(10**6), 10**6)))
def test_frames_are_found_among_others(numbers, frames):
    found = fcurves.are_among(np.array(numbers, np.int64), frames)
    assert found.tolist() == [number in frames for number in numbers]


@pytest.mark.parametrize("field", fcurves.KEY_TYPE.names)
@pytest.mark.parametrize("handles", ["AUTO_CLAMPED", "FREE"])
def test_keys_that_differ_in_anything_are_written_though_those_before_are_known(field, handles):
    """A curve that has the same keys already is left alone; handles that Blender places are not compared."""
    build()
    curve = bpy.data.actions[0].layers[0].strips[0].channelbags[0].fcurves[0]
    keys = fcurves.get_keys(curve)
    for side in ("handle_left_type", "handle_right_type"):
        keys[side] = fcurves.enum_value(side, handles)
    fcurves.set_keys(curve, [keys])
    before = fcurves.get_keys(curve)

    changed = before.copy()
    changed[field][1] = ~changed[field][1] if changed[field].dtype == bool else changed[field][1] + 1
    fcurves.set_keys(curve, [changed], before=before)
    known = fcurves.get_keys(curve)
    fcurves.set_keys(curve, [changed])
    assert np.array_equal(known, fcurves.get_keys(curve))

    placed_by_blender = handles == "AUTO_CLAMPED" and field in ("handle_left", "handle_right")
    assert np.array_equal(known, before) == placed_by_blender
    curve.keyframe_points[2].co.y += 0.5
    now = fcurves.get_keys(curve)
    fcurves.set_keys(curve, [changed], before=changed)
    assert np.array_equal(fcurves.get_keys(curve), now), "nothing is written"
