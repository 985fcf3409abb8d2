"""How bodies are drawn over the footage."""

from __future__ import annotations

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from addon_shots import metarig, shot  # noqa: E402
from kfmocap.kfmocap_addon.overlays import model_outlines  # noqa: E402
from kfmocap.kfmocap_addon.scene_io import scene as scenes  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.body import part_meshes, shown_model  # noqa: E402

pytest_plugins = ("addon_fixtures",)

pytestmark = pytest.mark.blender


@pytest.fixture
def built(blender, tmp_path):
    return scenes.build_scene(shot(tmp_path, ("man", "woman")), scene=bpy.context.scene)


def test_bones_that_are_shown_alone_are_rings_around_the_parts(built):
    assert shown_model.SHAPE not in bpy.data.objects
    built.kfmocap.display = "NONE"
    for slot in built.kfmocap.performers:
        assert slot.armature.data.show_bone_custom_shapes
        clouds = part_meshes.part_clouds(slot.armature)
        for bone in slot.armature.pose.bones:
            corners = np.array([corner.co for corner in bone.custom_shape.data.vertices])
            drawn = corners * bone.length * np.array(bone.custom_shape_scale_xyz)
            assert (np.abs(drawn[:, [0, 2]]).max(axis=0) > np.abs(clouds[bone.name][:, [0, 2]]).max(axis=0)).all()
            assert (drawn[:, 1].min(), drawn[:, 1].max()) == pytest.approx((0.0, bone.length), abs=1e-6)
    assert [thing.name for thing in bpy.data.objects if thing.name.startswith(shown_model.SHAPE)] == [shown_model.SHAPE]
    assert shown_model.SHAPE not in built.objects
    built.kfmocap.display = "OUTLINE"
    assert not any(slot.armature.data.show_bone_custom_shapes for slot in built.kfmocap.performers)


def test_a_shape_of_the_animators_stays(built):
    armature = built.kfmocap.performers[0].armature
    mine = bpy.data.objects.new("mine", None)
    armature.pose.bones["hand.L"].custom_shape = mine
    built.kfmocap.display = "NONE"
    assert armature.pose.bones["hand.L"].custom_shape == mine
    assert armature.pose.bones["hand.R"].custom_shape.name == shown_model.SHAPE


def test_other_rigs_are_drawn_as_they_were(built):
    rig = metarig()
    built.kfmocap.performers[1].armature = rig
    built.kfmocap.display = "NONE"
    assert rig.data.show_bone_custom_shapes and not any(bone.custom_shape for bone in rig.pose.bones)
    built.kfmocap.display = "WIRE"
    assert rig.data.show_bone_custom_shapes


def test_a_local_view_shows_the_outlines_of_the_bodies_in_it_alone(built):
    graph, [man, woman] = bpy.context.evaluated_depsgraph_get(), built.kfmocap.performers
    area = next(area for area in bpy.context.window.screen.areas if area.type == "VIEW_3D")
    region = next(region for region in area.regions if region.type == "WINDOW")

    def parts() -> int:
        return len(list(model_outlines.posed_solids(built, graph, area.spaces.active)))

    everybody = parts()
    for thing in built.objects:
        thing.select_set(thing == woman.armature)
    with bpy.context.temp_override(window=bpy.context.window, area=area, region=region):
        bpy.ops.view3d.localview()
    assert (
        parts()
        == len(part_meshes.part_clouds(woman.armature))
        == everybody - len(part_meshes.part_clouds(man.armature))
    )
