"""Feet that roll over their balls keep these where the source has them; toes that can bend stay out of the floor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from kfmocap.core.body import human
from kfmocap.core.body.motion import Motion
from kfmocap.core.body.skeleton_motion import SkeletonMotion
from kfmocap.core.body.soles import BALL_SHARE
from kfmocap.core.numerics import rotations
from kfmocap.core.retargeting.bone_roles.roles import BoneMap
from kfmocap.core.retargeting.contacts.foot_paths import BALL, foot_paths, toes_in_floor
from kfmocap.core.retargeting.control_rig import ControlRig
from kfmocap.core.retargeting.retarget import prepared, retarget
from made_rigs import LONGER_LEGS, made_rig, moved_body
from render.walking import Walk
from render.walking_feet import Footfalls

BODY = human(1.75)
FPS = 30.0


def walk(pivot: float) -> SkeletonMotion:
    """A walk with stiff feet that roll over a place of their soles, as a share of the way from heel to tips."""
    steps = Footfalls(1.2, 0.8, 0.66, -8, 30, pivot, heel_off=0.5, start=0.2, seed=3)
    return moved_body(BODY, Walk(steps).motion(BODY, np.arange(70) / FPS), FPS)


def sole(rest, poses, foot):
    """Heel and tip of a foot (F, 2, 3), whose bone ends above the tips."""
    ahead = (rest.tails[foot] - rest.heads[foot]) * [1.0, 1.0, 0.0]
    down = np.array([0.0, 0.0, rest.ground - rest.heads[foot, 2]])
    return poses.places[:, foot, None] + np.einsum(
        "fij,cj->fci", poses.turns[:, foot], np.stack([down - 0.3 * ahead, down + ahead])
    )


def test_the_ball_of_a_foot_that_is_short_for_its_leg_stays_on_the_floor():
    """The tips of stiff feet are in the floor then, and those of a short foot are not as deep."""
    source, bones = prepared(walk(BALL_SHARE))
    rig = made_rig("kfmocap", human(1.75, LONGER_LEGS), 0.0, 7)
    result = retarget(source, bones, rig)
    for path in result.feet:
        soles = sole(rig.rest, result.poses, rig.index(f"foot.{path.side}"))
        rolling = path.rolls_over_ball & path.planted[:, BALL] & ~path.planted[:, 0]
        assert rolling.sum() > 8
        assert (path.points[rolling, BALL, 2] < -0.02).any()
        ball = soles[:, 0] + path.ball * (soles[:, 1] - soles[:, 0])
        given = result.placement.moved(path.heel_and_ball[:, BALL])
        assert np.abs(ball[rolling, 2] - given[rolling, 2]).max() < 0.005
        for first in np.flatnonzero(rolling[1:] & rolling[:-1]):
            step = ball[first + 1, :2] - ball[first, :2] - (given[first + 1, :2] - given[first, :2])
            assert np.linalg.norm(step) < 0.001


def test_toes_are_in_the_floor_of_feet_that_roll_over_their_balls_alone():
    assert toes_in_floor(*prepared(walk(BALL_SHARE))) == ["L", "R"]
    assert toes_in_floor(*prepared(walk(1.0))) == []


def test_toes_that_can_bend_are_level_on_the_floor_while_the_foot_rolls_over_its_ball():
    source, bones = prepared(walk(BALL_SHARE))
    rig = with_toes(human(1.75, LONGER_LEGS))
    result = retarget(source, bones, rig)
    for path in foot_paths(source, bones):
        toe = rig.index(f"toe.{path.side}")
        joint, turns = result.poses.places[:, toe], result.poses.turns[:, toe]
        way = rig.rest.tails[toe] - rig.rest.heads[toe]
        low = rig.rest.ground - rig.rest.heads[toe, 2]
        tips = joint + turns @ (way * [1.0, 1.0, 0.0] + [0.0, 0.0, low])
        planted = path.planted[:, BALL]
        assert (result.placement.moved(path.points)[planted, BALL, 2] < -0.03).any()
        assert tips[planted, 2].min() > -0.005
        feet = result.poses.turns[:, rig.index(f"foot.{path.side}")]
        bends = np.linalg.norm(rotations.log(np.swapaxes(feet, -1, -2) @ turns), axis=1)
        assert np.degrees(bends[planted].max()) > 15
        assert np.degrees(np.abs(np.diff(bends)).max()) < 20


def with_stiff_soles(body, longer):
    """A rig whose feet have a skin: as long as the performer's, or longer, from heels to tips."""
    rig = made_rig("kfmocap", body, 0.0, 7)
    soles, tips = {}, {}
    for side in "LR":
        foot = rig.index(f"foot.{side}")
        ahead = longer * (rig.rest.tails[foot] - rig.rest.heads[foot]) * [1.0, 1.0, 0.0]
        down = np.array([0.0, 0.0, rig.rest.ground - rig.rest.heads[foot, 2]])
        soles[side] = np.stack([-0.3 * ahead + down, ahead / 0.86 + down, 0.5 * ahead])
        tips[side] = float(np.linalg.norm(ahead))
    return replace(rig, stiff_soles=soles, toe_tips=tips)


