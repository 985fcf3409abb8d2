"""Motions fitted to keypoints: offsets and body are found with the motion, gross errors do not count."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from keypoint_shots import NAMES, cameras, joint_errors, keypoints_of, seen_places, strolling
from kfmocap.core.body import Body, default_measures, human, part_poses
from kfmocap.core.body.motion import Motion
from kfmocap.core.keypoints.keypoint_motion.first_pass import first_pass, scaled_first_pass
from kfmocap.core.keypoints.keypoint_motion.keypoint_fit import FitProblem, KeypointFit, fit_motion
from kfmocap.core.keypoints.keypoint_rays import Keypoints
from kfmocap.core.keypoints.keypoint_sigmas import robust_weights, sigmas
from kfmocap.core.keypoints.left_and_right.left_right import swap_sides
from kfmocap.core.keypoints.view_agreement import ViewAgreement
from kfmocap.core.numerics import rotations
from kfmocap.core.shot.acceleration_prior import acceleration_precision
from kfmocap.core.shot.settings import Settings
from kfmocap.core.shot.shot import KeyPoses

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
    np.testing.assert_array_equal(fit.sigma, sigmas(residual, fit.keypoints.confidence))
    weights = robust_weights(residual, fit.keypoints.confidence, fit.sigma) * fit.sigma[:, None] ** 2
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
