"""Limbs that leap away for a moment are brought back across, where the pictures are for it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from kfmocap.core.body import human
from kfmocap.core.body.motion import Motion
from kfmocap.core.numerics import rotations
from kfmocap.core.shot.settings import Settings
from kfmocap.core.tracking.solvers import gauss_newton_solver
from kfmocap.core.tracking.solvers.equations.problem import SegmentProblem
from kfmocap.core.tracking.solvers.limb_corrections.leaping_limbs import bridged_motion, leaps, with_leaps_bridged
from made_evidence import Landscape
from synthetic import at_rest, ends_held

BODY, FRAMES, FPS = human(1.75), 24, 30.0
LEG, OTHER = ([BODY.index(f"{name}.{side}") for name in ("thigh", "shin", "foot")] for side in "LR")
PROBLEM = SegmentProblem((), (BODY,), 0, FPS, (ends_held(BODY, FRAMES),))


def striding() -> Motion:
    motion = at_rest(BODY, FRAMES)
    turns = np.zeros((FRAMES, 3))
    turns[:, 0] = 0.5 * np.sin(2 * np.pi * np.arange(FRAMES) / FPS)
    motion.rotations[:, LEG[0]] = motion.rotations[:, LEG[0]] @ rotations.exp(turns)
    motion.rotations[:, OTHER[0]] = motion.rotations[:, OTHER[0]] @ rotations.exp(-turns)
    return motion


TRUTH = striding()


def leaping(frames: slice, angle: float = 0.8) -> Motion:
    """The left leg is turned aside on some frames."""
    Q = TRUTH.rotations.copy()
    Q[frames, LEG[0]] = Q[frames, LEG[0]] @ rotations.exp(np.array([0.0, 0.0, angle]))
    return Motion(TRUTH.translations, Q)


def error(motion: Motion) -> float:
    return float(np.abs(motion.difference(TRUTH)).max())


def test_a_limb_that_leaps_away_and_back_is_distinguished_from_those_that_move_on() -> None:
    assert leaps(PROBLEM, 0, TRUTH) == []
    [leap] = leaps(PROBLEM, 0, leaping(slice(10, 13)))
    assert set(leap.parts) == set(LEG)
    assert leap.first in (9, 10) and leap.last in (12, 13)


@pytest.mark.parametrize("away", [slice(4, 20), slice(12, None)])
def test_a_limb_that_is_away_for_long_does_not_leap_there_and_back(away: slice) -> None:
    assert not any(leap.last - leap.first >= 8 for leap in leaps(PROBLEM, 0, leaping(away)))


def test_a_leap_to_a_pose_that_is_held_is_none() -> None:
    held = ends_held(BODY, FRAMES)
    held[11] = True
    found = leaps(replace(PROBLEM, fixed=(held,)), 0, leaping(slice(11, 12), 1.2))
    assert all(not leap.first <= 11 <= leap.last for leap in found)


def test_what_is_bridged_turns_evenly_and_what_is_fixed_stays() -> None:
    wrong = leaping(slice(10, 13))
    [leap] = leaps(PROBLEM, 0, wrong)
    bridged = bridged_motion(wrong, leap, PROBLEM.fixed[0])
    assert error(bridged) < 0.1
    fixed = PROBLEM.fixed[0].copy()
    fixed[11, 3 + 3 * LEG[0]] = True
    kept = bridged_motion(wrong, leap, fixed)
    np.testing.assert_array_equal(kept.rotations[11, LEG[0]], wrong.rotations[11, LEG[0]])
    np.testing.assert_array_equal(kept.rotations[12], bridged.rotations[12])


@pytest.mark.parametrize("right", [True, False])
def test_a_leap_is_bridged_only_where_the_pictures_are_likelier_with_that(right: bool) -> None:
    """The world pulls limbs to where they are in it: either straight on, or away for a moment."""
    wrong = leaping(slice(10, 13))
    landscape = Landscape(truth=TRUTH if right else wrong)
    problem = replace(PROBLEM, settings=Settings(joint_acceleration=300.0, root_acceleration=30.0))
    solution = landscape.solution(problem, wrong)
    found = with_leaps_bridged(problem, solution, landscape)
    away = np.abs(found.motions[0].difference(TRUTH if right else wrong)).max()
    assert away < 0.05
    assert right or found.motions is solution.motions


def test_without_foreground_no_leaps_are_searched_for(monkeypatch: pytest.MonkeyPatch) -> None:
    landscape = Landscape(truth=TRUTH)
    solution = landscape.solution(PROBLEM, leaping(slice(10, 13)))
    monkeypatch.setattr(gauss_newton_solver, "best_of_starts", lambda *_: solution)
    assert gauss_newton_solver.solved(PROBLEM, [TRUTH], landscape) is solution
