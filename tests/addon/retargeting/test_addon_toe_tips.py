"""Hands and feet whose bones do not tell enough: skin and fingers show where feet end and palms face."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from kfmocap.core.body import human  # noqa: E402
from kfmocap.core.body.soles import BALL_SHARE  # noqa: E402
from kfmocap.core.numerics.frame_ranges import runs  # noqa: E402
from kfmocap.core.retargeting.contacts.foot_paths import BALL, foot_paths  # noqa: E402
from kfmocap.core.retargeting.retarget import prepared  # noqa: E402
from kfmocap.kfmocap_addon.retargeting.send import SendOptions, send_to_rig  # noqa: E402
from kfmocap.kfmocap_addon.retargeting.source_motion import motion_of_armature  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.body import body_armature  # noqa: E402
from made_rigs import LONGER_LEGS, moved_body  # noqa: E402
from mathutils import Matrix, Vector  # noqa: E402
from odd_characters import BODY, CONTROL, controlled_human, shown_heads, skinned_human  # noqa: E402
from render.motions import MOTIONS  # noqa: E402
from render.walking import Walk  # noqa: E402
from render.walking_feet import Footfalls  # noqa: E402

pytest_plugins = ("addon_fixtures",)

DAZ_TOES = ((0.0, 0.0), (0.173, 0.007), (0.287, 0.036), (0.36, 0.09), (0.466, 0.155))
"""How far toes begin beside the big toe of Daz Genesis 3, and behind it, in distances from ankle to big toe."""

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("blender")]


def with_toes(ball=0.65):
    """A character whose foot ends at the ball, before a toe bone as long as importers leave it."""
    armature = with_feet(skinned_human(), ball)
    with body_armature.edit_bones(armature) as bones:
        for side in "LR":
            foot, toe = bones[f"foot.{side}"], bones.new(f"toe.{side}")
            toe.parent, toe.head, toe.tail = foot, foot.tail, foot.tail + 0.01 * (foot.tail - foot.head)
    return armature


def with_short_toes():
    return with_toes(0.75)


def with_feet(armature, share):
    """Shorten or lengthen the bones of feet, not the feet."""
    with body_armature.edit_bones(armature) as bones:
        for bone in bones:
            if "foot" in bone.name:
                bone.tail = bone.head + share * (bone.tail - bone.head)
    return armature


def with_feet_whose_tails_point_aside():
    """A character with toes, whose feet's bones point anywhere, as importers leave them."""
    armature = with_toes()
    with body_armature.edit_bones(armature) as bones:
        for side in "LR":
            bones[f"foot.{side}"].tail += Vector((0.1, 0.0, 0.05))
    return armature


def with_copies_of_feet():
    """A character whose skin is led by copies of its feet, that hang elsewhere, as models for MikuMikuDance have it."""
    armature = with_feet(skinned_human(), 0.6)
    with body_armature.edit_bones(armature) as bones:
        for side in "LR":
            foot, copy = bones[f"foot.{side}"], bones.new(f"copy.{side}")
            copy.parent, copy.head, copy.tail = bones[f"shin.{side}"], foot.head, foot.tail
    [skin] = [o for o in bpy.data.objects if o.type == "MESH"]
    for side in "LR":
        skin.vertex_groups[f"foot.{side}"].name = f"copy.{side}"
    return armature


