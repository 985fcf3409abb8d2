"""Triangulated keypoints: the points on which views agree, without those that leap; their sides and deviations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from keypoint_shots import NAMES, cameras, keypoints_of, seen_places, strolling
from kfmocap.core.body import human
from kfmocap.core.keypoints.keypoint_sigmas import robust_weights, sigmas
from kfmocap.core.keypoints.left_and_right.left_right import correct_sides, swap_sides
from kfmocap.core.keypoints.triangulation import triangulate
from kfmocap.core.keypoints.view_agreement import without_leaps

FPS = 30.0


def test_weights_fall_with_the_error_and_with_confidence() -> None:
    residual = np.zeros((1, 4, 1, 2))
    residual[0, :, 0, 0] = [0.0, 0.06, 0.6, np.nan]
    confidence = np.array([1.0, 1.0, 1.0, 0.0]).reshape(1, 4, 1)
    sigma = np.full((1, 1), 0.02)
    sure, far, gross, missing = robust_weights(residual, confidence, sigma)[0, :, 0] * 0.02**2
    assert sure == 1 and far == pytest.approx(0.25) and gross < 1e-3 and missing == 0
    assert robust_weights(residual, 0.5 * confidence, sigma)[0, 0, 0] == 0.5 / 0.02**2


def test_deviations_are_those_of_the_noise_and_no_outlier_counts() -> None:
    rng = np.random.default_rng(0)
    residual = 0.03 * rng.normal(size=(1, 400, 2, 2))
    residual[0, :60] = 5.0
    found = sigmas(residual, np.ones((1, 400, 2)))
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


def test_points_that_leap_are_left_out() -> None:
    points = seen_places(human(), strolling(human(), 12))
    spoilt = points.copy()
    spoilt[5, 3] += 0.5
    found = without_leaps(spoilt, FPS)
    assert np.isnan(found[5, 3]).all()
    np.testing.assert_array_equal(np.delete(found, 5, axis=0), np.delete(points, 5, axis=0))
