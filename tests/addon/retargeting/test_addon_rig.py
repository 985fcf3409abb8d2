"""A body becomes an armature with its parts, and is read back from it."""

from __future__ import annotations

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from addon_shots import joint_error, motion, person  # noqa: E402
from kfmocap.core.body import human, part_poses  # noqa: E402
from kfmocap.core.errors import BodyError  # noqa: E402
from kfmocap.core.numerics import rotations  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.body import armature_landmarks, body_armature, sides  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.keys import motion_curves  # noqa: E402
from mathutils import Matrix  # noqa: E402

pytest_plugins = ("addon_fixtures",)

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("blender")]


@pytest.fixture
def body():
    return human(1.83, {"thigh.L": 0.47, "forearm": 0.26})


@pytest.fixture
def armature(blender, body):
    return body_armature.build_armature(body, "man", bpy.context.scene.collection)


def test_a_bones_rest_matrix_is_its_parts_rest_frame(armature, body):
    for part in body.parts:
        matrix = np.array(armature.data.bones[part.name].matrix_local)
        assert np.abs(matrix[:3, :3] - part.R_world_rest).max() < 1e-6
        assert np.abs(matrix[:3, 3] - part.head_world).max() < 1e-6


def test_a_body_comes_back_from_its_armature(armature, body):
    read = body_armature.body_from_armature(armature)
    assert read.names == body.names and read.parents == body.parents
    assert list(read.landmarks) == list(body.landmarks)
    for name, (part, point) in body.landmarks.items():
        assert read.landmarks[name][0] == part and np.array_equal(read.landmarks[name][1], point)
    assert np.array_equal(read.limits, body.limits)
    for got, part in zip(read.parts, body.parts, strict=True):
        assert np.abs(got.vertices - part.vertices).max() < 1e-6
        assert np.abs(got.tail_world - part.tail_world).max() < 1e-6
        assert np.abs(got.R_world_rest - part.R_world_rest).max() < 1e-6


def test_landmarks_and_limits_survive_the_renaming_of_a_bone(armature, body):
    armature.data.bones["forearm.L"].name = "lower_arm.L"
    read = body_armature.body_from_armature(armature)
    assert read.names[read.landmarks["LElbow"][0]] == "lower_arm.L"
    assert np.array_equal(read.limits, body.limits)


def test_joints_and_parts_evaluate_as_the_core_says(armature, body):
    truth = motion(8)
    motion_curves.write_motion(armature, truth, 1)
    assert joint_error(armature, body, truth) < 0.05
    bpy.context.scene.frame_set(8)
    R, T = part_poses(body, truth)
    graph = bpy.context.evaluated_depsgraph_get()
    for i, part in enumerate(body.parts):
        child = bpy.data.objects[f"man {part.name}"].evaluated_get(graph)
        seen = np.array([child.matrix_world @ vertex.co for vertex in child.data.vertices])
        assert np.abs(seen - part.vertices @ R[-1, i].T - T[-1, i]).max() < 5e-5


def test_a_moved_armature_object_changes_neither_body_nor_motion(armature, body):
    truth = motion(8)
    turn = rotations.exp(np.array([0.3, -0.8, 1.9]))
    armature.matrix_world = Matrix.Translation((1, -2, 0.5)) @ Matrix(turn.tolist()).to_4x4()
    bpy.context.view_layer.update()
    read = body_armature.body_from_armature(armature)
    assert np.allclose(read.offsets[1:], body.offsets[1:], atol=1e-6)
    seen = body_armature.body_from_armature(armature)
    motion_curves.write_motion(armature, truth, 1)
    assert joint_error(armature, seen, truth) < 0.05


def test_parts_cannot_be_picked_and_are_drawn_as_wire_in_front(armature, body):
    assert len(armature.children) == len(body)
    for child in armature.children:
        assert child.hide_select and child.show_in_front and child.display_type == "WIRE"
    groups = {bone.name: {c.name for c in bone.collections} for bone in armature.data.bones}
    assert groups["hand.L"] == {"Left"} and groups["hand.R"] == {"Right"} and groups["head"] == {"Middle"}
    left, right = (armature.data.bones[f"hand.{side}"].color for side in "LR")
    assert left.palette == "CUSTOM" and left.custom.normal[2] > 0.9 > 0.5 > right.custom.normal[2]


@pytest.mark.parametrize(
    ("side", "names"),
    [
        ("L", ["hand.L", "LWrist", "mixamorig:LeftHand", "upperarm_l", "Bip01 L Thigh"]),
        ("R", ["hand.R", "RBigToe", "mixamorig:RightUpLeg", "calf_r", "J_Bip_R_Foot"]),
        ("", ["head", "ROOT", "RIG-spine", "mixamorig:Hips", "LOWER_BODY"]),
    ],
)
def test_sides_are_known_of_landmarks_and_of_the_bones_of_any_rig(side, names):
    assert [sides.side_of(name) for name in names] == [side] * len(names)


def test_an_armature_that_cannot_be_a_body_is_refused_by_name(armature):
    armature.scale = (1, 1, 1.1)
    bpy.context.view_layer.update()
    with pytest.raises(BodyError, match=r"armature man.*scaled"):
        body_armature.body_from_armature(armature)
    armature.scale = (1, 1, 1)
    bpy.context.view_layer.update()
    bpy.data.objects.remove(bpy.data.objects["man shin.L"])
    with pytest.raises(BodyError, match=r"bone shin\.L.*no mesh"):
        body_armature.body_from_armature(armature)


def test_an_armature_of_another_origin_is_a_body_if_its_bones_carry_meshes():
    own = body_armature.build_armature(person(), "man", bpy.context.scene.collection)
    for bone in own.data.bones:
        for name in (body_armature.PART, body_armature.LIMITS, armature_landmarks.LANDMARKS):
            del bone[name]
    read = body_armature.body_from_armature(own)
    assert set(read.names) == set(person().names)
    assert set(read.landmarks) == set(read.names)


def test_building_leaves_the_users_selection_and_mode(armature):
    other = bpy.data.objects.new("other", None)
    bpy.context.scene.collection.objects.link(other)
    bpy.context.view_layer.objects.active = other
    body_armature.build_armature(person(), "second", bpy.context.scene.collection)
    assert bpy.context.view_layer.objects.active == other
    assert bpy.context.mode == "OBJECT"