def with_toes_apart():
    """A character of controls, whose deforming bones hang on nothing: toes do not hang on feet."""
    armature = controlled_human(kind="COPY_TRANSFORMS")
    [skin] = [o for o in bpy.data.objects if o.type == "MESH"]
    with body_armature.edit_bones(armature) as bones:
        for side, prefix in product("LR", ("DEF-", CONTROL)):
            foot, toe = bones[f"{prefix}foot.{side}"], bones.new(f"{prefix}toe.{side}")
            tip, foot.tail = foot.tail.copy(), foot.head.lerp(foot.tail, 0.5)
            toe.parent, toe.head, toe.tail, toe.use_deform = foot, foot.tail, tip, prefix == "DEF-"
        for bone in bones:
            if bone.name.startswith("DEF-"):
                bone.use_connect, bone.parent = False, None
    for side in "LR":
        held = armature.pose.bones[f"DEF-toe.{side}"].constraints.new("COPY_TRANSFORMS")
        held.target, held.subtarget = armature, f"{CONTROL}toe.{side}"
        foot, toe = skin.vertex_groups[f"DEF-foot.{side}"], skin.vertex_groups.new(name=f"DEF-toe.{side}")
        joint = armature.data.bones[f"DEF-toe.{side}"].head_local.y
        led = [v.index for v in skin.data.vertices if v.groups[0].group == foot.index and v.co.y < joint]
        foot.remove(led)
        toe.add(led, 1.0, "REPLACE")
    return armature


def with_copies_of_toes():
    """A character of controls that are found by their names: the skin is led by copies of them that hang on nothing."""
    armature = with_toes_apart()
    for bone in [*armature.data.bones]:
        bone.name = bone.name.replace(CONTROL, "")
    return armature


def turned(armature):
    """How far the legs are turned to keep the feet where those of the performer stand, who has these legs, degrees."""
    report = send_to_rig(bpy.context.scene, moved_body(BODY, MOTIONS["walk"](BODY, 60, 30.0)), armature, 1)
    return max(report["turned_to_keep_feet_and_hands"][leg]["worst_degrees"] for leg in ("leg.L", "leg.R"))


def test_toes_that_do_not_move_show_the_ground_where_there_is_no_skin():
    """A skeleton that walks on its toes, on ankles as high as an animal's: these toes would sink into the ground."""
    armature = skinned_human()
    for skin in [o for o in bpy.data.objects if o.type == "MESH"]:
        bpy.data.objects.remove(skin)
    with body_armature.edit_bones(armature) as bones:
        for side in "LR":
            foot, shin, paw = bones[f"foot.{side}"], bones[f"shin.{side}"], bones.new(f"paw.{side}")
            shin.tail.z = foot.head.z = 0.36
            foot.tail = foot.head + Vector((0.0, 0.0, -0.28))
            paw.parent, paw.head, paw.tail = foot, foot.tail, foot.tail + Vector((0.0, -0.1, -0.08))
    send_to_rig(bpy.context.scene, moved_body(BODY, MOTIONS["walk"](BODY, 30, 30.0)), armature, 1)
    lowest = shown_heads(armature, 30, ["paw.L", "paw.R"])[..., 2].min()
    assert lowest == pytest.approx(0.08, abs=0.005)


def test_the_skin_shows_the_ground_below_a_character_that_is_above_its_origin_at_rest():
    armature = with_feet(skinned_human(), 0.5)
    up = armature.matrix_world.to_3x3().inverted() @ Vector((0.0, 0.0, 0.5))
    with body_armature.edit_bones(armature) as bones:
        for bone in bones:
            bone.head, bone.tail = bone.head + up, bone.tail + up
    [skin] = [o for o in bpy.data.objects if o.type == "MESH"]
    skin.data.transform(Matrix.Translation(up))
    report = send_to_rig(bpy.context.scene, moved_body(BODY, MOTIONS["walk"](BODY, 4, 30.0)), armature, 1)
    assert report["scale"] == pytest.approx(1.0, abs=0.003)


def test_the_skin_shows_the_ground_below_legs_that_are_scaled():
    armature = with_feet(skinned_human(), 0.5)
    for side in "LR":
        armature.pose.bones[f"shin.{side}"].scale = (1.0, 1.2, 1.0)
    report = send_to_rig(bpy.context.scene, moved_body(BODY, MOTIONS["walk"](BODY, 30, 30.0)), armature, 1)
    longer = 0.2 * armature.data.bones["shin.L"].length * armature.matrix_world.to_scale().x
    assert report["scale"] == pytest.approx(1 + longer / 0.95, abs=0.02)
    lowest = shown_heads(armature, 30, ["foot.L", "foot.R"])[..., 2].min()
    assert lowest == pytest.approx(BODY.parts[BODY.index("foot.L")].head_world[2], abs=0.02)


