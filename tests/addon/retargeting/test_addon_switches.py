"""Rigs whose limbs properties switch from FK to IK, wherever these are; bones whose turns cannot be read."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from addon_shots import joint_error  # noqa: E402
from kfmocap.core.body.skeleton_motion import motion_of_body  # noqa: E402
from kfmocap.core.errors import BodyError  # noqa: E402
from kfmocap.kfmocap_addon.retargeting import live, send  # noqa: E402
from kfmocap.kfmocap_addon.retargeting.rigs import rig_at_rest, rig_reading  # noqa: E402
from kfmocap.kfmocap_addon.retargeting.tracked_bodies.skinned_body import use_as_body  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.body import body_armature  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.characters import skins  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.keys import motion_curves  # noqa: E402
from odd_characters import (  # noqa: E402
    BODY,
    CONTROL,
    add_bones,
    controlled_human,
    generated_rig,
    linked,
    one_chain_human,
    skinned_human,
    switched_human,
)
from synthetic import swing  # noqa: E402

pytest_plugins = ("addon_fixtures",)

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("blender")]

FRAMES = 4
ENDS = [f"{end}.{side}" for end in ("hand", "foot") for side in "LR"]
SWITCHES = {
    "object": partial(switched_human, where="object"),
    "data": partial(switched_human, where="data"),
    "parent": partial(switched_human, where="parent"),
    "driven": partial(switched_human, where="driven"),
    "scripted": partial(switched_human, expression="min(1.0, 2.0 * s)"),
}
NAMES = {"object": "object rig", "data": "armature rig", "parent": "object settings", "driven": "object rig"}


def switched(where, armature):
    """The values of the four switches."""
    owner = {"data": armature.data, "parent": armature.parent}.get(where, armature)
    return [owner[f"ik_fk {end}"] for end in ENDS]


def limbs_apart(armature, rolls=("upper_arm", "forearm", "hand", "thigh", "shin", "foot")):
    """How far the deforming bones of the limbs stand from their FK controls on frame 3, metres."""
    bpy.context.scene.frame_set(3)
    posed = armature.evaluated_get(bpy.context.evaluated_depsgraph_get()).pose.bones
    names = [f"{roll}.{side}" for roll in rolls for side in "LR"]
    return max(np.abs(np.array(posed[f"DEF-{n}"].matrix) - np.array(posed[CONTROL + n].matrix)).max() for n in names)


@pytest.mark.parametrize("where", SWITCHES)
def test_limbs_are_switched_to_fk_wherever_their_switches_are(where):
    armature, remarks = use_as_body(bpy.context.scene, SWITCHES[where]())
    body = body_armature.body_from_armature(armature)
    assert {name.removeprefix(CONTROL) for name in body.names} == set(BODY.names)
    if where in NAMES:
        assert switched(where, armature) == [0, 0, 0, 0]
        assert sorted(remarks) == sorted(
            f"{NAMES[where].replace('rig', armature.name)}: its property 'ik_fk {end}' is 0 now: the limb is turned by "
            "FK controls"
            for end in ENDS
        )
    motion_curves.write_motion(armature, swing(body, FRAMES), 1)
    assert joint_error(armature, body, swing(body, FRAMES)) < 0.1
    assert limbs_apart(armature) < 1e-4


def test_a_switch_is_turned_to_the_far_end_of_its_range():
    """As in rigs whose switches count from 0 to 10, and where 10 is FK."""
    rig = switched_human(0.0, "object", "1.0 - 0.1 * s")
    for end in ENDS:
        rig.id_properties_ui(f"ik_fk {end}").update(soft_min=0.0, soft_max=10.0)
    armature, _ = use_as_body(bpy.context.scene, rig)
    assert switched("object", armature) == [10, 10, 10, 10]
    body = body_armature.body_from_armature(armature)
    motion_curves.write_motion(armature, swing(body, FRAMES), 1)
    assert joint_error(armature, body, swing(body, FRAMES)) < 0.1


@pytest.mark.parametrize("where", SWITCHES)
def test_motion_is_sent_through_fk_wherever_the_switches_are(where):
    target = SWITCHES[where]()
    report = send.send_to_rig(bpy.context.scene, motion_of_body(BODY, swing(BODY, FRAMES), "man", 30.0), target, 1)
    assert max(error["worst_degrees"] for error in report["error"].values()) < 0.1
    assert max(error["worst_mm"] for error in report["error"].values()) < 0.1
    assert limbs_apart(target) < 1e-4
    keyed = {curve.data_path for curve in target.animation_data.action.layers[0].strips[0].channelbags[0].fcurves}
    if where in ("object", "driven"):
        assert {f'["ik_fk {end}"]' for end in ENDS} <= keyed
    said = [text for text in report["warnings"] if "its property 'ik_fk" in text]
    assert len(said) == (len(ENDS) if where in ("data", "parent") else 0)


@pytest.mark.parametrize(("where", "count"), [("bone", 4), ("object", 2)])
def test_limbs_whose_own_bones_have_inverse_kinematics_are_switched(where, count):
    armature, remarks = use_as_body(bpy.context.scene, one_chain_human(where))
    body = body_armature.body_from_armature(armature)
    assert set(body.names) == set(BODY.names)
    assert len(remarks) == count
    assert all("its property 'ik" in text and "is 0 now" in text for text in remarks)
    truth = swing(body, FRAMES)
    motion_curves.write_motion(armature, truth, 1)
    assert joint_error(armature, body, truth) < 0.1


def test_a_saved_file_keeps_the_switches_of_a_linked_character(tmp_path):
    given = linked(partial(one_chain_human, "object"), tmp_path)  # opens another file
    armature, remarks = use_as_body(bpy.context.scene, given)
    body = body_armature.body_from_armature(armature)
    assert all("is 0 now" in text for text in remarks)
    truth = swing(body, FRAMES)
    motion_curves.write_motion(armature, truth, 1)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "shot.blend"))
    armature = bpy.context.scene.kfmocap.performers[0].armature
    assert joint_error(armature, body_armature.body_from_armature(armature), truth) < 0.1


def test_shoulders_of_a_linked_rigify_rig_are_no_parts_as_no_file_would_keep_them(tmp_path):
    given = linked(generated_rig, tmp_path)
    armature, _ = use_as_body(bpy.context.scene, given)
    names = body_armature.body_from_armature(armature).names
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "shot.blend"))
    assert body_armature.body_from_armature(bpy.context.scene.kfmocap.performers[0].armature).names == names


def test_drivers_of_what_belongs_to_a_constraint_are_no_hindrance():
    """Such as the weights of an Armature constraint's targets, which switch a control from one space to another."""
    armature = one_chain_human()
    held = armature.pose.bones["head"].constraints.new("ARMATURE")
    target = held.targets.new()
    target.target, target.subtarget = armature, "pelvis"
    held.influence = 0.0
    driver = target.driver_add("weight").driver
    driver.type = "SCRIPTED"
    driver.expression = "1.0"
    report = send.send_to_rig(bpy.context.scene, motion_of_body(BODY, swing(BODY, FRAMES), "man", 30.0), armature, 1)
    assert max(error["worst_mm"] for error in report["error"].values()) < 0.1


