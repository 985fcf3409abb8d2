"""Motion on other skeletons: joint angles come back from every one, feet stay where they stood, nothing is twisted."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from kfmocap.core.body import human
from kfmocap.core.body.skeleton_motion import RestSkeleton
from kfmocap.core.errors import BodyError
from kfmocap.core.numerics import rotations
from kfmocap.core.retargeting.bone_roles.bone_presets import PRESETS
from kfmocap.core.retargeting.bone_roles.roles import BoneMap
from kfmocap.core.retargeting.control_rig import local_places, local_turns
from kfmocap.core.retargeting.rest_poses.rest_alignment import alignments, toe_reach
from kfmocap.core.retargeting.retarget import grounded, prepared, retarget, upright_turn
from kfmocap.core.retargeting.transfer import BoneBlend, RetargetOptions, chain_blends, source_blends
from made_rigs import LONGER_LEGS, SHORTER_ARMS, made_rig, moved_body, moved_rig, wild_motion
from render.motions import MOTIONS
from render.movement_phrases import Movement

BODY = human(1.75)
KINDS = [name for name in PRESETS if name != "rigify-ik"]
POSES = {name: (np.radians(0 if k % 2 else 45), k) for k, name in enumerate(KINDS)}
"""Half of the rigs stand in a T pose, half in an A pose; each has rolls of its own."""


def rig_of(name, body=BODY):
    return made_rig(name, body, *POSES[name])


def degrees(a, b):
    return np.degrees(np.linalg.norm(rotations.log(np.swapaxes(a, -1, -2) @ b), axis=-1))


def through(source, rig):
    """The motion on a rig, as the source for the next."""
    return moved_rig(rig, retarget(*prepared(source), rig).poses)


@pytest.mark.parametrize(("there", "over"), list(product(KINDS, KINDS)), ids="-".join)
def test_joint_angles_come_back_from_every_pair_of_skeletons(there, over):
    source = moved_body(BODY, wild_motion())
    once, twice = rig_of(there), rig_of(over)
    back = through(through(through(source, once), twice), rig_of("kfmocap"))
    own = rig_of("kfmocap").rest.indices(BODY.names)
    direct = through(source, rig_of("kfmocap"))
    assert degrees(back.turns[:, own], direct.turns[:, own]).max() < 0.1
    assert np.abs(back.positions[:, own] - direct.positions[:, own]).max() < 1e-4


@pytest.mark.parametrize("name", KINDS)
def test_a_motion_without_collar_bones_comes_back_from_rigs_that_have_them(name):
    body = human(1.75, collar_bones=False)
    source = moved_body(body, wild_motion(collar_bones=False))
    there = through(source, rig_of(name))
    back = through(there, rig_of("kfmocap"))
    k = back.rest.indices(body.names)
    direct = through(source, rig_of("kfmocap"))
    assert degrees(back.turns[:, k], direct.turns[:, k]).max() < 0.1
    collar = rig_of("kfmocap").rest.indices(["shoulder.L", "chest"])
    assert degrees(direct.turns[:, collar[0]], direct.turns[:, collar[1]]).max() < 1e-6  # they rest


def test_limbs_of_an_a_pose_point_where_those_of_the_t_pose_point():
    source = moved_body(BODY, wild_motion())
    result = through(source, made_rig("mixamo", BODY, np.radians(45), 3))
    j = result.rest.indices(["mixamorig:LeftArm", "mixamorig:LeftForeArm", "mixamorig:LeftHand"])
    k = [BODY.index(f"{limb}.L") for limb in ("upper_arm", "forearm", "hand")]
    for a, b in ((0, 1), (1, 2)):
        ways = result.positions[:, j[b]] - result.positions[:, j[a]]
        own = source.positions[:, k[b]] - source.positions[:, k[a]]
        assert np.abs(ways - own).max() < 1e-9


@pytest.fixture(scope="module")
def walking():
    return prepared(moved_body(BODY, MOTIONS["walk"](BODY, 60, 30.0)))


@pytest.fixture(scope="module")
def other():
    """The same man with legs 20 % longer and arms 15 % shorter, as a Mixamo character in A pose."""
    return made_rig("mixamo", human(1.75, {**LONGER_LEGS, **SHORTER_ARMS}), np.radians(45), 5)


@pytest.mark.parametrize(("side", "word"), [("L", "Left"), ("R", "Right")])
def test_feet_that_stand_still_stand_still_on_longer_legs(walking, other, side, word):
    source, bones = walking
    result = retarget(source, bones, other)
    [path] = [path for path in result.feet if path.side == side]
    flat = path.planted.all(axis=1)
    still = flat & np.roll(flat, 1)
    still[0] = False
    foot = other.rest.indices([f"mixamorig:{word}Foot"])[0]
    end = other.rest.tails[foot] - other.rest.heads[foot]
    tip = result.poses.places[:, foot] + result.poses.turns[:, foot] @ end
    own = source.rest.indices([f"foot.{side}"])[0]
    own_end = source.rest.tails[own] - source.rest.heads[own]
    own_tip = source.positions[:, own] + source.turns[:, own] @ own_end
    steps = np.linalg.norm(np.diff(tip, axis=0), axis=1)[still[1:]]
    own_steps = result.placement.scale * np.linalg.norm(np.diff(own_tip, axis=0), axis=1)[still[1:]]
    assert still.sum() > 10
    assert (steps - own_steps).max() < 0.002
    above = tip[flat, 2] - (other.rest.tails[foot, 2] - other.rest.ground)
    own_above = own_tip[flat, 2] - own_end[2] - source.rest.heads[own, 2]
    assert np.abs(above - own_above).max() < 0.005


def test_no_bone_is_twisted_when_feet_are_kept(walking, other):
    source, bones = walking
    result = retarget(source, bones, other)
    change = np.swapaxes(result.by_angles.turns, -1, -2) @ result.poses.turns
    assert np.degrees(np.linalg.norm(rotations.log(change), axis=-1)).max() < 10


def test_clean_feet_do_not_move_at_all(walking, other):
    result = retarget(*walking, other, RetargetOptions(feet="clean"))
    for path, word in zip(result.feet, ("Left", "Right"), strict=True):
        foot = other.rest.indices([f"mixamorig:{word}Foot"])[0]
        flat = path.planted.all(axis=1)
        still = flat[1:] & flat[:-1]
        assert np.linalg.norm(np.diff(result.poses.places[:, foot], axis=0), axis=1)[still].max() < 1e-6


def test_clean_feet_that_stand_on_their_balls_keep_their_heels_raised(other):
    tiptoe = Movement({"lift.L": 0.1, "lift.R": 0.1, "z": -0.02}, (), tremor=0.0)
    source, bones = prepared(moved_body(BODY, tiptoe.motion(BODY, np.arange(30) / 30)))
    result = retarget(source, bones, other, RetargetOptions(feet="clean"))
    for path in result.feet:
        assert path.planted.all()
        foot = other.index(f"foot.{path.side}")
        assert degrees(result.by_angles.turns[:, foot], result.poses.turns[:, foot]).max() < 1


def test_toes_that_stay_straight_stay_above_the_ground(walking):
    """The foot of a source without toes rolls on their tips, where a foot bone that ends at the ball does not reach."""
    rig = made_rig("mixamo", BODY, 0.0)
    foot = rig.index("foot.L")
    end = rig.rest.tails[foot] - rig.rest.heads[foot]
    tails = rig.rest.tails.copy()
    tails[foot] = rig.rest.heads[foot] + 0.7 * end
    short = replace(rig, rest=replace(rig.rest, tails=tails), toe_tips=dict.fromkeys("LR", abs(end[1])))
    poses = retarget(*walking, short).poses
    own = walking[0].rest.indices(["foot.L"])[0]
    tips = [
        p[:, j, 2] + (turns[:, j] @ end)[:, 2]
        for p, turns, j in (
            (poses.places, poses.turns, foot),
            (walking[0].positions, walking[0].turns, own),
        )
    ]
    assert np.abs(tips[0] - tips[1]).max() < 1e-3


def test_toes_of_feet_that_are_long_for_their_legs_stay_above_the_ground(walking):
    """As those of children and of comic figures."""
    rig = made_rig("mixamo", BODY, 0.0)
    foot, long = rig.index("foot.L"), 1.4
    end = rig.rest.tails[foot] - rig.rest.heads[foot]
    sole = np.array([long * end[0], long * end[1], -rig.rest.heads[foot][2]])
    poses = retarget(*walking, replace(rig, toe_tips=dict.fromkeys("LR", long * abs(end[1])))).poses
    tips = poses.places[:, foot, 2] + (poses.turns[:, foot] @ sole)[:, 2]
    assert tips.min() > -0.005


@pytest.mark.parametrize("length", [0.001, 0.03, 0.09, 0.25, 0.3])
def test_feet_whose_bones_are_not_as_long_as_the_foot_turn_no_leg(walking, length):
    """On a character of the performer's own proportions: as importers leave bones, or as far as the ball, metres."""
    rig = made_rig("mixamo", BODY, 0.0)
    feet = rig.rest.indices(["mixamorig:LeftFoot", "mixamorig:RightFoot"])
    tails = rig.rest.tails.copy()
    ways = tails[feet] - rig.rest.heads[feet]
    tails[feet] = rig.rest.heads[feet] + length * ways / np.linalg.norm(ways, axis=1, keepdims=True)
    short = replace(rig, rest=replace(rig.rest, tails=tails))
    kept, free = (retarget(*walking, short, RetargetOptions(feet=feet)).poses for feet in ("keep", "off"))
    knees = rig.rest.indices(["mixamorig:LeftLeg", "mixamorig:RightLeg"])
    assert degrees(kept.turns[:, knees], free.turns[:, knees]).max() < 0.5


