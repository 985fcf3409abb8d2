"""Characters of more than one armature, and instances of linked ones: the armature that moves them is used."""

from __future__ import annotations

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from addon_shots import joint_error  # noqa: E402
from kfmocap.core.body.skeleton_motion import motion_of_body  # noqa: E402
from kfmocap.core.body.soles import Soles  # noqa: E402
from kfmocap.core.errors import BodyError  # noqa: E402
from kfmocap.kfmocap_addon.retargeting.send import send_to_rig  # noqa: E402
from kfmocap.kfmocap_addon.retargeting.target_armatures import find_target  # noqa: E402
from kfmocap.kfmocap_addon.retargeting.tracked_bodies.skinned_body import use_as_body  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.body import body_armature  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.characters import skins  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.keys import motion_curves  # noqa: E402
from mathutils import Euler, Matrix  # noqa: E402
from odd_characters import BODY, UNREAL, generated_rig, limited_legs, linked, skinned_human, unreal_like  # noqa: E402
from synthetic import swing  # noqa: E402

pytest_plugins = ("addon_fixtures",)

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("blender")]

FRAMES, HALF = 8, 0.5


def game_skeleton(kind="COPY_TRANSFORMS"):
    """A skeleton for a game engine, with the skin, whose bones follow those of a rig of controls; both."""
    controls = skinned_human()
    for skin in skins.skinned_meshes(controls):
        bpy.data.objects.remove(skin)
    controls.name = "controls"
    skeleton = skinned_human(UNREAL)
    skeleton.name = "game"
    for name, called in UNREAL.items():
        held = skeleton.pose.bones[called].constraints.new(kind if name != "pelvis" else "COPY_TRANSFORMS")
        held.target, held.subtarget = controls, name
    bpy.context.view_layer.update()
    return controls, skeleton


@pytest.mark.parametrize("kind", ["COPY_TRANSFORMS", "COPY_ROTATION"])
def test_controls_are_a_body_with_the_skin_of_the_skeleton_that_follows_them(kind):
    controls, skeleton = game_skeleton(kind)
    armature, remarks = use_as_body(bpy.context.scene, controls)
    assert armature == controls and not remarks
    body = body_armature.body_from_armature(armature)
    assert set(body.names) == set(UNREAL)
    for part in body.parts:
        own = BODY.parts[BODY.index(part.name)]
        assert np.abs(np.ptp(part.vertices, axis=0) - np.ptp(own.vertices, axis=0)).max() < 0.03
    truth = swing(body, FRAMES, 0.3)
    motion_curves.write_motion(armature, truth, 1)
    assert joint_error(armature, body, truth) < 0.1
    posed = skeleton.evaluated_get(bpy.context.evaluated_depsgraph_get()).pose.bones
    own = armature.evaluated_get(bpy.context.evaluated_depsgraph_get()).pose.bones
    assert (posed["hand_l"].head - own["hand.L"].head).length < 1e-5, "the skin moves with it"


def test_a_skeleton_of_rigifys_deforming_bones_is_tracked_through_rigifys_controls():
    rig = generated_rig()
    for skin in skins.skinned_meshes(rig):
        [modifier] = skin.modifiers
        skeleton = bpy.data.objects.new("game", rig.data.copy())
        modifier.object = skeleton
    bpy.context.scene.collection.objects.link(skeleton)
    bpy.context.view_layer.update()
    for bone in skeleton.pose.bones:
        if bone.bone.use_deform:
            held = bone.constraints.new("COPY_TRANSFORMS")
            held.target, held.subtarget = rig, bone.name
    use_as_body(bpy.context.scene, rig)
    limbs = ("upper_arm", "forearm", "hand", "thigh", "shin", "foot")
    assert {f"{limb}_fk.{side}" for limb in limbs for side in "LR"} < set(body_armature.body_from_armature(rig).names)


def test_a_skeleton_that_follows_controls_is_refused_with_their_name():
    _, skeleton = game_skeleton()
    with pytest.raises(BodyError, match=r"bone pelvis: .* \(make controls active instead, which it follows\)"):
        use_as_body(bpy.context.scene, skeleton)


def test_limbs_with_inverse_kinematics_on_their_own_bones_are_freed_with_a_word():
    armature, remarks = use_as_body(bpy.context.scene, limited_legs())
    body = body_armature.body_from_armature(armature)
    assert {"shin.L", "foot.L", "shin.R", "foot.R"} < set(body.names)
    assert remarks == tuple(
        f"bone shin.{side}: its constraint 'IK' is muted now: the limb is turned by its own bones" for side in "LR"
    )


def test_motion_for_a_file_goes_to_the_controls_and_not_to_the_skeleton_that_follows_them():
    controls, skeleton = game_skeleton()
    assert find_target(None) == controls
    assert find_target("game") == skeleton


def test_a_skeleton_that_is_sent_a_motion_no_longer_follows_with_one_word():
    _, skeleton = game_skeleton()
    report = send_to_rig(bpy.context.scene, motion_of_body(BODY, swing(BODY, FRAMES, 0.3), "man", 30.0), skeleton, 1)
    [said] = report["warnings"]
    assert said.startswith("armature game: its bones do not follow controls in the new action")
    assert max(limb["worst_degrees"] for limb in report["error"].values()) < 0.1


def test_an_instance_of_a_linked_character_becomes_a_performer_where_it_stands(tmp_path):
    linked(unreal_like, tmp_path)
    scene, collection = bpy.context.scene, bpy.data.collections["character"]
    scene.collection.children.unlink(collection)
    place = Matrix.LocRotScale((2.0, 1.0, 0.0), Euler((0.0, 0.0, 1.0)), (HALF,) * 3)
    for name, matrix in (("another", Matrix.Identity(4)), ("character", place)):
        instance = bpy.data.objects.new(name, None)
        instance.instance_type, instance.instance_collection = "COLLECTION", collection
        instance.matrix_world = matrix
        scene.collection.objects.link(instance)
    bpy.context.view_layer.objects.active = instance
    assert bpy.ops.kfmocap.use_armature() == {"FINISHED"}
    assert bpy.context.active_object == bpy.context.scene.kfmocap.performers[0].armature, "to be posed"
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "shot.blend"))
    [slot] = bpy.context.scene.kfmocap.performers
    assert np.allclose(slot.armature.matrix_world, place, atol=1e-6)
    body = body_armature.body_from_armature(slot.armature)
    assert len(body) == len(BODY)
    assert body.parts[0].head_world[2] == pytest.approx(HALF * BODY.parts[0].head_world[2], abs=1e-5)
    assert {o.name: o.instance_type for o in bpy.context.scene.objects if o.type == "EMPTY"} == {
        "character": "NONE",
        "another": "COLLECTION",
    }, "it is not shown a second time"


def test_a_linked_character_has_landmarks_and_soles_that_a_saved_file_keeps(tmp_path):
    given = linked(unreal_like, tmp_path)  # opens another file
    armature, _ = use_as_body(bpy.context.scene, given)
    found = body_armature.body_from_armature(armature)
    own = body_armature.body_from_armature(use_as_body(bpy.context.scene, unreal_like())[0])
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "shot.blend"))
    read = body_armature.body_from_armature(bpy.context.scene.kfmocap.performers[0].armature)
    assert Soles.of(read) is not None
    for body in (found, read):
        assert list(body.landmarks) == list(own.landmarks)
        for name, (part, point) in body.landmarks.items():
            assert (part, point) == (own.landmarks[name][0], pytest.approx(own.landmarks[name][1], abs=1e-5))
