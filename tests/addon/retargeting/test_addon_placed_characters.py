"""Characters that were placed, turned and scaled by their controls: tracked, exported and moved where they are."""

from __future__ import annotations

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")
from addon_shots import joint_error  # noqa: E402
from kfmocap.core.body.motion import Motion  # noqa: E402
from kfmocap.core.body.skeleton_motion import motion_of_body  # noqa: E402
from kfmocap.core.errors import BodyError, OutputError  # noqa: E402
from kfmocap.core.formats.bvh import read_bvh  # noqa: E402
from kfmocap.core.retargeting.transfer import RetargetOptions  # noqa: E402
from kfmocap.kfmocap_addon.export import exporters  # noqa: E402
from kfmocap.kfmocap_addon.export.export_options import ExportOptions  # noqa: E402
from kfmocap.kfmocap_addon.retargeting.live import LiveSource  # noqa: E402
from kfmocap.kfmocap_addon.retargeting.send import SendOptions, send_to_rig  # noqa: E402
from kfmocap.kfmocap_addon.retargeting.source_motion import motion_of_armature  # noqa: E402
from kfmocap.kfmocap_addon.retargeting.tracked_bodies.skinned_body import use_as_body  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.body import body_armature, part_meshes  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.keys import motion_curves  # noqa: E402
from made_rigs import moved_body  # noqa: E402
from mathutils import Matrix  # noqa: E402
from odd_characters import (  # noqa: E402
    BODY,
    CONTROL,
    add_bones,
    bind,
    controlled_human,
    shown_heads,
    skinned_human,
    switched_human,
    unreal_like,
)
from render.motions import MOTIONS  # noqa: E402
from scipy.spatial.transform import Rotation  # noqa: E402
from synthetic import swing  # noqa: E402

pytest_plugins = ("addon_fixtures",)

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("blender")]

FRAMES, HALF = 8, 0.5


def following_root():
    """A control rig whose topmost control follows the root by a constraint, as Rigify's torso does."""
    armature = controlled_human()
    with body_armature.edit_bones(armature) as bones:
        between, pelvis = bones.new("MCH-pelvis.parent"), bones[f"{CONTROL}pelvis"]
        between.head, between.tail, between.use_deform = pelvis.head, pelvis.tail, False
        pelvis.use_connect, pelvis.parent = False, between
    held = armature.pose.bones["MCH-pelvis.parent"].constraints.new("ARMATURE")
    target = held.targets.new()
    target.target, target.subtarget = armature, "root"
    return armature


def placed(armature, scale=1.0):
    """Shift, turn and scale a character by its root."""
    root = armature.pose.bones["root"]
    root.rotation_mode = "XYZ"
    root.location, root.rotation_euler, root.scale = (1.0, 0.5, 0.2), (0.3, 0.8, -0.2), (scale,) * 3
    armature.location, armature.scale = (0.3, -0.4, 0.1), (0.8,) * 3
    bpy.context.view_layer.update()
    return armature


MADE = [unreal_like, controlled_human, switched_human, following_root]


@pytest.mark.parametrize("scale", [1.0, HALF])
@pytest.mark.parametrize("made", MADE)
def test_a_body_stands_where_its_root_has_put_it_in_its_size(made, scale):
    armature, _ = use_as_body(bpy.context.scene, placed(made(), scale))
    body = body_armature.body_from_armature(armature)
    sizes = [np.ptp(part.vertices, axis=0) / np.ptp(own.vertices, axis=0) for part, own in zip_parts(body)]
    assert np.median(sizes) == pytest.approx(scale, rel=0.1), "its parts are as large as its skin, which has no parent"
    truth = swing(body, FRAMES, 0.3)
    motion_curves.write_motion(armature, truth, 1)
    assert joint_error(armature, body, truth) < 0.1


def zip_parts(body):
    """The parts of a body beside those of the default one on the same bones."""
    plain = {"thigh.L": "thigh_l", "shin.L": "calf_l", "upper_arm.R": "upperarm_r"}
    for own, other in plain.items():
        name = next(n for n in (other, CONTROL + own) if n in body.names)
        yield body.parts[body.index(name)], BODY.parts[BODY.index(own)]


