"""Motion sent to armatures of Blender: what Blender shows is what was asked for, and the rig's own keys stay."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")
import bmesh  # noqa: E402
from addon_shots import metarig, shot  # noqa: E402
from kfmocap.__main__ import main  # noqa: E402
from kfmocap.core.body import human  # noqa: E402
from kfmocap.core.errors import BodyError, ShotError  # noqa: E402
from kfmocap.core.retargeting.bone_roles.bone_presets import PRESETS  # noqa: E402
from kfmocap.core.retargeting.retarget import prepared  # noqa: E402
from kfmocap.kfmocap_addon.export import exporters  # noqa: E402
from kfmocap.kfmocap_addon.export.export_options import ExportOptions  # noqa: E402
from kfmocap.kfmocap_addon.properties import pointer_polls  # noqa: E402
from kfmocap.kfmocap_addon.properties.retarget_properties import KFMocapRetarget  # noqa: E402
from kfmocap.kfmocap_addon.retargeting import live  # noqa: E402
from kfmocap.kfmocap_addon.retargeting.character_files import save_copy, show_scene_of  # noqa: E402
from kfmocap.kfmocap_addon.retargeting.imported_files import import_alone  # noqa: E402
from kfmocap.kfmocap_addon.retargeting.motion_files import read_motion  # noqa: E402
from kfmocap.kfmocap_addon.retargeting.rigs.overrides import editable  # noqa: E402
from kfmocap.kfmocap_addon.retargeting.rigs.rig_curves import CurveOptions  # noqa: E402
from kfmocap.kfmocap_addon.retargeting.send import SendOptions, send_to_rig  # noqa: E402
from kfmocap.kfmocap_addon.retargeting.shown_characters import show_in  # noqa: E402
from kfmocap.kfmocap_addon.retargeting.source_motion import motion_of_armature  # noqa: E402
from kfmocap.kfmocap_addon.retargeting.target_armatures import find_target  # noqa: E402
from kfmocap.kfmocap_addon.scene_io import scene  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.body import body_armature  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.body.body_armature import edit_bones  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.keys import motion_curves  # noqa: E402
from made_rigs import made_rig, moved_body, wild_motion  # noqa: E402
from mathutils import Matrix, Vector  # noqa: E402
from odd_characters import bind  # noqa: E402

pytest_plugins = ("addon_fixtures",)

pytestmark = pytest.mark.blender

BODY = human(1.75)
FRAMES = 5


FBX_AS_TEXT = """; FBX 7.4.0 project file
FBXHeaderExtension: {
    FBXVersion: 7400
}
GlobalSettings: {
    Properties70: {
        P: "UpAxis", "int", "Integer", "", 1
        P: "FrontAxis", "int", "Integer", "", 2
        P: "CoordAxis", "int", "Integer", "", 0
        P: "UnitScaleFactor", "double", "Number", "", 1
    }
}
Objects: {
    NodeAttribute: 1, "NodeAttribute::Hips", "LimbNode" {
    }
    Model: 2, "Model::Hips", "LimbNode" {
        Properties70: {
            P: "Lcl Translation", "Lcl Translation", "", "A", 0, 95, 0
        }
    }
    NodeAttribute: 3, "NodeAttribute::Spine", "LimbNode" {
    }
    Model: 4, "Model::Spine", "LimbNode" {
        Properties70: {
            P: "Lcl Translation", "Lcl Translation", "", "A", 0, 10, 0
        }
    }
}
Connections: {
    C: "OO", 2, 0
    C: "OO", 1, 2
    C: "OO", 4, 2
    C: "OO", 3, 4
}
"""
"""Two bones, in centimetres, y up."""


def built(preset, droop=0.0, name="hero"):
    """An armature with the bones of a made rig."""
    rig = made_rig(preset, BODY, droop)
    armature = bpy.data.objects.new(name, bpy.data.armatures.new(name))
    bpy.context.scene.collection.objects.link(armature)
    with edit_bones(armature) as bones:
        for b, bone_name in enumerate(rig.rest.names):
            bone = bones.new(bone_name)
            bone.head, bone.tail = (Vector(point[b]) for point in (rig.rest.heads, rig.rest.tails))
            bone.roll = 0.3 * b
            parent = rig.rest.parents[b]
            bone.parent = bones[parent] if parent >= 0 else None
    return armature


def source(frames=FRAMES):
    return moved_body(BODY, wild_motion(frames))


def shown_joints(armature, names, frames=FRAMES):
    """Heads of bones in the world on every frame, (F, B, 3)."""
    found = []
    for frame in range(1, frames + 1):
        bpy.context.scene.frame_set(frame)
        found.append([armature.matrix_world @ armature.pose.bones[name].head for name in names])
    return np.array(found)


LIMBS = ["upper_arm", "forearm", "hand", "thigh", "shin", "foot"]
JOINTS = [f"{limb}.{side}" for side in "LR" for limb in LIMBS]


def joint_errors(armature, report, given, frames=FRAMES):
    """Largest distance of a limb's joint from the source's, metres; arms from the shoulder, since spines differ."""
    names = [report["target"]["bones"][role][0] for role in JOINTS]
    own, shown = given.positions[:, given.rest.indices(JOINTS)], shown_joints(armature, names, frames)
    for joints in (own, shown):
        for arm in (slice(0, 3), slice(6, 9)):
            joints[:, arm] -= joints[:, arm][:, :1]
    return np.abs(shown - own).max()


@pytest.mark.parametrize("mode", ["QUATERNION", "XYZ", "ZXY", "AXIS_ANGLE"])
def test_in_every_rotation_mode_blender_shows_the_sources_joints(blender, mode):
    armature = built("mixamo", np.radians(45))
    for bone in armature.pose.bones:
        bone.rotation_mode = mode
    given = source()
    report = send_to_rig(bpy.context.scene, given, armature, 1)
    assert joint_errors(armature, report, given) < 1e-4
    assert report["warnings"] == []


def test_a_scaled_and_turned_object_is_respected(blender):
    armature = built("unreal")
    armature.data.transform(Matrix.Scale(100.0, 4) @ Matrix.Rotation(-np.pi / 2, 4, "X"))
    armature.matrix_world = Matrix.Scale(0.01, 4) @ Matrix.Rotation(np.pi / 2, 4, "X")
    bpy.context.view_layer.update()
    given = source()
    report = send_to_rig(bpy.context.scene, given, armature, 1)
    assert joint_errors(armature, report, given) < 1e-4


def test_a_mechanism_is_driven_through_its_controls(blender):
    """The arm's control hangs on nothing, but a constraint carries it along with the chest."""
    armature = built("unity")
    with edit_bones(armature) as bones:
        carrier = bones.new("carrier")
        carrier.head, carrier.tail = bones["LeftUpperArm"].head, bones["LeftUpperArm"].tail
        bones["LeftUpperArm"].parent = carrier
    child_of = armature.pose.bones["carrier"].constraints.new("ARMATURE")
    child_of.targets.new().target = armature
    child_of.targets[0].subtarget = "UpperChest"
    given = source()
    report = send_to_rig(bpy.context.scene, given, armature, 1)
    assert joint_errors(armature, report, given) < 1e-4


