"""Characters of other proportions: feet that stood still stand still at their height, and no bone is twisted."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from kfmocap.core.body import human
from kfmocap.core.retargeting.contacts import foot_paths
from kfmocap.core.retargeting.contacts.long_feet import Sole
from kfmocap.core.retargeting.retarget import Retargeted, prepared, retarget
from made_rigs import LONGER_LEGS, SHORTER_ARMS, made_rig, moved_body, moved_rig
from render.benchmark_shots import PLANS
from scipy.spatial.transform import Rotation

HEIGHT = 1.75
EQUAL = human(HEIGHT)
BODIES = {
    "legs 20 % longer, arms 15 % shorter": human(HEIGHT, {**LONGER_LEGS, **SHORTER_ARMS}),
    "long thighs": human(HEIGHT, {"thigh": LONGER_LEGS["thigh"]}),
    "short shins": human(HEIGHT, {"shin": 0.8 * 0.246 * HEIGHT}),
    "a child": human(0.6 * HEIGHT),
}
MOVEMENTS = [
    "stroll_behind_bench",
    "hop_turn",
    "lunges",
    "dance",
    "round_kick",
    "front_kick",
    "sitting_down",
    "picking_up_near",
]
LONG_FOOT = 2.5
STILL = 0.001  # metres around its mean place
SLIDE, HEIGHT_ERROR, TWIST = 0.002, 0.005, 10.0


def moved(name, body):
    plan = PLANS[name]
    return moved_body(body, plan.movement.motion(body, plan.seconds), plan.fps)


def sole_points(rest, poses, foot, scale=1.0):
    """Heel and ball of a foot whose tail is above the ball, (F, 2, 3): carried by the foot's bone alone."""
    ahead = (rest.tails[foot] - rest.heads[foot]) * [1.0, 1.0, 0.0]
    down = np.array([0.0, 0.0, rest.ground - rest.heads[foot, 2]])
    offsets = np.stack([down - 0.3 * ahead, down + ahead])
    turns, places = poses
    return scale * (places[:, foot, None] + np.einsum("fij,cj->fci", turns[:, foot], offsets))


def standing(path) -> Iterator[slice]:
    """The frames (four at least) on which a point (F, 3) near the ground stays where it is."""
    first = 0
    while first < len(path):
        last = first + 1
        while last < len(path) and spread(path[first : last + 1]) < STILL:
            last += 1
        if last - first >= 4 and np.abs(path[first:last, 2]).max() < 0.03:
            yield slice(first, last)
        first = last


def spread(path):
    return np.linalg.norm(path - path.mean(axis=0), axis=1).max()


def slides_and_heights(source, result: Retargeted, rig) -> tuple[float, float, int]:
    worst, count = np.zeros(2), 0
    for side in "LR":
        [foot] = source.rest.indices([f"foot.{side}"])
        given = sole_points(source.rest, (source.turns, source.positions), foot, result.placement.scale)
        shown = sole_points(rig.rest, (result.poses.turns, result.poses.places), rig.index(f"foot.{side}"))
        for own, other in ((given[:, c], shown[:, c]) for c in range(2)):
            for frames in standing(own):
                count += 1
                slide = spread(other[frames, :2]) - spread(own[frames, :2])
                height = np.abs(other[frames, 2] - own[frames, 2]).max()
                worst = np.maximum(worst, (slide, height))
    return float(worst[0]), float(worst[1]), count


def twist(rig, result: Retargeted) -> float:
    """By how much keeping feet has turned a bone about its own length at most, degrees."""
    found = []
    for role, k, _ in rig.bones.items():
        b = rig.index(role, k)
        along = rig.rest.tails[b] - rig.rest.heads[b]
        change = np.swapaxes(result.by_angles.turns[:, b], -1, -2) @ result.poses.turns[:, b]
        x, y, z, w = Rotation.from_matrix(change).as_quat(canonical=True).T
        found.append(np.degrees(2 * np.arctan2(np.stack([x, y, z], axis=1) @ (along / np.linalg.norm(along)), w)))
    return float(np.abs(found).max())


def assert_feet_stand(source, result: Retargeted, rig, plants: int) -> None:
    """Check that feet stand as still and as high as the source's, in at least so many plants, and twist nothing."""
    slide, height, count = slides_and_heights(source, result, rig)
    assert count >= plants
    assert slide < SLIDE
    assert height < HEIGHT_ERROR
    assert twist(rig, result) < TWIST