def test_a_body_below_a_scaled_control_takes_other_lengths():
    """As Fit Body gives them: in the world, where the body stands."""
    armature, _ = use_as_body(bpy.context.scene, placed(unreal_like(), HALF))
    body = body_armature.body_from_armature(armature)
    body_armature.reshape(armature, body)
    again = body_armature.body_from_armature(armature)
    for part, other in zip(body.parts, again.parts, strict=True):
        assert np.abs(part.head_world - other.head_world).max() < 1e-5
        assert np.abs(part.vertices - other.vertices).max() < 1e-5
    assert {name: len(meshes) for name, meshes in part_meshes.meshes_by_bone(armature).items()} == dict.fromkeys(
        body.names, 1
    )


@pytest.mark.parametrize("scale", [1.0, HALF])
@pytest.mark.parametrize("made", MADE)
def test_files_have_a_placed_character_where_blender_shows_it(made, scale, tmp_path):
    scene = bpy.context.scene
    armature, _ = use_as_body(scene, placed(made(), scale))
    body = body_armature.body_from_armature(armature)
    motion_curves.write_motion(armature, swing(body, FRAMES, 0.3), 1)
    wanted = shown_heads(armature, FRAMES, body.names)
    options = ExportOptions(frames=(1, FRAMES))
    if scale == 1.0:
        exporters.export_bvh(tmp_path / "motion.bvh", armature, scene, options)
        moved = read_bvh(tmp_path / "motion.bvh")
        assert np.abs(moved.positions[:, moved.rest.indices(body.names)] - wanted).max() < 1e-4
    else:
        with pytest.raises(OutputError, match=r"BVH has no sizes of bones, and root is scaled \(export FBX alone"):
            exporters.export_bvh(tmp_path / "motion.bvh", armature, scene, options)
        assert not (tmp_path / "motion.bvh").exists()
    exporters.export_fbx(tmp_path / "motion.fbx", armature, scene, options)
    bpy.ops.import_scene.fbx(filepath=str(tmp_path / "motion.fbx"), anim_offset=0.0)
    assert np.abs(shown_heads(bpy.context.object, FRAMES, body.names) - wanted).max() < 1e-3


@pytest.mark.parametrize("root", ["world", "root-bone", "in-place"])
@pytest.mark.parametrize("made", MADE)
def test_motion_is_sent_to_a_character_that_its_root_has_placed_and_scaled(made, root):
    motion = motion_of_body(BODY, swing(BODY, FRAMES, 0.3), "man", 30.0)
    options = SendOptions(retarget=RetargetOptions(root=root))
    report = send_to_rig(bpy.context.scene, motion, placed(made(), HALF), 1, options)
    assert max(limb["worst_degrees"] for limb in report["error"].values()) < 0.1
    assert max(limb["worst_mm"] for limb in report["error"].values()) < 0.1


def sent_shape(armature, root, live):
    """Send a motion; returns where the bones that play roles are shown, about the first, in sizes of the character."""
    if live is not None:
        motion_curves.write_motion(live, swing(BODY, FRAMES, 0.3), 1)
    options = SendOptions(
        retarget=RetargetOptions(root=root, feet="off"), live=None if live is None else LiveSource(live, {})
    )
    motion = motion_of_body(BODY, swing(BODY, FRAMES, 0.3), "man", 30.0)
    report = send_to_rig(bpy.context.scene, motion, armature, 1, options)
    names = [name for role, played in report["target"]["bones"].items() if role != "root" for name in played]
    heads = shown_heads(armature, FRAMES, names)
    return (heads - heads[:, :1]) / report["scale"]


@pytest.mark.parametrize("follows", [False, True])
@pytest.mark.parametrize("root", ["world", "root-bone"])
@pytest.mark.parametrize("made", MADE)
def test_motion_is_upright_on_a_character_whose_root_leans(made, root, follows):
    live = body_armature.build_armature(BODY, "man", bpy.context.scene.collection) if follows else None
    wanted = sent_shape(made(), root, live)
    assert np.abs(sent_shape(placed(made(), HALF), root, live) - wanted).max() < 1e-3


