"""Posing in Blender: clicked joints, and poses made of other poses."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from addon_shots import video  # noqa: E402
from keypoint_shots import cameras, person, strolling  # noqa: E402
from kfmocap.core.body import landmark_positions  # noqa: E402
from kfmocap.core.body.motion import Motion  # noqa: E402
from kfmocap.core.shot.shot import KeyPoses, Performer, Shot, View  # noqa: E402
from kfmocap.kfmocap_addon.editing import click_posing  # noqa: E402
from kfmocap.kfmocap_addon.operators.posing.place_joints import PlacingTool  # noqa: E402
from kfmocap.kfmocap_addon.scene_io import joint_marks, scene  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.body import armature_landmarks, body_armature, shown_pose  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.keys import key_pose_curves, motion_curves  # noqa: E402
from kfmocap.kfmocap_addon.viewports import key_list  # noqa: E402
from user_keymaps import orbiting_with_alt  # noqa: E402

pytest_plugins = ("addon_fixtures",)

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
    bpy.context.view_layer.update()
    bpy.context.scene.frame_set(1)
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
    joint_marks.put(slot, frame, found)


def error(slot, truth: Motion) -> float:
    """Mean distance of the limbs' joints from where they should be, metres."""
    shown = landmark_positions(BODY, shown_pose.read_shown_pose(slot.armature), LIMBS)
    return float(np.linalg.norm(shown - landmark_positions(BODY, truth, LIMBS), axis=-1).mean())


def keyed(slot) -> dict[int, bool]:
    """Shot frames with a key pose, and whether it fixes the whole body."""
    found = key_pose_curves.read_key_poses(slot.armature, 1, 30)
    return {int(frame): bool(fixed.all()) for frame, fixed in zip(found.frames, found.fixed, strict=True)}


def test_marks_in_two_views_become_a_key_pose(blender, tmp_path):
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


def test_marks_of_other_frames_do_not_count(blender, tmp_path):
    slot = walk_scene(tmp_path)
    mark_joints(slot, 20, WALK[[19]], ("cam01",))
    bpy.context.scene.frame_set(13)
    with pytest.raises(RuntimeError, match="no joint is marked"):
        bpy.ops.kfmocap.place_joints()
    assert keyed(slot) == {0: True, 29: True}


def test_an_arm_alone_is_posed_and_keyed(blender, tmp_path):
    slot = walk_scene(tmp_path)
    bpy.context.scene.frame_set(13)
    before = shown_pose.read_shown_pose(slot.armature)
    placed = click_posing.Placing(bpy.context.scene, slot, {"upper_arm.L", "forearm.L"})
    placed.remember()
    placed.mark("cam01", "LWrist", (0.1, -0.1))
    placed.key()
    moved = before.difference(shown_pose.read_shown_pose(slot.armature))[0, 3:].reshape(-1, 3)
    parts = {BODY.names[i] for i in np.flatnonzero(np.abs(moved).max(axis=1) > 1e-5)}
    assert parts == {"upper_arm.L", "forearm.L"}
    assert keyed(slot) == {0: True, 12: False, 29: True}


def state(slot) -> list:
    return [shown_pose.shown_values(slot.armature), joint_marks.all_marks(slot)]


def test_what_is_cancelled_leaves_pose_and_marks_to_the_last_bit(blender, tmp_path):
    slot = walk_scene(tmp_path)
    mark_joints(slot, 7, WALK[[6]], ("cam02",))
    mark_joints(slot, 13, WALK[[12]], ("cam01",))
    bpy.context.scene.frame_set(13)
    before = state(slot)
    placed = click_posing.Placing(bpy.context.scene, slot)
    placed.mark("cam01", "LWrist", (0.1, -0.1))
    placed.mark("cam02", "Head", (0.0, -0.2))
    placed.unmark("cam01", "RWrist")
    placed.flip("cam01", "LWrist")
    assert state(slot) != before
    placed.restore()
    assert state(slot) == before


