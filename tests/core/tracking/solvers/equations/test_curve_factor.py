"""Stiff parts stay near the curve through the key poses, and collar bones rise with their arms."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import numpy as np
import pytest
from kfmocap.core.body import human, part_poses
from kfmocap.core.body.body import REST_SIGMA, Body
from kfmocap.core.body.motion import Motion
from kfmocap.core.body.shoulder_rhythm import RISE
from kfmocap.core.evidence.view_frames import ViewFrames
from kfmocap.core.numerics import rotations
from kfmocap.core.numerics.arrays import Array
from kfmocap.core.numerics.banded_blocks import BandedBlocks
from kfmocap.core.tracking.solvers.equations.curve_factor import (
    FRAME_SIGMA_RATIO,
    RISE_SIGMA_RATIO,
    near_curve,
    with_curves,
)
from kfmocap.core.tracking.solvers.equations.problem import SegmentProblem
from synthetic import at_rest, numeric_jacobian, random_motion

BODY = human()
F, KEYS = 9, [1, 7]
STIFF = ["spine", "chest", "shoulder.L", "shoulder.R"]


def problem_of(body: Body = BODY, keys: list[int] = KEYS, views: int = 2) -> SegmentProblem:
    """A problem with views that show nothing."""
    fixed = np.zeros((F, body.dof), bool)
    fixed[keys] = True
    return SegmentProblem(cast(tuple[ViewFrames, ...], (None,) * views), (body,), 0, 30.0, (fixed,))


def turning(body: Body = BODY, turn: float = 0.8) -> Motion:
    """Every part turns steadily about its x axis from the first key to the last, and rests before and after; arms and
    collar bones about their length, which raises no arm."""
    turns = np.zeros((F, len(body), 3))
    along = [name.startswith(("shoulder", "upper_arm")) for name in body.names]
    turns[:, 1:, 0] = turn * np.interp(np.arange(F), KEYS, [0.0, 1.0])[:, None]
    turns[:, along] = turns[:, along][..., [1, 0, 2]]
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
    truth = turning()
    motion = truth.with_parts([BODY.index(name) for name in STIFF], at_rest(BODY, F))
    motion.rotations[KEYS] = truth.rotations[KEYS]
    motion, _ = settled(problem_of(), motion, STIFF)
    parts = [BODY.index(name) for name in STIFF]
    np.testing.assert_allclose(motion.rotations[:, parts], truth.rotations[:, parts], atol=1e-7)
    assert np.array_equal(motion.rotations[KEYS], truth.rotations[KEYS])


def test_only_stiff_parts_and_arms_are_held_and_as_near_before_between_and_after_key_poses() -> None:
    found = near_curve(problem_of(), 0, turning())
    held = np.diagonal(found.diagonal, axis1=1, axis2=2)
    trunk, collars = rows(BODY, STIFF[:2]), rows(BODY, STIFF[2:])
    assert not np.delete(held, rows(BODY, [*STIFF, "upper_arm.L", "upper_arm.R"]), axis=1).any()
    usual = near_curve(problem_of(), 0, at_rest(BODY, F)).diagonal  # at rest, rotation vectors are metric
    usual = np.diagonal(usual, axis1=1, axis2=2)
    departures = np.repeat([BODY.departures[BODY.index(name)] for name in STIFF], 3)
    np.testing.assert_allclose(usual[:, trunk], [1 / (FRAME_SIGMA_RATIO * departures[:6]) ** 2] * F)
    rising = (1 - RISE) / RISE_SIGMA_RATIO  # it raises the arm, too
    own = (np.tile([1 / FRAME_SIGMA_RATIO, 1 / FRAME_SIGMA_RATIO, rising], 2) / departures[6:]) ** 2
    np.testing.assert_allclose(usual[:, collars], [own] * F)
    np.testing.assert_allclose(held[4, trunk], held[0, trunk], rtol=1e-9)
    between, before = (held[f, collars].reshape(2, 3).sum(axis=1) for f in (4, 0))  # they have turned
    np.testing.assert_allclose(between, before, rtol=1e-9)


def raising_arms(share: Array) -> Motion:
    """Arms that go from hanging to raised and back, by shares (F,) of 160 degrees in the shoulder joint."""
    turns = np.zeros((F, len(BODY), 3))
    for side, sign in (("L", 1.0), ("R", -1.0)):
        turns[:, BODY.index(f"upper_arm.{side}"), 2] = sign * (np.radians(160) * share - np.pi / 2)
    return Motion(at_rest(BODY, F).translations, rotations.exp(turns))


def settled(problem: SegmentProblem, motion: Motion, parts: list[str]) -> tuple[Motion, float]:
    """Return the motion in which some parts are as the prior wants them, and its cost."""
    free, columns = np.setdiff1d(np.arange(F), KEYS), rows(BODY, parts)
    for _ in range(8):
        found, step = near_curve(problem, 0, motion), np.zeros((F, BODY.dof))
        for f in free:
            step[f, columns] = -np.linalg.solve(found.diagonal[f][np.ix_(columns, columns)], found.gradient[f, columns])
        motion = motion.moved(step)
    return motion, near_curve(problem, 0, motion).energy


def test_collar_bones_rise_with_their_arms_and_stay_where_these_stay() -> None:
    share = np.sin(np.linspace(0, np.pi, F - 2)).clip(0)
    for shares in (np.pad(share, 1), np.zeros(F)):
        found, energy = settled(problem_of(), raising_arms(shares), STIFF)
        shoulder = [BODY.landmarks[name][0] for name in ("LShoulder", "RShoulder")]
        rise = part_poses(BODY, found)[1][:, shoulder, 2] - part_poses(BODY, at_rest(BODY, F))[1][:, shoulder, 2]
        assert energy < 1e-15
        np.testing.assert_allclose(rise[:, 0], rise[:, 1], atol=1e-9)
        assert np.array_equal(rise.argmax(axis=0), [shares.argmax()] * 2)
    turn = rotations.log(settled(problem_of(), raising_arms(np.pad(share, 1)), STIFF)[0].rotations)
    most = np.degrees(turn[4, BODY.index("shoulder.L"), 2])
    assert most == pytest.approx(0.123 * 180, rel=0.01)  # arm and collar bone together point straight up


def test_without_a_key_pose_of_the_arm_or_with_one_view_collar_bones_stay_near_the_curve() -> None:
    motion = raising_arms(np.linspace(0, 1, F))
    unknown = problem_of()
    unknown.fixed[0][KEYS[0], rows(BODY, ["upper_arm.L"])] = False
    usual = 1 / (FRAME_SIGMA_RATIO * BODY.departures[BODY.index("shoulder.L")]) ** 2
    arms, collar = [rows(BODY, [f"upper_arm.{side}"]) for side in "LR"], rows(BODY, ["shoulder.L"])
    for problem, coupled in ((unknown, [False, True]), (problem_of(views=1), [False, False])):
        found = near_curve(problem, 0, motion).diagonal
        assert [bool(found[:, arm].any()) for arm in arms] == coupled
        np.testing.assert_allclose(found[:, collar, collar], usual)


def test_a_shrug_is_held_little_more_than_without_the_rhythm() -> None:
    held = []
    for views in (1, 2):
        for turn in (0.02, 0.5):
            motion = at_rest(BODY, F)
            left = BODY.index("shoulder.L")
            turns = np.zeros((F, 3))
            turns[np.setdiff1d(np.arange(F), KEYS), 2] = turn
            motion.rotations[:, left] = rotations.exp(turns)
            motion.rotations[:, BODY.index("upper_arm.L")] = rotations.exp(-turns)  # the arm points where it did
            held.append(near_curve(problem_of(views=views), 0, motion).gradient[4, rows(BODY, ["shoulder.L"])[2]])
    small, large = held[2] / held[0], held[3] / held[1]
    assert small > 5 and 0.7 < large < 1.2


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