def test_a_character_that_its_root_has_raised_from_lying_is_left_standing():
    armature = unreal_like()
    armature.data.transform(Matrix.Rotation(-np.pi / 2, 4, "X"))
    wanted = sent_shape(unreal_like(), "world", None)
    armature.pose.bones["root"].rotation_mode = "XYZ"
    armature.pose.bones["root"].matrix = Matrix.Rotation(np.pi / 2, 4, "X") @ armature.data.bones["root"].matrix_local
    bpy.context.view_layer.update()
    assert np.abs(sent_shape(armature, "world", None) - wanted).max() < 1e-3


def sent_walk(armature):
    """Send a walk that keeps its feet; returns where the hips and the joints of the legs are shown."""
    report = send_to_rig(bpy.context.scene, moved_body(BODY, MOTIONS["walk"](BODY, 30, 30.0)), armature, 1)
    bones = report["target"]["bones"]
    legs = [bones[f"{part}.{side}"][0] for side in "LR" for part in ("thigh", "shin", "foot")]
    return shown_heads(armature, 30, [*bones["hips"], *legs])


def skins_of(armature):
    return [thing for thing in bpy.data.objects if thing.type == "MESH" and thing.modifiers[0].object == armature]


def in_a_step(armature):
    """Have a character stand in a step at rest, the left leg ahead, with its skin."""
    for name, angle in (("thigh_l", -0.5), ("calf_l", 0.4), ("thigh_r", 0.3)):
        bone = armature.pose.bones[name]
        bone.matrix = (
            Matrix.Translation(bone.head)
            @ Matrix.Rotation(angle, 4, "X")
            @ Matrix.Translation(-bone.head)
            @ bone.matrix
        )
        bpy.context.view_layer.update()
    bpy.context.view_layer.objects.active = armature
    skins = skins_of(armature)
    for skin in skins:
        with bpy.context.temp_override(object=skin, active_object=skin):
            bpy.ops.object.modifier_apply(modifier=skin.modifiers[0].name)
    bpy.ops.object.mode_set(mode="POSE")
    bpy.ops.pose.armature_apply()
    bpy.ops.object.mode_set(mode="OBJECT")
    for skin in skins:
        skin.modifiers.new("Armature", "ARMATURE").object = armature
    return armature


@pytest.mark.parametrize("made", [unreal_like, lambda: in_a_step(unreal_like())])
@pytest.mark.parametrize(("axis", "angle"), [("X", 90), ("Z", 90)])
def test_feet_are_kept_on_a_character_that_its_root_has_turned_as_on_one_that_stands_at_rest(made, axis, angle):
    wanted = sent_walk(made())
    turn = Matrix.Rotation(np.radians(angle), 4, axis)
    armature = made()
    armature.data.transform(turn.inverted())
    for skin in skins_of(armature):
        skin.data.transform(turn.inverted())
    root = armature.pose.bones["root"]
    root.matrix = turn @ root.bone.matrix_local
    bpy.context.view_layer.update()
    assert np.abs(sent_walk(armature) - wanted).max() < 2e-3


@pytest.mark.parametrize("name", ["pelvis", "upper_arm.L", "head"])
def test_motion_is_sent_to_a_character_with_a_bone_of_another_size(name):
    armature = skinned_human()
    armature.pose.bones[name].scale = (1.3,) * 3
    motion = motion_of_body(BODY, swing(BODY, FRAMES, 0.3), "man", 30.0)
    report = send_to_rig(bpy.context.scene, motion, armature, 1)
    assert report["warnings"] == []
    assert max(limb["worst_mm"] for limb in report["error"].values()) < 0.1
    assert tuple(armature.pose.bones[name].scale) == pytest.approx((1.3,) * 3)