@pytest.mark.parametrize("made", [skinned_human, controlled_human])
@pytest.mark.parametrize("share", [0.5, 1.5])
def test_legs_are_not_turned_where_bones_of_feet_are_not_as_long_as_the_feet(made, share):
    assert turned(with_feet(made(), share)) < 0.5


@pytest.mark.parametrize(
    "made", [with_toes, with_short_toes, with_copies_of_feet, with_toes_apart, with_copies_of_toes]
)
def test_the_skin_shows_where_feet_end_whose_bones_do_not(made):
    assert turned(made()) < 0.5


def test_feet_point_where_their_toes_begin_though_their_bones_point_aside():
    armature = with_feet_whose_tails_point_aside()
    rest = np.array(armature.data.bones["foot.L"].matrix_local)[:3, :3]
    motion = moved_body(BODY, MOTIONS["walk"](BODY, 2, 30.0))
    send_to_rig(bpy.context.scene, motion, armature, 1)
    bpy.context.scene.frame_set(1)
    shown = np.array(armature.pose.bones["foot.L"].matrix)[:3, :3] @ rest.T
    assert np.abs(shown - motion.turns[0, motion.rest.names.index("foot.L")]).max() < 0.01


def test_a_foot_that_is_long_indeed_rolls_over_its_own_tips():
    armature = with_feet(skinned_human(), 1.6)
    for skin in bpy.data.objects:
        if skin.type == "MESH":
            for vertex in skin.data.vertices:
                if vertex.co.z < 0.09:  # the feet
                    vertex.co.y *= 1.6
    assert turned(armature) > 2


def test_toes_of_a_foot_that_is_long_for_its_leg_bend_on_the_ground():
    """Those of the performer's own proportions do not, and keep the pose that they have."""
    walk = moved_body(BODY, MOTIONS["walk"](BODY, 60, 30.0))
    for share in (1.0, 1.6):
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        armature = with_feet(skinned_human(), share)
        [skin] = [o for o in bpy.data.objects if o.type == "MESH"]
        with body_armature.edit_bones(armature) as bones:
            for side in "LR":
                foot, toe = bones[f"foot.{side}"], bones.new(f"toe.{side}")
                tip, foot.tail = foot.tail.copy(), foot.head.lerp(foot.tail, 0.6)
                toe.parent, toe.head, toe.tail = foot, foot.tail, tip
        for vertex in skin.data.vertices:
            if vertex.co.z < 0.09:  # the feet
                vertex.co.y *= share
        report = send_to_rig(bpy.context.scene, walk, armature, 1)
        toes = [armature.pose.bones[f"toe.{side}"] for side in "LR"]
        assert ("toe.L" in report["not_in_source"]) == (share == 1.0)
        bends = []
        for frame in range(1, 61):
            bpy.context.scene.frame_set(frame)
            bends += [np.degrees(toe.matrix_basis.to_quaternion().angle) for toe in toes]
        assert (max(bends) > 20) == (share > 1)


def with_single_toes(toes):
    """A character whose feet end at the ball, with a bone for each of some toes, with rolls of their own."""
    armature = with_feet(skinned_human(), 0.7)
    with body_armature.edit_bones(armature) as bones:
        for side in "LR":
            foot = bones[f"foot.{side}"]
            for k in range(toes):
                bone = bones.new(f"toe{k + 1}.{side}")
                bone.parent, bone.head = foot, foot.tail + Vector((0.015 * k, 0.0, 0.0))
                bone.tail = bone.head + 0.4 * (foot.tail - foot.head)
                bone.roll = 0.4 * k
    return armature