@pytest.mark.parametrize(
    ("tail", "reach"), [((0.0, -0.08, 0.0), 0.21), ((0.0, 0.0, 0.08), 0.195), ((0.0, -0.3, 0.0), 0.195)]
)
def test_the_reach_of_toes_is_estimated_where_their_tails_are_arbitrary(tail, reach):
    rig = made_rig("mixamo", BODY, 0.0)
    foot, shin = rig.index("foot.L"), rig.index("shin.L")
    heads, tails = (a.copy() for a in (rig.rest.heads, rig.rest.tails))
    ball = heads[foot] + [0.0, -0.13, 0.0]
    rest = RestSkeleton(
        (*rig.rest.names, "toe"), (*rig.rest.parents, foot), np.vstack([heads, ball]), np.vstack([tails, ball + tail])
    )
    assert np.linalg.norm(heads[shin] - heads[foot]) > 0.13
    bones = BoneMap({**rig.bones.bones, "toe.L": ("toe",)})
    found, shown = toe_reach(rest, bones, "L")
    assert (found, shown) == (pytest.approx(reach, abs=1e-6), tail == (0.0, -0.08, 0.0))


@pytest.mark.parametrize(("ankle", "toe"), [(0.07, 0.02), (0.3, 0.01)])
def test_feet_with_high_ankles_stand_on_the_origin(ankle, toe):
    """Short legs below a large head, and those of animals that walk on their toes."""
    rig = made_rig("mixamo", BODY)
    heads, tails = rig.rest.heads.copy(), rig.rest.tails.copy()
    for side in "LR":
        thigh, shin, foot = (rig.index(f"{limb}.{side}") for limb in ("thigh", "shin", "foot"))
        heads[[thigh, shin, foot], 2] = ankle + 0.3, ankle + 0.15, ankle
        tails[foot, 2] = toe
    assert grounded(replace(rig.rest, heads=heads, tails=tails), rig.bones).ground == 0.0