def test_undo_takes_back_one_mark_at_a_time(blender, tmp_path):
    slot = walk_scene(tmp_path)
    placed = click_posing.Placing(bpy.context.scene, slot)
    poses = []
    for name, place in (("LWrist", (0.1, -0.1)), ("RWrist", (-0.1, 0.0)), ("LAnkle", (0.0, 0.2))):
        placed.remember()
        placed.mark("cam01", name, place)
        poses.append(placed.pose)
    assert placed.undo() and [name for _, name in placed.marks] == ["LWrist", "RWrist"]
    assert np.abs(placed.pose.difference(poses[1])).max() < 1e-2
    assert placed.undo() and placed.undo() and not placed.undo()
    assert joint_marks.on_frame(slot, 1) == {}
    assert np.abs(placed.pose.difference(WALK[[0]])).max() < 1e-5


def test_the_marks_of_a_frame_are_cleared(blender, tmp_path):
    slot = walk_scene(tmp_path)
    with pytest.raises(RuntimeError, match="No joint is marked"):
        bpy.ops.kfmocap.clear_marks()
    for frame in (7, 13):
        mark_joints(slot, frame, WALK[[frame - 1]], ("cam01",))
    bpy.context.scene.frame_set(13)
    assert bpy.ops.kfmocap.clear_marks() == {"FINISHED"}
    assert not joint_marks.on_frame(slot, 13) and len(joint_marks.on_frame(slot, 7)) == len(LIMBS)


def test_marks_are_pixels_of_the_undistorted_footage(blender, tmp_path):
    slot = walk_scene(tmp_path)
    placed, camera = click_posing.Placing(bpy.context.scene, slot), cameras(1)[0]
    R, t = camera.pose(0)
    point = landmark_positions(BODY, WALK[[0]], ["LWrist"])[0, 0]
    x, y, z = R @ point + t
    placed.mark("cam01", "LWrist", (x / z, y / z))
    np.testing.assert_allclose(joint_marks.on_frame(slot, 1)["cam01", "LWrist"], camera.project(point), atol=1e-3)
    assert placed.place_of("cam01", "LWrist") == pytest.approx((x / z, y / z))
    assert placed.fitted.misfit < 1e-4
    edge = (camera.size[0] - 0.5 - camera.matrix[0, 2]) / camera.matrix[0, 0]
    assert placed.is_inside("cam01", (edge - 1e-4, 0.0)) and not placed.is_inside("cam01", (edge + 1e-4, 0.0))


def test_joints_are_asked_for_limb_by_limb_with_names_that_people_say():
    names = click_posing.landmarks_in_order(BODY)
    assert names[:3] == ["LShoulder", "LElbow", "LWrist"] and sorted(names) == sorted(BODY.landmarks)
    labels = {name: click_posing.landmark_label(name) for name in ("LBigToe", "Neck", "RHip")}
    assert labels == {"LBigToe": "Left Big Toe", "Neck": "Neck", "RHip": "Right Hip"}


def test_a_body_of_another_origin_is_posed_by_its_bones(blender, tmp_path):
    slot = walk_scene(tmp_path)
    for bone in slot.armature.data.bones:
        del bone[armature_landmarks.LANDMARKS]
    placed = click_posing.Placing(bpy.context.scene, slot)
    assert placed.landmarks == BODY.names
    placed.mark("cam01", "hand.L", (0.1, -0.1))
    assert placed.fitted.misfit < 0.01


def shown(slot) -> Motion:
    return shown_pose.read_shown_pose(slot.armature)


def test_a_tracked_pose_is_copied_to_another_frame(blender, tmp_path):
    slot = walk_scene(tmp_path, tracked=True)
    with pytest.raises(RuntimeError, match="Copy a pose first"):
        bpy.ops.kfmocap.paste_pose()
    bpy.context.scene.frame_set(8)
    assert bpy.ops.kfmocap.copy_pose() == {"FINISHED"}
    bpy.context.scene.frame_set(21)
    assert bpy.ops.kfmocap.paste_pose() == {"FINISHED"}
    assert keyed(slot) == {0: True, 20: True, 29: True}
    bpy.context.scene.frame_set(20)
    bpy.context.scene.frame_set(21)
    assert np.abs(shown(slot).difference(WALK[[7]])).max() < 1e-5


def select(slot, *names: str) -> None:
    """Enter pose mode with these bones selected."""
    bpy.context.view_layer.objects.active = slot.armature
    bpy.ops.object.mode_set(mode="POSE")
    for bone in slot.armature.pose.bones:
        (bone if hasattr(bone, "select") else bone.bone).select = bone.name in names


