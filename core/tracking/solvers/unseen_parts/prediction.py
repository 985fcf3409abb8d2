"""Prediction of parts that no camera sees (paper 1, section 5 and appendix 4).

Each motion parameter, a step from one frame to the next, is modelled as an autoregressive series, equation (31). Its
coefficients are estimated from the steps that were seen, by Levinson's recursion, and a Kalman filter on the state
space (32)-(37) predicts the others. A gap between two runs of seen frames is predicted from both sides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import toeplitz

from ....body.motion import Motion
from ....numerics import frame_ranges, rotations
from ....numerics.arrays import Array
from ....numerics.robust_kernels import NORMAL_MAD

if TYPE_CHECKING:
    from filterpy.kalman import KalmanFilter as Filter


MAX_ORDER = 12
"""Largest order of a model; it is never more than a third of the number of steps that the model is learnt from.

Akaike's criterion would choose lower orders on series this short, where estimates of the autocovariance damp every
model, and predict less well: the error of limbs hidden for 12 frames at 30 frames/s would be a quarter larger."""
FILTER_STEPS = 16
"""Number of steps before a gap that the filter runs over; more make no difference."""
_MIN_VARIANCE = 1e-12  # variance of a parameter that stands still, (rad/frame)^2 or (m/frame)^2


@dataclass(frozen=True, eq=False)
class AutoRegression:
    """Model of one motion parameter: y_j = sum_i a_i y_{j-i} + v_j, observed as y_j + w_j.

    Attributes
    ----------
    coefficients : ndarray, shape (h,)
        a.
    variance : float
        Variance of the innovation v.
    noise : float
        Variance of the observation noise w.
    covariance : ndarray, shape (max(h, 1),)
        Autocovariance of y at lags 0, 1, ...
    """

    coefficients: Array
    variance: float
    noise: float
    covariance: Array


def levinson(covariance: Array) -> tuple[Array, float]:
    """Coefficients and innovation variance of the autoregression with this autocovariance.

    Parameters
    ----------
    covariance : ndarray, shape (h + 1,)
        At lags 0 to h, positive definite.

    Returns
    -------
    coefficients : ndarray, shape (g,)
        g is h, or less if the series can be predicted exactly with fewer.
    variance : float
        Variance of the innovation.

    References
    ----------
    N. Levinson, The Wiener RMS error criterion in filter design and prediction, J. Math. Phys. 25, 1947.
    """
    a, variance = np.zeros(0), float(covariance[0])
    for h in range(1, len(covariance)):
        if variance <= 1e-12 * covariance[0]:
            break
        reflection = (covariance[h] - a @ covariance[h - 1 : 0 : -1]) / variance
        a = np.append(a - reflection * a[::-1], reflection)
        variance *= 1 - reflection**2
    return a, variance


def autocovariance(runs: Sequence[Array], lags: int) -> Array:
    """Autocovariance at lags 0 to `lags`, shape (lags + 1,), of a series that is known in separate runs.

    Every lag is divided by the number of all samples, a biased but positive semidefinite estimate. The mean is not
    subtracted: that of a joint that turns to and fro is zero, and that of a short series is chance.
    """
    products = [sum(float(run[k:] @ run[: len(run) - k]) for run in runs if len(run) > k) for k in range(lags + 1)]
    return np.array(products) / max(1, sum(len(run) for run in runs))


def observation_noise(runs: Sequence[Array]) -> float:
    """Variance of the noise on the steps of a smooth motion whose poses have independent errors.

    Third differences of the steps are fourth differences of the poses, in which little motion is left. Their variance
    is 70 times that of a pose's error; that of a step is twice that of a pose. The median ignores sudden motion.
    """
    rough = np.concatenate([np.zeros(0)] + [np.diff(run, 3) for run in runs if len(run) > 3])
    return float(2 / 70 * (NORMAL_MAD * np.median(np.abs(rough))) ** 2) if len(rough) else 0.0


def autoregression(runs: Sequence[Array], order: int | None = None) -> AutoRegression:
    """Learn the model of one motion parameter.

    Parameters
    ----------
    runs : sequence of ndarray, shape (n_k,)
        Runs of the series, rad/frame or m/frame. If there are too few samples, or all are zero, the model stands still.
    order : int, optional
        Order h, by default `MAX_ORDER`; never more than a third of the samples.
    """
    h = min(MAX_ORDER if order is None else order, sum(len(run) for run in runs) // 3)
    r = autocovariance(runs, h)
    if r[0] <= _MIN_VARIANCE:
        return AutoRegression(np.zeros(0), _MIN_VARIANCE, _MIN_VARIANCE, np.array([_MIN_VARIANCE]))
    a, variance = levinson(r)
    return AutoRegression(
        a,
        max(variance, 1e-9 * r[0]),
        max(min(observation_noise(runs), r[0] / 2), _MIN_VARIANCE),
        r[: max(len(a), 1)],
    )


def predict(series: Array, steps: int, models: Sequence[AutoRegression] | None = None) -> tuple[Array, Array]:
    """Predict motion parameters by Kalman filters, up to k steps ahead of the last one seen (appendix 4).

    Parameters
    ----------
    series : ndarray, shape (n, d)
        Seen values of d parameters, oldest first.
    steps : int
        The largest k.
    models : sequence of AutoRegression, optional
        One per parameter; by default learnt from the series itself.

    Returns
    -------
    mean, variance : ndarray, shape (steps, d)
        Mean and variance of the parameters on the frames that follow.
    """
    models = [autoregression([y]) for y in series.T] if models is None else models
    mean, variance = np.zeros((2, steps, len(models)))
    for d, model in enumerate(models):
        if not len(model.coefficients):  # without memory zero is expected, whatever was seen
            variance[:, d] = model.variance
            continue
        kalman = _filtered(series[:, d], model)
        for k in range(steps):
            kalman.predict()
            mean[k, d], variance[k, d] = kalman.x[0, 0], kalman.P[0, 0]
    return mean, variance


def predict_unseen(motion: Motion, unseen: NDArray[np.bool_], *, since: int = 0) -> Motion:
    """Replace the poses of unseen parts by predictions from the frames on which they are seen.

    A part is predicted relative to its parent. A gap within the motion is predicted forward and backward, and both
    poses are averaged with the inverse of their accumulated variances; at the motion's ends there is one prediction. A
    part that is never seen is left as it is.

    Parameters
    ----------
    motion : Motion
        F poses of P parts.
    unseen : ndarray of bool, shape (F, P)
        The root's position is unseen where the root is.
    since : int
        Poses before this frame have not changed since the last call; only predictions that depend on later poses are
        made again.
    """
    T, Q = motion.translations.copy(), motion.rotations.copy()
    for p in np.flatnonzero(unseen.any(axis=0) & ~unseen.all(axis=0)):
        place = T if p == 0 else np.zeros_like(T)
        filled = _filled(Motion(place, Q[:, [p]]), unseen[:, p], since)
        Q[:, p] = filled.rotations[:, 0]
        if p == 0:
            T = filled.translations
    return Motion(T, Q)


def _filled(part: Motion, unseen: NDArray[np.bool_], since: int) -> Motion:
    """Predict the unseen frames of a single part's motion, where they depend on poses from frame `since` on."""
    gaps = [(a, b) for a, b in frame_ranges.runs(unseen) if b + 1 + FILTER_STEPS >= since]
    if not gaps:
        return part
    runs = [_steps(part[a : b + 1]) for a, b in frame_ranges.runs(~unseen)]
    drift = np.concatenate(runs).mean(axis=0) if any(map(len, runs)) else np.zeros(6)
    drift[3:] = 0
    models = [autoregression([run[:, d] - drift[d] for run in runs]) for d in range(6)]
    for a, b in gaps:
        n = b + 1 - a
        before, after = _seen_before(part[:a], unseen[:a]), _seen_before(part[b + 1 :][::-1], unseen[b + 1 :][::-1])
        ahead = _continued(before, n, models, drift) if a > 0 else None
        back = _continued(after, n, models, -drift) if b + 1 < len(part) else None
        part = part.replaced(a, _blended(ahead, back))
    return part


