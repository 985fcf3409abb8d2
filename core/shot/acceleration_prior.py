"""How strongly the joints and the root of a body are accelerated, before the footage is looked at."""

from __future__ import annotations

import numpy as np

from ..body import Body
from ..body.smoothness_estimate import POOLED, axis_mobility, precision_of
from ..numerics.arrays import Array, Bools
from .shot import KeyPoses, Settings

USUAL_JOINT = 30.0
"""Angular acceleration of a joint in careful movement, rad/s^2: where nothing is known of a shot."""
USUAL_ROOT = 2.0
"""Acceleration of the root, m/s^2, likewise."""
_LEAST_CHANGE = 1e-6  # of a variance: key poses that stand still do not say that nothing moves between them


def usual_variances(body: Body, fps: float, settings: Settings) -> Array:
    """Variances of accelerations per frame, shape (G,), as the settings give them, or as is usual.

    The groups are those of `core.body.smoothness_estimate`: the root's place and every part's turn.
    """
    deviation = np.full(body.dof // 3, settings.joint_acceleration or USUAL_JOINT)
    deviation[0] = settings.root_acceleration or USUAL_ROOT
    return np.asarray((deviation / fps**2) ** 2)


def given_groups(body: Body, settings: Settings) -> Bools:
    """Which groups' accelerations the settings give, shape (G,): these are not estimated."""
    given = np.full(body.dof // 3, settings.joint_acceleration is not None)
    given[0] = settings.root_acceleration is not None
    return given


def acceleration_precision(body: Body, fps: float, settings: Settings) -> Array:
    """Inverse variance of the acceleration of each degree of freedom, per frame squared, shape (D,)."""
    return precision_of(usual_variances(body, fps, settings), axis_mobility(body))


def variances_from_key_poses(body: Body, keys: KeyPoses, fps: float, settings: Settings) -> Array:
    """Variances of accelerations per frame, shape (G,), that key poses of the whole body suggest.

    Between them accelerations are taken for independent: then the change of the mean speed from one interval, of m
    frames, to the next, of n, has the variance of an acceleration times (m + n) / 3 + (1 / m + 1 / n) / 6 (the sum of
    squares of a triangle). Fewer than three key poses say nothing, and what is usual stays; so does what the settings
    give.
    """
    usual = usual_variances(body, fps, settings)
    whole = np.flatnonzero(keys.fixed.all(axis=1))
    if len(whole) < 3:
        return usual
    gaps = np.diff(keys.frames[whole]).astype(float)
    poses = keys.poses[whole]
    speed = poses[:-1].difference(poses[1:]) / gaps[:, None]
    m, n = gaps[:-1], gaps[1:]
    weight = (m + n) / 3 + (1 / m + 1 / n) / 6
    squares = (np.diff(speed, axis=0) / axis_mobility(body)) ** 2 / weight[:, None]
    seen = squares.reshape(len(m), -1, 3).mean(axis=(0, 2)) / usual
    count = 3 * len(m)
    likely = usual * np.maximum((POOLED * seen.mean() + count * seen) / (POOLED + count), _LEAST_CHANGE)
    return np.where(given_groups(body, settings), usual, likely)
