"""Skinned characters and Rigify rigs are bodies: their skin is divided into parts on the bones that are posed."""

from __future__ import annotations

import sys

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from addon_shots import joint_error  # noqa: E402
from kfmocap.core.body import human  # noqa: E402
from kfmocap.core.body.motion import Motion  # noqa: E402
from kfmocap.core.body.soles import Soles  # noqa: E402
from kfmocap.core.errors import BodyError  # noqa: E402
from kfmocap.core.numerics import rotations  # noqa: E402
from kfmocap.kfmocap_addon.operators.performers.fit_body import has_own_shape  # noqa: E402
from kfmocap.kfmocap_addon.retargeting.tracked_bodies.skinned_body import use_as_body  # noqa: E402
from kfmocap.kfmocap_addon.scene_io import fcurves  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.body import body_armature, part_meshes  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.characters import skinned_parts, skins  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.keys import key_pose_curves, motion_curves  # noqa: E402
from mathutils import Matrix  # noqa: E402
from odd_characters import (  # noqa: E402
    CONTROL,
    add_bones,
    as_imported,
    bind,
    bone_names,
    controlled_human,
    foreign_armature,
    mixamo_like,
    points_of,
    quadruped,
    skinned_human,
)
from scipy.spatial import ConvexHull  # noqa: E402

pytest_plugins = ("addon_fixtures",)

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("blender")]

BODY = human(1.75)
FINGER, TWIST = "finger.L", "forearm_twist.L"


def skinned(groups=True):
    """The default body without its parts, as one skin over two meshes; with a finger and a twist bone."""
    armature = foreign_armature(BODY)
    with body_armature.edit_bones(armature) as bones:
        hand, forearm = bones["hand.L"], bones["forearm.L"]
        for name, above, start, end in ((FINGER, hand, 0.6, 0.8), (TWIST, forearm, 0.3, 0.6)):
            bone = bones.new(name)
            bone.head, bone.tail = (above.head.lerp(above.tail, t) for t in (start, end))
            bone.parent = above
    halves = {"upper": [], "lower": []}
    for part in BODY.parts:
        lower = part.name.split(".")[0] in ("pelvis", "thigh", "shin", "foot")
        halves["lower" if lower else "upper"].append((part.name, points_of(part)))
    tip = BODY.parts[BODY.index("hand.L")].tail_world
    halves["upper"].append((FINGER, tip + 0.01 * np.random.default_rng(0).normal(size=(20, 3))))
    middle = BODY.parts[BODY.index("forearm.L")].head_world + [0.12, 0, 0]
    halves["upper"].append((TWIST, middle + 0.04 * np.random.default_rng(1).normal(size=(60, 3)).clip(-1, 1)))
    for name, clouds in halves.items():
        bind(armature, name, clouds, groups)
    return armature


def made_motion(parts):
    """Four poses of that many parts."""
    dice = np.random.default_rng(3)
    return Motion(dice.normal(0, 1, (4, 3)), rotations.exp(dice.normal(0, 0.5, (4, parts, 3))))


def test_every_bone_that_leads_skin_becomes_a_part_with_few_faces():
    armature = skinned()
    use_as_body(bpy.context.scene, armature)
    body = body_armature.body_from_armature(armature)
    assert set(body.names) == set(BODY.names)  # a finger belongs to its hand, a twist bone to its forearm
    for part in body.parts:
        own = BODY.parts[BODY.index(part.name)]
        assert np.allclose(part.head_world, own.head_world, atol=1e-5)
        assert len(part.vertices) <= 24
        if part.name not in ("hand.L", "forearm.L"):
            assert ConvexHull(part.vertices).volume > 0.75 * ConvexHull(own.vertices).volume


def test_a_character_of_scale_one_hundredth_is_the_same_body_in_metres():
    use_as_body(bpy.context.scene, armature := skinned())
    upright = body_armature.body_from_armature(armature)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    as_imported(armature := skinned())
    use_as_body(bpy.context.scene, armature)
    body = body_armature.body_from_armature(armature)
    assert body.names == upright.names
    for part, own in zip(body.parts, upright.parts, strict=True):
        assert np.allclose(part.head_world, own.head_world, atol=1e-5)
        world = [p.vertices @ p.R_world_rest.T + p.head_world for p in (part, own)]
        assert np.allclose(*(ConvexHull(points).volume for points in world), rtol=0.02)
    motion = made_motion(len(body))
    motion_curves.write_motion(armature, motion, 1)
    assert joint_error(armature, body, motion) < 0.1


