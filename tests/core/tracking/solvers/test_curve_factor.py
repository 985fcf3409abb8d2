"""Stiff parts stay near the curve through the key poses: trunk and collar bones, and nothing else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from kfmocap.core.body import human
from kfmocap.core.body.body import REST_SIGMA, Body
from kfmocap.core.body.motion import Motion
from kfmocap.core.numerics import rotations
from kfmocap.core.numerics.banded_blocks import BandedBlocks
from kfmocap.core.tracking.solvers.equations.curve_factor import FRAME_SIGMA_RATIO, near_curve, with_curves
from kfmocap.core.tracking.solvers.equations.problem import SegmentProblem
from synthetic import at_rest, numeric_jacobian, random_motion

BODY = human()
F, KEYS = 9, [1, 7]
STIFF = ["spine", "chest", "shoulder.L", "shoulder.R"]


def problem_of(body: Body = BODY, keys: list[int] = KEYS) -> SegmentProblem:
    fixed = np.zeros((F, body.dof), bool)
    fixed[keys] = True
    return SegmentProblem((), (body,), 0, 30.0, (fixed,))


def turning(body: Body = BODY, turn: float = 0.8) -> Motion:
    """Every part turns steadily about its x axis from the first key to the last, and rests before and after."""
    turns = np.zeros((F, len(body), 3))
    turns[:, 1:, 0] = turn * np.interp(np.arange(F), KEYS, [0.0, 1.0])[:, None]
    return Motion(at_rest(body, F).translations, rotations.exp(turns))


def rows(body: Body, names: list[str]) -> np.ndarray:
    return np.concatenate([3 + 3 * body.index(name) + np.arange(3) for name in names])


@pytest.mark.parametrize("keys", [KEYS, [4], []])
def test_the_gradient_is_that_of_the_energy(keys) -> None:
    problem, motion = problem_of(keys=keys), random_motion(BODY, F, turn=0.3)
    found = near_curve(problem, 0, motion)
    free = np.setdiff1d(np.arange(F), keys)

    def energy(steps: np.ndarray) -> float:
        moved = np.zeros((F, BODY.dof))
        moved[free] = steps.reshape(len(free), -1)
        return near_curve(problem, 0, motion.moved(moved)).energy / 2

    some = np.random.default_rng(0).choice(len(free) * BODY.dof, 60, replace=False)
    numeric = numeric_jacobian(
        lambda d: energy(np.bincount(some, weights=d, minlength=len(free) * BODY.dof)), np.zeros(60), 1e-6
    )
    np.testing.assert_allclose(found.gradient[free].ravel()[some], numeric, rtol=1e-5, atol=1e-5)


def test_a_steady_turn_between_key_poses_costs_nothing() -> None:
    found = near_curve(problem_of(), 0, turning())
    assert found.energy < 1e-18 and np.abs(found.gradient).max() < 1e-9


def test_without_evidence_stiff_parts_move_along_the_curve_and_key_poses_stay() -> None:
    problem, truth = problem_of(), turning()
    motion = Motion(truth.translations, rotations.exp(np.zeros((F, len(BODY), 3))))
    motion.rotations[KEYS] = truth.rotations[KEYS]
    stiff = rows(BODY, STIFF)
    for _ in range(5):
        found = near_curve(problem, 0, motion)
        step = np.zeros((F, BODY.dof))
        for f in np.setdiff1d(np.arange(F), KEYS):
            step[f, stiff] = -np.linalg.solve(found.diagonal[f][np.ix_(stiff, stiff)], found.gradient[f, stiff])
        motion = motion.moved(step)
    parts = [BODY.index(name) for name in STIFF]
    np.testing.assert_allclose(motion.rotations[:, parts], truth.rotations[:, parts], atol=1e-7)
    assert np.array_equal(motion.rotations[KEYS], truth.rotations[KEYS])


def test_only_stiff_parts_are_held_and_as_near_before_between_and_after_key_poses() -> None:
    found = near_curve(problem_of(), 0, turning())
    held = np.diagonal(found.diagonal, axis1=1, axis2=2)
    stiff = rows(BODY, STIFF)
    assert not np.delete(held, stiff, axis=1).any()
    departures = np.repeat([BODY.departures[BODY.index(name)] for name in STIFF], 3)
    usual = near_curve(problem_of(), 0, at_rest(BODY, F)).diagonal  # at rest, rotation vectors are metric
    expected = 1 / (FRAME_SIGMA_RATIO * departures) ** 2
    np.testing.assert_allclose(np.diagonal(usual, axis1=1, axis2=2)[:, stiff], [expected] * F)
    np.testing.assert_allclose(held[4, stiff], held[0, stiff], rtol=1e-9)


def test_without_key_poses_stiff_parts_stay_near_rest() -> None:
    found = near_curve(problem_of(keys=[]), 0, at_rest(BODY, F))
    assert found.energy == 0.0
    turned = random_motion(BODY, F, turn=0.2)
    usual = FRAME_SIGMA_RATIO * BODY.departures[:, None]
    expected = np.sum((rotations.log(turned.rotations) / usual) ** 2 * BODY.is_stiff[:, None])
    assert near_curve(problem_of(keys=[]), 0, turned).energy == pytest.approx(expected)


def test_a_body_of_an_earlier_version_is_left_alone() -> None:
    body = human(collar_bones=False)
    body = replace(body, parts=tuple(replace(part, departure=REST_SIGMA) for part in body.parts))
    system = BandedBlocks.zeros(F, body.dof)
    assert not body.is_stiff.any()
    assert with_curves(problem_of(body), [system], (random_motion(body, F),))[0] is system
