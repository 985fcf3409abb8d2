"""How far the tips of parts may be off, by the covariances of the poses."""

from __future__ import annotations

import numpy as np
from kfmocap.core.body import part_poses
from kfmocap.core.body.motion import Motion
from kfmocap.core.tracking.expected_errors.joint_covariances import tip_covariances, tip_jacobian
from synthetic import at_rest, figure, random_motion

Array = np.ndarray
BODY = figure()


def tips(motion: Motion) -> Array:
    R, T = part_poses(BODY, motion)
    lengths = [np.linalg.norm(part.tail_world - part.head_world) for part in BODY.parts]
    return R[..., 1] * np.array(lengths)[:, None] + T


def tip_deviations(motion: Motion, covariances: Array) -> Array:
    return np.sqrt(np.trace(tip_covariances(tip_jacobian(BODY, motion), covariances), axis1=2, axis2=3))


def test_the_deviation_of_a_tip_is_that_of_poses_drawn_with_their_covariance() -> None:
    rng = np.random.default_rng(0)
    motion = random_motion(BODY, 2)
    A = rng.normal(0, 0.002, (2, BODY.dof, BODY.dof))
    covariances = A @ np.swapaxes(A, 1, 2)
    expected = []
    for f in range(2):
        drawn = motion[[f] * 8000].moved(rng.normal(size=(8000, BODY.dof)) @ A[f].T)
        apart = tips(drawn) - tips(motion[[f]])
        expected.append(np.sqrt((apart**2).sum(axis=-1).mean(axis=0)))
    np.testing.assert_allclose(tip_deviations(motion, covariances), expected, rtol=0.05)


def test_what_is_held_does_not_deviate() -> None:
    assert not tip_deviations(at_rest(BODY, 3), np.zeros((3, BODY.dof, BODY.dof))).any()