def test_constraints_without_a_bone_and_flat_controls_are_no_hindrance():
    armature = controlled_human()
    for kind in ("SHRINKWRAP", "SPLINE_IK"):
        held = armature.pose.bones["DEF-head"].constraints.new(kind)
        held.target, held.influence = armature, 0.0
    add_bones(armature, [("flat", "root", (0.0, 0.0, 1.0), (0.0, 0.0, 1.2))])
    armature.pose.bones["flat"].scale = (0.0, 1.0, 0.5)
    copied = armature.pose.bones["DEF-pelvis"].constraints.new("COPY_ROTATION")
    copied.target, copied.subtarget, copied.influence = armature, "flat", 0.0
    motion = motion_of_body(BODY, swing(BODY, FRAMES), "man", 30.0)
    report = send.send_to_rig(bpy.context.scene, motion, armature, 1)
    assert max(error["worst_mm"] for error in report["error"].values()) < 0.1


def test_limbs_that_a_constraint_shifts_are_said():
    armature = skinned_human()
    add_bones(armature, [("aside", "", (0.5, 0, 1), (0.5, 0, 1.2))])
    shift = armature.pose.bones["forearm.L"].constraints.new("COPY_LOCATION")
    shift.target, shift.subtarget, shift.influence = armature, "aside", 0.5
    report = send.send_to_rig(bpy.context.scene, motion_of_body(BODY, swing(BODY, FRAMES), "man", 30.0), armature, 1)
    assert [text for text in report["warnings"] if text.startswith("arm.L: the rig is up to") and " mm off" in text]