@pytest.mark.parametrize(("root", "named"), [("world", True), ("root-bone", False), ("in-place", False)])
def test_skin_that_stays_where_it_is_while_the_hips_go_away_is_named(root, named):
    armature = unreal_like()
    add_bones(armature, [("board", "root", (0, 0, 0), (0, 0.2, 0))], deform=True)
    bind(armature, "deck", [("board", np.random.default_rng(0).uniform(-0.2, 0.2, (30, 3)))])
    here = swing(BODY, FRAMES, 0.3)
    away = Motion(here.translations + np.linspace(0, 1, FRAMES)[:, None] * (1.0, 0.0, 0.0), here.rotations)
    options = SendOptions(retarget=RetargetOptions(root=root))
    report = send_to_rig(bpy.context.scene, motion_of_body(BODY, away, "man", 30.0), armature, 1, options)
    assert [text.partition(":")[0] for text in report["warnings"]] == (["bone board"] if named else [])


def test_feet_that_stand_while_the_hips_go_down_are_not_named():
    rest, bend = {part.name: part.R_world_rest for part in BODY.parts}, np.radians(58)
    rotations = np.tile(np.eye(3), (FRAMES, len(BODY), 1, 1))
    for name, turn in (("thigh", 1), ("shin", -2), ("foot", 1)):
        for bone in (f"{name}.L", f"{name}.R"):
            turned = Rotation.from_rotvec(np.linspace(0, turn * bend, FRAMES)[:, None] * (1.0, 0.0, 0.0)).as_matrix()
            rotations[:, BODY.index(bone)] = rest[bone].T @ turned @ rest[bone]
    leg = BODY.parts[BODY.index("thigh.L")].head_world[2] - BODY.parts[BODY.index("foot.L")].head_world[2]
    down = leg * (1 - np.cos(np.linspace(0, bend, FRAMES)))
    motion = Motion(BODY.parts[0].head_world - down[:, None] * (0.0, 0.0, 1.0), rotations)
    assert down[-1] > 0.3
    report = send_to_rig(bpy.context.scene, motion_of_body(BODY, motion, "man", 30.0), unreal_like(), 1)
    assert report["warnings"] == []


@pytest.mark.parametrize(("modifier", "named"), [(None, True), ("SURFACE_DEFORM", False), ("ARMATURE", False)])
def test_vertices_that_belong_to_no_bone_are_named(modifier, named):
    """Such as those weighted to a bone that was deleted, or renamed; unless something else may move them."""
    armature = unreal_like()
    shirt = bind(armature, "shirt", [("spine_01", np.zeros((20, 3))), ("deleted", np.zeros((7, 3)))])
    if modifier is not None:
        shirt.modifiers.new("another", modifier)
    here = swing(BODY, FRAMES, 0.3)
    away = Motion(here.translations + np.linspace(0, 1, FRAMES)[:, None] * (1.0, 0.0, 0.0), here.rotations)
    report = send_to_rig(bpy.context.scene, motion_of_body(BODY, away, "man", 30.0), armature, 1)
    assert [text.partition(" of its")[0] for text in report["warnings"]] == (["mesh shirt: 7"] if named else [])


def test_the_hindquarters_of_a_centaur_go_along():
    """The hips of its human half hang on the bone that leads them, as another pair of legs does."""
    armature = unreal_like()
    hind = [(f"hind.{s}", "croup", (x, 0.6, 0.9), (x, 0.6, 0.1)) for s, x in (("L", 0.15), ("R", -0.15))]
    add_bones(armature, [("croup", "root", (0, 0.7, 0.95), (0, 0.1, 0.95)), *hind], deform=True)
    with body_armature.edit_bones(armature) as bones:
        bones["pelvis"].parent = bones["croup"]
    dice = np.random.default_rng(0)
    clouds = [(name, dice.uniform(-0.1, 0.1, (400, 3)) + (0, 0.6, z)) for name, z in (("croup", 0.9), ("hind.L", 0.5))]
    bind(armature, "horse", clouds)
    here = swing(BODY, FRAMES, 0.3)
    away = Motion(here.translations + np.linspace(0, 1, FRAMES)[:, None] * (1.0, 0.0, 0.0), here.rotations)
    report = send_to_rig(bpy.context.scene, motion_of_body(BODY, away, "man", 30.0), armature, 1)
    assert report["target"]["bones"]["hips"] == ["croup"]
    assert [text.partition(":")[0] for text in report["warnings"]] == ["bone croup"]
    assert max(limb["worst_mm"] for limb in report["error"].values()) < 0.1
    hips, hoof = np.moveaxis(shown_heads(armature, FRAMES, ["pelvis", "hind.L"]), 1, 0)
    assert np.linalg.norm(hoof - hips, axis=1) == pytest.approx(np.full(FRAMES, np.linalg.norm(hoof[0] - hips[0])))


