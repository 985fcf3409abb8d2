"""Keypoints as evidence: their slopes are right, and how well they agree with a motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from keypoint_shots import NAMES, cameras, joint_errors, keypoints_of, seen_places, strolling
from kfmocap.core.body import Body, human, part_poses
from kfmocap.core.body.motion import Motion
from kfmocap.core.keypoints import keypoint_factor as evidence
from kfmocap.core.keypoints.keypoint_factor import KeypointFactor, keypoint_system
from kfmocap.core.keypoints.keypoint_offsets import KeypointOffsets
from kfmocap.core.numerics.banded import BandedFactor
from kfmocap.core.tracking.solvers.assessment.solution_doubts import confirmed_by_keypoints
from kfmocap.core.tracking.solvers.assessment.solution_ranking import covering_most
from kfmocap.core.tracking.solvers.equations.problem import SegmentProblem, SegmentSolution
from synthetic import numeric_jacobian, random_motion

FPS = 30.0


def free(body: Body, frames: int) -> np.ndarray:
    return np.zeros((frames, body.dof), bool)


def test_the_system_is_that_of_the_weighted_residuals() -> None:
    """Gradient and normal matrix, of poses, offsets and both, against finite differences on the manifold."""
    body = human()
    motion = random_motion(body, 2, turn=0.3)
    seen = keypoints_of(cameras(2), seen_places(body, random_motion(body, 2, 1, turn=0.3)))
    seen.rays[1, 0, 3] = np.nan
    seen.confidence[1, 0, 3] = 0
    weights = np.random.default_rng(0).uniform(1, 5, seen.confidence.shape) * (seen.confidence > 0)
    places = replace(KeypointOffsets.on(body, NAMES), offsets=np.random.default_rng(1).normal(0, 0.02, (len(NAMES), 3)))
    D, n = body.dof, 3 * len(NAMES)
    prior = np.linalg.cholesky(evidence.offset_precision(NAMES)).T

    def residuals(x: np.ndarray) -> np.ndarray:
        moved = motion.moved(x[: 2 * D].reshape(2, D))
        there = replace(places, offsets=places.offsets + x[2 * D :].reshape(-1, 3))
        error = np.nan_to_num(seen.residuals(there.world(part_poses(body, moved))))
        return np.concatenate([(np.sqrt(weights)[..., None] * error).ravel(), prior @ there.offsets.ravel()])

    x0 = np.zeros(2 * D + n)
    J, r = numeric_jacobian(residuals, x0), residuals(x0)
    system = keypoint_system(body, part_poses(body, motion), seen, places, weights)
    H, g = J.T @ J, J.T @ r
    scale = np.abs(H).max()
    for f in range(2):
        rows = slice(f * D, (f + 1) * D)
        np.testing.assert_allclose(system.blocks.diagonal[f], H[rows, rows], atol=1e-6 * scale)
        np.testing.assert_allclose(system.border[f], H[rows, 2 * D :], atol=1e-6 * scale)
        np.testing.assert_allclose(system.blocks.gradient[f], g[rows], atol=1e-6 * np.abs(g).max())
    np.testing.assert_allclose(system.corner, H[2 * D :, 2 * D :], atol=1e-6 * scale)
    np.testing.assert_allclose(system.gradient, g[2 * D :], atol=1e-6 * np.abs(g).max())


def test_a_keypoint_factor_pulls_towards_its_keypoints() -> None:
    """A Gauss-Newton step on them alone, from a pose nearby, leads to the pose that they show."""
    body = human()
    motion = strolling(body, 3)
    seen = keypoints_of(cameras(3), seen_places(body, motion))
    factor = KeypointFactor(seen, KeypointOffsets.on(body, NAMES), 1.0)
    start = Motion(motion.translations + [0.03, -0.02, 0.01], motion.rotations)
    for _ in range(3):
        blocks = factor.blocks(body, part_poses(body, start), 8.0)
        start = start.moved(-BandedFactor(blocks, free(body, 3)).solve(blocks.gradient))
    assert joint_errors(body, start, body, motion).max() < 2e-3


def test_a_keypoint_factor_is_cut_to_some_frames() -> None:
    body = human()
    seen = keypoints_of(cameras(2), seen_places(body, strolling(body, 6)))
    cut = KeypointFactor(seen, KeypointOffsets.on(body, NAMES), 1.0)[2:5]
    assert len(cut.keypoints) == 3
    np.testing.assert_array_equal(cut.keypoints.rays, seen.rays[:, 2:5])


def test_agreement_is_one_on_the_true_poses_and_falls_away_from_them() -> None:
    body = human()
    motion = strolling(body, 5)
    seen = keypoints_of(cameras(2), seen_places(body, motion))
    seen.rays[0, 1, 2] = np.nan
    seen.confidence[0, 1, 2] = 0
    factor = KeypointFactor(seen, KeypointOffsets.on(body, NAMES), 9.0)
    beside = Motion(motion.translations + [0, 0, 0.06], motion.rotations)
    assert factor.agreement(part_poses(body, motion)) == pytest.approx(1)
    assert factor.agreement(part_poses(body, beside)) == pytest.approx(0.25, abs=0.03)


def test_the_solution_that_meets_the_keypoints_is_better_and_is_confirmed() -> None:
    """The other covers a little more of what looks like the performer."""
    body = human()
    motion = strolling(body, 5)
    seen = keypoints_of(cameras(2), seen_places(body, motion))
    astray = Motion(motion.translations + [0.2, 0, 0], motion.rotations)
    fixed = (free(body, 5),)
    problem = SegmentProblem(
        (), (body,), 0, FPS, fixed, keypoints=(KeypointFactor(seen, KeypointOffsets.on(body, NAMES), 9.0),)
    )

    def solution(found: Motion, explained: float) -> SegmentSolution:
        nothing = np.zeros(0)
        return SegmentSolution((found,), 1, (), nothing, np.full((1, 5), explained), nothing, nothing, {})

    right, wrong = solution(motion, 90.0), solution(astray, 100.0)
    assert covering_most(problem, wrong, right) is right
    assert covering_most(replace(problem, keypoints=()), wrong, right) is wrong
    assert confirmed_by_keypoints(problem, [motion], right) and not confirmed_by_keypoints(problem, [motion], wrong)
    assert not confirmed_by_keypoints(replace(problem, keypoints=()), [motion], right)
