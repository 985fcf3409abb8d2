"""What it costs to hold a point still, from the covariance of its places."""

from __future__ import annotations

import numpy as np
import pytest
from kfmocap.core.numerics.banded import BandedFactor
from kfmocap.core.numerics.banded_blocks import BandedBlocks
from kfmocap.core.tracking.solvers.plants import place_covariance
from kfmocap.core.tracking.solvers.plants.place_covariance import PlaceCovariance, TwistCovariance

FRAMES, D, SIGMA = 40, 7, 0.3
OWN = slice(1, 6)
"""The point's performer has these of the system's unknowns."""


def system(rng: np.random.Generator) -> tuple[BandedBlocks, np.ndarray]:
    """A positive definite system whose frames are coupled, with some unknowns fixed."""
    blocks = BandedBlocks.zeros(FRAMES, D)
    blocks.diagonal[:] = 6 * np.eye(D)
    blocks.first[:] = rng.normal(scale=0.4, size=blocks.first.shape)
    blocks.second[:] = rng.normal(scale=0.2, size=blocks.second.shape)
    fixed = np.zeros((FRAMES, D), bool)
    fixed[[0, 20]] = True
    return blocks, fixed


def place_of(factor: BandedFactor, jacobian: np.ndarray, places: np.ndarray) -> PlaceCovariance:
    """The covariance of the places of a part's origin, by their derivatives (F, 3, D)."""
    twist = np.concatenate([jacobian, np.zeros_like(jacobian)], axis=1)
    own = OWN if jacobian.shape[2] == OWN.stop - OWN.start else slice(0, jacobian.shape[2])
    return PlaceCovariance.of(TwistCovariance(factor, own, twist, np.zeros((FRAMES, 6))), places, np.zeros((FRAMES, 3)))


def dense(factor: BandedFactor) -> np.ndarray:
    """The inverse of its matrix, shape (F, D, F, D)."""
    return factor.solve(np.eye(FRAMES * D).reshape(FRAMES, D, -1)).reshape(FRAMES, D, FRAMES, D)


def test_steps_of_a_point_have_the_covariance_of_the_normal_equations() -> None:
    """More frames are asked for than are solved for at once, and in two turns, of which the second is longer."""
    rng = np.random.default_rng(3)
    factor = BandedFactor(*system(rng))
    twist, step = rng.normal(size=(FRAMES, 6, OWN.stop - OWN.start)), rng.normal(size=(FRAMES, 6))
    points, arms = rng.normal(size=(2, FRAMES, 3))
    found = PlaceCovariance.of(TwistCovariance(factor, OWN, twist, step), points, arms)
    places = points + step[:, :3] + np.cross(step[:, 3:], arms)
    jacobian = twist[:, :3] + np.cross(twist[:, 3:], arms[..., None], axis=1)
    full = np.einsum("fid,fdge,gje->figj", jacobian, dense(factor)[:, OWN, :, OWN], jacobian)
    assert place_covariance.FRAMES_AT_ONCE < FRAMES - 8
    for first, last in ((10, 12), (4, 34)):
        steps, covariance = found.steps(first, last)
        some = slice(first, last + 2)
        expected = np.diff(np.diff(full[some, :, some], axis=0), axis=2)
        assert np.allclose(steps, np.diff(places[some], axis=0).ravel())
        assert np.allclose(covariance, expected.reshape(len(steps), -1), atol=1e-12)


def test_in_a_long_segment_frames_far_ahead_count_as_known(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(3)
    factor = BandedFactor(*system(rng))
    jacobian, places = rng.normal(size=(FRAMES, 3, OWN.stop - OWN.start)), rng.normal(size=(FRAMES, 3))
    exact = place_of(factor, jacobian, places)
    monkeypatch.setattr(place_covariance, "LONG", 10)
    monkeypatch.setattr(place_covariance, "KNOWN_EVERY", 10)
    monkeypatch.setattr(place_covariance, "REACH", 8)
    found = place_of(factor, jacobian, places)
    for first, last in ((4, 8), (24, 26), (2, 36)):
        (steps, covariance), (true_steps, true) = (one.steps(first, last) for one in (found, exact))
        assert np.array_equal(steps, true_steps)
        assert np.allclose(covariance, true, atol=1e-3 * np.diag(true).max())
    ends = {known: begin + len(column) for (known, _), (begin, column) in found.columns.items()}
    assert ends == {20: 20, 40: 40}


def test_a_point_may_stand_for_longer_than_frames_are_looked_ahead(monkeypatch: pytest.MonkeyPatch) -> None:
    """Places far apart are hardly less alike than neighbours where they walk at random: all must be of one system."""
    monkeypatch.setattr(place_covariance, "LONG", 10)
    monkeypatch.setattr(place_covariance, "KNOWN_EVERY", 10)
    monkeypatch.setattr(place_covariance, "REACH", 4)
    blocks = BandedBlocks.zeros(FRAMES, 3)
    blocks.diagonal[:], blocks.first[:] = 2.001 * np.eye(3), -np.eye(3)
    factor = BandedFactor(blocks, np.zeros((FRAMES, 3), bool))
    jacobian = np.tile(np.eye(3), (FRAMES, 1, 1))
    _, covariance = place_of(factor, jacobian, np.zeros((FRAMES, 3))).steps(3, 30)
    assert np.allclose(covariance, covariance.T, atol=1e-12)
    assert np.linalg.eigvalsh(covariance).min() > 0.1
