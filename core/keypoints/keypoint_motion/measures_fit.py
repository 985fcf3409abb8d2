"""The body's measures as unknowns beside a motion: its height, and how its proportions depart from the average."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...body import default_measures, part_poses, point_jacobian
from ...body.human import SHIFTS
from ...body.measures.body_measures import BodyMeasures
from ...body.motion import Motion
from ...numerics.arrays import Array
from ..keypoint_factor import KeypointSystem
from ..keypoint_offsets import KeypointOffsets
from ..keypoint_rays import Keypoints

PROPORTION_SIGMA = 0.08
"""Standard deviation of a measure from that of an average person of the same height, as a share of it. It includes what
different rigs and laboratories mean by the centre of a joint."""
MEASURE_ASYMMETRY = 0.02
"""Standard deviation of the difference between a measure of the left side and the same of the right, as a share."""
SHIFT_SIGMA = 0.02
"""Standard deviation of the measures in `core.body.human.SHIFTS` from those of an average person, metres."""
STATURE_SIGMA = 0.07
"""Standard deviation of a person's height from the height at which the fit starts, as a share."""


def measures_prior(measures: BodyMeasures) -> tuple[Array, Array]:
    """Return the prior of the height's logarithm and the M measures: inverse covariance and present deviations.

    The inverse covariance has the shape (1 + M, 1 + M), the deviations from the mean (1 + M,). Measures of the left
    and the right side are correlated. The deviation of the height is given as zero, so that the prior only limits
    how far each step changes it.
    """
    average, names = default_measures(measures.stature), list(measures.values)
    sigma = [SHIFT_SIGMA if name in SHIFTS else PROPORTION_SIGMA * average[name] for name in names]
    covariance = np.diag(np.square([STATURE_SIGMA, *sigma]))
    for i, name in enumerate(names, 1):
        if name.endswith(".L"):
            j = names.index(f"{name[:-2]}.R") + 1
            covariance[i, j] = covariance[j, i] = covariance[i, i]
            covariance[[i, j], [i, j]] += (MEASURE_ASYMMETRY * average[name]) ** 2
    departure = [0.0] + [value - average[name] for name, value in measures.values.items()]
    return np.linalg.inv(covariance), np.array(departure)


def with_measures(
    system: KeypointSystem,
    measures: BodyMeasures,
    motion: Motion,
    *,
    keypoints: Keypoints,
    places: KeypointOffsets,
    weights: Array,
    prior_weight: float,
) -> KeypointSystem:
    """Add the height's logarithm and the measures to a system as further unknowns, after the offsets.

    Parameters
    ----------
    system : KeypointSystem
        Of the same motion, keypoints, places and weights.
    measures : BodyMeasures
        The measures of the body that moves.
    motion : Motion
        F poses.
    keypoints : Keypoints
    places : KeypointOffsets
    weights : ndarray, shape (V, F, L)
    prior_weight : float
        Factor of the prior of the measures.
    """
    body = measures.body(solid=False)
    columns = _measure_columns(measures, motion, keypoints, places)  # (F, L, 3, 1 + M)
    R, T = part_poses(body, motion)
    points = places.world((R, T))
    residual = np.nan_to_num(keypoints.residuals(points))
    across = keypoints.across()
    moved = point_jacobian(body, R, T, places.parts, points)
    A = np.einsum("vflka,vfl,vflkb->flab", across, weights, across)
    b = np.einsum("vflka,vfl,vflk->fla", across, weights, residual)
    M, L = columns.shape[-1], len(keypoints.names)
    pulled = A @ columns
    F, D = R.shape[0], body.dof
    border = np.swapaxes(moved.reshape(F, 3 * L, D), 1, 2) @ pulled.reshape(F, 3 * L, M)
    shifted = np.einsum("flba,flbm->lam", R[:, places.parts], pulled)
    precision, departure = measures_prior(measures)
    prior = prior_weight * precision
    whole = np.zeros((3 * L + M, 3 * L + M))
    whole[: 3 * L, : 3 * L] = system.corner
    whole[: 3 * L, 3 * L :] = shifted.reshape(3 * L, M)
    whole[3 * L :, : 3 * L] = whole[: 3 * L, 3 * L :].T
    whole[3 * L :, 3 * L :] = columns.reshape(-1, M).T @ pulled.reshape(-1, M) + prior
    gradient = np.einsum("flam,fla->m", columns, b) + prior @ departure
    return KeypointSystem(
        system.blocks,
        np.concatenate([system.border, border], axis=2),
        whole,
        np.concatenate([system.gradient, gradient]),
    )


def _measure_columns(measures: BodyMeasures, motion: Motion, keypoints: Keypoints, places: KeypointOffsets) -> Array:
    """Derivatives of the keypoints' world positions by the height's logarithm and every measure, (F, L, 3, 1 + M)."""
    base, step = places.world(part_poses(measures.body(solid=False), motion)), 1e-4

    def moved(changed: BodyMeasures) -> Array:
        body = changed.body(solid=False)
        on_body = replace(KeypointOffsets.on(body, keypoints.names), offsets=places.offsets)
        return on_body.world(part_poses(body, motion))

    return np.stack(
        [(moved(measures.changed(row)) - base) / step for row in step * np.eye(1 + len(measures.values))], -1
    )
