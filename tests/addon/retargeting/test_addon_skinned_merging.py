"""Bones of bought characters that are no parts of a body: halves of limbs, fingers, hair, skirts."""

from __future__ import annotations

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from addon_shots import joint_error  # noqa: E402
from kfmocap.core.errors import BodyError  # noqa: E402
from kfmocap.kfmocap_addon.retargeting.tracked_bodies.part_roles import limb_bones  # noqa: E402
from kfmocap.kfmocap_addon.retargeting.tracked_bodies.skinned_body import use_as_body  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.body import body_armature  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.keys import motion_curves  # noqa: E402
from mathutils import Vector  # noqa: E402
from odd_characters import BODY, add_bones, bind, controlled_human, layered_human, points_of, skinned_human  # noqa: E402
from synthetic import swing  # noqa: E402

pytest_plugins = ("addon_fixtures",)

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("blender")]

LOWER = {"upper_arm": "forearm", "forearm": "hand", "thigh": "shin", "shin": "foot"}


def cloud(head, tail, radius):
    """Points (120, 3) round a line."""
    dice = np.random.default_rng(5)
    round_it = dice.normal(size=(120, 3))
    along = dice.uniform(0, 1, (120, 1)) * (tail - head)
    return head + along + radius * round_it / np.linalg.norm(round_it, axis=1, keepdims=True)


def names_of(armature):
    return sorted(body_armature.body_from_armature(armature).names)


def with_chain(armature, name, parent, head, way, radius):
    """Four bones, one on the other, each of which leads skin."""
    ends = [head + k * way for k in range(5)]
    chain = [(f"{name}_{k}", parent if k == 0 else f"{name}_{k - 1}", ends[k], ends[k + 1]) for k in range(4)]
    add_bones(armature, chain, deform=True)
    bind(armature, f"{name} skin", [(bone, cloud(a, b, radius)) for bone, _, a, b in chain])


@pytest.mark.parametrize(("share", "aside"), [(0.5, 0.0), (0.2, 0.07)], ids=["halves", "short and askew"])
def test_the_halves_of_limbs_are_one_part(share, aside):
    """The first may be short, and askew, as that of the thighs of MakeHuman's women."""
    armature = skinned_human()
    halves = [(f"{upper}.{side}", f"{lower}.{side}") for upper, lower in LOWER.items() for side in "LR"]
    with body_armature.edit_bones(armature) as bones:
        for upper, lower in halves:
            half = bones.new(f"{upper}Twist")
            limb = bones[lower].head - bones[upper].head
            beside = aside * limb.cross((0.0, -1.0, 0.0))
            half.head, half.tail = bones[upper].head + share * limb + beside, bones[lower].head
            half.parent = bones[upper]
            bones[lower].use_connect, bones[lower].parent = False, half
    led = []
    for upper, lower in halves:
        head, tail = (np.array(armature.data.bones[name].head_local) for name in (upper, lower))
        led.append((f"{upper}Twist", cloud(head + share * (tail - head), tail, 0.04)))
    bind(armature, "lower halves", led)
    armature, remarks = use_as_body(bpy.context.scene, armature)
    body = body_armature.body_from_armature(armature)
    assert sorted(body.names) == sorted(BODY.names)
    assert not remarks
    truth = swing(body, 3)
    motion_curves.write_motion(armature, truth, 1)
    assert joint_error(armature, body, truth) < 0.1


@pytest.mark.parametrize("how", ["inherits no rotation", "follows"])
def test_a_half_of_a_limb_that_does_not_move_with_it_is_named(how):
    armature = skinned_human()
    with body_armature.edit_bones(armature) as bones:
        half = bones.new("forearmTwist")
        half.head, half.tail = bones["forearm.L"].head.lerp(bones["hand.L"].head, 0.5), bones["hand.L"].head
        half.parent, half.use_inherit_rotation = bones["forearm.L"], how == "follows"
        bones["hand.L"].use_connect, bones["hand.L"].parent = False, half
    if how == "follows":
        held = armature.pose.bones["forearmTwist"].constraints.new("COPY_ROTATION")
        held.target, held.subtarget = armature, "head"
    with pytest.raises(BodyError, match="bone forearmTwist: "):
        use_as_body(bpy.context.scene, armature)


def test_fingers_toes_and_hair_belong_to_hands_feet_and_the_head_however_long_they_are():
    armature = skinned_human()
    hand, foot, head = (BODY.parts[BODY.index(name)] for name in ("hand.L", "foot.R", "head"))
    along = (hand.tail_world - hand.head_world) / np.linalg.norm(hand.tail_world - hand.head_world)
    with_chain(armature, "f_index", "hand.L", hand.tail_world, 0.06 * along, 0.01)
    with_chain(armature, "big_toe", "foot.R", foot.tail_world, np.array([0.0, -0.06, 0.0]), 0.015)
    with_chain(armature, "ponytail", "head", head.head_world + [0.0, 0.12, 0.1], np.array([0.0, 0.05, -0.25]), 0.03)
    armature, _ = use_as_body(bpy.context.scene, armature)
    assert names_of(armature) == sorted(BODY.names)
    body = body_armature.body_from_armature(armature)
    points = body.parts[body.index("hand.L")].vertices
    assert np.ptp(points, axis=0).max() > 0.2  # the finger is there
    points = body.parts[body.index("head")].vertices
    assert np.ptp(points, axis=0).max() < 0.5  # the end of the hair, a metre below, is not