@pytest.mark.parametrize("mode", ["ZXY", "AXIS_ANGLE"])
def test_key_poses_in_every_rotation_mode_stay_what_they_are(mode):
    armature = skinned()
    bone = armature.pose.bones["forearm.L"]
    bone.rotation_mode = mode
    attribute = "rotation_axis_angle" if mode == "AXIS_ANGLE" else "rotation_euler"
    for frame, values in ((1, (0.3, 0.1, 0.9, -0.4)), (9, (2.9, -1.2, 0.4, 0.6)), (17, (3.4, 0.2, 0.5, 0.1))):
        setattr(bone, attribute, values[: len(getattr(bone, attribute))])
        bone.keyframe_insert(attribute, frame=frame)

    def shown():
        poses = []
        for frame in (1, 9, 17):
            bpy.context.scene.frame_set(frame)
            poses.append(np.array(bone.matrix))
        return poses

    before = shown()
    use_as_body(bpy.context.scene, armature)
    assert bone.rotation_mode == "QUATERNION"
    assert np.allclose(shown(), before, atol=1e-5)
    keys = key_pose_curves.read_key_poses(armature, 1, 17)
    assert keys.frames.tolist() == [0, 8, 16]


def test_locked_axes_and_limited_rotations_are_limits_of_the_joint():
    armature = skinned()
    armature.pose.bones["shin.L"].lock_rotation = (False, True, True)
    held = armature.pose.bones["forearm.R"].constraints.new("LIMIT_ROTATION")
    held.owner_space, held.use_limit_x, held.min_x, held.max_x = "LOCAL", True, -0.1, 2.0
    use_as_body(bpy.context.scene, armature)
    limits = {part.name: part.limits for part in body_armature.body_from_armature(armature).parts}
    assert np.allclose(limits["shin.L"], [[-np.pi, np.pi], [0, 0], [0, 0]])
    assert np.allclose(limits["forearm.R"], [[-0.1, 2.0], [-np.pi, np.pi], [-np.pi, np.pi]])


def with_root(armature):
    """A bone that is no part, above all others."""
    with body_armature.edit_bones(armature) as bones:
        root = bones.new("master")
        root.tail, root.use_deform = (0, 0.5, 0), False
        bones["pelvis"].parent = root
    return armature.pose.bones["master"]


def test_a_control_above_the_body_may_have_been_moved():
    armature = skinned()
    root = with_root(armature)
    root.location, root.rotation_mode, root.rotation_euler = (0.4, -0.2, 0.1), "XYZ", (0.2, 0.5, -1.0)
    bpy.context.view_layer.update()
    _, remarks = use_as_body(bpy.context.scene, armature)
    assert remarks == ()
    body, motion = body_armature.body_from_armature(armature), made_motion(len(BODY))
    motion_curves.write_motion(armature, motion, 1)
    assert joint_error(armature, body, motion) < 0.05


@pytest.mark.parametrize("mode", ["QUATERNION", "YZX"])
def test_motion_of_a_root_above_the_body_becomes_that_of_its_topmost_bone(mode):
    armature, scene = skinned(), bpy.context.scene
    root, top = with_root(armature), armature.pose.bones["pelvis"]
    for bone, frames in ((root, (1, 8, 9)), (top, (1, 7))):
        bone.rotation_mode = mode
        for frame in frames:
            bone.location.x = 0.1 * frame
            bone.keyframe_insert("location", frame=frame)
        bone.matrix_basis @= Matrix.Rotation(0.7, 4, "Y")
        bone.keyframe_insert(attribute(bone), frame=frames[-1])
    before, stored = shown_on(scene, armature, (1, 7, 8, 9)), keys_of(armature, "master")
    scene.frame_set(3, subframe=0.25)
    _, remarks = use_as_body(scene, armature)
    assert [text.split(":")[0] for text in remarks] == ["bone master"] and "pelvis is keyed on 4 frames" in remarks[0]
    assert (scene.frame_current, scene.frame_subframe) == (3, 0.25)
    assert np.allclose(shown_on(scene, armature, (1, 7, 8, 9)), before, atol=1e-5)
    assert keys_of(armature, "master") == stored, "the keys of the root are muted, and stay"
    body, motion = body_armature.body_from_armature(armature), made_motion(len(BODY))
    motion_curves.write_motion(armature, motion, 2)
    assert joint_error(armature, body, motion, first=2) < 0.05, "on all frames the tracked motion is shown where it is"


def shown_on(scene, armature, frames):
    """Matrices of all bones on scene frames, in the armature."""
    now, found = scene.frame_current, []
    for frame in frames:
        scene.frame_set(frame)
        found.append([np.array(bone.matrix) for bone in armature.pose.bones if bone.name != "master"])
    scene.frame_set(now)
    return np.array(found)


