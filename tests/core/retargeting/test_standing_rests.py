"""Rest poses in mid-stride: motion from and to such skeletons is that of the same ones that stand at rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from kfmocap.core.body import human
from kfmocap.core.body.skeleton_motion import RestSkeleton
from kfmocap.core.numerics import rotations
from kfmocap.core.retargeting.retarget import grounded, prepared, retarget
from kfmocap.core.retargeting.standing_rests import as_at_rest, standing_rig, standing_source, standing_turns
from made_rigs import made_rig, moved_body
from render.motions import MOTIONS

BODY = human(1.75)
LEGS = ["thigh.L", "shin.L", "foot.L", "thigh.R", "shin.R", "foot.R"]
TWIST = 10.0
"""Degrees by which thighs may be turned about themselves, as straight legs do not show this."""


@pytest.fixture(scope="module")
def walk():
    return moved_body(BODY, MOTIONS["walk"](BODY, 60, 30.0))


def strides(motion):
    """The frames on which one heel is high, and on which the feet are apart on the ground."""
    ankles = motion.positions[:, motion.rest.indices(["foot.L", "foot.R"]), 2]
    apart = np.abs(np.diff(ankles, axis=1)[:, 0])
    return [int(apart.argmax()), int(np.abs(apart - 0.09).argmin())]


def posed(rest, turns, places):
    """A skeleton with a pose as its rest pose."""
    tails = places + np.einsum("jab,jb->ja", turns, rest.tails - rest.heads)
    return RestSkeleton(rest.names, rest.parents, places, tails)


def degrees(a, b):
    return np.degrees(np.linalg.norm(rotations.log(np.swapaxes(a, -1, -2) @ b), axis=-1))


@pytest.mark.parametrize("which", [0, 1])
def test_a_motion_whose_rest_pose_is_a_stride_moves_legs_as_one_that_stands(walk, which):
    k = strides(walk)[which]
    rest = posed(walk.rest, walk.turns[k], walk.positions[k])
    stride = replace(walk, rest=rest, turns=walk.turns @ np.swapaxes(walk.turns[k], -1, -2))
    rig = made_rig("mixamo", BODY)
    upright, bones = prepared(stride)
    found = retarget(standing_source(upright, bones), bones, rig)
    wanted = retarget(*prepared(walk), rig)
    assert found.placement.scale == pytest.approx(wanted.placement.scale, rel=0.02)
    legs = [rig.index(role) for role in LEGS]
    assert degrees(found.poses.turns[:, legs], wanted.poses.turns[:, legs]).max() < TWIST
    as_it_is = retarget(upright, bones, rig)
    assert degrees(as_it_is.poses.turns[:, legs], wanted.poses.turns[:, legs]).max() > 1.5 * TWIST


@pytest.mark.parametrize("which", [0, 1])
@pytest.mark.parametrize("skinned", [False, True])
def test_a_rig_whose_rest_pose_is_a_stride_walks_as_one_that_stands(walk, which, skinned):
    rig = made_rig("unity", BODY)
    source, bones = prepared(walk)
    wanted = retarget(source, bones, rig)
    k = strides(walk)[which]
    turns, places = wanted.poses.turns[k], wanted.poses.places[k]
    rest = grounded(posed(rig.rest, turns, places), rig.bones)
    stride = replace(rig, rest=rest, R_world_rest=turns @ rig.R_world_rest)
    soles = {}
    for side in "LR" if skinned else ():
        foot = BODY.parts[BODY.index(f"foot.{side}")]
        soles[side] = foot.vertices @ (turns[rig.index(f"foot.{side}")] @ foot.R_world_rest).T
    standing = standing_turns(rest, rig.bones, soles)
    assert set(standing) == set(LEGS)
    straight, turned = standing_rig(stride, standing, None)
    result = as_at_rest(retarget(source, bones, straight), turned)
    assert result.placement.scale == pytest.approx(wanted.placement.scale, rel=0.02)
    legs = [rig.index(role) for role in LEGS]
    moved, as_wanted = result.poses.turns @ stride.R_world_rest, wanted.poses.turns @ rig.R_world_rest
    assert degrees(moved[:, legs], as_wanted[:, legs]).max() < TWIST
    hips, feet = rig.index("hips"), [rig.index(f"foot.{side}") for side in "LR"]
    ways, as_wanted = (each.places[:, feet] - each.places[:, [hips]] for each in (result.poses, wanted.poses))
    assert np.abs(ways - as_wanted).max() < 0.01


@pytest.mark.parametrize("droop", [0.0, 0.8])
def test_a_skeleton_that_stands_at_rest_is_left_as_it_is(walk, droop):
    rig = made_rig("mixamo", BODY, droop)
    assert not standing_turns(rig.rest, rig.bones)
    upright, bones = prepared(walk)
    assert standing_source(upright, bones) is upright
