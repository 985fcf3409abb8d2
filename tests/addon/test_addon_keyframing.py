"""Key poses from a detector's keypoints and from landmarks, in Blender."""

from __future__ import annotations

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from keypoint_shots import cameras, seen_places, write_openpose  # noqa: E402
from kfmocap.core.body import landmark_positions  # noqa: E402
from kfmocap.core.errors import ShotError  # noqa: E402
from kfmocap.core.formats import write_trc  # noqa: E402
from kfmocap.kfmocap_addon.editing import keyframing  # noqa: E402
from kfmocap.kfmocap_addon.scene_io import joint_marks  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.body import shown_pose  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.key_pictures import KeyPictures  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.keys import key_pose_curves, motion_curves  # noqa: E402
from kfmocap.kfmocap_addon.session import SESSION  # noqa: E402
from test_addon_posing import BENT, BODY, LIMBS, WALK, error, keyed, walk_scene  # noqa: E402

pytest_plugins = ("addon_fixtures",)

pytestmark = pytest.mark.blender


def write_keypoints(folder, views: int = 2):
    """A detector's files, a folder for each camera, of the pictures that bent lenses make."""
    from dataclasses import replace

    for camera in cameras(views):
        bent = replace(camera, distortions=np.array(BENT))
        write_openpose(folder / f"{camera.name}_json", bent, [seen_places(BODY, WALK)], noise=0.5)


def keypoint_scene(folder, keys=(0, 29)):
    slot = walk_scene(folder, keys)
    write_keypoints(folder)
    for camera in ("cam01", "cam02"):
        files = [{"name": f"{camera}_000000.json"}]
        assert bpy.ops.kfmocap.import_keypoints(directory=str(folder / f"{camera}_json"), files=files) == {"FINISHED"}
    return slot


def ask(choice: str, **values) -> None:
    wanted = bpy.context.scene.kfmocap.key_frames
    wanted.choice = choice
    for name, value in values.items():
        setattr(wanted, name, value)


def test_keypoints_are_given_to_the_view_with_their_name(blender, tmp_path):
    walk_scene(tmp_path)
    write_keypoints(tmp_path)
    with pytest.raises(RuntimeError, match="No view has 2D keypoints yet"):
        bpy.ops.kfmocap.pose_from_keypoints()
    bpy.ops.kfmocap.import_keypoints(filepath=str(tmp_path / "cam02_json" / "cam02_000003.json"))
    assert [view.keypoints for view in bpy.context.scene.kfmocap.views] == ["", "cam02_json"]


def test_a_file_without_keypoints_changes_nothing(blender, tmp_path):
    walk_scene(tmp_path)
    (tmp_path / "cam01.json").write_text("[1, 2]")
    with pytest.raises(RuntimeError, match=r"cam01\.json: "):
        bpy.ops.kfmocap.import_keypoints(filepath=str(tmp_path / "cam01.json"))
    assert not bpy.context.scene.kfmocap.views[0].keypoints


def test_key_poses_are_made_on_the_frames_asked_for(blender, tmp_path):
    slot = keypoint_scene(tmp_path)
    ask("LISTED", listed="11, 16-17")
    assert bpy.ops.kfmocap.pose_from_keypoints() == {"FINISHED"}
    assert keyed(slot) == dict.fromkeys([0, 10, 15, 16, 29], True)
    for frame in (10, 15, 16):
        bpy.context.scene.frame_set(1 + frame)
        assert error(slot, WALK[[frame]]) < 0.02


def test_keys_of_the_animators_stay_unless_they_are_to_be_replaced(blender, tmp_path):
    slot = keypoint_scene(tmp_path)
    bpy.context.scene.frame_set(13)
    bpy.ops.kfmocap.set_key_pose()
    wrong = shown_pose.shown_values(slot.armature)
    ask("CURRENT")
    bpy.ops.kfmocap.pose_from_keypoints()
    bpy.context.scene.frame_set(13)
    assert shown_pose.shown_values(slot.armature) == pytest.approx(wrong, abs=1e-6)
    ask("CURRENT", replace=True)
    # What is to be replaced must not hold the fit.
    bpy.ops.kfmocap.pose_from_keypoints()
    bpy.context.scene.frame_set(13)
    assert error(slot, WALK[[12]]) < 0.02


def test_proposals_and_a_first_pass_without_any_key_pose(blender, tmp_path):
    slot = keypoint_scene(tmp_path, keys=())
    ask("AUTO")
    assert bpy.ops.kfmocap.pose_from_keypoints() == {"FINISHED"}
    own, proposed = key_pose_curves.keyed_bones(slot.armature)
    assert not own and len(proposed) == 2
    for frame in (3, 12, 25):
        bpy.context.scene.frame_set(1 + frame)
        assert error(slot, WALK[[frame]]) < 0.03
    assert bpy.ops.kfmocap.show_key_pictures() == {"FINISHED"}
    pictures = SESSION.of(KeyPictures)
    assert sorted(pictures.icons(slot.armature)) == proposed
    pictures.clear()  # as when the add-on is disabled
    assert pictures.icons(slot.armature) == {}
    assert bpy.ops.kfmocap.show_key_pictures() == {"FINISHED"}
    assert sorted(pictures.icons(slot.armature)) == proposed
    before = motion_curves.read_motion(slot.armature, 1, 30)
    assert bpy.ops.kfmocap.refuse_proposal(frame=proposed[0]) == {"FINISHED"}
    assert key_pose_curves.keyed_bones(slot.armature) == ({}, proposed[1:])
    assert np.array_equal(motion_curves.read_motion(slot.armature, 1, 30).rotations, before.rotations)
    assert bpy.ops.kfmocap.refuse_proposal(frame=proposed[0]) == {"CANCELLED"}
    bpy.ops.kfmocap.accept_proposals(every=True)
    assert list(keyed(slot)) == [proposed[1] - 1]