def test_the_sole_shows_the_ground_below_a_skeleton_that_does_not_stand():
    rig = made_rig("mixamo", BODY)
    up = [0.0, 0.0, 0.4]
    raised = replace(rig.rest, heads=rig.rest.heads + up, tails=rig.rest.tails + up)
    assert grounded(raised, rig.bones, sole=0.1).ground == pytest.approx(raised.heads[rig.index("foot.L"), 2] - 0.1)
    assert grounded(rig.rest, rig.bones, sole=0.1).ground == 0.0


@pytest.mark.parametrize("splay", [0.0, 0.2])
def test_the_knees_of_who_sits_at_rest_bend_as_those_of_who_stands(splay):
    """The thigh's twist at rest is what its knee shows: turning the thigh down by the shortest way would keep half."""
    standing = made_rig("kfmocap", BODY)
    heads, tails = standing.rest.heads.copy(), standing.rest.tails.copy()
    for side, sign in (("L", 1.0), ("R", -1.0)):
        thigh, shin, foot = (standing.index(f"{limb}.{side}") for limb in ("thigh", "shin", "foot"))
        long = np.linalg.norm(heads[shin] - heads[thigh])
        knee = heads[thigh] + long * np.array([sign * np.sin(splay), -np.cos(splay), 0.0])
        ankle = knee - [0.0, 0.0, np.linalg.norm(heads[foot] - heads[shin])]
        tails[foot] += ankle - heads[foot]
        heads[shin], heads[foot] = knee, ankle
        tails[thigh], tails[shin] = knee, ankle
    sitting = replace(standing.rest, heads=heads, tails=tails)
    there = alignments(standing.rest, standing.bones, sitting, standing.bones)
    back = alignments(sitting, standing.bones, standing.rest, standing.bones)
    for side, sign in (("L", 1.0), ("R", -1.0)):
        [A], [B] = there[f"thigh.{side}"], back[f"thigh.{side}"]
        hinge = [np.cos(splay), sign * np.sin(splay), 0.0]
        np.testing.assert_allclose(A @ hinge, [1.0, 0.0, 0.0], atol=0.05)
        np.testing.assert_allclose(A @ B, np.eye(3), atol=1e-9)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("turn", [0.0, np.pi / 2, np.pi, -np.pi / 2])