def test_only_the_selected_bones_are_pasted_and_keyed(blender, tmp_path):
    slot = walk_scene(tmp_path, tracked=True)
    bpy.ops.kfmocap.copy_pose()
    bpy.context.scene.frame_set(13)
    select(slot, "forearm.L")
    bpy.ops.kfmocap.paste_pose()
    forearm = slice(3 + 3 * BODY.index("forearm.L"), 6 + 3 * BODY.index("forearm.L"))
    assert np.abs(shown(slot).difference(WALK[[0]])[:, forearm]).max() < 1e-5
    rest = np.delete(shown(slot).difference(WALK[[12]]), np.r_[forearm], axis=1)
    assert np.abs(rest).max() < 1e-5
    assert keyed(slot) == {0: True, 12: False, 29: True}
    assert bpy.ops.kfmocap.set_key_pose() == {"FINISHED"}
    assert keyed(slot)[12] is False
    assert bpy.ops.kfmocap.remove_key_pose() == {"FINISHED"}
    assert keyed(slot) == {0: True, 29: True}


@pytest.mark.parametrize("root", [True, False])
def test_mirroring_is_what_blenders_own_paste_flipped_does(blender, tmp_path, root):
    slot = walk_scene(tmp_path, tracked=True)
    bpy.context.scene.frame_set(8)
    select(slot, *(bone.name for bone in slot.armature.pose.bones))
    bpy.ops.pose.copy()
    if not root:
        select(slot, *(bone.name for bone in slot.armature.pose.bones if bone.parent is not None))
    bpy.ops.pose.paste(flipped=True, selected_mask=not root)
    theirs = shown(slot)
    bpy.context.scene.frame_set(7)
    bpy.context.scene.frame_set(8)
    bpy.ops.object.mode_set(mode="OBJECT")
    assert bpy.ops.kfmocap.mirror_pose(root=root) == {"FINISHED"}
    assert np.abs(shown(slot).difference(theirs)).max() < 1e-5
    assert np.abs(shown(slot).difference(WALK[[7]])).max() > 0.1
    assert keyed(slot) == {0: True, 7: True, 29: True}


def test_pasted_mirrored_is_pasted_and_then_mirrored(blender, tmp_path):
    slot = walk_scene(tmp_path, tracked=True)
    bpy.context.scene.frame_set(8)
    bpy.ops.kfmocap.copy_pose()
    bpy.ops.kfmocap.mirror_pose()
    mirrored = shown(slot)
    bpy.context.scene.frame_set(20)
    bpy.ops.kfmocap.paste_pose(flipped=True)
    assert np.abs(shown(slot).difference(mirrored)).max() < 1e-5


def test_a_breakdown_lies_between_the_key_poses_beside_it(blender, tmp_path):
    slot = walk_scene(tmp_path, tracked=True)
    bpy.context.scene.frame_set(13)
    bpy.ops.kfmocap.breakdown_pose(share=0.25)
    step = WALK[[0]].difference(WALK[[29]])
    assert np.abs(shown(slot).difference(WALK[[0]].moved(0.25 * step))).max() < 1e-5
    bpy.ops.kfmocap.nudge_pose(side="AFTER", share=0.5)
    way = WALK[[0]].moved(0.25 * step)
    assert np.abs(shown(slot).difference(way.moved(0.5 * way.difference(WALK[[29]])))).max() < 1e-5
    bpy.context.scene.frame_set(30)
    with pytest.raises(RuntimeError, match="no key pose after"):
        bpy.ops.kfmocap.breakdown_pose()


def test_a_nudge_in_depth_leaves_the_root_where_it_is_seen(blender, tmp_path):
    slot = walk_scene(tmp_path)
    before = shown(slot)
    bpy.ops.kfmocap.nudge_depth(distance=0.3)
    seen = [cameras(1)[0].project(pose.translations[0]) for pose in (before, shown(slot))]
    np.testing.assert_allclose(*seen, atol=1e-3)
    assert np.linalg.norm(shown(slot).translations - before.translations) == pytest.approx(0.3, abs=1e-5)