def test_the_old_action_stays_and_becomes_a_strip_below(blender):
    armature = built("vrm")
    old = bpy.data.actions.new("old")
    armature.animation_data_create().action = old
    send_to_rig(bpy.context.scene, source(), armature, 1, SendOptions(curves=CurveOptions(layer=True)))
    assert armature.animation_data.action != old
    assert [strip.action for track in armature.animation_data.nla_tracks for strip in track.strips] == [old]


def test_fewer_keys_stay_within_the_tolerance(blender):
    armature = built("mixamo")
    given = moved_body(BODY, wild_motion(FRAMES)[[0] * FRAMES])
    whole = send_to_rig(bpy.context.scene, given, armature, 1)
    few = send_to_rig(
        bpy.context.scene, given, armature, 1, SendOptions(curves=CurveOptions(angle=0.01, distance=0.001))
    )
    assert few["keys"] < 0.5 * whole["keys"]
    assert joint_errors(armature, few, given) < 0.01


def save_character(path) -> None:
    """Save the open scene's character, or export it with a skin."""
    if path.suffix == ".blend":
        bpy.context.view_layer.objects.active = bpy.data.objects["hero"]
        bpy.ops.object.mode_set(mode="EDIT")
        bpy.ops.wm.save_as_mainfile(filepath=str(path))
        return
    armature = bpy.data.objects["hero"]
    corner = 0.1 * np.eye(3)
    skin = bind(armature, "skin", [(bone.name, np.array(bone.head_local) + corner) for bone in armature.data.bones])
    skin.parent, mesh = armature, bmesh.new()
    mesh.from_mesh(skin.data)
    corners = list(mesh.verts)
    for triangle in zip(corners[::3], corners[1::3], corners[2::3], strict=True):
        mesh.faces.new(triangle)
    mesh.to_mesh(skin.data)
    mesh.free()
    export = bpy.ops.export_scene.fbx if path.suffix == ".fbx" else bpy.ops.export_scene.gltf
    export(filepath=str(path))


