"""Holds as evidence: a prop stays in the hand as its key poses show, and moves the hand as the hand moves it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from kfmocap.core.body import Body, part_poses
from kfmocap.core.body.motion import Motion
from kfmocap.core.body.prop import body_of_prop
from kfmocap.core.body.skeleton_motion import RestSkeleton
from kfmocap.core.errors import ShotError
from kfmocap.core.numerics import rotations
from kfmocap.core.numerics.banded_blocks import BandedBlocks
from kfmocap.core.shot.grips import relative_pose, shot_with_grips, with_grips
from kfmocap.core.shot.holds import Grip, Hold
from kfmocap.core.shot.shot import KeyPoses, Performer, Shot
from kfmocap.core.tracking.retracking import digest
from kfmocap.core.tracking.scheduling.segment_stages import SegmentData, segment_problem
from kfmocap.core.tracking.solvers.equations.hold_factor import (
    GRIP_POSITION_SIGMA,
    GRIP_ROTATION_SIGMA,
    HoldFactor,
    hold_factors,
    tied_systems,
)
from kfmocap.core.tracking.solvers.starts.sequential_start import excerpt
from kfmocap.core.tracking.track_state import TrackState
from kfmocap.core.tracking.tracker import track
from synthetic import box, figure, film, look_at, random_motion, shot_of, swing

Array = np.ndarray
FRAMES = 12
HELD = (2, 9)
FIGURE = figure()
STICK = body_of_prop(
    RestSkeleton(("stick",), (-1,), np.zeros((1, 3)), np.ones((1, 3))), box([-0.02] * 3, [0.02, 0.4, 0.02])
)
BODIES = (FIGURE, STICK)
TURN_IN_HAND, PLACE_IN_HAND = rotations.exp(np.array([0.4, -0.2, 1.1])), np.array([0.02, 0.3, -0.05])
FOREARM = FIGURE.index("forearm.L")
HOLD = Hold("stick", "figure", "forearm.L", HELD)
FREE = tuple(np.zeros((FRAMES, body.dof), bool) for body in BODIES)


def in_hand(motion: Motion) -> Motion:
    """The stick as it is held."""
    R, T = (values[:, FOREARM] for values in part_poses(FIGURE, motion))
    return Motion(T + R @ PLACE_IN_HAND, (R @ TURN_IN_HAND)[:, None])


TRUTH = (swing(FIGURE, FRAMES), in_hand(swing(FIGURE, FRAMES)))


def performers(frames: list[int], motions: tuple[Motion, ...] = TRUTH) -> tuple[Performer, ...]:
    return tuple(
        Performer(name, body, KeyPoses.whole(frames, motion[frames]))
        for name, body, motion in zip(("figure", "stick"), BODIES, motions, strict=True)
    )


def factor_of(frames: list[int], motions: tuple[Motion, ...] = TRUTH) -> HoldFactor:
    people = performers(frames, motions)
    [found] = hold_factors(with_grips([HOLD], people), people, 0, FRAMES - 1)
    return found


def apart(motions: tuple[Motion, ...], frames: slice = slice(HELD[0], HELD[1] + 1)) -> tuple[Array, Array]:
    """How far the stick is from where it was held, metres and radians, on the frames of the hold."""
    poses = [part_poses(body, motion[frames]) for body, motion in zip(BODIES, motions, strict=True)]
    turns, places = relative_pose(poses[1], poses[0], FOREARM)
    turned = np.linalg.norm(rotations.log(np.swapaxes(turns, 1, 2) @ TURN_IN_HAND), axis=1)
    return np.linalg.norm(places - PLACE_IN_HAND, axis=1), turned


def shaken(seed: int, size: float) -> tuple[Motion, ...]:
    dice = np.random.default_rng(seed)
    return tuple(m.moved(dice.normal(0, size, (FRAMES, b.dof))) for m, b in zip(TRUTH, BODIES, strict=True))


def prior(begin: tuple[Motion, ...], motions: tuple[Motion, ...], precisions: tuple[float, ...]) -> list[BandedBlocks]:
    """Poses as they are at the start, by an inverse variance per performer."""
    systems = []
    for body, start, motion, weight in zip(BODIES, begin, motions, precisions, strict=True):
        system = BandedBlocks.zeros(FRAMES, body.dof)
        diagonal = np.broadcast_to(weight * np.eye(body.dof), system.diagonal.shape).copy()
        off = start.difference(motion)
        systems.append(replace(system, diagonal=diagonal, gradient=weight * off, energy=weight * float(np.sum(off**2))))
    return systems


def settled(
    begin: tuple[Motion, ...], factor: HoldFactor, precisions: tuple[float, ...], sought: tuple[int, ...] = (0, 1)
) -> tuple[Motion, ...]:
    """What a prior on the poses and the hold lead to."""
    motions = begin
    for _ in range(6):
        tied = tied_systems(prior(begin, motions, precisions), [factor], BODIES, motions, fixed=FREE, sought=sought)
        steps = tied.by_performer([system.solve(0.0) for system in tied.systems])
        motions = tuple(m.moved(steps[i]) if i in steps else m for i, m in enumerate(motions))
    return motions


def test_its_gradient_is_the_slope_of_its_cost() -> None:
    factor, motions = factor_of([0, 5, 11]), shaken(1, 0.3)
    nothing = [BandedBlocks.zeros(FRAMES, body.dof) for body in BODIES]

    def tied(moved: tuple[Motion, ...]) -> float:
        return tied_systems(nothing, [factor], BODIES, moved, fixed=FREE, sought=(0, 1)).cost

    [system] = tied_systems(nothing, [factor], BODIES, motions, fixed=FREE, sought=(0, 1)).systems
    for seed in range(3):
        ways = [np.random.default_rng([seed, i]).normal(0, 1, (FRAMES, b.dof)) for i, b in enumerate(BODIES)]
        sides = [tied(tuple(m.moved(s * w) for m, w in zip(motions, ways, strict=True))) for s in (1e-6, -1e-6)]
        assert (sides[0] - sides[1]) / 2e-6 == pytest.approx(system.slope(np.concatenate(ways, axis=1)), rel=1e-5)


def test_the_prop_stays_in_the_hand_on_the_frames_of_the_hold_and_on_no_others() -> None:
    begin = shaken(2, 0.1)
    found = settled(begin, factor_of([0, 5, 11]), (1 / 0.1**2, 1 / 0.1**2))
    place, turn = apart(found)
    assert place.max() < GRIP_POSITION_SIGMA
    assert turn.max() < GRIP_ROTATION_SIGMA
    for i, motion in enumerate(found):
        moved = np.abs(motion.difference(begin[i])).max(axis=1)
        assert moved[HELD[0] : HELD[1] + 1].min() > 1e-3
        assert moved[[0, 1, 10, 11]].max() < 1e-12


@pytest.mark.parametrize("sure", [0, 1])
def test_who_is_seen_well_leads_the_other_there(sure: int) -> None:
    """A prop that is seen shows where a hidden hand is, and a hand where a hidden prop is."""
    begin = tuple(
        truth if i == sure else off for i, (truth, off) in enumerate(zip(TRUTH, shaken(3, 0.15), strict=True))
    )
    precisions = tuple(1 / 0.005**2 if i == sure else 1 / 0.15**2 for i in range(2))
    found = settled(begin, factor_of([0, 5, 11]), precisions)

    def errors(motions: tuple[Motion, ...]) -> Array:
        part, i = (FOREARM, 0) if sure else (0, 1)
        places = [part_poses(BODIES[i], own[i])[1][HELD[0] : HELD[1] + 1, part] for own in (motions, TRUTH)]
        return np.linalg.norm(places[0] - places[1], axis=-1)

    assert errors(found).mean() < 0.2 * errors(begin).mean()
    assert np.abs(found[sure].difference(TRUTH[sure])).max() < 0.02


def test_a_performer_whose_motion_is_given_stays_and_leads() -> None:
    begin = (TRUTH[0], shaken(4, 0.2)[1])
    found = settled(begin, factor_of([0, 5, 11]), (1.0, 1 / 0.2**2), sought=(1,))
    assert found[0] is begin[0]
    place, turn = apart(found)
    assert place.max() < GRIP_POSITION_SIGMA
    assert turn.max() < GRIP_ROTATION_SIGMA


def test_performers_without_a_hold_are_solved_by_themselves() -> None:
    systems = prior(TRUTH, TRUTH, (1.0, 1.0))
    tied = tied_systems(systems, [], BODIES, TRUTH, fixed=FREE, sought=(0, 1))
    assert tied.groups == ((0,), (1,))
    assert [system.blocks for system in tied.systems] == systems


def test_where_key_poses_differ_the_grip_passes_from_one_to_the_other() -> None:
    """As when the prop slips, or a key pose is a little off: key poses are met without a jump beside them."""
    slipped = TRUTH[1].moved(np.tile([0.04, 0, 0, 0, 0.2, 0], (FRAMES, 1)))
    sticks = [TRUTH[1], slipped]
    keys = [
        KeyPoses.whole([4], sticks[0][[4]]).joined(KeyPoses.whole([8], sticks[1][[8]])),
        KeyPoses.whole([4, 8], TRUTH[0][[4, 8]]),
    ]
    people = (Performer("figure", FIGURE, keys[1]), Performer("stick", STICK, keys[0]))
    grip = with_grips([HOLD], people)[0].grip
    assert grip is not None
    places = grip.at(np.arange(2, 10))[1]
    assert places[:3] == pytest.approx(np.tile(PLACE_IN_HAND, (3, 1)))
    assert np.linalg.norm(np.diff(places[2:7], axis=0), axis=1) == pytest.approx(0.01)
    assert places[6] == pytest.approx(places[7])


def test_of_a_part_of_the_shot_the_grip_is_still_that_of_the_whole() -> None:
    whole = shot_with_grips(Shot("held", 30.0, (100, 111), (), performers([5]), holds=(HOLD,)))
    part = shot_with_grips(whole.between(6, 11))
    assert part.holds[0].frames == (0, 3)
    assert part.holds[0].grip.at(np.array([2]))[1] == pytest.approx(PLACE_IN_HAND[None])
    assert whole.between(10, 11).holds == ()


def test_the_problem_of_a_segment_has_its_holds_and_lets_the_hand_touch_the_prop() -> None:
    shot = shot_with_grips(Shot("held", 30.0, (0, FRAMES - 1), (), performers([0, 5, 11]), holds=(HOLD,)))
    data = SegmentData((0, 5), (), tuple(free[:6] for free in FREE))
    problem = segment_problem(shot, data, TrackState(TRUTH))
    assert [hold.frames.tolist() for hold in problem.holds] == [[2, 3, 4, 5]]
    assert problem.contact.touching == {(4, 1), (1, 4), (4, 2), (2, 4)}
    assert digest(shot, (0, 5)) != digest(replace(shot, holds=()), (0, 5))


@pytest.mark.parametrize(("first", "stop", "held"), [(0, 4, [2, 3]), (5, 9, [0, 1, 2, 3]), (10, 12, [])])
def test_a_part_of_a_segment_has_the_holds_of_its_frames(first: int, stop: int, held: list[int]) -> None:
    shot = shot_with_grips(Shot("held", 30.0, (0, FRAMES - 1), (), performers([0, 5, 11]), holds=(HOLD,)))
    data = SegmentData((0, FRAMES - 1), (), FREE)
    part = excerpt(segment_problem(shot, data, TrackState(TRUTH)), first, stop)
    [hold] = part.holds
    assert hold.frames.tolist() == held
    motions = tuple(motion[first:stop] for motion in TRUTH)
    nothing = [BandedBlocks.zeros(stop - first, body.dof) for body in BODIES]
    assert part.tied(nothing, motions).cost == pytest.approx(0.0, abs=1e-9)
    assert part.alone(1).tied(nothing, motions).groups == ((1,),)
    assert part.alone(1).holds == part.holds
    assert part.alone(0).holds == ()  # an arm is looked for wherever the prop is


@pytest.mark.parametrize(
    ("hold", "said"),
    [
        (Hold("broom", "figure", "forearm.L", HELD), "no performer 'broom' (there are figure, stick)"),
        (Hold("figure", "figure", "forearm.L", HELD), "cannot hold itself"),
        (Hold("stick", "figure", "hand.L", HELD), "no part 'hand.L' (its parts are trunk"),
        (Hold("stick", "figure", "forearm.L", (6, 9)), "no frame from 106 to 109 has a key pose of both"),
    ],
)
def test_holds_that_cannot_be_are_refused(hold: Hold, said: str) -> None:
    with pytest.raises(ShotError) as error:
        with_grips([hold], performers([0, 5, 11]), 100)
    assert said in str(error.value)


def test_two_holds_at_once_are_two_hands() -> None:
    people = performers([0, 5, 11])
    both = with_grips([HOLD, replace(HOLD, part="arm.R")], people)
    assert len(both) == 2
    with pytest.raises(ShotError, match="twice on frames 5 to 9"):
        with_grips([HOLD, replace(HOLD, frames=(5, 11))], people)


def test_random_grips_are_met_by_their_own_motion() -> None:
    """The residuals are nothing where the prop is held as the grip says, whatever the poses."""
    body: Body = FIGURE
    motions = (random_motion(body, FRAMES, seed=3), in_hand(random_motion(body, FRAMES, seed=3)))
    grip = Grip(np.array([0]), TURN_IN_HAND[None], PLACE_IN_HAND[None])
    factor = HoldFactor(1, 0, FOREARM, np.arange(FRAMES), *grip.at(np.arange(FRAMES)))
    assert np.abs(factor.residuals(BODIES, motions)[0]).max() < 1e-6


@pytest.fixture(scope="module")
def tracked(tmp_path_factory: pytest.TempPathFactory) -> dict[bool, tuple[Motion, ...]]:
    """The motions that are found where the stick is held, and where nobody says so."""
    cameras = [look_at(f"cam{i}", eye) for i, eye in enumerate(((0.3, -3.6, 1.6), (-2.4, -2.8, 1.0)))]
    views = film(tmp_path_factory.mktemp("held"), BODIES, TRUTH, cameras)
    shot = shot_of(views, BODIES, TRUTH, [0, FRAMES - 1])
    hold = Hold("performer 1", "performer 0", "forearm.L", (0, FRAMES - 1))
    return {held: track(replace(shot, holds=(hold,) if held else ())).motions for held in (False, True)}


def test_a_held_prop_is_tracked_nearer_to_the_truth_and_in_the_hand(tracked: dict[bool, tuple[Motion, ...]]) -> None:
    def ends(motions: tuple[Motion, ...]) -> Array:
        """Both ends of the stick, (F, 2, 3)."""
        R, T = (values[:, 0] for values in part_poses(STICK, motions[1]))
        return np.stack([T, T + R @ [0.0, 0.4, 0.0]], axis=1)

    errors = {held: np.linalg.norm(ends(found) - ends(TRUTH), axis=-1)[1:-1].mean() for held, found in tracked.items()}
    assert errors[True] < 0.6 * errors[False]
    place, turn = apart(tracked[True], slice(0, FRAMES))
    assert place.max() < 2 * GRIP_POSITION_SIGMA
    assert turn.max() < 2 * GRIP_ROTATION_SIGMA