def test_proposals_become_key_poses_one_by_one_or_all(blender, tmp_path):
    slot = walk_scene(tmp_path, keys=(0,))
    motion_curves.write_motion(slot.armature, WALK, 1, [6, 13, 20])
    assert [row.frame for row in key_list.find_key_poses(slot.armature) if row.proposed] == [6, 13, 20]
    bpy.context.scene.frame_set(7)
    assert bpy.ops.kfmocap.accept_proposals() == {"CANCELLED"}
    bpy.context.scene.frame_set(13)
    bpy.ops.kfmocap.accept_proposals()
    assert [frame for frame, whole in keyed(slot).items() if whole] == [0, 12]
    bpy.ops.kfmocap.accept_proposals(every=True)
    assert keyed(slot) == dict.fromkeys([0, 5, 12, 19], True)
    assert np.abs(motion_curves.read_motion(slot.armature, 6, 1).difference(WALK[[5]])).max() < 1e-5


def test_key_poses_are_listed_with_what_they_fix(blender, tmp_path):
    slot = walk_scene(tmp_path, tracked=True)
    slot.armature.pose.bones["hand.L"].keyframe_insert("rotation_quaternion", frame=9)
    motion_curves.write_motion(slot.armature, WALK, 1)
    slot.armature.pose.bones["hand.L"].rotation_quaternion = (0.8, 0.6, 0, 0)
    slot.armature.pose.bones["hand.L"].keyframe_insert("rotation_quaternion", frame=9)
    rows = {row.frame: row for row in key_list.find_key_poses(slot.armature)}
    assert sorted(rows) == [1, 9, 30] and rows[9].bones == ("hand.L",) and not rows[1].bones
    assert "hand.L" in rows[9].description and "whole body" in rows[1].description


def test_the_list_is_looked_up_again_when_keys_change(blender, tmp_path):
    slot = walk_scene(tmp_path)
    assert key_list.known_keys().entries(slot.armature) is None
    key_list.known_keys().look_up()
    assert len(key_list.known_keys().entries(slot.armature)) == 2
    bpy.context.scene.frame_set(13)
    bpy.context.view_layer.update()
    assert len(key_list.known_keys().entries(slot.armature)) == 2  # a frame change alone changes no keys
    bpy.ops.kfmocap.set_key_pose()
    bpy.context.view_layer.update()
    assert len(key_list.known_keys().entries(slot.armature)) == 2  # until it has been looked up
    key_list.known_keys().look_up()
    assert len(key_list.known_keys().entries(slot.armature)) == 3


def test_the_active_armature_is_posed_else_the_one_chosen_by_name(blender, tmp_path):
    from kfmocap.kfmocap_addon.scene_io import active_performer

    walk_scene(tmp_path)
    slots = bpy.context.scene.kfmocap.performers
    other = slots.add()
    other.name = "woman"
    other.armature = body_armature.build_armature(person(1.6), "woman", bpy.context.scene.collection)
    bpy.context.view_layer.update()
    bpy.context.view_layer.objects.active = None
    assert active_performer.chosen(bpy.context).name == "man"
    bpy.context.scene.kfmocap.performer = "woman"
    assert active_performer.chosen(bpy.context).name == "woman"
    bpy.context.view_layer.objects.active = slots[0].armature
    assert active_performer.chosen(bpy.context).name == "man"