def attribute(bone):
    return "rotation_quaternion" if bone.rotation_mode == "QUATERNION" else "rotation_euler"


def keys_of(armature, bone):
    """The keys of a bone, by channel."""
    bag = fcurves.find_channelbag(armature)
    curves = [curve for curve in bag.fcurves if fcurves.bone_of(curve.data_path) == bone]
    return {(c.data_path, c.array_index): [tuple(key.co) for key in c.keyframe_points] for c in curves}


def test_keys_that_a_bones_rotation_mode_leaves_without_effect_are_named():
    armature = skinned()
    for name in ("head", "hand.L"):
        bone = armature.pose.bones[name]
        bone.rotation_mode = "XYZ"
        bone.keyframe_insert("rotation_euler", frame=1)
    armature.pose.bones["head"].rotation_mode = "QUATERNION"
    _, [said] = use_as_body(bpy.context.scene, armature)
    assert said.startswith("bones head: they have keys of another rotation mode")


def test_a_bone_with_keys_between_parts_is_named():
    armature = skinned()
    with body_armature.edit_bones(armature) as bones:
        between = bones.new("between")
        between.head, between.tail = bones["head"].head, bones["head"].tail
        between.parent, bones["head"].parent = bones["head"].parent, between
        bones["head"].use_connect = False
    bone = armature.pose.bones["between"]
    for frame in (1, 9):
        bone.location.x = 0.01 * frame
        bone.keyframe_insert("location", frame=frame)
    _, remarks = use_as_body(bpy.context.scene, armature)
    assert [text.split(":")[0] for text in remarks] == ["bone between"]


def test_a_bone_that_does_not_turn_with_the_one_above_is_named():
    armature = skinned()
    armature.data.bones["head"].use_inherit_rotation = False
    with pytest.raises(BodyError, match=r"bone head: the bone does not turn with the one above"):
        use_as_body(bpy.context.scene, armature)


def test_motion_on_a_skinned_character_is_what_blender_shows():
    armature = skinned()
    use_as_body(bpy.context.scene, armature)
    body = body_armature.body_from_armature(armature)
    motion = made_motion(len(body))
    motion_curves.write_motion(armature, motion, 1)
    assert joint_error(armature, body, motion) < 0.05


def test_bones_between_parts_need_no_skin():
    armature = skinned()
    with body_armature.edit_bones(armature) as bones:
        between = bones.new("clavicle.L")
        between.head, between.tail = bones["chest"].tail, bones["upper_arm.L"].head
        between.parent, bones["upper_arm.L"].parent = bones["chest"], between
    use_as_body(bpy.context.scene, armature)
    body = body_armature.body_from_armature(armature)
    assert body.names[body.parents[body.index("upper_arm.L")]] == "chest"


def test_eyes_and_props_on_single_bones_of_a_skinned_character_belong_to_its_parts():
    armature = skinned()
    use_as_body(bpy.context.scene, armature)
    alone = body_armature.body_from_armature(armature)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    armature = skinned()
    club = bpy.data.objects.new("club", bpy.data.meshes.new("club"))
    corners = np.array(np.meshgrid([-0.02, 0.02], [0, 0.6], [-0.02, 0.02])).reshape(3, -1).T
    club.data.from_pydata(corners.tolist(), [], [])
    bpy.context.scene.collection.objects.link(club)
    club.parent, club.parent_type, club.parent_bone = armature, "BONE", "hand.R"
    use_as_body(bpy.context.scene, armature)
    body = body_armature.body_from_armature(armature)
    assert body.names == alone.names
    longer = {p.name for p, own in zip(body.parts, alone.parts, strict=True) if extent(p) > 1.2 * extent(own)}
    assert longer == {"hand.R"}
    assert club.name not in {child.name for child in part_meshes.parts_of(armature)}


def extent(part):
    return np.linalg.norm(np.ptp(part.vertices, axis=0))


def test_hips_and_spine_that_hang_side_by_side_on_a_bone_without_skin_are_one_body():
    armature = skinned()
    centre = with_root(armature)
    with body_armature.edit_bones(armature) as bones:
        bones["spine"].use_connect, bones["spine"].parent = False, bones[centre.name]
    _, remarks = use_as_body(bpy.context.scene, armature)
    body = body_armature.body_from_armature(armature)
    assert set(body.names) == {*BODY.names, centre.name}
    assert [body.names[i] if i >= 0 else None for i in body.parents].count(centre.name) == 2
    assert not remarks
    motion = made_motion(len(body))
    motion_curves.write_motion(armature, motion, 1)
    assert joint_error(armature, body, motion) < 0.05


