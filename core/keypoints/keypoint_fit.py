"""A motion fitted to keypoints alone: poses of all frames, the keypoints' offsets, and the body's measures at once."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..body import Body, part_poses
from ..body.joint_limits import posture_prior
from ..body.motion import Motion
from ..body.smoothness import limited, smoothness
from ..numerics.banded_blocks import BandedBlocks
from ..numerics.least_squares import GAUSS_NEWTON, StoppingRule, minimise
from ..numerics.normal_equations import BandedEquations, BorderedEquations
from .body_measures import BodyMeasures, with_measures
from .keypoint_factor import (
    USUAL_DEVIATION,
    Keypoints,
    Places,
    deviations,
    keypoint_system,
    offset_energy,
    robust_energy,
    robust_weights,
)
from .left_right import correct_sides

Array = NDArray[np.float64]

ROUNDS = ((8.0, 1), (4.0, 2), (2.0, 2), (1.0, 2), (1.0, 3))
"""Tolerance of large errors, and steps with it: from a start that may be far off to the solution. Deviations, and which
side is which, are found anew for every round."""
SIDES_TOLERANCE = 2.0
"""Sides are corrected when the tolerance has come down to this: before, the start may be farther off than the limbs are
apart."""


@dataclass(frozen=True, eq=False)
class KeypointFit:
    """A motion fitted to keypoints. Everything in it belongs to that motion.

    Attributes
    ----------
    body : Body
    motion : Motion
        F poses.
    places : Places
        Of the keypoints on the body, offsets included.
    keypoints : Keypoints
        With their sides corrected.
    changed : ndarray of bool, shape (V, F, L)
        Where they were changed.
    deviation : ndarray, shape (V, L)
        See `core.keypoints.keypoint_factor.deviations`.
    weights : ndarray, shape (V, F, L)
        Robust weights, 1 for a sure keypoint that fits.
    energy : float
        What keypoints, joint limits and accelerations leave, with one usual deviation of all keypoints: so the fits of
        several starts can be compared.
    """

    body: Body
    motion: Motion
    places: Places
    keypoints: Keypoints
    changed: NDArray[np.bool_]
    deviation: Array
    weights: Array
    energy: float


@dataclass(frozen=True, eq=False)
class _State:
    """The unknowns of a fit. The body is that of the measures, where these are unknown."""

    body: Body
    motion: Motion
    places: Places
    names: tuple[str, ...]
    measures: BodyMeasures | None

    def moved(self, step: tuple[Array, Array]) -> _State:
        poses, others = step
        motion, count = self.motion.moved(limited(poses)), self.places.offsets.size
        places = replace(self.places, offsets=self.places.offsets + others[:count].reshape(-1, 3))
        if self.measures is None:
            return replace(self, motion=motion, places=places)
        measures = self.measures.changed(others[count:])
        body = measures.body()
        return _State(body, motion, places.on_body(body, self.names), self.names, measures)


@dataclass(frozen=True, eq=False)
class _Round:
    """Least squares of keypoints, joint limits and accelerations, with deviations and sides that are known."""

    keypoints: Keypoints
    fixed: NDArray[np.bool_]
    precision: Array
    correlated: float
    deviation: Array
    tolerance: float

    def linearised(self, state: _State) -> BorderedEquations:
        keypoints, places = self.keypoints, state.places
        poses = part_poses(state.body, state.motion)
        residual = keypoints.residuals(places.world(poses))
        weights = robust_weights(residual, keypoints.confidence, self.deviation, self.tolerance) / self.correlated
        system = keypoint_system(state.body, poses, keypoints, places, weights)
        prior = self.motion_prior(state)
        if state.measures is not None:
            system = with_measures(
                system, state.measures, state.motion, keypoints=keypoints, places=places, weights=weights
            )
        blocks = replace(system.blocks + prior, energy=self.energy(state, residual, prior))
        return BorderedEquations(BandedEquations(blocks, self.fixed), system.border, system.corner, system.gradient)

    def motion_prior(self, state: _State) -> BandedBlocks:
        """What is known of the motion without keypoints."""
        return smoothness(state.motion, self.precision) + posture_prior(state.body, state.motion)

    def energy(self, state: _State, residual: Array, motion_prior: BandedBlocks) -> float:
        """The robust cost of a state whose keypoints have these residuals."""
        keypoints = robust_energy(residual, self.keypoints.confidence, self.deviation, self.tolerance)
        energy = keypoints / self.correlated + offset_energy(self.keypoints.names, state.places) + motion_prior.energy
        if state.measures is not None:
            prior, departure = state.measures.prior()
            energy += float(np.sum(prior * departure**2))
        return energy


def fit_motion(
    body: Body,
    keypoints: Keypoints,
    start: Motion,
    *,
    fixed: NDArray[np.bool_],
    precision: Array,
    correlated: float = 1.0,
    measures: BodyMeasures | None = None,
) -> KeypointFit:
    """Fit the motion of all frames, and the keypoints' offsets, by robust least squares from coarse to fine.

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
        Of accelerations, see `core.body.smoothness.smoothness`.
    correlated : float
        How many neighbouring frames err together and count as one.
    measures : BodyMeasures, optional
        Those of the body, which are then fitted as well.
    """
    state = _State(body, start, Places.on(body, keypoints.names), keypoints.names, measures)
    for tolerance, steps in ROUNDS:
        points = state.places.world(part_poses(state.body, state.motion))
        expected = points if tolerance <= SIDES_TOLERANCE else np.full_like(points, np.nan)
        sided, _ = correct_sides(keypoints, expected)
        deviation = deviations(sided.residuals(points), sided.confidence)
        problem = _Round(sided, fixed, precision, correlated, deviation, tolerance)
        stopping: StoppingRule[_State] = StoppingRule(iterations=steps)
        state = minimise(state, problem.linearised, _State.moved, damping=GAUSS_NEWTON, stopping=stopping).state
    points = state.places.world(part_poses(state.body, state.motion))
    sided, changed = correct_sides(keypoints, points)
    residual = sided.residuals(points)
    deviation = deviations(residual, sided.confidence)
    weights = robust_weights(residual, sided.confidence, deviation) * deviation[:, None] ** 2
    usual = np.full_like(deviation, USUAL_DEVIATION)
    last = _Round(sided, fixed, precision, correlated, usual, 1.0)
    energy = last.energy(state, residual, last.motion_prior(state))
    return KeypointFit(state.body, state.motion, state.places, sided, changed, deviation, weights, energy)