class Tool(PlacingTool):
    """Place Joints outside Blender's window: the 3D view under the mouse is a fake one, 100 pixels wide and high."""

    def __init__(self, slot) -> None:
        self._placing, self.reports = click_posing.Placing(bpy.context.scene, slot), []
        self._asked, self._press, self._dragged, self._asks_to_discard = {}, None, None, False
        self._shown_frame, self._name, self.is_ended = self._placing.frame, slot.name, False

    def _look(self, context):
        view = SimpleNamespace(name="cam01")
        region = SimpleNamespace(type="WINDOW", x=0, y=0, width=100, height=100)
        look = SimpleNamespace(
            view=view,
            area=SimpleNamespace(regions=[region]),
            region=region,
            place=lambda x, y: (0.002 * x, -0.002 * y),
            position_of=lambda point: None,
        )
        look.position_of = look.position = lambda point: None
        return look if self._is_over_3d_view(context) else None

    def _show_status(self, context):
        pass

    def _ended(self, context):
        self.is_ended = True

    def report(self, kind, text):
        self.reports.append(text)

    def event(self, kind, value="PRESS", at=(50, 50), **held):
        keys = {"alt": False, "ctrl": False, "shift": False, "oskey": False} | held
        given = SimpleNamespace(type=kind, value=value, mouse_x=at[0], mouse_y=at[1], **keys)
        area = SimpleNamespace(
            type="VIEW_3D", regions=[SimpleNamespace(type="WINDOW", x=0, y=0, width=100, height=100)]
        )
        window = SimpleNamespace(screen=SimpleNamespace(areas=[area]))
        scene, layer = bpy.context.scene, bpy.context.view_layer
        [outcome] = self.modal(SimpleNamespace(window=window, scene=scene, view_layer=layer), given)
        return outcome

    def click(self, at=(50, 50), button="LEFTMOUSE"):
        return self.event(button, at=at), self.event(button, "RELEASE", at=at)


BESIDE = (200, 50)


@pytest.fixture
def tool(blender, tmp_path):
    """Place Joints at work on scene frame 13, with two marks."""
    slot = walk_scene(tmp_path)
    bpy.context.scene.frame_set(13)
    placing = Tool(slot)
    placing.click((40, 60))
    placing.click((60, 40))
    assert len(placing._placing.marks) == 2
    return placing


def test_clicks_beside_the_footage_are_blenders_and_key_nothing(tool):
    keys = keyed(tool._placing.slot)
    for button in ("LEFTMOUSE", "RIGHTMOUSE", "MIDDLEMOUSE"):
        assert tool.click(BESIDE, button) == ("PASS_THROUGH", "PASS_THROUGH")
    assert tool.event("X", at=BESIDE) == "PASS_THROUGH"
    assert not tool.is_ended and keyed(tool._placing.slot) == keys and len(tool._placing.marks) == 2


def test_looking_and_going_through_the_frames_stay_possible_while_joints_are_placed(tool):
    kinds = ("N", "NUMPAD_1", "NUMPAD_PERIOD", "WHEELUPMOUSE", "MIDDLEMOUSE", "LEFT_ARROW", "MOUSEMOVE")
    assert {tool.event(kind) for kind in kinds} == {"PASS_THROUGH"}
    assert {tool.event(kind) for kind in ("G", "A", "I", "DEL")} == {"RUNNING_MODAL"}


def test_what_orbits_in_the_users_keymap_places_no_joint(tool):
    with orbiting_with_alt():
        assert tool.event("LEFTMOUSE", alt=True) == "PASS_THROUGH"
    assert len(tool._placing.marks) == 2
    tool.event("LEFTMOUSE", alt=True)
    tool.event("LEFTMOUSE", "RELEASE")
    assert len(tool._placing.marks) == 3, "without such a key it is a click"


def test_a_right_click_asks_before_it_discards_marks(tool):
    tool.click(button="RIGHTMOUSE")
    tool.event("TAB")
    tool.click(button="RIGHTMOUSE")
    assert not tool.is_ended and len(tool._placing.marks) == 2
    assert tool.event("RIGHTMOUSE") == "CANCELLED" and tool.is_ended
    assert not len(tool._placing.slot.marks)


def test_a_right_click_with_nothing_to_lose_cancels(tool):
    tool.event("Z", ctrl=True)
    tool.event("Z", ctrl=True)
    assert not tool._placing.marks and tool.event("RIGHTMOUSE") == "CANCELLED"


def test_undo_and_redo_inside_the_tool_are_of_marks(tool):
    marks = dict(tool._placing.marks)
    assert tool.event("Z", ctrl=True, at=BESIDE) == "RUNNING_MODAL"
    assert len(tool._placing.marks) == 1
    tool.event("Z", ctrl=True, shift=True)
    assert tool._placing.marks == marks


def test_enter_keys_the_frame_of_the_marks_from_any_other(tool):
    bpy.context.scene.frame_set(20)
    tool.click((30, 30))
    assert len(tool._placing.marks) == 2
    assert tool.event("RET") == "FINISHED"
    assert keyed(tool._placing.slot) == {0: True, 12: True, 29: True} and bpy.context.scene.frame_current == 13


