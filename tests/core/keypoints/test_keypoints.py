"""Keypoints: their slopes are right, offsets and body are found with the motion, gross errors do not count."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from keypoint_shots import NAMES, cameras, joint_errors, keypoints_of, seen_places, strolling
from kfmocap.core.body import Body, default_measures, human, part_poses
from kfmocap.core.body.joint_limits import LIMIT_SIGMA, posture_prior
from kfmocap.core.body.motion import Motion
from kfmocap.core.keypoints import keypoint_factor as evidence
from kfmocap.core.keypoints.keypoint_deviations import deviations, robust_weights
from kfmocap.core.keypoints.keypoint_factor import KeypointFactor, keypoint_system
from kfmocap.core.keypoints.keypoint_motion.closed_form import closed_form_pose
from kfmocap.core.keypoints.keypoint_motion.first_pass import first_pass, scaled_first_pass
from kfmocap.core.keypoints.keypoint_motion.keypoint_fit import FitProblem, KeypointFit, fit_motion
from kfmocap.core.keypoints.keypoint_places import Places
from kfmocap.core.keypoints.keypoint_rays import Keypoints
from kfmocap.core.keypoints.left_right import correct_sides, swap_sides
from kfmocap.core.keypoints.triangulation import triangulate
from kfmocap.core.keypoints.view_agreement import ViewAgreement, without_leaps
from kfmocap.core.numerics import rotations
from kfmocap.core.numerics.banded import BandedFactor, bordered_solution
from kfmocap.core.numerics.banded_blocks import BandedBlocks
from kfmocap.core.shot.acceleration_prior import acceleration_precision
from kfmocap.core.shot.shot import KeyPoses, Settings
from kfmocap.core.tracking.solvers.equations.problem import SegmentProblem, SegmentSolution
from kfmocap.core.tracking.solvers.solution_doubts import confirmed_by_keypoints
from kfmocap.core.tracking.solvers.solution_ranking import covering_most
from synthetic import figure, numeric_jacobian, random_motion

FPS = 30.0
HIPS = [NAMES.index(n) for n in ("LHip", "RHip")]


def precision(body: Body) -> np.ndarray:
    return acceleration_precision(body, FPS, Settings())


def free(body: Body, frames: int) -> np.ndarray:
    return np.zeros((frames, body.dof), bool)


def fit_without_agreement(body: Body, keypoints: Keypoints, start: Motion) -> KeypointFit:
    """The fit where the views agree on nothing beforehand: the detector's errors are those that the motion leaves."""
    nowhere = np.full((len(start), len(keypoints.names), 3), np.nan)
    none = np.zeros_like(keypoints.confidence)
    agreement = ViewAgreement(keypoints, none > 0, nowhere, none, None, FPS)
    return fit_motion(FitProblem(agreement, free(body, len(start)), precision(body)), body, start)


def spoiled(keypoints: Keypoints, seed: int = 0) -> Keypoints:
    """20 % of the frames missing, 10 % with left for right, 5 % of the keypoints somewhere else: 30 cm away."""
    rng = np.random.default_rng(seed)
    V, F, L = keypoints.confidence.shape
    turned = swap_sides(keypoints)
    rays, confidence = keypoints.rays.copy(), keypoints.confidence.copy()
    for v in range(V):
        order = rng.permutation(F)
        wrong = order[: round(0.1 * F)]
        rays[v, wrong], confidence[v, wrong] = turned.rays[v, wrong], turned.confidence[v, wrong]
        missing = order[len(order) - round(0.2 * F) :]
        rays[v, missing], confidence[v, missing] = np.nan, 0.0
    leap = rng.random((V, F, L)) < 0.05
    angle = rng.uniform(0, 2 * np.pi, (V, F, L))
    rays[leap] += 0.06 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)[leap]
    return replace(keypoints, rays=rays, confidence=confidence)


def test_the_system_is_that_of_the_weighted_residuals() -> None:
    """Gradient and normal matrix, of poses, offsets and both, against finite differences on the manifold."""
    body = human()
    motion = random_motion(body, 2, turn=0.3)
    seen = keypoints_of(cameras(2), seen_places(body, random_motion(body, 2, 1, turn=0.3)))
    seen.rays[1, 0, 3] = np.nan
    seen.confidence[1, 0, 3] = 0
    weights = np.random.default_rng(0).uniform(1, 5, seen.confidence.shape) * (seen.confidence > 0)
    places = replace(Places.on(body, NAMES), offsets=np.random.default_rng(1).normal(0, 0.02, (len(NAMES), 3)))
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