def with_broad_feet():
    """A character whose five toes begin where those of Daz's people do, on feet a fifth broader, with a bone in the
    middle of each foot, and the knee's pole target, which hangs on the foot.
    """
    armature = with_single_toes(5)
    with body_armature.edit_bones(armature) as bones:
        for side, out in (("L", 1.0), ("R", -1.0)):
            foot = bones[f"foot.{side}"]
            along = foot.tail - foot.head
            for k, (aside, back) in enumerate(DAZ_TOES):
                bone = bones[f"toe{k + 1}.{side}"]
                place = foot.tail - back * along + Vector((1.2 * out * aside * along.length, 0.0, 0.0))
                bone.head, bone.tail = place, place + 0.4 * along
            bone = bones.new(f"instep.{side}")
            bone.parent, bone.head, bone.tail = foot, foot.head + 0.4 * along, foot.tail
            pole = bones.new(f"pole.{side}")
            pole.parent, pole.head, pole.use_deform = foot, foot.head + Vector((0.0, -0.5, 0.4)), False
            pole.tail = pole.head + Vector((0.0, -0.1, 0.0))
    return armature


def rolling_over_balls():
    steps = Footfalls(1.2, 0.8, 0.66, -8, 30, BALL_SHARE, heel_off=0.5, start=0.2)
    return moved_body(BODY, Walk(steps).motion(BODY, np.arange(40) / 30.0), 30.0)


def bends_of_toes(armature, toes):
    """By how much each toe is turned away from its foot in the armature, (F, 2, toes) rotation vectors, degrees."""
    found = []
    for frame in range(1, 41):
        bpy.context.scene.frame_set(frame)
        for name in (f"toe{k + 1}.{side}" for side in "LR" for k in range(toes)):
            at_rest = armature.data.bones[name].matrix_local.to_quaternion()
            turn = at_rest @ armature.pose.bones[name].matrix_basis.to_quaternion() @ at_rest.inverted()
            found.append(np.degrees(np.multiply(turn.angle, turn.axis)))
    return np.reshape(found, (40, 2, toes, 3))


@pytest.mark.parametrize("toes", [1, 5])
def test_toes_bend_where_the_performer_rolls_over_the_balls_of_stiff_feet(toes):
    """Each of five toes about the same axis and by as much as the first, however its bone is rolled."""
    armature = with_single_toes(toes)
    send_to_rig(bpy.context.scene, rolling_over_balls(), armature, 1)
    bends = bends_of_toes(armature, toes)
    assert np.linalg.norm(bends, axis=-1).max() > 15
    np.testing.assert_allclose(bends, bends[:, :, :1].repeat(toes, axis=2), atol=0.01)


def test_the_skin_of_stiff_feet_is_not_in_the_floor_where_the_performer_rolls_over_the_balls():
    """Its legs are longer than the performer's, but its feet are not."""
    armature = skinned_human(body=human(1.75, LONGER_LEGS))
    [skin] = [o for o in bpy.data.objects if o.type == "MESH"]
    send_to_rig(bpy.context.scene, rolling_over_balls(), armature, 1)
    lowest = []
    for frame in range(1, 41):
        bpy.context.scene.frame_set(frame)
        shown = skin.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()
        lowest.append(min(vertex.co.z for vertex in shown.vertices))
    assert min(lowest) > -0.003


def test_all_toes_of_broad_feet_bend_and_no_bone_of_the_instep_does():
    armature = with_broad_feet()
    send_to_rig(bpy.context.scene, rolling_over_balls(), armature, 1)
    most = np.linalg.norm(bends_of_toes(armature, 5), axis=-1).max(axis=(0, 1))
    assert most.min() > 10
    assert most == pytest.approx([most.max()] * 5)
    assert all(armature.pose.bones[f"instep.{side}"].matrix_basis.is_identity for side in "LR")


