"""Characters that nobody made for this program: tracked from key poses on their own bones, and moved."""

from __future__ import annotations

import time
from functools import partial

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from addon_shots import joint_error, shot  # noqa: E402
from kfmocap.core.body.skeleton_motion import motion_of_body  # noqa: E402
from kfmocap.core.errors import BodyError  # noqa: E402
from kfmocap.core.formats.bvh import read_bvh  # noqa: E402
from kfmocap.kfmocap_addon.export import exporters  # noqa: E402
from kfmocap.kfmocap_addon.export.export_options import ExportOptions  # noqa: E402
from kfmocap.kfmocap_addon.retargeting import send, source_motion  # noqa: E402
from kfmocap.kfmocap_addon.retargeting.rigs import fk_controls  # noqa: E402
from kfmocap.kfmocap_addon.retargeting.tracked_bodies.skinned_body import use_as_body  # noqa: E402
from kfmocap.kfmocap_addon.scene_io import added_views, scene  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.body import body_armature, shown_pose  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.keys import key_pose_curves, motion_curves  # noqa: E402
from odd_characters import (  # noqa: E402
    BODY,
    CONTROL,
    add_bones,
    bind,
    controlled_human,
    generated_rig,
    hung_on_controls,
    layered_human,
    limited_legs,
    linked,
    loose_arms,
    quadruped,
    shown_heads,
    switched_human,
    unreal_like,
)
from synthetic import film, look_at, swing  # noqa: E402

pytest_plugins = ("addon_fixtures",)

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("blender")]

FRAMES = 8
EYES = ((3.0, -3.0, 0.6), (-3.0, -3.0, 0.3))


def error_of(armature, body, truth):
    """How far in mm the worst joint of a frame is off, on average over the frames of the shot."""
    first = bpy.context.scene.kfmocap.frame_start
    errors = [joint_error(armature, body, truth[[f]], first + f) for f in range(len(truth))]
    return float(np.mean(errors))


@pytest.mark.parametrize("made", [unreal_like, quadruped, switched_human])
def test_a_character_is_tracked_on_its_own_bones(made, tmp_path):
    scene = bpy.context.scene
    armature, _ = use_as_body(scene, made())
    body = body_armature.body_from_armature(armature)
    truth = swing(body, FRAMES, 0.35)
    middle = body.parts[0].head_world
    cameras = [look_at(f"cam{i}", middle + np.array(eye), middle) for i, eye in enumerate(EYES)]
    film(tmp_path, [body], [truth], cameras)
    added_views.add_footage(scene, [tmp_path / camera.name / "000.png" for camera in cameras])
    added_views.calibrate_views(scene, {camera.name: camera for camera in cameras})
    first = scene.kfmocap.frame_start
    for frame in (0, FRAMES - 1):
        shown_pose.show_pose(armature, truth[[frame]])
        key_pose_curves.key_current_pose(armature, first + frame)
    curves = error_of(armature, body, truth)
    assert bpy.ops.kfmocap.track() == {"FINISHED"}
    assert error_of(armature, body, truth) < 0.3 * curves
    for frame in (0, FRAMES - 1):
        assert joint_error(armature, body, truth[[frame]], first + frame) < 0.1


COPYING = [controlled_human, partial(controlled_human, "COPY_ROTATION"), hung_on_controls]


@pytest.mark.parametrize("made", COPYING, ids=["transforms", "rotation", "parents"])
def test_parts_hang_on_the_controls_that_deforming_bones_follow(made):
    armature, remarks = use_as_body(bpy.context.scene, made())
    body = body_armature.body_from_armature(armature)
    assert {name.removeprefix(CONTROL) for name in body.names} == set(BODY.names)
    assert not remarks
    truth = swing(body, FRAMES)
    motion_curves.write_motion(armature, truth, 1)
    assert joint_error(armature, body, truth) < 0.1
    bpy.context.scene.frame_set(4)
    posed = armature.evaluated_get(bpy.context.evaluated_depsgraph_get()).pose.bones
    for name in BODY.names:
        assert np.allclose(posed[f"DEF-{name}"].matrix, posed[CONTROL + name].matrix, atol=1e-5)