def test_the_top_of_a_body_moves_though_it_was_connected_to_a_bone_above():
    armature = skinned()
    root = with_root(armature)
    with body_armature.edit_bones(armature) as bones:
        bones[root.name].tail = bones["pelvis"].head
        bones["pelvis"].use_connect = True
    _, remarks = use_as_body(bpy.context.scene, armature)
    assert [text.split(",")[0] for text in remarks] == ["bone pelvis: it was connected to the bone above"]
    body, motion = body_armature.body_from_armature(armature), made_motion(len(BODY))
    motion_curves.write_motion(armature, motion, 1)
    assert joint_error(armature, body, motion) < 0.05


def test_locations_and_scales_of_parts_are_named():
    armature = skinned()
    armature.pose.bones["chest"].scale = (1.3, 1.3, 1.3)
    arm = armature.pose.bones["upper_arm.L"]
    for frame in (1, 9):
        arm.location.x = 0.02 * frame
        arm.keyframe_insert("location", frame=frame)
    _, remarks = use_as_body(bpy.context.scene, armature)
    assert [text.split(":")[0] for text in remarks] == ["bone chest", "bone upper_arm.L"]


@pytest.mark.parametrize(("centimetres", "named"), [(3e-5, []), (0.5, ["bone mixamorig:LeftArm"])])
def test_locations_that_an_importer_has_rounded_are_not_named(centimetres, named):
    """The single precision of a file in centimetres is 1.5e-5 off."""
    armature = mixamo_like()
    arm = armature.pose.bones["mixamorig:LeftArm"]
    for frame in (1, 5):
        arm.location.x = centimetres * (frame == 1)
        arm.keyframe_insert("location", frame=frame)
    arm.location.y = 7.6e-6
    _, remarks = use_as_body(bpy.context.scene, armature)
    assert [text.split(": ")[0] for text in remarks] == named


@pytest.mark.parametrize(("scale", "said"), [(0.0, "scaled to nothing"), (-1.0, "mirrored")])
def test_an_armature_whose_bones_have_no_true_size_is_refused_unchanged(scale, said):
    armature = skinned()
    armature.scale = (scale,) * 3
    bpy.context.view_layer.update()
    before = set(bpy.data.objects)
    with pytest.raises(BodyError, match=f"the armature object is {said}"):
        use_as_body(bpy.context.scene, armature)
    assert set(bpy.data.objects) == before


def test_an_armature_that_moves_as_a_whole_is_refused():
    armature = skinned()
    for frame in (1, 9):
        armature.location.x = 0.1 * frame
        armature.keyframe_insert("location", frame=frame)
    with pytest.raises(BodyError, match="armature hero: keys of location move the armature object itself"):
        use_as_body(bpy.context.scene, armature)


def test_bone_envelopes_are_left_out_with_a_word():
    with pytest.raises(BodyError, match=r"mesh upper: bone envelopes"):
        use_as_body(bpy.context.scene, skinned(groups=False))


def with_tail(held_by):
    """The character with a tail of two bones below the pelvis, whose last bone something moves."""
    armature = skinned()
    with body_armature.edit_bones(armature) as bones:
        dice, above = np.random.default_rng(2), "pelvis"
        clouds = []
        for k, name in enumerate(("tail", "tuft")):
            bone = bones.new(name)
            bone.head, bone.tail = (0.0, 0.2 + 0.3 * k, 0.9), (0.0, 0.5 + 0.3 * k, 0.9)
            bone.parent = bones[above]
            clouds.append((name, np.array(bone.head) + dice.uniform([-0.05, 0, -0.05], [0.05, 0.3, 0.05], (40, 3))))
            above = name
    bind(armature, "fur", clouds)
    if held_by == "driver":
        armature.pose.bones["tuft"].driver_add("rotation_quaternion", 1)
    elif held_by:
        constraint = armature.pose.bones["tuft"].constraints.new(held_by)
        constraint.target, constraint.subtarget = armature, "head"
        if held_by == "IK":
            constraint.chain_count = 2
    return armature


def test_a_driver_is_noticed_whatever_the_bone_is_called():
    armature = with_tail("driver")
    armature.data.bones["tuft"].name = 'the "tuft" \\ 1'
    _, remarks = use_as_body(bpy.context.scene, armature)
    assert [text.split(",")[0] for text in remarks] == ['bone the "tuft" \\ 1: it is moved by a driver']


