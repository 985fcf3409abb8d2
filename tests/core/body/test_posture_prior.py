"""The prior of poses: joint limits, and nearness to rest."""

from __future__ import annotations

import numpy as np
import pytest
from kfmocap.core.body import human
from kfmocap.core.body.joint_limits import LIMIT_SIGMA, posture_prior
from kfmocap.core.numerics import rotations
from synthetic import numeric_jacobian, random_motion


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