def test_limbs_that_a_property_switches_are_switched_to_their_fk_controls_with_a_word():
    armature = switched_human()
    armature, remarks = use_as_body(bpy.context.scene, armature)
    goals = [f"IK-{end}.{side}" for end in ("hand", "foot") for side in "LR"]
    assert sorted(text.split(":")[0] for text in remarks) == sorted(f"bone {name}" for name in goals)
    assert all(armature.pose.bones[name]["ik_fk"] == 0 for name in goals)
    names = body_armature.body_from_armature(armature).names
    assert {name.removeprefix(CONTROL) for name in names} == set(BODY.names)


def test_motion_is_sent_past_keys_that_switch_a_limb_to_inverse_kinematics():
    scene, target = bpy.context.scene, switched_human()
    target.pose.bones["IK-hand.L"].keyframe_insert('["ik_fk"]', frame=1)
    motion = motion_of_body(BODY, swing(BODY, FRAMES), "man", 30.0)
    report = send.send_to_rig(scene, motion, target, 1)
    assert report["warnings"] == []
    assert report["error"]["arm.L"]["worst_degrees"] < 0.1


def test_the_error_of_a_character_in_an_excluded_collection_is_measured():
    scene, target = bpy.context.scene, unreal_like()
    kept = bpy.data.collections.new("kept")
    scene.collection.children.link(kept)
    scene.collection.objects.unlink(target)
    kept.objects.link(target)
    bpy.context.view_layer.layer_collection.children["kept"].exclude = True
    report = send.send_to_rig(scene, motion_of_body(BODY, swing(BODY, FRAMES), "man", 30.0), target, 1)
    assert report["warnings"] == []
    assert bpy.context.view_layer.layer_collection.children["kept"].exclude


def test_a_linked_character_is_tracked_on_an_override_that_a_saved_file_keeps(tmp_path):
    given = linked(unreal_like, tmp_path)  # opens another file
    armature, _ = use_as_body(bpy.context.scene, given)
    assert armature.library is None
    key_pose_curves.key_current_pose(armature, 1)
    body = body_armature.body_from_armature(armature)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "shot.blend"))
    [slot] = bpy.context.scene.kfmocap.performers
    assert body_armature.body_from_armature(slot.armature).names == body.names
    assert key_pose_curves.read_key_poses(slot.armature, 1, 5).frames.tolist() == [0]


def test_limbs_that_hang_on_no_bone_are_named_with_what_to_do():
    _, remarks = use_as_body(bpy.context.scene, loose_arms())
    assert len(remarks) == 2
    assert all("does not hang on pelvis" in text and "Ctrl P" in text for text in remarks)


def test_a_limb_that_has_inverse_kinematics_alone_is_named_with_what_to_do():
    armature = controlled_human()
    for name in ("upper_arm.L", "forearm.L"):
        held = armature.pose.bones[f"DEF-{name}"].constraints
        held.remove(held[0])
    chain = armature.pose.bones["DEF-forearm.L"].constraints.new("IK")
    chain.target, chain.subtarget, chain.chain_count = armature, "CTRL-hand.L", 2
    with pytest.raises(BodyError, match=r"bone DEF-upper_arm.L: no control .* of DEF-forearm.L .*switch its limb to f"):
        use_as_body(bpy.context.scene, armature)
    assert not armature.children


def test_limits_of_controls_do_not_keep_them_from_being_those_of_the_body():
    armature = controlled_human()
    limit = armature.pose.bones["CTRL-forearm.L"].constraints.new("LIMIT_ROTATION")
    limit.owner_space = "LOCAL"
    limit.use_limit_x = limit.use_limit_y = limit.use_limit_z = True
    limit.min_x = -2.5
    use_as_body(bpy.context.scene, armature)
    assert "CTRL-forearm.L" in body_armature.body_from_armature(armature).names
    assert not limit.mute