@pytest.mark.parametrize(("kind", "file"), [("bvh", "blend"), ("fbx", "fbx"), ("bvh", "glb")])
def test_the_command_line_moves_a_character(blender, tmp_path, capsys, kind, file):
    """One of a .blend file, even if it was saved in edit mode, or of another program's file."""
    motion = wild_motion(FRAMES)
    performer = body_armature.build_armature(BODY, "man", bpy.context.scene.collection)
    motion_curves.write_motion(performer, motion, 1)
    take = tmp_path / f"take.{kind}"
    write = {"bvh": exporters.export_bvh, "fbx": exporters.export_fbx}[kind]
    write(take, performer, bpy.context.scene, ExportOptions(frames=(1, FRAMES)))
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    built("mixamo", np.radians(45))
    save_character(tmp_path / f"hero.{file}")
    out = tmp_path / "moved.blend"
    assert main(["retarget", str(take), "--to", str(tmp_path / f"hero.{file}"), "--out", str(out)]) == 0
    assert capsys.readouterr().out.split()[-2:] == [str(out), str(out.with_suffix(".report.json"))]
    report = json.loads(out.with_suffix(".report.json").read_text())
    bpy.ops.wm.open_mainfile(filepath=str(out))
    armature = bpy.data.objects["hero"]
    given, _ = prepared(moved_body(BODY, motion))
    assert joint_errors(armature, report, given) < 1e-4
    assert (bpy.context.scene.frame_start, bpy.context.scene.frame_end) == (1, FRAMES)


def test_the_way_of_hips_that_are_the_only_bones_on_a_root_is_read_from_fbx_files(blender, tmp_path):
    """Blender's importer connects them to the root, and shows no place of connected bones then."""
    armature = body_armature.build_armature(BODY, "man", bpy.context.scene.collection)
    with edit_bones(armature) as bones:
        root = bones.new("root")
        root.head, root.tail = (0.0, 0.0, 0.0), (0.0, 0.0, 0.1)
        bones["pelvis"].parent = root
    for frame, place in ((1, 0.0), (5, 0.4)):
        armature.pose.bones["pelvis"].location = (place, 0.0, 0.0)
        armature.pose.bones["pelvis"].keyframe_insert("location", frame=frame)
    bpy.context.view_layer.update()
    exporters.export_fbx(tmp_path / "walk.fbx", armature, bpy.context.scene, ExportOptions(frames=(1, 5)))
    motion, _ = read_motion(tmp_path / "walk.fbx")
    way = motion.positions[:, motion.rest.indices(["pelvis"])[0]]
    assert np.linalg.norm(way[-1] - way[0]) == pytest.approx(0.4, abs=1e-4)