def _steps(motion: Motion) -> Array:
    """Motion parameters x_j of a part from each frame to the next, equation (5), shape (F - 1, 6)."""
    return motion[:-1].difference(motion[1:]) if len(motion) > 1 else np.zeros((0, 6))


def _seen_before(past: Motion, unseen: NDArray[np.bool_]) -> Motion:
    """Return the last run of past frames that was seen without a break."""
    hidden = np.flatnonzero(unseen)
    start = hidden[-1] + 1 if len(hidden) else 0
    return past[max(start, len(past) - 1 - FILTER_STEPS) :]


def _continued(seen: Motion, steps: int, models: Sequence[AutoRegression], drift: Array) -> tuple[Motion, Array]:
    """Predict poses after those seen, with the variance of each parameter, shape (steps, D)."""
    mean, variance = predict(_steps(seen) - drift, steps, models)
    steps_ahead = np.concatenate([seen.translations[-1:], mean[:, :3] + drift[:3]])
    turns = accumulate(rotations.exp(mean[:, 3:] + drift[3:]), np.matmul, initial=seen.rotations[-1, 0])
    R = rotations.orthonormal(np.array(list(turns)[1:]))
    return Motion(np.cumsum(steps_ahead, axis=0)[1:], R[:, None]), np.cumsum(variance, axis=0)


def _blended(ahead: tuple[Motion, Array] | None, back: tuple[Motion, Array] | None) -> Motion:
    """Average a forward and a backward prediction by their inverse variances; or return the only one."""
    if back is None:
        assert ahead is not None
        return ahead[0]
    backward, spread_back = back[0][::-1], back[1][::-1]
    if ahead is None:
        return backward
    forward, spread = ahead
    return forward.moved(spread / (spread + spread_back) * forward.difference(backward))


def _filtered(series: Array, model: AutoRegression) -> Filter:
    """Run the Kalman filter of the state space (32)-(37) over a series."""
    from .kalman import KalmanFilter

    h = len(model.covariance)
    kalman: Filter = KalmanFilter(dim_x=h, dim_z=1)
    kalman.F = np.eye(h, k=-1)
    kalman.F[0, : len(model.coefficients)] = model.coefficients
    G = np.eye(h, 1)
    kalman.Q = model.variance * G @ G.T
    kalman.H = G.T
    kalman.R *= model.noise
    kalman.P = toeplitz(model.covariance)
    for y in series:
        kalman.predict()
        kalman.update(y)
    return kalman