def test_keypoints_become_marks_that_place_joints_poses(blender, tmp_path):
    slot = keypoint_scene(tmp_path)
    bpy.context.scene.frame_set(13)
    assert bpy.ops.kfmocap.mark_keypoints() == {"FINISHED"}
    found = joint_marks.on_frame(slot, 13)
    truth = landmark_positions(BODY, WALK[[12]], LIMBS)[0]
    for camera in cameras(2):
        seen = [found[camera.name, name] for name in LIMBS]
        assert np.abs(camera.project(truth) - seen).max() < 3  # the undistorted picture's
    assert bpy.ops.kfmocap.place_joints() == {"FINISHED"}
    assert error(slot, WALK[[12]]) < 0.02


def test_marks_lie_on_the_keypoints_of_a_picture_that_is_zoomed(blender, tmp_path):
    slot = keypoint_scene(tmp_path)
    lens = bpy.context.scene.kfmocap.views["cam01"].camera.data
    for frame, zoom in ((1, 1.0), (30, 1.5)):
        lens.lens *= zoom
        lens.keyframe_insert("lens", frame=frame)
    bpy.context.scene.frame_set(20)
    assert bpy.ops.kfmocap.mark_keypoints() == {"FINISHED"}
    found = joint_marks.on_frame(slot, 20)
    places = cameras(1)[0].project(landmark_positions(BODY, WALK[[19]], LIMBS)[0])
    assert np.abs(places - [found["cam01", name] for name in LIMBS]).max() < 3


def landmark_file(folder, step: int = 1, fps: float = 30.0):
    names = [name for name in BODY.landmarks if "Hand" not in name]
    points = landmark_positions(BODY, WALK, names)
    path = folder / "walk.trc"
    write_trc(path, [f"Anna:{name}" for name in names], np.repeat(points, step, axis=0), fps * step)
    return path


@pytest.mark.parametrize("step", [1, 2], ids=["the same rate", "twice the rate"])
def test_landmarks_become_key_poses_every_n_frames(blender, tmp_path, step: int):
    slot = walk_scene(tmp_path, keys=())
    ask("EVERY", step=12)
    path = landmark_file(tmp_path, step)
    assert bpy.ops.kfmocap.pose_from_landmarks(filepath=str(path)) == {"FINISHED"}
    assert keyed(slot) == dict.fromkeys([0, 12, 24], True)
    bpy.context.scene.frame_set(13)
    assert error(slot, WALK[[12]]) < 0.005


def test_landmarks_choose_frames_beside_the_key_poses(blender, tmp_path):
    slot = walk_scene(tmp_path, keys=(0,))
    ask("AUTO")
    bpy.ops.kfmocap.pose_from_landmarks(filepath=str(landmark_file(tmp_path)))
    frames = list(keyed(slot))
    assert frames[0] == 0 and 1 <= len(frames) - 1 <= 2 and min(np.diff(frames)) > 9


def test_frames_without_landmarks_are_named(blender, tmp_path):
    slot = walk_scene(tmp_path)
    ask("LISTED", listed="3, 20")
    with pytest.raises(RuntimeError, match="no row for frame 20"):
        bpy.ops.kfmocap.pose_from_landmarks(filepath=str(landmark_file(tmp_path)), first_row=15)
    assert keyed(slot) == {0: True, 29: True}


@pytest.mark.parametrize("text", ["", "1, two", "99", "0"])
def test_invalid_lists_are_reported(blender, tmp_path, text: str):
    walk_scene(tmp_path)
    ask("LISTED", listed=text)
    with pytest.raises(ShotError, match="Frames: "):
        keyframing.frames_wanted(bpy.context.scene)


def test_lists_of_frames_have_ranges():
    assert keyframing.frames_listed("1, 20,40-42 , ") == [1, 20, 40, 41, 42]


def test_dropped_keypoints_and_landmarks_are_taken(blender, tmp_path):
    slot = walk_scene(tmp_path, keys=(0,))
    write_keypoints(tmp_path)
    assert bpy.ops.kfmocap.open_file(filepath=str(tmp_path / "cam01_json" / "cam01_000000.json")) == {"FINISHED"}
    assert bpy.context.scene.kfmocap.views[0].keypoints == "cam01_json"
    ask("LISTED", listed="20")
    assert bpy.ops.kfmocap.open_file(filepath=str(landmark_file(tmp_path))) == {"FINISHED"}
    assert keyed(slot) == {0: True, 19: True}