def test_a_damaged_fbx_file_is_refused_in_one_line(blender, tmp_path):
    armature = built("mixamo")
    send_to_rig(bpy.context.scene, source(), armature, 1)
    bpy.ops.export_scene.fbx(filepath=str(tmp_path / "cut.fbx"), object_types={"ARMATURE"})
    data = (tmp_path / "cut.fbx").read_bytes()
    (tmp_path / "cut.fbx").write_bytes(data[: len(data) // 2])
    with pytest.raises(ShotError, match=r"cut\.fbx: Blender cannot read it: ") as refused:
        read_motion(tmp_path / "cut.fbx")
    assert "Traceback" not in str(refused.value)
    assert "\n" not in str(refused.value)


def test_an_fbx_file_with_a_light_is_read(blender, tmp_path):
    armature = built("mixamo")
    send_to_rig(bpy.context.scene, source(), armature, 1)
    lamp = bpy.data.objects.new("lamp", bpy.data.lights.new("lamp", "POINT"))
    bpy.context.scene.collection.objects.link(lamp)
    bpy.ops.export_scene.fbx(filepath=str(tmp_path / "lit.fbx"), object_types={"ARMATURE", "LIGHT"})
    motion, _ = read_motion(tmp_path / "lit.fbx")
    assert len(motion) == FRAMES


def test_an_fbx_file_as_text_is_read(blender, tmp_path):
    """Blender's importer written in Python reads binary files only."""
    (tmp_path / "text.fbx").write_text(FBX_AS_TEXT)
    import_alone(tmp_path / "text.fbx")
    [armature] = [o for o in bpy.data.objects if o.type == "ARMATURE"]
    heads = [tuple(armature.matrix_world @ bone.head_local) for bone in armature.data.bones]
    assert [bone.name for bone in armature.data.bones] == ["Hips", "Spine"]
    assert heads == [pytest.approx((0, 0, 0.95), abs=1e-4), pytest.approx((0, 0, 1.05), abs=1e-4)]


def test_a_linked_character_moves_through_an_override(blender, tmp_path):
    hero = built("mixamo", np.radians(45))
    collection = bpy.data.collections.new("hero")
    collection.objects.link(hero)
    bpy.data.libraries.write(str(tmp_path / "library.blend"), {collection})
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    with bpy.data.libraries.load(str(tmp_path / "library.blend"), link=True) as (_, wanted):
        wanted.collections = ["hero"]
    instance = bpy.data.objects.new("instance", None)
    instance.instance_type, instance.instance_collection = "COLLECTION", bpy.data.collections["hero"]
    bpy.context.scene.collection.objects.link(instance)
    armature = editable(find_target(None), bpy.context.scene)
    assert armature.library is None
    given = source()
    assert joint_errors(armature, send_to_rig(bpy.context.scene, given, armature, 1), given) < 1e-4
    assert find_target("hero") == armature


def test_a_character_that_only_an_instance_shows_moves_there_and_is_not_shown_twice(blender):
    hero, shown = built("mixamo", np.radians(45)), bpy.context.scene
    collection = bpy.data.collections.new("hero")
    collection.objects.link(hero)
    shown.collection.objects.unlink(hero)
    instance = bpy.data.objects.new("instance", None)
    instance.instance_type, instance.instance_collection = "COLLECTION", collection
    shown.collection.objects.link(instance)
    assert not show_in(shown, hero) and show_scene_of(hero) == shown
    report = send_to_rig(shown, source(), hero, 1)
    assert max(error["worst_degrees"] for error in report["error"].values()) < 0.01
    assert list(shown.objects) == [instance]


def one_bone_bvh(frame_time: str) -> str:
    """A BVH file of one frame."""
    skeleton = "HIERARCHY ROOT a { OFFSET 0 0 0 CHANNELS 3 Zrotation Xrotation Yrotation }"
    return f"{skeleton} MOTION Frames: 1 Frame Time: {frame_time} 0 0 0"


def test_what_cannot_be_meant_is_said_by_name(blender, tmp_path, capsys):
    built("mixamo", name="hero")
    built("unreal", name="villain")
    blend, bvh = tmp_path / "two.blend", tmp_path / "no.bvh"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    bvh.write_text(one_bone_bvh("0.04"))
    assert main(["retarget", str(bvh), "--to", str(blend), "--out", str(tmp_path / "out.blend")]) == 1
    assert "hero, villain" in capsys.readouterr().err
    command = ["retarget", str(bvh), "--to", str(blend), "--armature", "hero", "--out", str(tmp_path / "out.blend")]
    assert main(command) == 1
    assert "no bone was found for hips" in capsys.readouterr().err
    assert not (tmp_path / "out.blend").exists()


@pytest.mark.parametrize(
    ("kept", "arguments"),
    [
        ("hero.blend", ("--out", "hero.blend")),
        ("hero.blend", ("--out", "new.blend", "--save-map", "hero.blend")),
        ("walk.json", ("--out", "new.blend", "--source-map", "walk.json", "--save-map", "walk.json")),
    ],
    ids=["out", "map", "source-map"],
)
def test_the_character_and_the_bone_map_of_the_motion_are_never_replaced(blender, tmp_path, capsys, kept, arguments):
    built("mixamo", name="hero")
    blend, bvh = tmp_path / "hero.blend", tmp_path / "walk.bvh"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    bvh.write_text("HIERARCHY")
    (tmp_path / "walk.json").write_text("{}")
    before = (tmp_path / kept).read_bytes()
    places = [text if text.startswith("--") else str(tmp_path / text) for text in arguments]
    assert main(["retarget", str(bvh), "--to", str(blend), *places]) == 1
    assert f"{kept}: would be replaced by the results" in capsys.readouterr().err
    assert (tmp_path / kept).read_bytes() == before


def test_a_motion_without_a_frame_rate_is_refused_in_one_line(blender, tmp_path, capsys):
    built("mixamo", name="hero")
    blend, bvh = tmp_path / "hero.blend", tmp_path / "still.bvh"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    bvh.write_text(one_bone_bvh("0"))
    assert main(["retarget", str(bvh), "--to", str(blend), "--out", str(tmp_path / "new.blend")]) == 1
    assert "still: its frame rate is impossible" in capsys.readouterr().err


@pytest.fixture
def tracked(blender, tmp_path):
    """A tracked performer, and a character beside it that is chosen."""
    scene.build_scene(shot(tmp_path), scene=bpy.context.scene)
    armature = bpy.context.scene.kfmocap.performers[0].armature
    motion_curves.write_motion(armature, wild_motion(12), 1)
    hero = built("mixamo", np.radians(45))
    bpy.context.scene.kfmocap.retarget.target = hero
    return hero


def test_the_operator_takes_the_motion_back(tracked):
    settings = bpy.context.scene.kfmocap.retarget
    assert not bpy.ops.kfmocap.take_motion_back.poll()
    bpy.ops.kfmocap.send_to_rig()
    assert bpy.ops.kfmocap.take_motion_back() == {"FINISHED"}
    assert tracked.animation_data.action is None and not settings.errors
    settings.live = True
    bpy.ops.kfmocap.send_to_rig()
    assert not bpy.ops.kfmocap.take_motion_back.poll()


def test_the_operator_sends_the_performers_motion(tracked):
    assert bpy.ops.kfmocap.send_to_rig() == {"FINISHED"}
    errors = bpy.context.scene.kfmocap.retarget.errors
    assert {error.name for error in errors} == {"trunk", "arm.L", "arm.R", "leg.L", "leg.R"}
    assert max(error.distance for error in errors) < 0.1
    assert len(tracked.animation_data.action.layers[0].strips[0].channelbags[0].fcurves) > 60


def test_what_moves_already_is_not_offered_as_the_character(tracked):
    settings = bpy.context.scene.kfmocap.retarget
    body = bpy.context.scene.kfmocap.performers[0].armature
    assert pointer_polls.is_character(settings, tracked)
    assert not pointer_polls.is_character(settings, body)
    settings.source = tracked
    assert not pointer_polls.is_character(settings, tracked)
    assert pointer_polls.is_character(settings, body)


def test_the_only_other_armature_is_the_character_and_a_live_helper_is_none(tracked):
    settings = bpy.context.scene.kfmocap.retarget
    settings.target, settings.live = None, True
    assert bpy.ops.kfmocap.send_to_rig() == {"FINISHED"}
    assert settings.target == tracked
    settings.target = None
    [helper] = [o for o in bpy.data.objects if o.type == "ARMATURE" and o.name.startswith(live.NAME)]
    assert not pointer_polls.is_character(settings, helper) and not pointer_polls.is_armature(settings, helper)
    assert bpy.ops.kfmocap.find_bones() == {"FINISHED"}
    assert settings.target == tracked
    settings.target = None
    built("unity", 0.0)
    assert not bpy.ops.kfmocap.send_to_rig.poll()


@pytest.mark.parametrize("in_collection", [True, False])
def test_a_character_of_another_scene_moves_where_the_shot_is(tracked, in_collection):
    """A shot is loaded into a scene of its own; what hangs on the character comes along, and the rest does not."""
    here, there = bpy.context.scene, bpy.data.scenes.new("there")
    mesh = bpy.data.objects.new("coat", bpy.data.meshes.new("coat"))
    mesh.modifiers.new("Armature", "ARMATURE").object = tracked
    lamp = bpy.data.objects.new("lamp", bpy.data.lights.new("lamp", "POINT"))
    home = bpy.data.collections.new("hero")
    there.collection.children.link(home)
    for thing in (tracked, mesh, lamp):
        for collection in tuple(thing.users_collection):
            collection.objects.unlink(thing)
        (home if in_collection and thing != lamp else there.collection).objects.link(thing)
    assert bpy.ops.kfmocap.send_to_rig() == {"FINISHED"}
    assert {tracked.name, "coat"} <= set(here.objects.keys()) and "lamp" not in here.objects
    assert ("hero" in here.collection.children) == in_collection
    assert tracked.name in there.objects


def test_an_edited_list_of_bones_is_used_and_comes_back_from_a_file(tracked, tmp_path):
    settings = bpy.context.scene.kfmocap.retarget
    assert bpy.ops.kfmocap.find_bones() == {"FINISHED"}
    next(row for row in settings.bones if row.name == "head").bone = ""
    path = str(tmp_path / "map.json")
    assert bpy.ops.kfmocap.save_bone_map(filepath=path) == {"FINISHED"}
    assert bpy.ops.kfmocap.forget_bones() == {"FINISHED"}
    assert bpy.ops.kfmocap.load_bone_map(filepath=path) == {"FINISHED"}
    assert bpy.ops.kfmocap.send_to_rig() == {"FINISHED"}
    curves = tracked.animation_data.action.layers[0].strips[0].channelbags[0].fcurves
    assert not any("mixamorig:Head" in curve.data_path for curve in curves)


def test_the_panel_offers_every_preset(blender):
    items = KFMocapRetarget.bl_rna.properties["preset"].enum_items
    assert [item.identifier for item in items] == ["auto", *PRESETS]


def test_limbs_held_by_inverse_kinematics_are_freed_in_the_new_action(blender):
    armature = built("mixamo", np.radians(45))
    constraint = armature.pose.bones["mixamorig:LeftLeg"].constraints.new("IK")
    constraint.target = bpy.data.objects.new("goal", None)
    bpy.context.scene.collection.objects.link(constraint.target)
    constraint.chain_count = 2
    given = source()
    report = send_to_rig(bpy.context.scene, given, armature, 1)
    assert joint_errors(armature, report, given) < 1e-4
    assert any("mixamorig:LeftLeg" in text and "IK" in text for text in report["warnings"])


def test_a_bone_that_something_else_holds_is_named_and_nothing_changes(blender):
    armature = built("mixamo", np.radians(45))
    held = armature.pose.bones["mixamorig:LeftLeg"].constraints.new("COPY_ROTATION")
    held.target, held.subtarget = armature, "mixamorig:Hips"
    held.driver_add("influence").driver.expression = "1.0"
    with pytest.raises(BodyError, match=r"bone mixamorig:LeftLeg: the bone does not turn"):
        send_to_rig(bpy.context.scene, source(), armature, 1)
    assert armature.animation_data.action is None


def test_bones_that_the_motion_says_nothing_of_stay_as_they_are_posed(blender):
    armature = built("mixamo")
    bone = armature.pose.bones["mixamorig:LeftShoulder"]
    bone.rotation_quaternion = (0.96, 0.2, 0.1, 0.16)
    body = human(1.75, collar_bones=False)
    given = moved_body(body, wild_motion(FRAMES, collar_bones=False))
    report = send_to_rig(bpy.context.scene, given, armature, 1)
    assert joint_errors(armature, report, given) < 1e-4
    assert tuple(bone.rotation_quaternion) == pytest.approx((0.96, 0.2, 0.1, 0.16))
    assert report["not_in_source"] == ["mixamorig:LeftShoulder", "mixamorig:RightShoulder"]


def test_a_character_in_an_excluded_collection_moves(blender):
    armature = built("mixamo")
    closet = bpy.data.collections.new("closet")
    bpy.context.scene.collection.children.link(closet)
    closet.objects.link(armature)
    bpy.context.scene.collection.objects.unlink(armature)
    layer = bpy.context.view_layer.layer_collection.children["closet"]
    layer.exclude = True
    given = source()
    report = send_to_rig(bpy.context.scene, given, armature, 1)
    layer.exclude = False
    assert joint_errors(armature, report, given) < 1e-4


def test_motion_comes_from_any_armature(blender):
    """From the body to a Mixamo character, and from there to an Unreal one."""
    first, second = built("mixamo", np.radians(45)), built("unreal", name="other")
    given = source()
    send_to_rig(bpy.context.scene, given, first, 1)
    motion, bones = motion_of_armature(bpy.context.scene, first, (1, FRAMES))
    report = send_to_rig(bpy.context.scene, motion, second, 1, SendOptions(source_bones=bones))
    assert joint_errors(second, report, given) < 1e-4


def test_a_time_between_two_frames_stays_shown(blender):
    current, first, second = bpy.context.scene, built("mixamo", np.radians(45)), built("unreal", name="other")
    current.frame_set(3, subframe=0.25)
    send_to_rig(current, source(), first, 1)
    assert (current.frame_current, current.frame_subframe) == (3, 0.25)
    motion, bones = motion_of_armature(current, first, (1, FRAMES))
    assert (current.frame_current, current.frame_subframe) == (3, 0.25)
    send_to_rig(current, motion, second, 1, SendOptions(source_bones=bones))
    assert (current.frame_current, current.frame_subframe) == (3, 0.25)


def test_the_operator_sends_another_armatures_motion(tracked):
    settings = bpy.context.scene.kfmocap.retarget
    assert bpy.ops.kfmocap.send_to_rig() == {"FINISHED"}
    settings.source, settings.target = tracked, built("unreal", name="other")
    bpy.context.scene.frame_end = 3
    assert bpy.ops.kfmocap.send_to_rig() == {"FINISHED"}
    assert settings.target.animation_data.action is not None


def test_relative_paths_of_a_character_still_lead_where_they_led(blender, tmp_path):
    (tmp_path / "deep").mkdir()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "character.blend"))
    bpy.data.images.new("skin", 4, 4).filepath = "//skin.png"
    bpy.data.images["skin"].source = "FILE"
    bpy.data.images["skin"].use_fake_user = True
    save_copy(tmp_path / "deep" / "moved.blend")
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "deep" / "moved.blend"))
    assert Path(bpy.path.abspath(bpy.data.images["skin"].filepath)).resolve() == tmp_path / "skin.png"
    assert [file.name for file in (tmp_path / "deep").iterdir()] == ["moved.blend"]


