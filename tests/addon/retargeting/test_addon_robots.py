"""Robots, whose bones carry meshes, are tracked as they are shown: with modifiers, and with what hangs on a mesh."""

from __future__ import annotations

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from kfmocap.kfmocap_addon.retargeting.tracked_bodies.skinned_body import use_as_body  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.body import body_armature, part_meshes  # noqa: E402
from mathutils import Matrix  # noqa: E402

pytest_plugins = ("addon_fixtures",)

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("blender")]

BOX = np.array(np.meshgrid([0.0, 0.1], [-0.1, 0.1], [-0.1, 0.1])).reshape(3, -1).T
"""On one side of x = 0, metres."""


def linked(name, corners=BOX):
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(np.asarray(corners).tolist(), [], [])
    made = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(made)
    return made


def robot():
    """Three bones, one above the other, with a box on the middle of each."""
    armature = bpy.data.objects.new("robot", bpy.data.armatures.new("robot"))
    bpy.context.scene.collection.objects.link(armature)
    boxes = []
    with body_armature.edit_bones(armature) as bones:
        above = None
        for i, name in enumerate(("hips", "waist", "top")):
            bone = bones.new(name)
            bone.head, bone.tail, bone.parent = (0, 0, 0.4 * i), (0, 0, 0.4 * i + 0.4), above
            above = bone
    for i, bone in enumerate(armature.data.bones):
        box = linked(f"box {bone.name}")
        box.parent, box.parent_type, box.parent_bone = armature, "BONE", bone.name
        bpy.context.view_layer.update()
        box.matrix_world = Matrix.Translation((0, 0, 0.4 * i + 0.2))
        boxes.append(box)
    bpy.context.view_layer.update()
    return armature, boxes


def extents(armature):
    """Size of every part along the world's axes, at rest."""
    use_as_body(bpy.context.scene, armature)
    body = body_armature.body_from_armature(armature)
    return {part.name: np.ptp(part.vertices @ part.R_world_rest.T, axis=0) for part in body.parts}


def test_meshes_that_are_shown_as_they_are_stay_the_parts():
    armature, boxes = robot()
    found = extents(armature)
    assert set(found) == {"hips", "waist", "top"}
    np.testing.assert_allclose(list(found.values()), [[0.1, 0.2, 0.2]] * 3, atol=1e-6)
    assert set(part_meshes.parts_of(armature)) == set(boxes)


def test_the_half_that_a_modifier_mirrors_belongs_to_the_part():
    armature, boxes = robot()
    boxes[1].modifiers.new("Mirror", "MIRROR")
    found = extents(armature)
    np.testing.assert_allclose(found["waist"], [0.2, 0.2, 0.2], atol=1e-6)
    np.testing.assert_allclose(found["top"], [0.1, 0.2, 0.2], atol=1e-6)


def test_meshes_that_hang_on_a_part_by_empties_belong_to_it():
    armature, boxes = robot()
    empty = bpy.data.objects.new("empty", None)
    bpy.context.scene.collection.objects.link(empty)
    empty.parent, empty.location = boxes[2], (0, 0, 0.3)
    hat = linked("hat")
    hat.parent, hat.location = empty, (0, 0.5, 0)
    bpy.context.view_layer.update()
    found = extents(armature)
    np.testing.assert_allclose(found["top"], [0.1, 0.7, 0.5], atol=0.02)
    np.testing.assert_allclose(found["waist"], [0.1, 0.2, 0.2], atol=1e-6)


def test_meshes_out_of_sight_that_hang_on_a_part_do_not_belong_to_it():
    armature, boxes = robot()
    hidden = linked("collision shape")
    hidden.parent, hidden.location, hidden.hide_viewport = boxes[2], (0, 0.5, 0), True
    bpy.context.view_layer.update()
    found = extents(armature)
    np.testing.assert_allclose(found["top"], [0.1, 0.2, 0.2], atol=1e-6)
    assert set(part_meshes.parts_of(armature)) == set(boxes)


def test_meshes_on_a_bone_that_is_gone_are_left_out():
    armature, boxes = robot()
    boxes[1].modifiers.new("Mirror", "MIRROR")
    lost = linked("lost")
    lost.parent, lost.parent_type, lost.parent_bone = armature, "BONE", "renamed"
    assert set(extents(armature)) == {"hips", "waist", "top"}


def test_dense_meshes_become_parts_with_few_corners():
    armature, boxes = robot()
    points = np.random.default_rng(0).normal(size=(2000, 3))
    ball = bpy.data.meshes.new("ball")
    ball.from_pydata((0.1 * points / np.linalg.norm(points, axis=1, keepdims=True)).tolist(), [], [])
    boxes[1].data = ball
    use_as_body(bpy.context.scene, armature)
    body = body_armature.body_from_armature(armature)
    assert [len(part.vertices) for part in body.parts] == [8, 24, 8]
