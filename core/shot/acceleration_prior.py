"""Prior variances of the accelerations of a body's joints and root."""

from __future__ import annotations

import numpy as np

from ..body import Body
from ..body.smoothness_estimate import POOLING_COUNT, ROOT_GROUPS, axis_mobility, by_group, group_sizes, precision_of
from ..numerics.arrays import Array, Bools
from .settings import Settings
from .shot import KeyPoses

USUAL_JOINT = 30.0
"""Typical angular acceleration of a joint in calm movement, rad/s^2; used if nothing is known of the shot."""
USUAL_ROOT = 2.0
"""Typical acceleration of the root in calm movement, m/s^2."""
_MIN_CHANGE = 1e-6  # of a variance: equal key poses do not mean that nothing moves between them


def usual_variances(body: Body, fps: float, settings: Settings) -> Array:
    """Return the variances of accelerations per frame, shape (G,), from the settings or else the typical ones.

    The groups are those of `core.body.smoothness_estimate`.
    """
    sigma = np.full(len(group_sizes(body.dof)), settings.joint_acceleration or USUAL_JOINT)
    sigma[:ROOT_GROUPS] = settings.root_acceleration or USUAL_ROOT
    return np.asarray((sigma / fps**2) ** 2)


def given_groups(body: Body, settings: Settings) -> Bools:
    """Return which groups' accelerations are given in the settings and not estimated, shape (G,)."""
    given = np.full(len(group_sizes(body.dof)), settings.joint_acceleration is not None)
    given[:ROOT_GROUPS] = settings.root_acceleration is not None
    return given


def acceleration_precision(body: Body, fps: float, settings: Settings) -> Array:
    """Return the inverse variance of each degree of freedom's acceleration per frame squared, shape (D,)."""
    return precision_of(usual_variances(body, fps, settings), axis_mobility(body))


def variances_from_key_poses(body: Body, keys: KeyPoses, fps: float, settings: Settings) -> Array:
    """Estimate the variances of accelerations per frame, shape (G,), from key poses of the whole body.

    If accelerations are independent from frame to frame, the change of mean velocity from an interval of m frames to
    the next, of n frames, has the variance of an acceleration times (m + n) / 3 + (1 / m + 1 / n) / 6 (the sum of
    squares of a triangle). With fewer than three key poses the typical variances are returned; groups given in the
    settings always keep theirs.
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
    count = len(m) * group_sizes(body.dof)
    seen = by_group(squares).sum(axis=0) / count / usual
    likely = usual * np.maximum((POOLING_COUNT * seen.mean() + count * seen) / (POOLING_COUNT + count), _MIN_CHANGE)
    return np.where(given_groups(body, settings), usual, likely)