@pytest.mark.parametrize("root", ["world", "in-place", "root-bone"])
def test_a_character_that_follows_live_does_what_keys_would_make_it_do(tracked, root):
    """Also after the performer was posed anew; and it is as it was when it stops."""
    settings = bpy.context.scene.kfmocap.retarget
    hero = settings.target = built("unreal", np.radians(45), "walker")
    with edit_bones(hero) as bones:
        ground = bones.new("root")
        ground.head, ground.tail = (0, 0.1, 0), (0, 0.3, 0)
        bones["pelvis"].parent = ground
    settings.root, settings.feet, settings.live = root, "off", True
    names = [bone.name for bone in hero.pose.bones]
    assert bpy.ops.kfmocap.send_to_rig() == {"FINISHED"}
    assert hero.animation_data is None or hero.animation_data.action is None
    assert max(error.distance for error in settings.errors) < 0.1
    performer = bpy.context.scene.kfmocap.performers[0].armature
    motion_curves.write_motion(performer, wild_motion(12, seed=1), 1)
    followed = shown_joints(hero, names)
    settings.live = False
    assert bpy.ops.kfmocap.send_to_rig() == {"FINISHED"}
    assert not any(bone.constraints for bone in hero.pose.bones)
    assert not any(o.name.startswith("KF Mocap Live") for o in bpy.data.objects)
    keyed = shown_joints(hero, names)
    keyed[..., :2] += (followed[0] - keyed[0])[names.index("pelvis"), :2]  # now over another first pose
    assert np.abs(followed - keyed).max() < 1e-4


def test_a_hand_shape_is_keyed_on_whatever_axes_the_fingers_have(blender):
    """On Rigify's metarig: fingertips come near the palm, in quaternions and in Euler angles."""
    rig = metarig()

    def apart():
        bpy.context.view_layer.update()
        ends = [(rig.pose.bones[f"f_middle.03.{s}"].tail - rig.pose.bones[f"hand.{s}"].head).length for s in "LR"]
        return np.array(ends)

    before = apart()
    assert bpy.ops.kfmocap.hand_shape(shape="fist") == {"FINISHED"}
    assert (apart() < 0.7 * before).all()
    bags = rig.animation_data.action.layers[0].strips[0].channelbags
    assert {len(curve.keyframe_points) for curve in bags[0].fcurves} == {1}
    assert len({curve.data_path for curve in bags[0].fcurves}) == 30