def test_a_stray_vertex_of_the_root_makes_it_no_hips():
    armature = unreal_like()
    add_bones(armature, [("cape", "root", (0, 0.2, 1.4), (0, 0.3, 0.6))], deform=True)
    armature.data.bones["root"].use_deform = True
    dice = np.random.default_rng(0)
    cape = dice.uniform(-0.1, 0.1, (400, 3)) + (0, 0.3, 1)
    trunk = dice.uniform(-0.1, 0.1, (1000, 3)) + (0, 0, 1.1)
    bind(armature, "skin", [("cape", cape), ("pelvis", trunk), ("root", np.array([[0, 0, 1.2]]))])
    motion = motion_of_body(BODY, swing(BODY, FRAMES, 0.3), "man", 30.0)
    report = send_to_rig(bpy.context.scene, motion, armature, 1)
    assert report["target"]["bones"]["hips"] == ["pelvis"]
    assert report["warnings"] == []


def test_a_bone_that_is_scaled_unevenly_is_named():
    armature = skinned_human()
    armature.pose.bones["upper_arm.L"].scale = (1.0, 1.3, 1.0)
    armature.pose.bones["head"].scale = (1.2, 1.0, 1.0)  # nothing hangs on it
    [said] = send_to_rig(bpy.context.scene, motion_of_body(BODY, swing(BODY, FRAMES, 0.3), "man", 30.0), armature, 1)[
        "warnings"
    ]
    assert said.startswith("bone upper_arm.L: it is scaled by different amounts along its axes")


@pytest.mark.parametrize(
    ("scales", "said"),
    [
        (((1, 1, 1), (1, 2, 1)), "the armature object is scaled by different amounts along its axes"),
        (((1, 2, 1), (1, 1, 1)), "the mount object is scaled by different amounts along its axes"),
        (((-1, -1, -1), (1, 1, 1)), "the mount object is mirrored"),
        (((0, 0, 0), (1, 1, 1)), "the mount object is scaled to nothing"),
    ],
)
def test_an_object_that_is_scaled_unevenly_is_named_though_it_is_a_parent(scales, said):
    armature, mount = skinned_human(), bpy.data.objects.new("mount", None)
    bpy.context.scene.collection.objects.link(mount)
    armature.parent = mount
    mount.scale, armature.scale = scales
    bpy.context.view_layer.update()
    with pytest.raises(BodyError, match=said):
        send_to_rig(bpy.context.scene, motion_of_body(BODY, swing(BODY, 2), "man", 30.0), armature, 1)


@pytest.mark.parametrize(("longer", "most"), [(1.0, 0.5), (1.3, 10.0)])
def test_a_source_has_the_size_that_its_bones_have(longer, most):
    """A walking character whose root is scaled, and whose shins are longer: its motion comes back as it was sent."""
    scene, walk = bpy.context.scene, moved_body(BODY, MOTIONS["walk"](BODY, 30, 30.0))
    source = unreal_like()
    source.pose.bones["root"].scale = (HALF,) * 3
    for side in "lr":
        source.pose.bones[f"calf_{side}"].scale = (1.0, longer, 1.0)
    send_to_rig(scene, walk, source, 1)
    motion, bones = motion_of_armature(scene, source, (1, len(walk)))
    report = send_to_rig(scene, motion, skinned_human(), 1, SendOptions(source_bones=bones))
    shin = np.linalg.norm(BODY.parts[BODY.index("shin.L")].tail_world - BODY.parts[BODY.index("shin.L")].head_world)
    leg = BODY.parts[BODY.index("thigh.L")].head_world[2]
    assert report["scale"] == pytest.approx(1 / (HALF * (1 + (longer - 1) * shin / leg)), rel=0.03)
    for leg in ("leg.L", "leg.R"):
        assert report["turned_to_keep_feet_and_hands"][leg]["worst_degrees"] < most