@pytest.mark.parametrize("where", ["bone", "object"])
def test_motion_is_sent_to_limbs_whose_own_bones_have_inverse_kinematics(where):
    target = one_chain_human(where)
    report = send.send_to_rig(bpy.context.scene, motion_of_body(BODY, swing(BODY, FRAMES), "man", 30.0), target, 1)
    assert report["warnings"] == []
    assert max(error["worst_degrees"] for error in report["error"].values()) < 0.1
    assert max(error["worst_mm"] for error in report["error"].values()) < 0.1


def moved_by_goals():
    """A person whose limbs goals of inverse kinematics move at all times: there is no switch."""
    armature = switched_human()
    for curve in list(armature.animation_data.drivers):
        armature.driver_remove(curve.data_path)
    for bone in armature.pose.bones:
        for held in bone.constraints:
            held.influence = 1.0
    return armature


def test_a_limb_that_a_goal_alone_moves_is_refused_by_the_name_of_the_limbs_bone():
    """And not by that of a bone of its mechanism."""
    armature = moved_by_goals()
    with pytest.raises(BodyError, match=r"bone DEF-.*forward kinematics"):
        use_as_body(bpy.context.scene, armature)


def test_limbs_without_a_switch_are_moved_by_their_own_bones_up_to_hands_and_feet():
    """The goals of inverse kinematics turn hands and feet, but do not move with the limbs."""
    target = moved_by_goals()
    report = send.send_to_rig(bpy.context.scene, motion_of_body(BODY, swing(BODY, FRAMES), "man", 30.0), target, 1)
    assert {f"DEF-{end}" for end in ENDS} <= {name for names in report["target"]["bones"].values() for name in names}
    assert max(error["worst_degrees"] for error in report["error"].values()) < 0.1
    assert max(error["worst_mm"] for error in report["error"].values()) < 0.1


def test_switches_of_the_object_come_back_when_a_character_stops_following():
    target = switched_human(where="object")
    source = skinned_human()
    motion = motion_of_body(BODY, swing(BODY, FRAMES), "man", 30.0)
    send.send_to_rig(bpy.context.scene, motion, target, 1, send.SendOptions(live=live.LiveSource(source, {})))
    assert switched("object", target) == [0, 0, 0, 0]
    assert live.stop_following(target)
    assert switched("object", target) == [1, 1, 1, 1]


def test_keys_of_a_switch_on_the_object_get_its_value_with_a_word():
    armature = switched_human(where="object")
    armature.keyframe_insert('["ik_fk hand.L"]', frame=1)
    _, remarks = use_as_body(bpy.context.scene, armature)
    [said] = [text for text in remarks if "on all its keys" in text]
    assert said.startswith(f"object {armature.name}: its property 'ik_fk hand.L' is 0 now, on all its keys")
    bpy.context.scene.frame_set(1)
    assert armature["ik_fk hand.L"] == 0


@pytest.mark.parametrize(
    ("scale", "what"),
    [((-1.0, -1.0, -1.0), "mirrored"), ((-1.0, 1.0, 1.0), "mirrored"), ((0.0, 0.0, 0.0), "scaled to nothing")],
)
def test_a_bone_whose_scale_hides_its_turns_is_named_with_what_to_do(scale, what):
    target = skinned_human()
    target.pose.bones["forearm.L"].scale = scale
    with pytest.raises(BodyError, match=f"forearm.L: it is {what} .clear its scale"):
        send.send_to_rig(bpy.context.scene, motion_of_body(BODY, swing(BODY, 2), "man", 30.0), target, 1)


def test_a_bone_that_a_constraint_leaves_no_length_is_not_said_to_be_scaled():
    target = skinned_human()
    held = target.pose.bones["forearm.L"].constraints.new("LIMIT_SCALE")
    held.use_max_y = True
    with pytest.raises(
        BodyError, match=r"no length or no width as it is shown, held by 'Limit Scale' of forearm.L .mute"
    ):
        send.send_to_rig(bpy.context.scene, motion_of_body(BODY, swing(BODY, 2), "man", 30.0), target, 1)


@pytest.mark.parametrize("hidden", [False, True])
def test_skins_are_not_deformed_while_a_rig_is_read(hidden, monkeypatch):
    target = skinned_human()
    [skin] = skins.skinned_meshes(target)
    skin.hide_viewport = hidden
    seen, read = [], rig_at_rest.posed_matrices

    def watched(*given):
        seen.append(skin.hide_viewport)
        return read(*given)

    monkeypatch.setattr(rig_reading, "posed_matrices", watched)
    send.send_to_rig(bpy.context.scene, motion_of_body(BODY, swing(BODY, 2), "man", 30.0), target, 1)
    assert seen
    assert all(seen)
    assert skin.hide_viewport is hidden