def test_a_hidden_bone_of_the_mechanism_is_not_taken_for_the_control_that_it_hangs_on():
    armature = controlled_human()
    for name in ("thigh.L", "shin.L", "head"):
        control = armature.data.bones[CONTROL + name]
        add_bones(armature, [(f"dummy-{name}", control.name, control.head_local, control.tail_local)])
        armature.data.bones[f"dummy-{name}"].hide = True
        [held] = armature.pose.bones[f"DEF-{name}"].constraints
        held.subtarget = f"dummy-{name}"
    use_as_body(bpy.context.scene, armature)
    names = body_armature.body_from_armature(armature).names
    assert {f"{CONTROL}thigh.L", f"{CONTROL}shin.L", f"{CONTROL}head"} < set(names)


def test_a_control_that_does_not_turn_with_the_one_above_is_named():
    armature = controlled_human()
    armature.data.bones["CTRL-head"].use_inherit_rotation = False
    with pytest.raises(BodyError, match=r"bone CTRL-head: it does not move with CTRL-chest .*it does not inherit rot"):
        use_as_body(bpy.context.scene, armature)
    assert not armature.children
    assert not bpy.context.scene.kfmocap.performers


def test_bones_that_follow_a_controlled_one_in_part_are_left_out_with_a_word():
    armature = controlled_human()
    top = BODY.parts[BODY.index("head")].tail_world
    add_bones(armature, [("plume", "DEF-head", top, top + [0, 0.3, 0])], deform=True)
    bind(armature, "plume", [("plume", top + np.random.default_rng(0).uniform(-0.1, 0.1, (40, 3)) + [0, 0.2, 0])])
    held = armature.pose.bones["plume"].constraints.new("COPY_ROTATION")
    held.target, held.subtarget, held.influence = armature, "CTRL-chest", 0.5
    armature, remarks = use_as_body(bpy.context.scene, armature)
    assert [text.split(",")[0] for text in remarks] == ["bone plume: it is moved by its constraint 'Copy Rotation'"]
    assert len(body_armature.body_from_armature(armature)) == len(BODY)


@pytest.mark.parametrize("made", [controlled_human, switched_human, layered_human, hung_on_controls])
def test_motion_is_sent_to_the_controls_of_a_rig_that_no_preset_knows(made):
    scene = bpy.context.scene
    target = made()
    source = body_armature.build_armature(BODY, "source", scene.collection)
    motion_curves.write_motion(source, swing(BODY, FRAMES), 1)
    scene.frame_start, scene.frame_end = 1, FRAMES
    motion, bones = source_motion.motion_of_armature(scene, source, (1, FRAMES))
    report = send.send_to_rig(scene, motion, target, 1, send.SendOptions(source_bones=bones))
    assert report["warnings"] == []
    assert all(
        name.startswith(CONTROL)
        for role, names in report["target"]["bones"].items()
        if role != "root"
        for name in names
    )
    assert max(limb["worst_degrees"] for limb in report["error"].values()) < 0.1
    scene.frame_set(4)
    graph = bpy.context.evaluated_depsgraph_get()
    shown, wanted = (one.evaluated_get(graph).pose.bones for one in (target, source))
    for name in BODY.names:
        assert np.allclose(shown[f"DEF-{name}"].head, wanted[name].head, atol=1e-3)


def test_legs_with_inverse_kinematics_and_limits_are_freed_with_a_word():
    scene = bpy.context.scene
    target = limited_legs()
    motion = motion_of_body(BODY, swing(BODY, FRAMES), "man", 25.0)
    report = send.send_to_rig(scene, motion, target, 1)
    assert sorted(report["warnings"]) == sorted(
        f"bone shin.{side}: its constraint '{name}' has no influence in the new action"
        for side in "LR"
        for name in ("IK", "Limit Rotation")
    )
    assert max(limb["worst_degrees"] for limb in report["error"].values()) < 0.1