@pytest.mark.parametrize("name", ["J_Sec_L_Skirt", "LeftBreast", "skirt_front", "スカート_0_1", "Cape.001", "Юбка_1"])
def test_what_a_simulation_moves_belongs_to_the_part_above(name):
    armature = skinned_human()
    top = BODY.parts[BODY.index("pelvis")].head_world
    with_chain(armature, name, "pelvis", top + [0.1, -0.1, 0.0], np.array([0.03, -0.02, -0.1]), 0.03)
    armature, remarks = use_as_body(bpy.context.scene, armature)
    assert names_of(armature) == sorted(BODY.names)
    assert not remarks


def with_skirt():
    """A human, and four chains of bones under names that say nothing round the pelvis."""
    armature = skinned_human()
    top = BODY.parts[BODY.index("pelvis")].head_world
    for k, way in enumerate(([1.0, 0, 0], [0, 1.0, 0], [-1.0, 0, 0], [0, -1.0, 0])):
        way = np.array(way)
        with_chain(armature, f"x{k}", "pelvis", top + 0.12 * way, 0.02 * way - [0.0, 0.0, 0.15], 0.03)
    return armature


def test_what_carries_no_limb_trunk_or_head_goes_along_with_the_body_whatever_it_is_called():
    armature, remarks = use_as_body(bpy.context.scene, with_skirt())
    body = body_armature.body_from_armature(armature)
    assert sorted(body.names) == sorted(BODY.names)
    [said] = remarks
    assert said.startswith("bones x0_0, x0_1, x0_2, ...: ")
    pelvis = points_of(body.parts[body.index("pelvis")])
    assert np.ptp(pelvis[:, 2]) < 0.55  # the hem, 0.6 m below, is not there


def test_chains_that_hang_on_a_bone_of_their_own_go_along_with_the_body():
    armature = skinned_human()
    top = BODY.parts[BODY.index("pelvis")].head_world
    add_bones(armature, [("belt", "pelvis", top, top + [0.0, 0.05, 0.0])], deform=True)
    for k, x in enumerate((-0.1, 0.0, 0.1)):
        with_chain(armature, f"x{k}", "belt", top + [x, -0.1, 0.0], np.array([0.0, -0.01, -0.1]), 0.03)
    armature, _ = use_as_body(bpy.context.scene, armature)
    assert names_of(armature) == sorted(BODY.names)


def test_what_hangs_on_a_finger_belongs_to_the_hand_however_long_it_is():
    armature = skinned_human()
    tip = BODY.parts[BODY.index("hand.L")].tail_world
    joint, end = tip + [0.04, 0.0, 0.0], tip + [0.04, -0.9, 0.0]
    add_bones(armature, [("index1.L", "hand.L", tip, joint), ("blade", "index1.L", joint, end)], deform=True)
    bind(armature, "blade", [("blade", cloud(joint, end, 0.03))])
    armature, remarks = use_as_body(bpy.context.scene, armature)
    body = body_armature.body_from_armature(armature)
    assert sorted(body.names) == sorted(BODY.names)
    assert not remarks
    assert np.ptp(body.parts[body.index("hand.L")].vertices, axis=0).max() > 0.8


def test_what_key_poses_turn_is_tracked_though_it_carries_no_limb():
    armature = with_skirt()
    for frame, angle in ((1, 0.0), (9, 0.4)):
        armature.pose.bones["x1_0"].rotation_quaternion = (np.cos(angle), np.sin(angle), 0, 0)
        armature.pose.bones["x1_0"].keyframe_insert("rotation_quaternion", frame=frame)
        armature.pose.bones["x2_0"].keyframe_insert("rotation_quaternion", frame=frame)  # keyed, but never turned
    armature, _ = use_as_body(bpy.context.scene, armature)
    assert names_of(armature) == sorted([*BODY.names, "x1_0"])


def test_nothing_goes_along_with_a_body_whose_head_is_not_known():
    """A dragon whose forelegs and wings pass for legs and arms: its skull would go along with the neck."""
    armature = skinned_human({name: f"b{k}" for k, name in enumerate(BODY.names)})
    head = BODY.parts[BODY.index("head")]
    with body_armature.edit_bones(armature) as bones:
        bone = bones[f"b{BODY.index('head')}"]
        bone.head = bone.head + (bone.tail - bone.head) * 0.1 + Vector((0.0, -0.6, 0.0))
        bone.tail = bone.head + Vector((0.0, -0.2, 0.0))
    assert "head" not in limb_bones(armature).bones
    armature, remarks = use_as_body(bpy.context.scene, armature)
    assert f"b{BODY.index(head.name)}" in names_of(armature)
    assert not remarks