@pytest.mark.parametrize("proportions", BODIES)
@pytest.mark.parametrize("name", MOVEMENTS)
def test_feet_that_stood_still_stand_still_and_nothing_is_twisted(name, proportions):
    source, bones = prepared(moved(name, EQUAL))
    rig = made_rig("mixamo", BODIES[proportions], np.radians(45), 5)
    result = retarget(source, bones, rig)
    assert_feet_stand(source, result, rig, plants=2)


@pytest.mark.parametrize("kind", ["rigify", "rigify-metarig", "unreal", "unity", "vrm", "makehuman"])
@pytest.mark.parametrize("there", [True, False], ids=["to", "from"])
def test_the_same_holds_from_and_to_every_kind_of_rig(kind, there):
    given = EQUAL if there else BODIES["legs 20 % longer, arms 15 % shorter"]
    other = BODIES["legs 20 % longer, arms 15 % shorter"] if there else EQUAL
    source, bones = prepared(moved("stroll_behind_bench", given))
    if not there:
        own = made_rig(kind, given, np.radians(45), 3)
        step = retarget(source, bones, own)
        through, bones = prepared(moved_rig(own, step.poses, source.fps))
        rig = made_rig("kfmocap", other, 0.0, 7)
        result = retarget(through, bones, rig)
    else:
        rig = made_rig(kind, other, np.radians(45), 7)
        result = retarget(source, bones, rig)
    assert_feet_stand(source, result, rig, plants=4)


def test_a_long_foot_on_its_tips_comes_down_at_the_heel_rather_than_only_bend_the_leg(monkeypatch):
    """The sum of squared turns of thigh, shin and foot is less than where the leg alone is bent."""
    source, bones = prepared(moved("front_kick", EQUAL))
    rig = made_rig("kfmocap", EQUAL, 0.0, 7)
    foot = rig.index("foot.R")
    ahead = LONG_FOOT * (rig.rest.tails[foot] - rig.rest.heads[foot]) * [1.0, 1.0, 0.0]
    rig = replace(rig, toe_tips=dict.fromkeys("LR", float(np.linalg.norm(ahead))))
    result = retarget(source, bones, rig)
    monkeypatch.setattr(Sole, "with_lower_heel", lambda _, turns, *__: turns)
    bent = retarget(source, bones, rig)
    [path] = [path for path in result.feet if path.side == "R"]
    frames = path.planted[:, foot_paths.BALL]
    turned, by_leg = (squared_turns(rig, each, frames, ("thigh.R", "shin.R", "foot.R")) for each in (result, bent))
    assert (turned < 0.8 * by_leg).all()
    tip = [*ahead[:2], rig.rest.ground - rig.rest.heads[foot, 2]]
    height = (result.poses.places[:, foot] + result.poses.turns[:, foot] @ tip)[frames, 2]
    np.testing.assert_allclose(height, path.points[frames, foot_paths.BALL, 2], atol=HEIGHT_ERROR)


def squared_turns(rig, result: Retargeted, frames, roles) -> np.ndarray:
    """Sum of the squared turns of bones away from joint angles, by frame."""
    found = []
    for b in map(rig.index, roles):
        before, after = (poses.turns[frames, b] for poses in (result.by_angles, result.poses))
        found.append(Rotation.from_matrix(np.swapaxes(before, -1, -2) @ after).magnitude() ** 2)
    return np.sum(found, axis=0)


def test_the_sole_of_a_foot_whose_toes_bend_stays_above_the_ground():
    """Until its toes are level, their tips touch it; the heel comes down as far as the sole below their joint needs."""
    heel, tip, joint = np.array([0.0, 0.05, -0.08]), np.array([0.0, -0.3, -0.08]), np.array([0.0, -0.2, -0.06])
    sole = Sole(heel, tip, joint)
    pitch = np.radians([0.0, 10.0, 30.0, 50.0])
    turns = Rotation.from_rotvec(pitch[:, None] * [1.0, 0.0, 0.0]).as_matrix()
    for height in (0.08, 0.12, 0.2, 0.3):
        bends = sole.toe_bends(turns, np.full(4, height))
        tips = height + (turns @ (joint + sole.bent(bends) @ (tip - joint))[..., None])[:, 2, 0]
        straight = height + (turns @ tip)[:, 2]
        assert (bends[straight >= 0] < 1e-9).all()
        assert (bends <= pitch + 1e-9).all()
        part = (bends > 1e-9) & (bends < pitch - 1e-9)
        np.testing.assert_allclose(tips[part], 0.0, atol=1e-9)
