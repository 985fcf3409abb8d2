"""Estimated smoothness: known variances are found again, bursts survive, and the frame rate does not matter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from kfmocap.core.body import human
from kfmocap.core.body.acceleration_scale import likeliest_scale
from kfmocap.core.body.motion import Motion
from kfmocap.core.body.smoothness import SecondDifferences, acceleration, smoothness
from kfmocap.core.body.smoothness_estimate import (
    ROOT_GROUPS,
    AccelerationVariances,
    ObservedMotion,
    axis_mobility,
    estimate_variances,
    group_sizes,
    precision_of,
    updated_variances,
)
from kfmocap.core.numerics.banded import BandedFactor
from kfmocap.core.numerics.banded_blocks import BandedBlocks, diagonal_groups
from kfmocap.core.shot.acceleration_prior import given_groups, usual_variances, variances_from_key_poses
from kfmocap.core.shot.keypose_spline import spline
from kfmocap.core.shot.settings import Settings
from kfmocap.core.shot.shot import KeyPoses
from kfmocap.core.tracking.solvers.equations.problem import AccelerationSearch, SegmentProblem
from kfmocap.core.tracking.solvers.equations.smoothness_factor import SegmentSmoothness

BODY = human(solid=False)
BODY = replace(BODY, parts=BODY.parts[:4], landmarks={})
"""Trunk and head: a root and three joints."""
FREE = axis_mobility(BODY)
SIZES = group_sizes(BODY.dof)
JOINT = ROOT_GROUPS + 1
"""Group of the joint whose rotation is degrees of freedom 6 to 8."""
SETTINGS = Settings()
USUAL = usual_variances(BODY, 30.0, SETTINGS)


def walk(frames: int, deviation: np.ndarray, seed: int = 0) -> Motion:
    """A motion whose accelerations are independent, with deviations (F - 2, D) or (D,)."""
    a = np.random.default_rng(seed).normal(0, 1, (frames - 2, BODY.dof)) * deviation
    a -= a.mean(axis=0)  # or it turns right round
    speed = np.concatenate([np.zeros((1, BODY.dof)), np.cumsum(a, axis=0)])
    speed -= speed.mean(axis=0)
    place = np.concatenate([np.zeros((1, BODY.dof)), np.cumsum(speed, axis=0)])
    still = Motion(np.zeros((frames, 3)), np.broadcast_to(np.eye(3), (frames, len(BODY), 3, 3)))
    return still.moved(place)


def observed_blocks(motion: Motion, truth: Motion, noise: float, seed: int = 1) -> BandedBlocks:
    """Normal equations of noisy observations of every degree of freedom around a motion."""
    F, D = len(motion), BODY.dof
    zero = BandedBlocks.zeros(F, D)
    error = np.random.default_rng(seed).normal(0, noise, (F, D))
    gradient = -motion.difference(truth.moved(error)) / noise**2
    diagonal = np.broadcast_to(np.eye(D) / noise**2, (F, D, D))
    return BandedBlocks(diagonal, zero.first, zero.second, gradient, 0.0)


def found(truth: Motion, noise: float, start: float, rounds: int = 10) -> AccelerationVariances:
    fixed = np.zeros((len(truth), BODY.dof), bool)
    begin = AccelerationVariances.constant(np.full(len(SIZES), start**2), len(truth) - 2)
    return estimate_variances(
        ObservedMotion(truth, observed_blocks(truth, truth, noise), fixed), FREE, begin, rounds=rounds
    )


@pytest.mark.parametrize("start", [0.001, 0.03])
def test_a_known_acceleration_is_found_from_noisy_observations(start: float) -> None:
    truth = walk(200, 0.006 * FREE)
    spread = found(truth, 0.01, start)
    # Student's t has longer tails than these normal accelerations: its scale is a little less than their deviation.
    assert np.sqrt(spread.typical) == pytest.approx(0.006, rel=0.35)
    assert np.sqrt(spread.local).mean() == pytest.approx(0.006, rel=0.35)


def test_a_body_that_bounces_is_found_to_accelerate_upwards_and_not_across() -> None:
    deviation = 0.002 * FREE
    deviation[2] *= 10
    across, up = np.sqrt(found(walk(200, deviation), 0.003, 0.006).typical[:ROOT_GROUPS])
    assert across == pytest.approx(0.002, rel=0.5)
    assert up == pytest.approx(0.02, rel=0.5)


def test_the_root_as_one_accelerates_alike_along_all_axes() -> None:
    deviation = 0.002 * FREE
    deviation[2] *= 10
    truth, fixed = walk(60, deviation), np.zeros((60, BODY.dof), bool)
    observed = ObservedMotion(truth, observed_blocks(truth, truth, 0.003), fixed)
    begin = AccelerationVariances.constant(np.full(len(SIZES), 4e-5), 58)
    spread = estimate_variances(observed, FREE, begin, rounds=5, root_as_one=True)
    np.testing.assert_array_equal(spread.typical[0], spread.typical[1])
    np.testing.assert_array_equal(spread.local[:, 0], spread.local[:, 1])
    assert np.sqrt(spread.typical[0]) == pytest.approx(np.sqrt(np.mean(deviation[:3] ** 2)), rel=0.5)


def test_a_burst_in_a_quiet_motion_is_left_in_it() -> None:
    deviation = np.repeat(0.001 * FREE[None], 118, axis=0)
    deviation[50:54, 6:9] *= 60
    truth = walk(120, deviation)
    spread = found(truth, 0.003, 0.002)
    loud, quiet = spread.local[50:54, JOINT].mean(), np.median(np.delete(spread.local[:, JOINT], np.s_[46:58]))
    assert loud > 20 * quiet
    observed = observed_blocks(truth, truth, 0.003)
    free = np.zeros((120, BODY.dof), bool)
    errors = []
    for weights in (spread.precision(FREE), AccelerationVariances.constant(spread.typical, 118).precision(FREE)):
        system = observed + smoothness(truth, weights)
        left = truth.moved(-BandedFactor(system, free).solve(system.gradient))
        errors.append(np.abs(truth.difference(left)[45:60, 6:9]).mean())
    assert errors[0] < 0.7 * errors[1]


def test_a_joint_that_nothing_is_seen_of_is_as_smooth_as_the_others() -> None:
    spread = AccelerationVariances.constant(np.array([1.0, 4.0, 4.0, 4.0]), 50)
    squares = np.tile([3.0, 3.0, 3.0, 0.0], (50, 1))
    variances = np.tile([0.0, 0.0, 0.0, 12.0], (50, 1))  # as uncertain as it was thought to be
    for _ in range(30):
        spread = updated_variances(spread, squares, variances * spread.typical / 4, np.full(4, 3.0))
    assert spread.typical[3] == pytest.approx(spread.typical[1], rel=0.1)


def test_key_poses_suggest_the_same_at_any_frame_rate() -> None:
    truth = walk(61, 0.004 * FREE)
    keys = KeyPoses.whole(np.array([0, 20, 40, 60]), truth[[0, 20, 40, 60]])
    slow, fast = (variances_from_key_poses(BODY, keys, fps, SETTINGS) for fps in (15.0, 240.0))
    np.testing.assert_allclose(slow, fast, rtol=1e-9)
    reversed_keys = KeyPoses.whole(keys.frames, keys.poses[::-1])
    np.testing.assert_allclose(
        variances_from_key_poses(BODY, reversed_keys, 30.0, SETTINGS),
        variances_from_key_poses(BODY, keys, 30.0, SETTINGS),
        rtol=0.2,
    )


def test_key_poses_suggest_the_acceleration_between_them() -> None:
    estimates, true = [], 0.01 * np.sqrt(USUAL)
    for seed in range(20):
        truth = walk(121, np.repeat(true, SIZES) * FREE, seed)
        frames = np.arange(0, 121, 10)
        estimates.append(variances_from_key_poses(BODY, KeyPoses.whole(frames, truth[frames]), 30.0, SETTINGS))
    assert np.sqrt(np.mean(estimates, axis=0)) == pytest.approx(true, rel=0.2)


def test_two_key_poses_suggest_nothing() -> None:
    truth = walk(20, 0.01 * FREE)
    keys = KeyPoses.whole(np.array([0, 19]), truth[[0, 19]])
    np.testing.assert_array_equal(variances_from_key_poses(BODY, keys, 30.0, SETTINGS), USUAL)


def test_variances_of_accelerations_are_those_of_the_dense_inverse() -> None:
    motion = walk(6, 0.2 * FREE)
    F, D = 6, BODY.dof
    system = observed_blocks(motion, motion, 0.1) + smoothness(motion, np.full(D, 30.0))
    free = np.zeros((F, D), bool)
    free[0] = True
    factor = BandedFactor(system, free)
    C = factor.solve(np.eye(F * D).reshape(F, D, F * D))
    J, h = np.zeros(((F - 2) * D, F * D)), 1e-6
    for k in range(F * D):
        step = np.zeros(F * D)
        step[k] = h
        ahead, back = (acceleration(motion.moved(s * step.reshape(F, D))) for s in (1, -1))
        J[:, k] = ((ahead - back) / (2 * h)).ravel()
    expected = np.diag(J @ C.reshape(F * D, F * D) @ J.T).reshape(F - 2, D)
    band = factor.covariance_band(kept=diagonal_groups)
    np.testing.assert_allclose(SecondDifferences.of(motion).variances(band), expected, rtol=1e-5)


def test_accelerations_that_the_settings_give_are_not_estimated() -> None:
    truth, fixed = walk(60, 0.006 * FREE), np.zeros((60, BODY.dof), bool)
    settings = Settings(joint_acceleration=45.0)
    begin = AccelerationVariances.constant(usual_variances(BODY, 30.0, settings), 58)
    evidence, given = observed_blocks(truth, truth, 0.01), given_groups(BODY, settings)
    spread = estimate_variances(ObservedMotion(truth, evidence, fixed), FREE, begin, rounds=3, given=given)
    assert spread.typical_accelerations(30.0)[ROOT_GROUPS:] == pytest.approx(45.0)
    assert np.ptp(spread.local[:, ROOT_GROUPS:]) == 0
    for root in range(ROOT_GROUPS):
        assert spread.typical_accelerations(30.0)[root] != pytest.approx(begin.typical_accelerations(30.0)[root], 0.1)
    keys = KeyPoses.whole(np.array([0, 20, 40]), truth[[0, 20, 40]])
    suggested = variances_from_key_poses(BODY, keys, 30.0, settings)
    np.testing.assert_array_equal(suggested[ROOT_GROUPS:], begin.typical[ROOT_GROUPS:])
    assert (suggested[:ROOT_GROUPS] != begin.typical[:ROOT_GROUPS]).all()


def test_without_bursts_a_limb_that_jumps_is_as_smooth_as_on_other_frames() -> None:
    deviation = np.repeat(0.001 * FREE[None], 58, axis=0)
    deviation[18:22, 6:9] *= 60
    truth, fixed = walk(60, deviation), np.zeros((60, BODY.dof), bool)
    evidence = observed_blocks(truth, truth, 0.003)
    begin = AccelerationVariances.constant(np.full(len(SIZES), 4e-6), 58)
    for bursts in (False, True):
        spread = estimate_variances(ObservedMotion(truth, evidence, fixed), FREE, begin, rounds=10, bursts=bursts)
        assert (spread.local[18:22, JOINT].mean() > 20 * spread.local[40, JOINT]) == bursts


def test_the_spline_stays_where_nothing_is_free() -> None:
    truth = walk(10, 0.01 * FREE)
    keys = KeyPoses.whole(np.arange(10), truth)
    fixed = np.ones((10, BODY.dof), bool)
    begin = AccelerationVariances.constant(USUAL, 8)
    motion = spline(keys, 10)
    assert estimate_variances(ObservedMotion(motion, observed_blocks(motion, truth, 0.01), fixed), FREE, begin) is begin


@pytest.mark.parametrize("called", [1 / 16, 1.0, 16.0])
def test_the_scale_of_all_accelerations_is_found_whatever_was_expected(called: float) -> None:
    true, noise = 0.02, 0.01
    truth = walk(60, true * FREE)
    fixed = np.zeros((60, BODY.dof), bool)
    expected = np.full(len(SIZES), (called * true) ** 2)
    scale = likeliest_scale(
        ObservedMotion(truth, observed_blocks(truth, truth, noise), fixed), precision_of(expected, FREE)[None]
    )
    assert called * scale == pytest.approx(1.0, rel=0.15)


def test_where_nothing_is_seen_the_scale_is_the_expected_one_nearly() -> None:
    still = walk(10, np.zeros(BODY.dof))
    fixed = np.zeros((10, BODY.dof), bool)
    fixed[[0, -1]] = True
    nothing = BandedBlocks.zeros(10, BODY.dof)
    moved = walk(10, 0.02 * FREE)
    precision = precision_of(np.full(len(SIZES), 0.02**2), FREE)[None]
    assert likeliest_scale(ObservedMotion(still, nothing, np.ones_like(fixed)), precision) == 1.0
    assert 0.1 < likeliest_scale(ObservedMotion(moved, nothing, fixed), precision) < 10


def test_usual_accelerations_are_settled_by_all_that_the_pictures_say_and_not_by_a_coarse_stage() -> None:
    """The first coarse looks still lie near a smooth start, where fast movement passes for usual movement."""
    fixed = np.zeros((60, BODY.dof), bool)
    problem = SegmentProblem(
        (), (BODY,), 0, 30.0, (fixed,), typical_variances=(USUAL,), search=AccelerationSearch.SCALE_THEN_JOINTS
    )

    def estimated(before: SegmentSmoothness, factor: float, *, bursts: bool) -> SegmentSmoothness:
        truth = walk(60, factor * np.sqrt(np.repeat(USUAL, SIZES)) * FREE)
        seen = observed_blocks(truth, truth, 0.2 * factor * float(np.sqrt(USUAL[1])))
        return before.estimated(problem, [truth], [seen], bursts=bursts)

    start = SegmentSmoothness.start(problem)
    coarse, settled = (estimated(start, 0.3, bursts=bursts) for bursts in (False, True))
    for one in (coarse, settled):
        np.testing.assert_array_equal(one.variances[0].typical, USUAL)
    assert estimated(coarse, 4.0, bursts=False).scaled
    assert not estimated(settled, 4.0, bursts=True).scaled