@pytest.mark.parametrize(
    ("held_by", "left"),
    [("", set()), ("DAMPED_TRACK", {"tuft"}), ("driver", {"tuft"}), ("IK", {"tuft", "tail"})],
)
def test_bones_at_the_end_that_something_else_moves_are_left_out_with_a_word(held_by, left):
    armature, remarks = use_as_body(bpy.context.scene, with_tail(held_by))
    names = set(body_armature.body_from_armature(armature).names)
    assert {"tail", "tuft"} - names == left
    assert {"pelvis", "forearm.R", "foot.L"} < names
    assert {text.split(":")[0] for text in remarks} == {f"bone {name}" for name in left}
    assert all("is left out, and follows the body" in text for text in remarks)


@pytest.mark.parametrize("held", [False, True])
def test_limbs_whose_skin_twist_bones_lead_are_parts(held):
    """As MetaHumans have them: the limb's own bone leads none, and importers lose where the twist bones point."""
    armature = skinned()
    with body_armature.edit_bones(armature) as bones:
        limbs = ("upper_arm.L", "forearm.R", "thigh.R", "shin.R")
        for name in limbs:
            above = bones[name]
            bone = bones.new(name.replace(".", "_twist_01."))
            bone.head, bone.tail, bone.parent = above.head, above.head + above.z_axis * 0.05, above
    for skin in skins.skinned_meshes(armature):
        for name in limbs:
            if name in skin.vertex_groups:
                skin.vertex_groups[name].name = name.replace(".", "_twist_01.")
    for name in limbs if held else ():
        copy = armature.pose.bones[name.replace(".", "_twist_01.")].constraints.new("COPY_ROTATION")
        copy.target, copy.subtarget = armature, name
    armature, remarks = use_as_body(bpy.context.scene, armature)
    assert sorted(body_armature.body_from_armature(armature).names) == sorted(BODY.names)
    assert not remarks


def test_short_limbs_below_a_large_head_are_parts(monkeypatch):
    short = {"thigh": 0.12, "shin": 0.10, "upper_arm": 0.09, "forearm": 0.08}
    monkeypatch.setattr(sys.modules[__name__], "BODY", human(1.2, short))
    armature, _ = use_as_body(bpy.context.scene, skinned())
    assert sorted(body_armature.body_from_armature(armature).names) == sorted(BODY.names)


def test_a_hand_or_a_foot_that_a_constraint_moves_is_not_left_out():
    armature = skinned()
    held = armature.pose.bones["foot.L"].constraints.new("COPY_ROTATION")
    held.target, held.subtarget = armature, "foot.R"
    with pytest.raises(BodyError, match=r"bone foot\.L: the bone is moved by its constraint 'Copy Rotation'"):
        use_as_body(bpy.context.scene, armature)


def test_a_foot_that_hangs_on_another_bone_than_its_shin_is_named():
    armature = skinned()
    with body_armature.edit_bones(armature) as bones:
        bones["foot.L"].use_connect = False
        bones["foot.L"].parent = bones["pelvis"]
    with pytest.raises(BodyError, match=r"bone foot\.L: it hangs on pelvis instead of shin\.L.*Ctrl P"):
        use_as_body(bpy.context.scene, armature)
    assert not armature.children


def test_a_bone_that_a_constraint_moves_is_named():
    armature = skinned()
    held = armature.pose.bones["forearm.R"].constraints.new("DAMPED_TRACK")
    held.target, held.subtarget = armature, "head"
    with pytest.raises(BodyError, match=r"bone forearm\.R: the bone is moved by its constraint 'Damped Track'"):
        use_as_body(bpy.context.scene, armature)
    assert not armature.children


@pytest.mark.parametrize("kind", ["IK", "COPY_ROTATION", "ARMATURE", "DAMPED_TRACK"])
def test_constraints_whose_targets_are_gone_move_nothing(kind):
    """As of characters without the scene from which they come."""
    armature, lost = skinned(), bpy.data.objects.new("lost", None)
    for bone in ("pelvis", "forearm.R", "foot.L"):
        held = armature.pose.bones[bone].constraints.new(kind)
        if kind != "ARMATURE":
            held.target = lost
    bpy.data.objects.remove(lost)
    _, remarks = use_as_body(bpy.context.scene, armature)
    assert not remarks


