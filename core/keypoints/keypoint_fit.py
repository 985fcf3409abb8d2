"""A motion fitted to keypoints alone: poses of all frames, the keypoints' offsets, and the body's measures at once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..body import Body, default_measures, human, part_poses, point_jacobian
from ..body.human import SHIFTS
from ..body.motion import Motion
from ..body.smoothness import limited, smoothness
from ..numerics import rotations
from ..numerics.banded import BandedFactor, bordered_solution
from ..numerics.banded_blocks import BandedBlocks, block_diagonal
from .keypoint_factor import (
    USUAL_DEVIATION,
    Keypoints,
    KeypointSystem,
    Places,
    deviations,
    keypoint_system,
    robust_energy,
    robust_weights,
)
from .left_right import correct_sides

Array = NDArray[np.float64]

TOLERANCES = (8.0, 4.0, 4.0, 2.0, 2.0, 1.0, 1.0, 1.0, 1.0, 1.0)
SIDES_TOLERANCE = 2.0
"""Sides are put right when the tolerance has come down to this: before, the start may be farther off than the limbs are
apart."""
LIMIT_DEVIATION = 0.05
"""How far a joint may go beyond its limits, radians."""
POSTURE_DEVIATION = 2.0
"""Usual departure of a joint from its rest orientation, radians: only decides what no keypoint shows."""
PROPORTION_DEVIATION = 0.05
"""Usual departure of a measure from the average person's of that height, as a share."""
SHIFT_DEVIATION = 0.015
"""The same of `body.human.SHIFTS`, metres."""
STATURE_DEVIATION = 0.07
"""Usual departure of a person's height from where the fit begins, as a share."""


@dataclass(frozen=True, eq=False)
class KeypointFit:
    """What keypoints alone say.

    Attributes
    ----------
    body : Body
    motion : Motion
        F poses.
    places : Places
        Of the keypoints on the body, offsets included.
    keypoints : Keypoints
        With their sides put right.
    changed : ndarray of bool, shape (V, F, L)
        Where they were changed.
    deviation : ndarray, shape (V, L)
        See `evidence.keypoints.deviations`.
    weights : ndarray, shape (V, F, L)
        Robust weights at the end, of 1 for a sure keypoint that fits.
    energy : float
        What the keypoints, the joints' limits and accelerations leave.
    """

    body: Body
    motion: Motion
    places: Places
    keypoints: Keypoints
    changed: NDArray[np.bool_]
    deviation: Array
    weights: Array
    energy: float


def fit_motion(
    body: Body,
    keypoints: Keypoints,
    start: Motion,
    fixed: NDArray[np.bool_],
    precision: Array,
    together: float = 1.0,
    measures: tuple[float, Mapping[str, float]] | None = None,
) -> KeypointFit:
    """Gauss-Newton on all frames.

    Parameters
    ----------
    body : Body
    keypoints : Keypoints
        On F frames.
    start : Motion
        F poses.
    fixed : ndarray of bool, shape (F, D)
        Degrees of freedom that are known.
    precision : ndarray, shape (D,)
        Of accelerations, see `smoothness`.
    together : float
        How many neighbouring frames err together and count as one.
    measures : tuple of float and mapping, optional
        Height and measures of the body, which are then fitted as well.
    """
    motion, places = start, Places.on(body, keypoints.names)
    for tolerance in TOLERANCES:
        poses = part_poses(body, motion)
        expected = (
            places.world(poses)
            if tolerance <= SIDES_TOLERANCE
            else np.full((len(motion), len(places.parts), 3), np.nan)
        )
        sided, changed = correct_sides(keypoints, expected)
        residual = sided.residuals(places.world(poses))
        deviation = deviations(residual, sided.confidence)
        weights = robust_weights(residual, sided.confidence, deviation, tolerance) / together
        system = keypoint_system(body, poses, sided, places, weights)
        blocks = system.blocks + smoothness(motion, precision) + posture(body, motion)
        if measures is not None:
            system = _with_measures(system, body, measures, motion, sided, places, weights)
        factor = BandedFactor(blocks, fixed)
        step, border = bordered_solution(factor, blocks.gradient, system.border, system.corner, system.gradient)
        motion = motion.moved(-limited(step))
        L = len(keypoints.names)
        places = replace(places, offsets=places.offsets - border[: 3 * L].reshape(L, 3))
        if measures is not None:
            measures = _grown(measures, -border[3 * L :])
            body = human(*measures)
            places = replace(Places.on(body, keypoints.names), offsets=places.offsets)
    residual = sided.residuals(places.world(part_poses(body, motion)))
    fitting = robust_weights(residual, sided.confidence, deviation) * deviation[:, None] ** 2
    energy = robust_energy(residual, sided.confidence, np.full_like(deviation, USUAL_DEVIATION)) / together
    energy += smoothness(motion, precision).energy + posture(body, motion).energy
    return KeypointFit(body, motion, places, sided, changed, deviation, fitting, energy)