@pytest.mark.parametrize("made", [unreal_like, controlled_human, switched_human, hung_on_controls])
def test_files_have_what_blender_shows_of_bones_below_a_root_and_of_those_that_follow_controls(made, tmp_path):
    scene = bpy.context.scene
    armature, _ = use_as_body(scene, made())
    body = body_armature.body_from_armature(armature)
    motion_curves.write_motion(armature, swing(body, FRAMES), 1)
    armature.location = (0.3, -0.4, 0.0)
    options = ExportOptions(frames=(1, FRAMES))
    names = [bone.name for bone in armature.data.bones if bone.name in body.names or bone.use_deform]
    wanted = shown_heads(armature, FRAMES, names)
    exporters.export_bvh(tmp_path / "motion.bvh", armature, scene, options)
    moved = read_bvh(tmp_path / "motion.bvh")
    assert np.abs(moved.positions[:, moved.rest.indices(names)] - wanted).max() < 1e-4
    exporters.export_fbx(tmp_path / "motion.fbx", armature, scene, options)
    bpy.ops.import_scene.fbx(filepath=str(tmp_path / "motion.fbx"), anim_offset=0.0)
    assert np.abs(shown_heads(bpy.context.object, FRAMES, names) - wanted).max() < 1e-3
    assert np.abs(shown_heads(armature, FRAMES, names) - wanted).max() < 1e-5, "the rig itself is as it was"


def test_a_rigify_rig_takes_50_frames_a_second_and_is_a_body_with_all_limbs(request):
    nightly = request.config.getoption("nightly")
    rig, frames = generated_rig(face=nightly), 1000 if nightly else 200
    assert len(rig.data.bones) > (700 if nightly else 500)
    motion = motion_of_body(BODY, swing(BODY, frames, 0.4), "man", 30.0)
    begun = time.process_time()
    report = send.send_to_rig(bpy.context.scene, motion, rig, 1)
    assert time.process_time() - begun < frames / 50
    assert report["frames"] == [1, frames]
    rig.animation_data.action = None
    use_as_body(bpy.context.scene, rig)
    names = body_armature.body_from_armature(rig).names
    limbs = ("upper_arm", "forearm", "hand", "thigh", "shin", "foot")
    assert {f"{limb}_fk.{side}" for limb in limbs for side in "LR"} < set(names)


@pytest.mark.parametrize("follows", [True, False])
def test_shoulders_of_a_rigify_rig_are_parts_if_its_arms_move_with_them(follows, monkeypatch):
    """The arms hang on the chest, and follow the shoulders by constraints."""
    rig = generated_rig()

    def refuse(*_):
        raise BodyError("they do not", where="arms")

    if not follows:
        monkeypatch.setattr(fk_controls, "refuse_otherwise_moved", refuse)
    use_as_body(bpy.context.scene, rig)
    body = body_armature.body_from_armature(rig)
    above = {name: body.names[k] for name, k in zip(body.names, body.parents, strict=True) if k >= 0}
    for side in "LR":
        assert above[f"upper_arm_fk.{side}"] == (f"shoulder.{side}" if follows else "spine_fk.003")
    truth = swing(body, 3)
    motion_curves.write_motion(rig, truth, 1)
    assert joint_error(rig, body, truth) < 0.1
    bpy.context.scene.frame_set(2)
    posed = rig.evaluated_get(bpy.context.evaluated_depsgraph_get()).pose.bones
    for side in "LR":
        place = np.array(rig.matrix_world @ posed[f"DEF-upper_arm.{side}"].head)
        assert np.abs(place - np.array(rig.matrix_world @ posed[f"upper_arm_fk.{side}"].head)).max() < 1e-4


def test_from_a_tracked_shot_a_rigify_character_moves_after_four_clicks(tmp_path):
    """The section's title, the field Character, the rig in it, and the button; all else stays as it comes."""
    scene.build_scene(shot(tmp_path), scene=bpy.context.scene)
    performer = bpy.context.scene.kfmocap.performers[0].armature
    motion_curves.write_motion(performer, swing(body_armature.body_from_armature(performer), FRAMES), 1)
    rig = generated_rig()
    bpy.ops.kfmocap.open_section(section="retarget")
    assert bpy.context.scene.kfmocap.retarget.target is None
    bpy.context.scene.kfmocap.retarget.target = rig  # two clicks: the field, and the rig in its list
    before = shown_heads(rig, FRAMES, ["DEF-forearm.L"])
    assert bpy.ops.kfmocap.send_to_rig() == {"FINISHED"}
    after = shown_heads(rig, FRAMES, ["DEF-forearm.L"])
    assert np.ptp(before, axis=0).max() == 0 and np.ptp(after, axis=0).max() > 0.01