def test_a_prop_of_one_bone_is_a_body():
    armature = bpy.data.objects.new("prop", bpy.data.armatures.new("prop"))
    bpy.context.scene.collection.objects.link(armature)
    with body_armature.edit_bones(armature) as bones:
        bone = bones.new("box")
        bone.tail = (0, 0, 1)
    box = np.array(np.meshgrid([-0.5, 0.5], [-0.2, 0.2], [0, 1])).reshape(3, -1).T
    bind(armature, "box", [("box", box)])
    use_as_body(bpy.context.scene, armature)
    assert len(body_armature.body_from_armature(armature).parts[0].vertices) == 8


def made_mesh():
    """A long box that is turned, scaled and moved."""
    bpy.ops.mesh.primitive_cube_add(size=1)
    box = bpy.context.object
    box.location, box.rotation_euler, box.scale = (0.5, -0.3, 1.0), (0.2, 0.7, -0.4), (0.1, 0.5, 0.06)
    bpy.context.view_layer.update()
    return box


def seen_at(mesh, frame):
    bpy.context.scene.frame_set(frame)
    posed = mesh.evaluated_get(bpy.context.evaluated_depsgraph_get())
    return np.array([posed.matrix_world @ vertex.co for vertex in posed.to_mesh().vertices])


def test_a_mesh_becomes_a_prop_that_stays_where_it_is_and_keeps_its_keys():
    box = made_mesh()
    for frame, place, turn in ((1, 0.5, 0.7), (9, 0.9, 1.9), (17, -0.2, 2.5)):
        box.location.x, box.rotation_euler.y = place, turn
        box.keyframe_insert("location", frame=frame)
        box.keyframe_insert("rotation_euler", frame=frame)
    before = [seen_at(box, frame) for frame in (1, 9, 17)]
    bpy.context.scene.frame_set(1)
    assert bpy.ops.kfmocap.use_armature() == {"FINISHED"}
    armature = bpy.context.scene.kfmocap.performers[0].armature
    assert bpy.context.active_object == armature
    for frame, points in zip((1, 9, 17), before, strict=True):
        assert np.abs(seen_at(box, frame) - points).max() < 1e-5
    assert key_pose_curves.read_key_poses(armature, 1, 17).frames.tolist() == [0, 8, 16]
    body = body_armature.body_from_armature(armature)
    assert np.isclose(ConvexHull(body.parts[0].vertices).volume, 0.1 * 0.5 * 0.06, rtol=1e-3)
    motion = made_motion(1)
    motion_curves.write_motion(armature, motion, 20)
    assert joint_error(armature, body, motion, 20) < 0.05


def test_the_active_skin_of_a_character_stands_for_its_armature():
    armature = skinned()
    bpy.context.view_layer.objects.active = skins.skinned_meshes(armature)[0]
    assert bpy.ops.kfmocap.use_armature() == {"FINISHED"}
    assert [slot.armature for slot in bpy.context.scene.kfmocap.performers] == [armature]


def test_what_hangs_on_a_mesh_goes_with_the_prop_and_belongs_to_it():
    """A lid that opens by its own keys, on a box that is turned and scaled."""
    box = made_mesh()
    box.rotation_euler, box.scale = (0.3, 0.2, 0.5), (1.5, 1.5, 1.5)
    bpy.ops.mesh.primitive_cube_add(size=0.2, location=(0.0, 0.0, 1.2))
    lid = bpy.context.object
    lid.parent = box
    for frame, angle in ((1, 0.0), (5, 0.6)):
        lid.rotation_euler.x = angle
        lid.keyframe_insert("rotation_euler", frame=frame)
    bpy.context.scene.frame_set(3)
    box.select_set(True)
    bpy.context.view_layer.objects.active = box
    before, on_box = lid.matrix_world.copy(), box.matrix_world.inverted() @ lid.matrix_world
    assert bpy.ops.kfmocap.use_armature() == {"FINISHED"}
    [slot] = bpy.context.scene.kfmocap.performers
    bpy.context.view_layer.update()
    assert np.allclose(np.array(lid.matrix_world), np.array(before), atol=1e-5)
    body = body_armature.body_from_armature(slot.armature)
    [part] = body.parts
    reach = np.linalg.norm(points_of(part) - np.array(box.matrix_world.translation), axis=1).max()
    assert reach > 1.7  # the box alone is 1.3
    slot.armature.pose.bones[0].location = (0.4, 0.1, -0.2)
    slot.armature.pose.bones[0].rotation_quaternion = (0.8, 0.6, 0.0, 0.0)
    bpy.context.view_layer.update()
    moved = slot.armature.matrix_world @ slot.armature.pose.bones[0].matrix @ Matrix.Scale(1.5, 4)
    assert np.allclose(np.array(lid.matrix_world), np.array(moved @ on_box), atol=1e-5)