def test_skeletons_that_lie_or_stand_on_their_heads_are_put_upright(axis, turn):
    rig = made_rig("mixamo", BODY)
    given = rotations.exp(turn * np.eye(3)[axis])
    turned = replace(rig.rest, heads=rig.rest.heads @ given.T, tails=rig.rest.tails @ given.T)
    found = upright_turn(turned, rig.bones) @ given
    np.testing.assert_allclose(found[2], [0.0, 0.0, 1.0], atol=1e-12)


def test_a_skeleton_above_its_origin_stands_on_its_feet():
    rig = made_rig("mixamo", BODY)
    up = [0.0, 0.0, 0.25]
    raised = replace(rig.rest, heads=rig.rest.heads + up, tails=rig.rest.tails + up)
    feet = [rig.index(f"foot.{side}") for side in "LR"]
    lowest = min(raised.heads[feet, 2].min(), raised.tails[feet, 2].min())
    assert grounded(raised, rig.bones).ground == pytest.approx(lowest)


def test_in_place_the_hips_stay_where_they_were(walking, other):
    result = retarget(*walking, other, RetargetOptions(root="in-place"))
    hips = result.poses.places[:, other.index("thigh.L")] + result.poses.places[:, other.index("thigh.R")]
    assert np.ptp(hips[:, :2], axis=0).max() < 1e-9


def test_a_skeleton_without_width_is_refused_by_its_bones(walking, other):
    flat = replace(other, rest=replace(other.rest, heads=other.rest.heads * [0.0, 1.0, 1.0]))
    with pytest.raises(BodyError, match=r"LeftUpLeg.*RightArm: left is not beside right at rest"):
        retarget(*walking, flat)


def test_a_missing_root_bone_is_said(walking, other):
    with pytest.raises(BodyError, match="no root bone"):
        retarget(*walking, other, RetargetOptions(root="root-bone"))


def test_channels_of_the_controls_give_their_poses(walking, other):
    result = retarget(*walking, other)
    local = local_turns(other, result.poses)
    R = np.empty_like(local)
    for b, k in enumerate(other.turn_parents):
        above = np.eye(3) if k < 0 else R[:, k] @ other.R_world_rest[k].T
        R[:, b] = above @ other.R_world_rest[b] @ local[:, b]
    assert np.abs(R - result.poses.turns @ other.R_world_rest).max() < 1e-9
    hips = other.index("hips")
    place = other.rest.heads[hips] + local_places(other, result.poses, hips) @ other.R_world_rest[hips].T
    assert np.abs(place - result.poses.places[:, hips]).max() < 1e-9


def test_a_motion_in_centimetres_with_y_up_is_the_same(walking, other):
    source, _ = walking
    turn = rotations.exp(np.array([-np.pi / 2, 0.0, 0.0]))
    lying = source.rotated(turn)
    scaled = type(lying)(
        "cm",
        type(lying.rest)(lying.rest.names, lying.rest.parents, 100 * lying.rest.heads, 100 * lying.rest.tails),
        lying.turns,
        100 * lying.positions,
        lying.fps,
    )
    one, two = (retarget(*prepared(given), other).poses for given in (source, scaled))
    assert np.abs(one.places - two.places).max() < 1e-6
    assert np.abs(one.turns - two.turns).max() < 1e-6


@pytest.mark.parametrize(("few", "many"), [(1, 3), (2, 3), (2, 5), (3, 4), (3, 5)])
def test_a_spine_brought_to_more_bones_and_back_is_what_it_was(few, many):
    dice = np.random.default_rng(few)
    before, *chain = rotations.exp(dice.normal(0, 0.4, (few + 1, 4, 3)))
    there, back = chain_blends(few, many, has_end=False), chain_blends(many, few, has_end=False)
    longer = [blend.rotation(np.stack([*chain, before], axis=1)) for blend in there]  # -1 is the bone below the chain
    again = [blend.rotation(np.stack([*longer, before], axis=1)) for blend in back]
    assert np.abs(np.array(again) - np.array(chain)).max() < 1e-9


def test_a_source_without_a_spine_moves_none_and_without_a_neck_the_head_turns_it() -> None:
    names = ("hips", "chest", "head")
    rest = RestSkeleton(names, (-1, 0, 1), np.zeros((3, 3)), np.zeros((3, 3)))
    headless = {"hips": ("hips",), "spine": ("chest",)}
    whole = BoneMap(headless | {"head": ("head",)})
    assert source_blends(rest, BoneMap({"hips": ("hips",), "head": ("head",)}), "spine", 2) == []
    assert source_blends(rest, BoneMap(headless), "neck", 1) == []
    [neck] = source_blends(rest, whole, "neck", 1)
    assert (neck.low, neck.high) == (1, 2) and 0 < neck.share < 1
    assert source_blends(rest, whole, "head", 1) == [BoneBlend(2, 2)]