def test_the_pose_in_work_is_shown_again_on_its_frame(tool):
    shown = shown_pose.shown_values(tool._placing.slot.armature)
    for frame in (20, 13):
        bpy.context.scene.frame_set(frame)
        tool.event("MOUSEMOVE")
    assert shown_pose.shown_values(tool._placing.slot.armature) == shown


def test_placing_ends_when_the_performer_is_removed(tool):
    bpy.data.objects.remove(tool._placing.slot.armature)
    assert tool.event("MOUSEMOVE") == "CANCELLED" and tool.is_ended
    assert "left the scene" in tool.reports[0]


def test_alternatives_of_one_view_are_gone_through_and_undone(tool):
    """The tool asks, shows the likeliest, goes on with every press, and forgets them at the next mark."""
    placing = tool._placing
    before = placing.pose
    tool.event("A")
    count = len(placing.alternatives)
    assert count > 1 and placing.alternative == 0
    poses = []
    for _ in range(count):
        poses.append(shown(placing.slot))
        tool.event("A")
    assert placing.alternative == 0
    points = np.concatenate([landmark_positions(BODY, pose, LIMBS) for pose in poses])
    apart = np.linalg.norm(points[:, None] - points[None], axis=-1).max(axis=-1)
    assert apart[~np.eye(count, dtype=bool)].min() > 0.02
    assert placing.bones_of_alternatives().shape == (count, len(BODY), 2, 3)
    tool.event("A", shift=True)
    assert placing.alternative == count - 1
    tool.event("Z", ctrl=True)
    assert not placing.alternatives and len(placing.marks) == 2
    assert np.abs(placing.pose.difference(before)).max() < 1e-12


def test_every_alternative_has_a_box_to_click():
    from kfmocap.kfmocap_addon.overlays import alternative_boxes

    row = alternative_boxes.boxes(4, 1.0)
    for number, (left, bottom, right, top) in enumerate(row):
        assert alternative_boxes.box_at(row, (left + right) / 2, (bottom + top) / 2) == number
    assert alternative_boxes.box_at(row, right + 2, top) is None
    assert alternative_boxes.box_at(row[:3], right, top) is None


def test_the_boxes_lie_where_they_cover_the_fewest_joints():
    from kfmocap.kfmocap_addon.overlays import alternative_boxes

    low, high = [(200.0, 60.0), (240.0, 70.0)], [(200.0, 560.0)]
    at_the_bottom = alternative_boxes.boxes(4, 1.0)
    assert alternative_boxes.row_beside([*low, *high], 4, 600.0, 1.0) == alternative_boxes.boxes(4, 1.0, upper=600.0)
    assert alternative_boxes.row_beside(high, 4, 600.0, 1.0) == at_the_bottom
    assert alternative_boxes.row_beside([(900.0, 60.0)], 4, 600.0, 1.0) == at_the_bottom, "it is beside the row"
    assert alternative_boxes.boxes(4, 1.0, upper=600.0)[0][3] < 600.0


def test_the_boxes_lie_between_toolbar_and_sidebar():
    from kfmocap.kfmocap_addon.overlays import alternative_boxes

    wide, narrow = (alternative_boxes.boxes(8, 1.0, sides=(48.0, right)) for right in (1200.0, 700.0))
    assert [box[2] - box[0] for box in wide] == [box[2] - box[0] for box in alternative_boxes.boxes(8, 1.0)]
    for row, right in ((wide, 1200.0), (narrow, 700.0)):
        assert row[0][0] > 48.0 and row[-1][2] < right
        assert all(box[2] < after[0] for box, after in pairwise(row)), "none lies over the next"


def test_seen_from_the_side_what_is_farther_from_the_camera_is_to_the_right():
    from kfmocap.kfmocap_addon.overlays import alternative_boxes

    bones = np.array([[[[0.0, 5.0, 1.0], [0.5, 6.0, 2.0]]]])
    flat = alternative_boxes.from_the_side(bones, np.array([0.25, 0.0, 3.0]))
    np.testing.assert_allclose(flat[0, 0, 1] - flat[0, 0, 0], [1.0, 1.0], atol=1e-9)