def test_meshes_on_bones_that_copy_controls_hang_on_these():
    """As of a robot: there is no skin."""
    armature = controlled_human()
    [skin] = skins.skinned_meshes(armature)
    bpy.data.objects.remove(skin)
    for part in BODY.parts:
        piece = bpy.data.objects.new(part.name, bpy.data.meshes.new(part.name))
        piece.data.from_pydata(points_of(part).tolist(), [], part.faces.tolist())
        bpy.context.scene.collection.objects.link(piece)
        piece.parent, piece.parent_type, piece.parent_bone = armature, "BONE", f"DEF-{part.name}"
        bpy.context.view_layer.update()
        piece.matrix_world = Matrix.Identity(4)
    use_as_body(bpy.context.scene, armature)
    assert set(body_armature.body_from_armature(armature).names) <= {f"{CONTROL}{part.name}" for part in BODY.parts}


@pytest.mark.parametrize("how", ["constraint", "modifier", "parent"])
def test_a_mesh_that_something_else_moves_does_not_become_a_prop(how):
    box = made_mesh()
    if how == "constraint":
        box.constraints.new("COPY_LOCATION").target = bpy.data.objects.new("empty", None)
    elif how == "modifier":
        box.modifiers.new("Cloth", "CLOTH")
    else:
        box.parent = bpy.data.objects.new("empty", None)
    with pytest.raises(RuntimeError, match="mesh Cube: it"):
        bpy.ops.kfmocap.use_armature()
    assert not bpy.context.scene.kfmocap.performers
    assert not bpy.data.armatures
    assert not box.vertex_groups


def test_corners_of_a_dense_cloud_span_nearly_all_of_it():
    cloud = np.random.default_rng(5).normal(size=(5000, 3))
    cloud = cloud / np.linalg.norm(cloud, axis=1, keepdims=True) * [1.0, 0.2, 0.1]
    chosen = skinned_parts.corners(cloud)
    assert ConvexHull(chosen).volume > 0.7 * ConvexHull(cloud).volume


def test_a_character_of_other_bones_has_landmarks_and_soles():
    armature = mixamo_like()
    use_as_body(bpy.context.scene, armature)
    body = body_armature.body_from_armature(armature)
    assert set(BODY.landmarks) - set(body.landmarks) == {"LHand", "RHand"}
    assert body.names[body.landmarks["LKnee"][0]] == "mixamorig:LeftLeg"
    assert Soles.of(body).names == Soles.of(BODY).names
    own, found = (
        np.sort([each.parts[i].head_world[2] + each.parts[i].R_world_rest[2] @ p for i, p in soles])
        for each in (BODY, body)
        for soles in [[each.landmarks[f"{side}{tip}"] for side in "LR" for tip in ("Heel", "BigToe")]]
    )
    np.testing.assert_allclose(found, own, atol=0.01)


def test_a_character_whose_hips_lead_no_skin_has_landmarks_and_soles():
    """As a rig of 3ds Max may: legs and chest hang on the first bone of the spine."""
    limbs = "UpperArm Forearm Hand Thigh Calf Foot"
    names = bone_names("Bip_Spine Bip_Spine1 Bip_Spine2 Bip_Head", limbs, lambda word, side: f"Bip_{side}_{word}")
    armature = skinned_human(names)
    add_bones(armature, [("Bip_Pelvis", "", (0.0, 0.1, 0.85), (0.0, 0.1, 0.9))], deform=True)
    with body_armature.edit_bones(armature) as bones:
        bones["Bip_Spine"].parent = bones["Bip_Pelvis"]
    use_as_body(bpy.context.scene, armature)
    body = body_armature.body_from_armature(armature)
    assert body.names[body.landmarks["Hip"][0]] == "Bip_Spine"
    assert Soles.of(body).names == Soles.of(BODY).names


@pytest.mark.parametrize("degrees", [90, -90])
def test_feet_of_a_character_whose_object_lies_have_soles(degrees):
    """As importers leave it: the heights of hands and hips are those in the world."""
    armature = skinned()
    turn = Matrix.Rotation(np.radians(degrees), 4, "X") @ Matrix.Scale(0.01, 4)
    for data in (armature.data, *(skin.data for skin in skins.skinned_meshes(armature))):
        data.transform(Matrix.Translation((0.0, -0.5, 0.0)))
        data.transform(turn.inverted())
    armature.matrix_world = turn
    bpy.context.view_layer.update()
    use_as_body(bpy.context.scene, armature)
    assert Soles.of(body_armature.body_from_armature(armature)) is not None