def with_high_toes():
    """A character whose toes carry the ball, and begin high above the floor, as those of an animal on two legs."""
    armature = skinned_human()
    with body_armature.edit_bones(armature) as bones:
        for side in "LR":
            foot, toe = bones[f"foot.{side}"], bones.new(f"toe.{side}")
            tip, foot.tail = foot.tail.copy(), foot.head.lerp(foot.tail, 0.35)
            toe.parent, toe.head, toe.tail = foot, foot.tail, tip
    return armature


def test_toes_that_carry_the_ball_stay_where_it_does():
    """They would slide forward as their joint does, which moves over the ball while the heel rises."""
    armature, performer = with_high_toes(), rolling_over_balls()
    send_to_rig(bpy.context.scene, performer, armature, 1)
    upright, bones = prepared(performer)
    bends = []
    for path in foot_paths(upright, bones):
        toe = armature.pose.bones[f"toe.{path.side}"]
        for first, last in runs(path.planted[:, BALL]):
            tips = []
            for frame in range(first, last + 1):
                bpy.context.scene.frame_set(1 + frame)
                tips.append(toe.tail[:2])
                bends.append(np.degrees(toe.matrix_basis.to_quaternion().angle))
            moved = np.array(tips) - path.heel_and_ball[first : last + 1, BALL, :2]
            assert np.ptp(moved, axis=0).max() < 0.002
    assert max(bends) > 15


@pytest.mark.parametrize("what", ["helper", "held", "driven"])
def test_toes_do_not_bend_beside_others_that_cannot(what):
    """One that leads no skin may be part of the rig's mechanism; one that something else turns would stay behind."""
    armature = with_single_toes(5)
    if what == "helper":
        armature.data.bones["toe3.L"].use_deform = False
    elif what == "driven":
        armature.pose.bones["toe3.L"].driver_add("rotation_quaternion", 1).driver.expression = "0.0"
    else:
        held = armature.pose.bones["toe3.L"].constraints.new("COPY_ROTATION")
        held.target, held.subtarget = armature, "shin.L"
    send_to_rig(bpy.context.scene, rolling_over_balls(), armature, 1)
    bends = np.linalg.norm(bends_of_toes(armature, 5), axis=-1)
    assert bends[:, 0, [0, 1, 3, 4]].max() < 0.01
    assert bends[:, 1].max() > 15


def test_all_toes_move_with_those_of_the_motion():
    """The performer has one bone for the toes of each foot."""
    performer = with_single_toes(1)
    send_to_rig(bpy.context.scene, rolling_over_balls(), performer, 1)
    motion, bones = motion_of_armature(bpy.context.scene, performer, (1, 40))
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    armature = with_single_toes(5)
    send_to_rig(bpy.context.scene, motion, armature, 1, SendOptions(source_bones=bones))
    bends = bends_of_toes(armature, 5)
    assert np.linalg.norm(bends, axis=-1).max() > 15
    np.testing.assert_allclose(bends, bends[:, :, :1].repeat(5, axis=2), atol=0.01)


def test_fingers_that_are_not_moved_show_where_palms_face():
    """The performer has no fingers, and holds its palms down; the character's face forward at rest."""
    armature = skinned_human()
    with body_armature.edit_bones(armature) as bones:
        for side in "LR":
            hand = bones[f"hand.{side}"]
            for finger, up in (("index", 0.03), ("middle", 0.0), ("pinky", -0.03)):
                bone = bones.new(f"{finger}.{side}")
                bone.parent, bone.head = hand, hand.tail + Vector((0.0, 0.0, up))
                bone.tail = bone.head + 0.3 * (hand.tail - hand.head)
    motion = moved_body(BODY, MOTIONS["walk"](BODY, 2, 30.0))
    send_to_rig(bpy.context.scene, motion, armature, 1)
    for side in "LR":
        index, pinky = shown_heads(armature, 1, [f"index.{side}", f"pinky.{side}"])[0]
        ahead = motion.turns[0, motion.rest.names.index(f"hand.{side}")] @ [0.0, -1.0, 0.0]
        assert (index - pinky) @ ahead > 0.99 * np.linalg.norm(index - pinky), side