@pytest.mark.parametrize("longer", [1.0, 1.1, 1.6])
def test_stiff_feet_stand_on_the_tips_of_their_toes_where_the_performers_roll_over_their_balls(longer):
    """Unless they are as the performer's: these are as deep in the floor as there, and no joint is turned."""
    source, bones = prepared(walk(BALL_SHARE))
    rig = with_stiff_soles(BODY, longer)
    result = retarget(source, bones, rig)
    before = retarget(source, bones, replace(rig, stiff_soles={}))
    for path in result.feet:
        foot = rig.index(f"foot.{path.side}")
        low, deep = (
            each.poses.places[:, foot, None, 2] + each.poses.turns[:, foot, 2] @ rig.stiff_soles[path.side].T
            for each in (result, before)
        )
        assert deep.min() < -0.02
        if longer == 1.0:
            assert np.array_equal(result.poses.turns, before.poses.turns)
        else:
            assert low.min() > -0.004
            held = path.planted.any(axis=1)
            places = [each.poses.places[held, foot, :2] for each in (result, before)]
            assert np.abs(places[0] - places[1]).max() < 0.003  # raised, and not shifted


@pytest.mark.parametrize("lifted", [False, True], ids=["both stand", "the ball is lifted first"])
def test_heel_and_ball_of_a_long_foot_that_stands_move_no_farther_than_the_performers(lifted):
    """It turns by 3 degrees while it stands, as tracked feet do; twice as long, it would move twice as far."""
    frames, foot = np.arange(40), BODY.index("foot.L")
    yaw = np.radians(3) * np.clip((frames - 5) / 20, 0, 1) + np.radians(4) * lifted * np.clip(frames - 29, 0, 6)
    turns = np.tile(np.eye(3), (len(frames), len(BODY), 1, 1))
    rest = BODY.parts[foot].R_world_rest
    turns[:, foot] = rest.T @ rotations.exp(yaw[:, None] * [0.0, 0.0, 1.0]) @ rest
    source, bones = prepared(moved_body(BODY, Motion(np.tile(BODY.parts[0].head_world, (len(frames), 1)), turns), FPS))
    rig = made_rig("kfmocap", BODY, 0.0, 7)
    own = rig.rest.tails[rig.index("foot.L")] - rig.rest.heads[rig.index("foot.L")]
    rig = replace(rig, toe_tips=dict.fromkeys("LR", 2 * float(np.linalg.norm(own[:2]))))
    planted = {"heel.L": frames < 36, "ball.L": frames < (30 if lifted else 36)}
    result = retarget(source, bones, rig, planted=planted)
    [path, _] = result.feet
    way = (result.poses.turns[:, rig.index("foot.L")] @ (2 * own * [1.0, 1.0, 0.0]))[:, None]
    points = result.poses.places[:, rig.index("foot.L"), None] + [[[-0.3], [1.0]]] * way
    moved, given = (each - each[0] for each in (points, result.placement.moved(path.points)))
    apart = np.linalg.norm((moved - given)[..., :2], axis=-1)
    assert np.linalg.norm(given[29, 1, :2]) > 0.005
    assert apart[:36, 0].max() < 0.0005
    assert apart[planted["ball.L"], 1].max() < 0.0005


def with_toes(body):
    """A rig whose feet end at their balls, before toes."""
    rig = made_rig("mixamo", body, 0.0, 7)
    rest, names, found = rig.rest, list(rig.rest.names), dict(rig.bones.bones)
    heads, tails, parents = [*rest.heads], [*rest.tails], [*rest.parents]
    tips = {}
    for side in "LR":
        foot = rig.index(f"foot.{side}")
        way = rest.tails[foot] - rest.heads[foot]
        tips[side] = float(np.linalg.norm(way[:2]))
        tip, ball = tails[foot].copy(), heads[foot] + 0.6 * way
        tails[foot] = ball
        heads.append(ball)
        tails.append(tip)
        parents.append(foot)
        names.append(f"toes.{side}")
        found[f"toe.{side}"] = (f"toes.{side}",)
    rest = replace(rest, names=tuple(names), parents=tuple(parents), heads=np.array(heads), tails=np.array(tails))
    axes = np.broadcast_to(np.eye(3), (len(names), 3, 3))
    return ControlRig(rest, BoneMap(found, rig.bones.preset), rest.parents, axes, axes, tips)