def test_an_animal_has_no_landmarks_of_people():
    armature = quadruped()
    use_as_body(bpy.context.scene, armature)
    body = body_armature.body_from_armature(armature)
    assert Soles.of(body) is None
    assert set(body.landmarks) == set(body.names)


@pytest.mark.parametrize("parented", [True, False])
def test_a_skinned_character_gets_another_height_as_a_whole_with_its_key_poses_in_place(parented):
    armature = skinned()
    meshes = [o for o in bpy.data.objects if o.type == "MESH"]
    if parented:
        for mesh in meshes:
            mesh.parent = armature
    armature.location = (0.4, -0.2, 0.1)
    bpy.context.view_layer.update()
    slot = bpy.context.scene.kfmocap.performers.add()
    slot.armature, _ = use_as_body(bpy.context.scene, armature)
    hips = armature.pose.bones[BODY.names[0]]
    hips.location = (0.3, 0.2, -0.1)
    hips.keyframe_insert("location", frame=1)
    bpy.context.view_layer.update()
    rest = {bone.name: tuple(bone.head_local) for bone in armature.data.bones}
    tall, place, sole = slot.height, armature.matrix_world @ hips.head, floor_of(armature)
    sizes = [mesh.matrix_world.median_scale for mesh in meshes]
    slot.height = 0.5 * tall
    bpy.context.view_layer.update()
    assert slot.height == pytest.approx(0.5 * tall, rel=1e-5)
    assert {bone.name: tuple(bone.head_local) for bone in armature.data.bones} == rest
    assert [mesh.matrix_world.median_scale for mesh in meshes] == pytest.approx([0.5 * size for size in sizes])
    assert floor_of(armature) == pytest.approx(sole, abs=1e-5)
    assert np.allclose(armature.matrix_world @ hips.head, place, atol=1e-5)
    bpy.context.scene.frame_set(1)
    assert np.allclose(armature.matrix_world @ hips.head, place, atol=1e-5)


def floor_of(armature):
    """Height of the lowest corner of the parts at rest."""
    body = body_armature.body_from_armature(armature)
    return min(float((part.vertices @ part.R_world_rest[2] + part.head_world[2]).min()) for part in body.parts)


def test_the_proportions_of_a_skinned_character_are_its_own():
    armature = skinned()
    slot = bpy.context.scene.kfmocap.performers.add()
    slot.armature, _ = use_as_body(bpy.context.scene, armature)
    before = {bone.name: tuple(bone.tail_local) for bone in armature.data.bones}
    assert slot.upper_arm == 0.0  # no field is shown
    assert "set its height" in has_own_shape(bpy.context)
    assert {bone.name: tuple(bone.tail_local) for bone in armature.data.bones} == before


def test_drivers_that_pose_bones_of_the_body_are_muted_and_key_poses_look_as_before():
    """As on a character whose forearm and upper spine a slider bends; its eyelids' would go on."""
    armature = skinned()
    driven = {"forearm.L": 0.5, "chest": -0.2}
    for name, angle in driven.items():
        bone = armature.pose.bones[name]
        bone.rotation_mode = "XYZ"
        bone.driver_add("rotation_euler", 0).driver.expression = str(angle)
    for frame in (1, 9):
        armature.pose.bones["upper_arm.L"].keyframe_insert("rotation_quaternion", frame=frame)
    bpy.context.view_layer.update()
    before = [np.array(armature.pose.bones[name].matrix) for name in (*driven, "hand.L")]
    armature, remarks = use_as_body(bpy.context.scene, armature)
    for name in driven:
        assert f"bone {name}: the driver of its rotation is muted, as keys would be without effect" in remarks
    assert {"forearm.L", "chest"} < set(body_armature.body_from_armature(armature).names)
    for frame in (1, 9):
        bpy.context.scene.frame_set(frame)
        for name, was in zip((*driven, "hand.L"), before, strict=True):
            np.testing.assert_allclose(np.array(armature.pose.bones[name].matrix), was, atol=1e-4)
    assert all(driver.mute for driver in armature.animation_data.drivers)


def test_a_driver_of_a_bones_size_is_named_and_one_that_is_muted_is_no_hindrance():
    armature = skinned()
    driver = armature.pose.bones["forearm.L"].driver_add("scale", 1)
    driver.driver.expression = "1.0"
    with pytest.raises(BodyError, match=r"bone forearm.L: the bone is moved by a driver.*Drivers editor"):
        use_as_body(bpy.context.scene, armature)
    assert not any(child.parent_type == "BONE" for child in armature.children)
    driver.mute = True
    assert not use_as_body(bpy.context.scene, armature)[1]
