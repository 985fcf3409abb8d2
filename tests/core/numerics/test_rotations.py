"""Rotations: exponential, logarithm and their Jacobians, for large and for vanishing angles."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from kfmocap.core.numerics import rotations
from synthetic import numeric_jacobian

coordinate = st.floats(-1, 1, allow_subnormal=False)
direction = st.tuples(coordinate, coordinate, coordinate).filter(lambda v: np.linalg.norm(v) > 1e-3)
angle = st.one_of(st.floats(0, 3.1), st.floats(0, 2e-3), st.just(1e-3))


def vector(axis: tuple[float, float, float], size: float) -> np.ndarray:
    return size * np.array(axis) / np.linalg.norm(axis)


@given(direction, angle)
def test_log_inverts_exp(axis: tuple[float, float, float], size: float) -> None:
    v = vector(axis, size)
    np.testing.assert_allclose(rotations.log(rotations.exp(v)), v, atol=1e-9)


@given(direction, angle)
def test_exp_is_a_rotation_about_the_axis(axis: tuple[float, float, float], size: float) -> None:
    v = vector(axis, size)
    R = rotations.exp(v)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(R @ v, v, atol=1e-12)
    assert np.trace(R) == pytest.approx(1 + 2 * np.cos(size), abs=1e-12)
    assert np.linalg.det(R) == pytest.approx(1)


def test_values_that_cannot_be_written_to_are_taken() -> None:
    """As broadcasting makes them: a single frame of poses that are the same on all of them."""
    v = np.broadcast_to(np.array([0.1, 0.2, 0.3]), (1, 1, 3))
    R = rotations.exp(v)
    R.flags.writeable = False
    np.testing.assert_allclose(rotations.log(R), v, atol=1e-12)
    np.testing.assert_allclose(rotations.orthonormal(R), R, atol=1e-12)


def test_exp_turns_by_the_right_hand() -> None:
    np.testing.assert_allclose(rotations.exp(np.array([0, 0, np.pi / 2])) @ [1, 0, 0], [0, 1, 0], atol=1e-12)


@given(st.tuples(coordinate, coordinate, coordinate), st.tuples(coordinate, coordinate, coordinate))
def test_skew_is_the_cross_product(v: tuple[float, ...], w: tuple[float, ...]) -> None:
    np.testing.assert_allclose(rotations.skew(np.array(v)) @ w, np.cross(v, w), atol=1e-15)


@given(direction, angle)
def test_right_jacobian_is_the_derivative_of_exp(axis: tuple[float, float, float], size: float) -> None:
    v = vector(axis, size)
    R = rotations.exp(v)
    numeric = numeric_jacobian(lambda x: rotations.log(R.T @ rotations.exp(x)), v)
    np.testing.assert_allclose(rotations.right_jacobian(v), numeric, atol=1e-6 * max(1.0, np.abs(numeric).max()))


@given(direction, angle)
def test_inverse_jacobians_are_the_derivatives_of_log(axis: tuple[float, float, float], size: float) -> None:
    v = vector(axis, size)
    R = rotations.exp(v)
    right = numeric_jacobian(lambda d: rotations.log(R @ rotations.exp(d)), np.zeros(3))
    left = numeric_jacobian(lambda d: rotations.log(rotations.exp(d) @ R), np.zeros(3))
    scale = max(1.0, np.abs(right).max())
    np.testing.assert_allclose(rotations.right_jacobian_inverse(v), right, atol=1e-6 * scale)
    np.testing.assert_allclose(rotations.left_jacobian_inverse(v), left, atol=1e-6 * scale)


@given(direction, st.sampled_from([0.0, 1e-12, 1e-8, 9.99e-4, 1.001e-3, 0.1]))
def test_jacobian_times_its_inverse_is_one_on_both_sides_of_the_series(
    axis: tuple[float, float, float], size: float
) -> None:
    v = vector(axis, size)
    product = rotations.right_jacobian(v) @ rotations.right_jacobian_inverse(v)
    np.testing.assert_allclose(product, np.eye(3), atol=1e-9)


def test_leading_axes_are_kept() -> None:
    v = np.random.default_rng(0).normal(0, 0.5, (2, 4, 3))
    R = rotations.exp(v)
    assert R.shape == (2, 4, 3, 3)
    np.testing.assert_allclose(rotations.log(R), v, atol=1e-12)
    for f in (rotations.right_jacobian, rotations.right_jacobian_inverse, rotations.left_jacobian_inverse):
        np.testing.assert_allclose(f(v)[1, 2], f(v[1, 2]), atol=1e-15)


def test_orthonormal_takes_rounding_away() -> None:
    rng = np.random.default_rng(1)
    R = rotations.exp(rng.normal(0, 1, (5, 3)))
    clean = rotations.orthonormal(R + rng.normal(0, 1e-7, R.shape))
    np.testing.assert_allclose(clean @ np.swapaxes(clean, 1, 2), np.broadcast_to(np.eye(3), R.shape), atol=1e-14)
    np.testing.assert_allclose(clean, R, atol=1e-6)


def test_the_mean_of_rotations_is_nearest_to_them_also_where_their_sum_mirrors() -> None:
    rng = np.random.default_rng(2)
    R = rotations.exp(rng.normal(0, 3, (4, 200, 3)))
    weight = (rng.random((4, 200)) < 0.8).astype(float)
    mirrored = np.linalg.det(np.einsum("fp,fpab->pab", weight, R)) < 0
    assert mirrored.sum() > 20

    def misfit(candidate: np.ndarray) -> np.ndarray:
        return np.einsum("fp,fpab->p", weight, (R - candidate) ** 2)

    found = rotations.mean(R, weight)
    np.testing.assert_allclose(np.linalg.det(found), 1)
    for _ in range(50):
        beside = found @ rotations.exp(rng.normal(0, 0.5, (200, 3)))
        assert (misfit(beside) > misfit(found) - 1e-9).all()
    np.testing.assert_allclose(rotations.mean(R, np.zeros((4, 200))), np.broadcast_to(np.eye(3), (200, 3, 3)))