def test_the_bordered_solution_is_the_dense_one() -> None:
    rng = np.random.default_rng(0)
    F, D, n = 5, 3, 4
    A = rng.normal(size=(F * D, F * D))
    band = np.abs(np.subtract.outer(np.arange(F * D) // D, np.arange(F * D) // D)) <= 2
    A = (A @ A.T) * band + 60 * np.eye(F * D)
    B, C = rng.normal(size=(F * D, n)), 30 * np.eye(n)
    a, c = rng.normal(size=F * D), rng.normal(size=n)

    def block(i: int, k: int) -> np.ndarray:
        return A[D * (i + k) : D * (i + k + 1), D * i : D * (i + 1)]

    blocks = BandedBlocks(*(np.stack([block(i, k) for i in range(F - k)]) for k in range(3)), a.reshape(F, D), 0.0)
    fixed = np.zeros((F, D), bool)
    fixed[2, 1] = fixed[0] = True
    step, border = bordered_solution(BandedFactor(blocks, fixed), a.reshape(F, D), B.reshape(F, D, n), C, c)
    kept = np.concatenate([~fixed.ravel(), np.ones(n, bool)])
    whole = np.block([[A, B], [B.T, C]])[np.ix_(kept, kept)]
    expected = np.zeros(F * D + n)
    expected[kept] = np.linalg.solve(whole, np.concatenate([a, c])[kept])
    np.testing.assert_allclose(np.concatenate([step.ravel(), border]), expected, atol=1e-5 * np.abs(expected).max())


def test_limits_and_ease_have_their_slopes() -> None:
    body = human()
    motion = random_motion(body, 2, turn=1.0)
    limits = body.limits[1:]

    def residuals(x: np.ndarray) -> np.ndarray:
        turns = rotations.log(motion.moved(x.reshape(2, -1)).rotations[:, 1:])
        beyond = turns - np.clip(turns, limits[..., 0], limits[..., 1])
        ease = turns / (np.sqrt(2) * body.departures[1:, None])  # once for the whole shot, of two frames
        return np.concatenate([beyond.ravel() / LIMIT_SIGMA, ease.ravel()])

    x0 = np.zeros(2 * body.dof)
    J, r = numeric_jacobian(residuals, x0), residuals(x0)
    blocks = posture_prior(body, motion)
    np.testing.assert_allclose(blocks.gradient.ravel(), J.T @ r, atol=1e-5 * np.abs(J.T @ r).max())
    H = J.T @ J
    np.testing.assert_allclose(blocks.diagonal[1], H[body.dof :, body.dof :], atol=1e-5 * np.abs(H).max())
    assert blocks.energy == pytest.approx(r @ r)


def test_weights_fall_with_the_error_and_with_confidence() -> None:
    residual = np.zeros((1, 4, 1, 2))
    residual[0, :, 0, 0] = [0.0, 0.06, 0.6, np.nan]
    confidence = np.array([1.0, 1.0, 1.0, 0.0]).reshape(1, 4, 1)
    deviation = np.full((1, 1), 0.02)
    sure, far, gross, missing = robust_weights(residual, confidence, deviation)[0, :, 0] * 0.02**2
    assert sure == 1 and far == pytest.approx(0.25) and gross < 1e-3 and missing == 0
    assert robust_weights(residual, 0.5 * confidence, deviation)[0, 0, 0] == 0.5 / 0.02**2


def test_deviations_are_those_of_the_noise_and_no_outlier_counts() -> None:
    rng = np.random.default_rng(0)
    residual = 0.03 * rng.normal(size=(1, 400, 2, 2))
    residual[0, :60] = 5.0
    found = deviations(residual, np.ones((1, 400, 2)))
    np.testing.assert_allclose(found, 0.03, rtol=0.25)


def test_points_are_where_the_views_agree() -> None:
    """One view of three is wrong, another joint is seen by a single one."""
    points = seen_places(human(), strolling(human(), 4))
    seen = keypoints_of(cameras(3), points)
    seen.rays[1, :, 4] += 0.1
    seen.rays[1:, :, 7] = np.nan
    seen.confidence[1:, :, 7] = 0
    found, inliers = triangulate(seen)
    others = [i for i in range(len(NAMES)) if i != 7]
    np.testing.assert_allclose(found[:, others], points[:, others], atol=1e-6)
    assert np.isnan(found[:, 7]).all() and not inliers[:, :, 7].any()
    assert not inliers[1, :, 4].any() and inliers[[0, 2], :, 4].all()


def test_where_pairs_of_views_agree_on_different_points_the_steady_one_counts() -> None:
    """A knee is seen elsewhere by one view of three for some frames, on the ray of another: two views agree there."""
    frames, wrong, knee = 24, slice(9, 15), NAMES.index("RKnee")
    points = seen_places(human(), strolling(human(), frames))
    seen = keypoints_of(cameras(3), points)
    eye = -np.einsum("fba,fb->fa", seen.R_cam_world[0], seen.t_cam_world[0])
    elsewhere = points.copy()
    elsewhere[:, knee] += 0.08 * (points[:, knee] - eye)
    seen.rays[2, wrong, knee] = keypoints_of(cameras(3), elsewhere).rays[2, wrong, knee]
    seen.confidence[1, wrong, knee] = 0.6
    alone, _ = triangulate(seen)
    steady, inliers = triangulate(seen, FPS)
    assert np.linalg.norm(alone - points, axis=-1)[wrong, knee].min() > 0.2
    np.testing.assert_allclose(steady, points, atol=1e-6)
    assert not inliers[2, wrong, knee].any() and inliers[:2, :, knee].all()


def test_a_point_that_stays_elsewhere_is_believed() -> None:
    points = seen_places(human(), strolling(human(), 60))
    points[30:, NAMES.index("RWrist")] += [0.0, 0.0, 0.4]
    found, _ = triangulate(keypoints_of(cameras(3), points), FPS)
    np.testing.assert_allclose(found, points, atol=1e-6)


def test_sure_views_count_more() -> None:
    points = seen_places(human(), strolling(human(), 1))
    seen = keypoints_of(cameras(3), points)
    seen.rays[2, ..., 0] += 0.004
    seen.confidence[2] = 0.01
    found, _ = triangulate(seen)
    assert np.linalg.norm(found - points, axis=-1).max() < 1e-3


def test_sides_are_put_right_limb_by_limb() -> None:
    body = human()
    points = seen_places(body, strolling(body, 6))
    true = keypoints_of(cameras(2), points)
    turned = swap_sides(true)
    legs = [i for i, n in enumerate(NAMES) if n[1:] in ("Hip", "Knee", "Ankle", "BigToe", "Heel")]
    rays = true.rays.copy()
    rays[0, 2] = turned.rays[0, 2]
    rays[1, 4][legs] = turned.rays[1, 4][legs]
    found, changed = correct_sides(replace(true, rays=rays), points + 0.01)
    np.testing.assert_array_equal(found.rays, true.rays)
    assert changed[0, 2].sum() == sum(n[0] in "LR" for n in NAMES)
    assert changed[1, 4].sum() == len(legs) and not changed[0, [0, 1, 3, 4, 5]].any()


def test_what_is_expected_nowhere_keeps_its_sides() -> None:
    seen = keypoints_of(cameras(2), seen_places(human(), strolling(human(), 2)))
    found, changed = correct_sides(seen, np.full((2, len(NAMES), 3), np.nan))
    assert not changed.any() and np.array_equal(found.rays, seen.rays)


def test_the_closed_form_pose_of_a_body_matches_its_own_joints() -> None:
    """All joints within centimetres, without an iteration; missing points are bridged."""
    body = human()
    motion = strolling(body, 20)
    points = seen_places(body, motion)
    points[7:10, NAMES.index("LKnee")] = np.nan
    laid = closed_form_pose(body, NAMES, points)
    assert laid is not None
    assert joint_errors(body, laid, body, motion).max() < 0.04


def test_a_knee_that_seems_to_bend_forward_does_not_turn_the_thigh_round() -> None:
    body = human()
    motion = strolling(body, 3)
    points = seen_places(body, motion)
    hip, knee, ankle = (points[:, NAMES.index("L" + n)] for n in ("Hip", "Knee", "Ankle"))
    points[:, NAMES.index("LKnee")] = hip + ankle - knee  # on the other side of the line between hip and ankle
    laid = closed_form_pose(body, NAMES, points)
    assert laid is not None
    thigh = body.index("thigh.L")
    turn = rotations.log(np.swapaxes(motion.rotations[:, thigh], -1, -2) @ laid.rotations[:, thigh])
    assert np.linalg.norm(turn, axis=-1).max() < np.pi / 2


def test_other_bodies_have_no_closed_form_pose() -> None:
    points = seen_places(human(), strolling(human(), 2))
    assert closed_form_pose(figure(), NAMES, points) is None
    points[:, [NAMES.index("RShoulder"), NAMES.index("LHip")]] = np.nan
    assert closed_form_pose(human(), NAMES, points) is None


def test_points_that_leap_are_left_out() -> None:
    points = seen_places(human(), strolling(human(), 12))
    spoilt = points.copy()
    spoilt[5, 3] += 0.5
    found = without_leaps(spoilt, FPS)
    assert np.isnan(found[5, 3]).all()
    np.testing.assert_array_equal(np.delete(found, 5, axis=0), np.delete(points, 5, axis=0))


def test_true_keypoints_give_the_true_motion_and_body() -> None:
    """Of a body that is not the average one; the start knows neither its height nor its pose."""
    measures = default_measures(1.62)
    measures |= {"thigh.L": 1.05 * measures["thigh.L"], "thigh.R": 1.05 * measures["thigh.R"]}
    body = human(1.62, measures)
    motion = strolling(body, 30)
    seen = keypoints_of(cameras(3), seen_places(body, motion), noise=0.005)
    fit = scaled_first_pass(seen, fps=FPS, precision=precision(body), correlated=1.0)
    assert joint_errors(fit.body, fit.motion, body, motion).mean() < 0.02


def test_offsets_of_the_detector_are_found_where_key_poses_are_true() -> None:
    """Its hips are 4 cm too low: with the key poses at both ends the joints are found all the same."""
    body = human()
    motion = strolling(body, 40)
    offsets = np.zeros((len(NAMES), 3))
    offsets[HIPS, 1] = 0.04
    seen = keypoints_of(cameras(3), seen_places(body, motion, offsets), noise=0.01)
    fixed = free(body, 40)
    fixed[[0, -1]] = True
    keys = KeyPoses.whole([0, 39], motion[[0, 39]])
    fit = first_pass(body, keys, seen, fixed=fixed, precision=precision(body), fps=FPS, correlated=1.0)
    np.testing.assert_allclose(fit.places.offsets[HIPS, 1], 0.04, atol=0.012)
    assert joint_errors(body, fit.motion, body, motion).mean() < 0.01
    np.testing.assert_array_equal(fit.motion.translations[[0, -1]], motion.translations[[0, -1]])


def test_spoiled_keypoints_give_nearly_the_same_motion() -> None:
    body = human()
    motion = strolling(body, 24)
    seen = keypoints_of(cameras(3), seen_places(body, motion), noise=0.015)
    errors = []
    for keypoints in (seen, spoiled(seen)):
        fit = scaled_first_pass(keypoints, fps=FPS, precision=precision(body), correlated=3.0)
        errors.append(joint_errors(fit.body, fit.motion, body, motion).mean())
    assert errors[1] < 1.25 * errors[0] + 0.001


def test_what_a_fit_says_of_itself_belongs_to_its_motion() -> None:
    body = human()
    motion = strolling(body, 12)
    seen = keypoints_of(cameras(3), seen_places(body, motion), noise=0.015)
    start = Motion(motion.translations + [0.05, 0.0, 0.02], motion.rotations)
    fit = fit_without_agreement(body, seen, start)
    residual = fit.keypoints.residuals(fit.places.world(part_poses(fit.body, fit.motion)))
    np.testing.assert_array_equal(fit.deviation, deviations(residual, fit.keypoints.confidence))
    weights = robust_weights(residual, fit.keypoints.confidence, fit.deviation) * fit.deviation[:, None] ** 2
    np.testing.assert_array_equal(fit.weights, weights)


def test_a_fit_from_a_worse_start_says_so() -> None:
    """Energies are comparable: the fit that ends in the wrong place has the greater one."""
    body = human()
    motion = strolling(body, 12)
    seen = keypoints_of(cameras(3), seen_places(body, motion), noise=0.01)
    far = Motion(motion.translations + [2.0, 0.0, 0.0], motion.rotations @ rotations.exp(np.array([0.0, 2.5, 0.0])))
    fits = [fit_without_agreement(body, seen, m) for m in (motion, far)]
    errors = [joint_errors(body, fit.motion, body, motion).mean() for fit in fits]
    assert errors[1] > 2 * errors[0] and fits[1].energy > fits[0].energy


def test_one_camera_and_key_poses_give_the_motion_between() -> None:
    body = human()
    motion = strolling(body, 30)
    seen = keypoints_of(cameras(1), seen_places(body, motion), noise=0.01)
    keys = KeyPoses.whole([0, 15, 29], motion[[0, 15, 29]])
    fixed = free(body, 30)
    fixed[keys.frames] = True
    fit = first_pass(body, keys, seen, fixed=fixed, precision=precision(body), fps=FPS, correlated=1.0)
    assert joint_errors(body, fit.motion, body, motion).mean() < 0.03
    np.testing.assert_allclose(fit.motion.rotations[keys.frames], motion.rotations[keys.frames], atol=1e-12)


def test_a_keypoint_factor_pulls_towards_its_keypoints() -> None:
    """A Gauss-Newton step on them alone, from a pose nearby, leads to the pose that they show."""
    body = human()
    motion = strolling(body, 3)
    seen = keypoints_of(cameras(3), seen_places(body, motion))
    factor = KeypointFactor(seen, Places.on(body, NAMES), 1.0)
    start = Motion(motion.translations + [0.03, -0.02, 0.01], motion.rotations)
    for _ in range(3):
        blocks = factor.blocks(body, part_poses(body, start), 8.0)
        start = start.moved(-BandedFactor(blocks, free(body, 3)).solve(blocks.gradient))
    assert joint_errors(body, start, body, motion).max() < 2e-3


def test_a_keypoint_factor_of_some_frames() -> None:
    body = human()
    seen = keypoints_of(cameras(2), seen_places(body, strolling(body, 6)))
    cut = KeypointFactor(seen, Places.on(body, NAMES), 1.0)[2:5]
    assert len(cut.keypoints) == 3
    np.testing.assert_array_equal(cut.keypoints.rays, seen.rays[:, 2:5])


def test_the_fit_does_not_depend_on_the_order_of_the_views() -> None:
    body = human()
    motion = strolling(body, 20)
    seen = keypoints_of(cameras(3), seen_places(body, motion), noise=0.01)
    order = [2, 0, 1]
    other = Keypoints(NAMES, seen.rays[order], seen.confidence[order], seen.R_cam_world[order], seen.t_cam_world[order])
    keys = KeyPoses.whole([0, 19], motion[[0, 19]])
    fits = [fit_without_agreement(body, k, motion) for k in (seen, other)]
    assert keys.fixed.all()
    np.testing.assert_allclose(fits[0].motion.translations, fits[1].motion.translations, atol=1e-9)


def test_agreement_is_one_on_the_true_poses_and_falls_away_from_them() -> None:
    body = human()
    motion = strolling(body, 5)
    seen = keypoints_of(cameras(2), seen_places(body, motion))
    seen.rays[0, 1, 2] = np.nan
    seen.confidence[0, 1, 2] = 0
    factor = KeypointFactor(seen, Places.on(body, NAMES), 9.0)
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
    problem = SegmentProblem((), (body,), 0, FPS, fixed, keypoints=(KeypointFactor(seen, Places.on(body, NAMES), 9.0),))

    def solution(found: Motion, explained: float) -> SegmentSolution:
        nothing = np.zeros(0)
        return SegmentSolution((found,), 1, (), nothing, np.full((1, 5), explained), nothing, nothing, {})

    right, wrong = solution(motion, 90.0), solution(astray, 100.0)
    assert covering_most(problem, wrong, right) is right
    assert covering_most(replace(problem, keypoints=()), wrong, right) is wrong
    assert confirmed_by_keypoints(problem, [motion], right) and not confirmed_by_keypoints(problem, [motion], wrong)
    assert not confirmed_by_keypoints(replace(problem, keypoints=()), [motion], right)
