"""The adjustment: its derivatives, its minimum, and the wand's length, which nothing may change."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from kfmocap.benchmarks.studies.wand_captures import LFRAME, Faults, capture, ring, scattered, waved
from kfmocap.core.calibration.lframe.lframe_pose import resting
from kfmocap.core.calibration.solving.ball_observations import BallObservations
from kfmocap.core.calibration.solving.bundle import adjust, covariance, variance_inflation
from kfmocap.core.calibration.solving.bundle_residuals import linearise
from kfmocap.core.calibration.solving.bundle_scene import BundleEvidence, Scene, unknowns
from kfmocap.core.calibration.solving.camera_rig import CAMERA_DOF, DRIFT, FOCAL, K1, OFFSET, SHIFT, TURN, Rig, rig_of
from kfmocap.core.calibration.solving.frame_stencil import Stencil
from kfmocap.core.calibration.solving.wand_motion import Wand
from kfmocap.core.calibration.wand_matching import matched
from kfmocap.core.numerics.least_squares import StoppingRule
from kfmocap.core.numerics.robust_kernels import Cauchy, Quadratic, RobustKernel
from scipy.optimize import least_squares
from synthetic import numeric_jacobian

Array = np.ndarray
CAMERAS = ring(3)


def scene_of(positions: Array, rig: Rig | None = None) -> Scene:
    length = float(np.linalg.norm(positions[0, 0] - positions[0, 1]))
    direction = (positions[:, 0] - positions[:, 1]) / length
    wand = Wand(np.arange(len(positions)), positions.mean(axis=1), direction, length)
    return Scene(rig or rig_of(CAMERAS), wand, LFRAME.copy())


def evidence_of(scene: Scene, positions: Array, noise: float = 0.3, seed: int = 0) -> BundleEvidence:
    given = capture(CAMERAS, [positions] * 3, Faults(noise), seed)
    parts = [
        matched(scene, v, view.wand, np.full((len(view.wand), 2), 50.0)).observations(v, view.wand)
        for v, view in enumerate(given.views)
    ]
    lframe = resting([view.lframe for view in given.views])
    return BundleEvidence(BallObservations.joined(parts), lframe, LFRAME, focal=np.array([1200.0, np.nan, 1400]))


def lens_free() -> Array:
    free = np.zeros((3, CAMERA_DOF), bool)
    free[:, TURN] = free[:, SHIFT] = True
    free[:, [FOCAL, K1]] = True
    return free


@pytest.mark.parametrize("between", [False, True])
def test_derivatives_agree_with_finite_differences(between: bool) -> None:
    positions = waved(np.arange(9) / 30, speed=2.0)
    scene = scene_of(positions)
    evidence = evidence_of(scene, positions)
    if between:
        rig = replace(
            scene.rig,
            offset=np.array([0.0, 0.3, -0.4]),
            drift=np.array([0, 1e-3, -2e-3]),
            rate=np.array([1, 1, 1.01]),
        )
        scene, evidence = replace(scene, rig=rig), replace(evidence, smooth=True)
    scene = scene.moved(np.random.default_rng(0).normal(0, 1e-3, unknowns(scene)))

    def residual(step: Array) -> Array:
        system = linearise(scene.moved(step), evidence)
        return np.concatenate([system.points.ravel(), system.others])

    numeric = numeric_jacobian(residual, np.zeros(unknowns(scene)), 1e-6)
    exact = linearise(scene, evidence).jacobian.toarray()
    scale = np.abs(numeric).max(axis=0)
    assert (scale > 0).all()
    np.testing.assert_allclose(exact / scale, numeric / scale, rtol=0, atol=1e-6)


def test_the_wand_keeps_its_length_exactly() -> None:
    positions = scattered(5)
    scene = scene_of(positions)
    moved = scene.moved(np.random.default_rng(0).normal(0, 1, unknowns(scene))).wand
    np.testing.assert_allclose(np.linalg.norm(moved.ends_world[:, 0] - moved.ends_world[:, 1], axis=1), 0.5, rtol=1e-12)


def test_the_minimum_is_that_of_scipy() -> None:
    positions = scattered(4)
    scene = scene_of(positions)
    evidence = evidence_of(scene, positions)
    fit = adjust(scene, evidence, lens_free(), stopping=StoppingRule(relative_gain=1e-12))

    def residual(step: Array) -> Array:
        whole = np.zeros(len(fit.free))
        whole[fit.free] = step
        system = linearise(scene.moved(whole), evidence)
        return np.concatenate([system.points.ravel(), system.others])

    reference = least_squares(residual, np.zeros(fit.free.sum()), x_scale="jac", xtol=1e-12, ftol=1e-12)
    assert fit.cost == pytest.approx(2 * reference.cost, rel=1e-6)


def test_the_covariance_is_the_inverse_of_the_whole_normal_matrix() -> None:
    positions = scattered(12)
    scene = scene_of(positions)
    evidence = evidence_of(scene, positions)
    free = np.concatenate([np.ones(unknowns(scene) - 3 * CAMERA_DOF, bool), lens_free().ravel()])
    J = linearise(scene, evidence).jacobian.toarray()[:, free]
    own = lens_free().ravel()
    whole = np.linalg.inv(J.T @ J)[-own.sum() :, -own.sum() :]
    np.testing.assert_allclose(covariance(scene, evidence, free)[np.ix_(own, own)], whole, rtol=1e-3, atol=1e-12)


def test_a_robust_loss_leaves_a_wrong_ball_behind() -> None:
    positions = scattered(60)
    scene = scene_of(positions)
    clean = evidence_of(scene, positions)
    uv = clean.wand.uv.copy()
    uv[::15] += [40.0, -30.0]
    spoilt = replace(clean, wand=replace(clean.wand, uv=uv))

    def focal_error(evidence: BundleEvidence, kernel: RobustKernel) -> float:
        fit = adjust(scene, evidence, lens_free(), kernel=kernel)
        return float(np.abs(fit.scene.rig.focal / scene.rig.focal - 1).max())

    assert focal_error(spoilt, Cauchy(3.0)) < 0.003 < focal_error(spoilt, Quadratic())


def test_cubic_paths_are_interpolated_exactly() -> None:
    frames = np.array([3, 4, 5, 6, 7, 8, 20, 21, 22, 40])
    times = np.array([2.6, 3.0, 3.5, 5.25, 8.4, 20.5, 21.3, 22.0, 40.0, 12.0])

    def path(t: Array) -> Array:
        return np.stack([t**2 - 3 * t, 2 * t + 1], axis=1)

    stencil = Stencil.create(frames, times)
    assert stencil.reached.tolist() == [True] * 9 + [False]
    found = stencil.value(path(frames.astype(float)))
    np.testing.assert_allclose(found[:9], path(times)[:9], rtol=1e-12)
    slope = stencil.slope(path(frames.astype(float)))
    np.testing.assert_allclose(slope[:8], np.stack([2 * times - 3, 2 + 0 * times], axis=1)[:8], rtol=1e-9)
    cubic = Stencil.create(frames, times[:5]).value(frames[:, None].astype(float) ** 3)[:, 0]
    np.testing.assert_allclose(cubic, times[:5] ** 3, rtol=1e-12)


def test_offsets_and_drifts_run_both_ways() -> None:
    rig = replace(
        rig_of(CAMERAS), offset=np.array([0, 2.5, -3]), drift=np.array([0, 1e-3, 0]), rate=np.array([1, 2, 1.0])
    )
    camera, times = np.array([0, 1, 2]), np.array([10.0, 10.0, 10.0])
    frames = rig.rate * (1 + rig.drift) * times + rig.offset
    np.testing.assert_allclose(frames, [10, 22.52, 7])
    np.testing.assert_allclose(rig.times(camera, frames), times)
    assert rig.moved(np.eye(1, 3 * CAMERA_DOF, OFFSET).reshape(3, -1)).offset[0] == 1
    assert rig.moved(np.eye(1, 3 * CAMERA_DOF, DRIFT).reshape(3, -1)).drift[0] == 1


def test_observations_are_weighted_by_their_covariance() -> None:
    rng = np.random.default_rng(2)
    way, sigma = np.array([0.48, 0.36]), 0.2  # e = 0.6 along (0.8, 0.6)
    unit = way / 0.6
    C = sigma**2 * (0.4 * np.eye(2) + 1.2 * np.outer(unit, unit))
    zero = np.zeros(1, int)
    seen = BallObservations(zero, zero, np.zeros(1), np.zeros((1, 2)), np.array([sigma]), way[None])
    r = rng.normal(size=(1, 2))
    assert np.sum(seen.whitened(r) ** 2) == pytest.approx(r[0] @ np.linalg.solve(C, r[0]))
    np.testing.assert_allclose(seen.in_pixels(seen.whitened(r)), r)
    J = rng.normal(size=(1, 2, 3))
    np.testing.assert_allclose(seen.whitened(J)[0] @ np.ones(3), seen.whitened(J @ np.ones(3))[0])


@pytest.mark.parametrize(("r", "expected"), [(0.0, 1.0), (0.6, 4.0)])
def test_errors_that_last_from_frame_to_frame_make_results_less_certain(r: float, expected: float) -> None:
    rng, n = np.random.default_rng(0), 8000
    error = rng.normal(size=(n, 2))
    for k in range(1, n):
        error[k] = r * error[k - 1] + np.sqrt(1 - r**2) * error[k]
    ones = np.ones(n)
    seen = BallObservations(ones.astype(int), ones.astype(int), np.arange(n, dtype=float), error, ones)
    assert variance_inflation(seen, error) == pytest.approx(expected, rel=0.12)