def test_further_arms_are_tracked():
    armature = skinned_human()
    chest = BODY.parts[BODY.index("chest")].head_world
    arm = [chest + [0.15 + 0.25 * k, 0.0, 0.0] for k in range(4)]
    fingers = [(f"third_{q}", "third_2", arm[3], arm[3] + [0.06, 0.03 * q, 0.0]) for q in range(3, 6)]
    bones = [(f"third_{k}", f"third_{k - 1}" if k else "chest", arm[k], arm[k + 1]) for k in range(3)]
    add_bones(armature, [*bones, *fingers], deform=True)
    bind(armature, "third arm", [(name, cloud(a, b, 0.04)) for name, _, a, b in bones])
    armature, _ = use_as_body(bpy.context.scene, armature)
    assert {"third_0", "third_1", "third_2"} < set(names_of(armature))


def test_an_animals_long_tail_has_parts_of_its_own():
    armature = skinned_human({name: f"bone {k}" for k, name in enumerate(BODY.names)})
    top = BODY.parts[BODY.index("pelvis")].head_world
    with_chain(armature, "tail", "bone 0", top + [0.0, 0.1, 0.0], np.array([0.0, 0.1, -0.1]), 0.04)
    armature, _ = use_as_body(bpy.context.scene, armature)
    assert len(names_of(armature)) == len(BODY.names) + 4


def test_fingers_of_a_control_rig_belong_to_the_hand():
    armature = controlled_human()
    hand = BODY.parts[BODY.index("hand.L")]
    along = (hand.tail_world - hand.head_world) / np.linalg.norm(hand.tail_world - hand.head_world)
    with_chain(armature, "f_index", "DEF-hand.L", hand.tail_world, 0.06 * along, 0.01)
    armature, _ = use_as_body(bpy.context.scene, armature)
    assert len(names_of(armature)) == len(BODY.names)


def test_halves_of_limbs_that_are_stretched_between_points_on_its_control_are_one_part():
    armature = controlled_human()
    thigh, shin = (BODY.parts[BODY.index(name)].head_world for name in ("thigh.L", "shin.L"))
    middle = (thigh + shin) / 2
    points = [("MCH-middle", "CTRL-thigh.L", middle), ("MCH-end", "CTRL-thigh.L", shin)]
    add_bones(armature, [(name, above, at, at + [0.0, 0.0, 0.05]) for name, above, at in points])
    add_bones(armature, [("DEF-thigh2.L", "MCH-middle", middle, shin)], deform=True)
    stretched = armature.pose.bones["DEF-thigh2.L"].constraints.new("STRETCH_TO")
    stretched.target, stretched.subtarget = armature, "MCH-end"
    bind(armature, "lower half", [("DEF-thigh2.L", cloud(middle, shin, 0.05))])
    armature, remarks = use_as_body(bpy.context.scene, armature)
    assert len(names_of(armature)) == len(BODY.names)
    assert not remarks


@pytest.mark.parametrize("above", ["ORG-pelvis", "CTRL-pelvis"])
@pytest.mark.parametrize("posed", [False, True], ids=["goes along", "posed"])
def test_what_hangs_on_controls_or_their_copies_goes_along_with_the_limb_or_the_trunk(posed, above):
    """The lower half of a thigh and a finger hang on bones that play no role, as they copy controls. A skirt that is
    posed is tracked where it hangs on a control itself.
    """
    plain, _ = use_as_body(bpy.context.scene, layered_human())
    parts = names_of(plain)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    armature = layered_human()
    at = {part.name: part.head_world for part in BODY.parts}
    halves = ("DEF-half", "ORG-thigh.L", (at["thigh.L"] + at["shin.L"]) / 2, at["shin.L"])
    finger = BODY.parts[BODY.index("hand.L")].tail_world
    add_bones(armature, [halves, ("DEF-finger", "ORG-hand.L", finger, finger + [0.1, 0, 0])], deform=True)
    bind(armature, "more", [("DEF-half", cloud(*halves[2:], 0.05)), ("DEF-finger", cloud(finger, finger + 0.1, 0.01))])
    with_chain(armature, "x", above, at["pelvis"] - [0, 0.15, 0], np.array([0.0, 0.0, -0.1]), 0.05)
    for frame, angle in ((1, 0.0), (9, 0.4)) if posed else ():
        armature.pose.bones["x_0"].rotation_quaternion = (np.cos(angle), np.sin(angle), 0, 0)
        armature.pose.bones["x_0"].keyframe_insert("rotation_quaternion", frame=frame)
    armature, _ = use_as_body(bpy.context.scene, armature)
    assert names_of(armature) == sorted([*parts, *(["x_0"] if posed and above == "CTRL-pelvis" else [])])