def posture(body: Body, motion: Motion, usual: float = POSTURE_DEVIATION) -> BandedBlocks:
    """Joints within their limits, and near rest, as far as is usual, where nothing else is known; the root is free."""
    F, D = len(motion), body.dof
    blocks = BandedBlocks.zeros(F, D)
    turns = rotations.log(motion.rotations[:, 1:])
    beyond = turns - np.clip(turns, body.limits[1:, :, 0], body.limits[1:, :, 1])
    J = rotations.right_jacobian_inverse(turns)  # of the rotation vector by the joint's increment
    stop, ease = (beyond != 0) / LIMIT_DEVIATION**2, 1 / (F * usual**2)
    H = np.einsum("fpra,fpr,fprb->fpab", J, stop + ease, J)
    g = np.einsum("fpra,fpr->fpa", J, stop * beyond + ease * turns)
    blocks.gradient[:, 6:] = g.reshape(F, -1)
    energy = float(np.sum(stop * beyond**2) + ease * np.sum(turns**2))
    diagonal = block_diagonal(np.pad(H, ((0, 0), (2, 0), (0, 0), (0, 0))))
    return BandedBlocks(diagonal, blocks.first, blocks.second, blocks.gradient, energy)


def _with_measures(
    system: KeypointSystem,
    body: Body,
    measures: tuple[float, Mapping[str, float]],
    motion: Motion,
    keypoints: Keypoints,
    places: Places,
    weights: Array,
) -> KeypointSystem:
    """The system with the height's logarithm and the measures' departures from the average as further unknowns."""
    columns = _measure_columns(body, measures, motion, keypoints, places)  # (F, L, 3, M)
    poses = part_poses(body, motion)
    R, T = poses
    points = places.world(poses)
    residual = np.nan_to_num(keypoints.residuals(points))
    across = keypoints.across()
    moved = point_jacobian(body, R, T, places.parts, points)
    A = np.einsum("vflka,vfl,vflkb->flab", across, weights, across)
    b = np.einsum("vflka,vfl,vflk->fla", across, weights, residual)
    M, L = columns.shape[-1], len(keypoints.names)
    pulled = A @ columns
    border = np.einsum("flad,flam->fdm", moved, pulled)
    shifted = np.einsum("flba,flbm->lam", R[:, places.parts], pulled)
    corner = np.einsum("flam,flan->mn", columns, pulled)
    gradient = np.einsum("flam,fla->m", columns, b)
    prior, departure = _measure_prior(measures)
    whole = np.zeros((3 * L + M, 3 * L + M))
    whole[: 3 * L, : 3 * L] = system.corner
    whole[: 3 * L, 3 * L :] = shifted.reshape(3 * L, M)
    whole[3 * L :, : 3 * L] = whole[: 3 * L, 3 * L :].T
    whole[3 * L :, 3 * L :] = corner + np.diag(prior)
    return KeypointSystem(
        system.blocks,
        np.concatenate([system.border, border], axis=2),
        whole,
        np.concatenate([system.gradient, gradient + prior * departure]),
    )


def _measure_prior(measures: tuple[float, Mapping[str, float]]) -> tuple[Array, Array]:
    stature, values = measures
    average = default_measures(stature)
    deviation = [STATURE_DEVIATION] + [
        SHIFT_DEVIATION if k in SHIFTS else PROPORTION_DEVIATION * average[k] for k in values
    ]
    departure = [0.0] + [values[k] - average[k] for k in values]
    return 1 / np.square(deviation), np.array(departure)


def _measure_columns(
    body: Body, measures: tuple[float, Mapping[str, float]], motion: Motion, keypoints: Keypoints, places: Places
) -> Array:
    """Movement of the keypoints by the height's logarithm and by every measure, shape (F, L, 3, 1 + M)."""
    stature, values = measures
    base, step = places.world(part_poses(body, motion)), 1e-4

    def placed(changed: tuple[float, Mapping[str, float]]) -> Array:
        other = human(*changed)
        moved = replace(Places.on(other, keypoints.names), offsets=places.offsets)
        return moved.world(part_poses(other, motion))

    columns = [(placed(_grown(measures, np.eye(1 + len(values))[0] * step)) - base) / step]
    columns += [(placed((stature, {**values, key: values[key] + step})) - base) / step for key in values]
    return np.stack(columns, axis=-1)


def _grown(measures: tuple[float, Mapping[str, float]], change: Array) -> tuple[float, dict[str, float]]:
    """Measures of a body that grew in proportion, and beyond."""
    stature, values = measures
    growth = float(np.exp(np.clip(change[0], -0.1, 0.1)))
    before, after = default_measures(stature), default_measures(stature * growth)
    grown = {k: v + after[k] - before[k] + float(d) for (k, v), d in zip(values.items(), change[1:], strict=True)}
    return stature * growth, {k: v if k in SHIFTS else max(v, 0.2 * after[k]) for k, v in grown.items()}
