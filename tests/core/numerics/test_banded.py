"""The banded solver agrees with a dense one."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from kfmocap.core.numerics import banded as banded_module
from kfmocap.core.numerics.banded import BandedFactor, banded
from kfmocap.core.numerics.banded_blocks import BandedBlocks


def system(F: int, D: int, seed: int = 0) -> tuple[BandedBlocks, np.ndarray]:
    """A positive definite system far from singular, block-banded and dense."""
    rng = np.random.default_rng(seed)
    rows = np.zeros((F + 2, D, F + 2, D))
    for j in range(F):
        rows[j, :, j : j + 3] = rng.normal(0, 1, (D, 3, D))
    J = rows[:, :, :F].reshape(-1, F * D)
    A = J.T @ J + 3 * np.eye(F * D)
    B = A.reshape(F, D, F, D)
    blocks = BandedBlocks(
        np.stack([B[j, :, j] for j in range(F)]),
        np.array([B[j + 1, :, j] for j in range(F - 1)]).reshape(-1, D, D),
        np.array([B[j + 2, :, j] for j in range(F - 2)]).reshape(-1, D, D),
        rng.normal(0, 1, (F, D)),
        0.0,
    )
    return blocks, A


def with_ridge(A: np.ndarray) -> np.ndarray:
    """The solver lifts the diagonal by a millionth so that what nothing measures stays where it is."""
    d = np.diag(A)
    return A + np.diag(1e-6 * np.maximum(d, 1.0))


@given(st.integers(1, 6), st.integers(1, 5), st.integers(0, 99), st.floats(0, 1))
def test_solve_equals_the_dense_solve_of_the_free_unknowns(F: int, D: int, seed: int, share: float) -> None:
    blocks, A = system(F, D, seed)
    fixed = np.random.default_rng(seed).random((F, D)) < share
    free = ~fixed.ravel()
    x = BandedFactor(blocks, fixed).solve(blocks.gradient)
    expected = np.zeros(F * D)
    dense = with_ridge(A)[np.ix_(free, free)]
    expected[free] = np.linalg.solve(dense, blocks.gradient.ravel()[free])
    np.testing.assert_allclose(x.ravel(), expected, rtol=1e-9, atol=1e-12)
    assert (x[fixed] == 0).all()


def test_fixed_unknowns_are_exactly_zero_whatever_they_are_coupled_to() -> None:
    blocks, _ = system(7, 4)
    fixed = np.zeros((7, 4), bool)
    fixed[0], fixed[6], fixed[3, 1] = True, True, True
    x = BandedFactor(blocks, fixed).solve(1e9 * np.ones((7, 4)))
    assert (x[fixed] == 0).all() and (x[~fixed] != 0).all()


def test_several_right_hand_sides_are_solved_at_once() -> None:
    blocks, _ = system(5, 3)
    factor = BandedFactor(blocks, np.zeros((5, 3), bool))
    right = np.random.default_rng(1).normal(0, 1, (5, 3, 4))
    together = factor.solve(right)
    for n in range(4):
        np.testing.assert_allclose(together[..., n], factor.solve(right[..., n]), rtol=1e-12)


@pytest.mark.parametrize("frame", [0, 2, 4])
def test_covariance_is_the_block_of_the_dense_inverse(frame: int) -> None:
    blocks, A = system(5, 3)
    fixed = np.zeros((5, 3), bool)
    fixed[0, 1] = fixed[2, 2] = fixed[4] = True
    free = ~fixed.ravel()
    inverse = np.zeros_like(A)
    inverse[np.ix_(free, free)] = np.linalg.inv(with_ridge(A)[np.ix_(free, free)])
    expected = inverse.reshape(5, 3, 5, 3)[frame, :, frame]
    np.testing.assert_allclose(BandedFactor(blocks, fixed).covariance(frame), expected, rtol=1e-9, atol=1e-14)


def test_between_two_frames_what_is_known_of_those_before_counts_and_those_after_are_held() -> None:
    F, D, first, stop = 12, 3, 4, 9
    blocks, A = system(F, D)
    part = BandedFactor(blocks, np.zeros((F, D), bool)).between(first, stop)
    expected = np.linalg.inv(with_ridge(A)[: stop * D, : stop * D])[first * D :, first * D :]
    unit = np.eye((stop - first) * D).reshape(stop - first, D, -1)
    np.testing.assert_allclose(part.solve(unit).reshape(len(expected), -1), expected, atol=1e-12)


def test_damping_adds_its_share_of_the_diagonal() -> None:
    blocks, A = system(4, 3)
    x = BandedFactor(blocks, np.zeros((4, 3), bool), damping=0.5).solve(blocks.gradient)
    expected = np.linalg.solve(with_ridge(A) + 0.5 * np.diag(np.diag(A)), blocks.gradient.ravel())
    np.testing.assert_allclose(x.ravel(), expected, rtol=1e-9)


def test_what_nothing_measures_stays_where_it_is() -> None:
    blocks = BandedBlocks.zeros(5, 3)
    blocks.diagonal[:, 0, 0] = 1e8
    blocks.gradient[:, 0] = 1e8
    x = BandedFactor(blocks, np.zeros((5, 3), bool)).solve(blocks.gradient)
    np.testing.assert_allclose(x[:, 0], 1, rtol=1e-5)
    np.testing.assert_allclose(x[:, 1:], 0, atol=1e-12)


def test_storage_is_that_of_lapack() -> None:
    """Row k of the lower band holds A[i + k, i]."""
    blocks, A = system(4, 3)
    stored = banded(blocks, np.zeros((4, 3), bool))
    assert stored.shape == (9, 12)
    for k in range(9):
        np.testing.assert_allclose(stored[k, : 12 - k], np.diag(with_ridge(A), -k), rtol=1e-12)


@given(st.integers(1, 7), st.integers(1, 5), st.integers(0, 99), st.floats(0, 0.9))
def test_all_covariances_equal_the_blocks_of_the_dense_inverse(F: int, D: int, seed: int, share: float) -> None:
    blocks, A = system(F, D, seed)
    fixed = np.random.default_rng(seed).random((F, D)) < share
    free = ~fixed.ravel()
    dense = np.zeros((F * D, F * D))
    dense[np.ix_(free, free)] = np.linalg.inv(with_ridge(A)[np.ix_(free, free)])
    expected = dense.reshape(F, D, F, D)[np.arange(F), :, np.arange(F)]
    factor = BandedFactor(blocks, fixed)
    np.testing.assert_allclose(factor.covariances(), expected, rtol=1e-8, atol=1e-12)
    for found, all_frames in zip(factor.covariance_band(F // 2), factor.covariance_band(), strict=True):
        np.testing.assert_array_equal(found, all_frames[F // 2 :])


def test_covariances_keep_their_digits_over_many_frames_of_a_smooth_motion() -> None:
    """Rounding that is let grow from frame to frame is larger than the covariances after some forty."""
    F, D = 120, 6
    rng = np.random.default_rng(0)
    blocks = BandedBlocks.zeros(F, D)
    for j in range(F - 2):
        A = [np.linalg.qr(rng.normal(0, 1, (D, D)))[0] for _ in range(3)]
        rows = (A[0], -A[0] - A[2], A[2])
        for a in range(3):
            blocks.diagonal[j + a] += 1e6 * rows[a].T @ rows[a]
            if a < 2:
                blocks.first[j + a] += 1e6 * rows[a + 1].T @ rows[a]
        blocks.second[j] += 1e6 * rows[2].T @ rows[0]
    blocks.diagonal[:] += np.eye(D)
    fixed = np.zeros((F, D), bool)
    fixed[[0, -1]] = True
    factor = BandedFactor(blocks, fixed)
    found = factor.covariances()
    for frame in (1, 5, 40, 80, F - 2):
        unit = np.zeros((F, D, D))
        unit[frame] = np.eye(D)
        expected = factor.solve(unit)[frame]
        np.testing.assert_allclose(found[frame], expected, rtol=1e-6, atol=1e-9 * found[frame].max())


def test_a_system_that_is_added_to_is_the_sum_to_the_last_bit() -> None:
    (one, _), (other, _) = system(6, 3), system(6, 3, seed=1)
    wanted = other + one
    found = one.add(other)
    assert found.energy == wanted.energy and found.diagonal is one.diagonal
    for name in ("diagonal", "first", "second", "gradient"):
        np.testing.assert_array_equal(getattr(found, name), getattr(wanted, name))


def test_covariances_of_a_long_segment_are_the_same_in_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    blocks, _ = system(11, 3)
    fixed = np.random.default_rng(2).random((11, 3)) < 0.3
    factor = BandedFactor(blocks, fixed)
    whole, found = factor.covariance_band(), factor.covariances()
    monkeypatch.setattr(banded_module, "FRAMES_AT_ONCE", 4)
    np.testing.assert_array_equal(factor.covariances(), found)
    for at_once, in_runs in zip(whole, factor.covariance_band(), strict=True):
        np.testing.assert_array_equal(in_runs, at_once)
    np.testing.assert_array_equal(factor.covariance(5), found[5])
