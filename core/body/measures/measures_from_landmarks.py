"""Body measures from landmarks, fitted together with the poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...errors import LandmarkError
from ...numerics import rotations
from ...numerics.arrays import Array
from ...numerics.least_squares import GAUSS_NEWTON, StoppingRule, minimise
from ...numerics.normal_equations import DenseEquations
from ...numerics.repeatable import on_grid
from .. import Body, default_measures, human, landmark_positions, part_poses, point_jacobian
from ..human import FRACTIONS, SHIFTS
from ..inverse_kinematics import (
    COARSE_TOLERANCE,
    FINE_TOLERANCE,
    LANDMARK_SIGMA,
    PoseSearch,
    pose_costs,
    posture_weights,
    searched_poses,
)
from ..motion import Motion

MEASURE_SIGMA = 0.12
"""Standard deviation of a measure from the average person's, as a share of it."""
SHIFT_SIGMA = 0.03
"""Standard deviation of a shift (`body.human.SHIFTS`) from the average person's, metres."""
MIN_GAIN = 1e-3
"""The fit of measures ends when a step lowers the cost by less than this share."""
MAX_HEIGHT_RATIO = 1.5
"""Ratio of two heights beyond which they are not those of one person: fits from there do not converge."""
LIMIT_TOLERANCE = 1e-6
"""A joint this near to its limit is held while measures change, radians."""
UNOBSERVED_WEIGHT = 1e-12
"""Square metres per square unit of a degree of freedom that no landmark shows."""


def fit_body(names: Sequence[str], targets_world: Array, height: float | None = None, rounds: int = 5) -> Body:
    """Scale the default human to landmarks of some poses.

    Measures and poses are fitted together. A prior keeps measures that the landmarks do not show near those of an
    average person of that height.

    Parameters
    ----------
    names : sequence of str, length L
    targets_world : ndarray, shape (K, L, 3)
        Metres; NaN where a landmark is not known.
    height : float, optional
        See `starting_height`.
    rounds : int
        Largest number of steps of the measures.
    """
    targets = np.asarray(targets_world, float)
    stature = starting_height(names, targets, height)
    problem = _MeasureProblem.of(stature, names, targets)
    rough = problem.minimised(problem.posed(problem.average, None, tolerance=COARSE_TOLERANCE), 1)
    # With the second round the body nearly fits.
    found = problem.minimised(problem.posed(rough.values, rough.poses, search=True), rounds - 1)
    return human(stature, problem.measures(found.values))


def starting_height(names: Sequence[str], targets_world: Array, given: float | None) -> float:
    """Return the height from which measures are fitted, metres: the given one, unless the lengths of the limbs
    contradict it altogether, as with a calibration in another unit; if none is given, that of the limbs.
    """
    if given is None:
        return estimate_height(names, targets_world)
    default_measures(given)  # raises for an impossible height
    try:
        seen = estimate_height(names, targets_world)
    except LandmarkError:
        return given
    return given if 1 / MAX_HEIGHT_RATIO < seen / given < MAX_HEIGHT_RATIO else seen


def limb_height(body: Body) -> float | None:
    """Return the height of the average person with a body's limbs, metres; None if it has none of these."""
    names = list(body.landmarks)
    rest = Motion(np.zeros((1, 3)), np.tile(np.eye(3), (1, len(body), 1, 1)))
    try:
        return estimate_height(names, landmark_positions(body, rest, names))
    except LandmarkError:
        return None


def estimate_height(names: Sequence[str], targets_world: Array) -> float:
    """Height in metres of the average person whose limbs are as long as the distances between the landmarks."""
    column = {name: i for i, name in enumerate(names)}
    heights = []
    for measure, ends in (
        ("upper_arm", ("Shoulder", "Elbow")),
        ("forearm", ("Elbow", "Wrist")),
        ("thigh", ("Hip", "Knee")),
        ("shin", ("Knee", "Ankle")),
    ):
        for side in "LR":
            if all(side + end in column for end in ends):
                a, b = (targets_world[:, column[side + end]] for end in ends)
                lengths = np.linalg.norm(a - b, axis=1)
                if (known := lengths[np.isfinite(lengths)]).size:
                    heights.append(np.median(known) / FRACTIONS[measure])
    if not heights:
        raise LandmarkError("no limb has both its landmarks, so the body cannot be scaled", todo="give a height")
    return float(np.median(heights))


@dataclass(frozen=True, eq=False)
class _MeasuredPoses:
    """Measures (M,), the body with these measures, without surfaces, and its poses on the landmarks."""

    values: Array
    body: Body
    poses: Motion


@dataclass(frozen=True, eq=False)
class _MeasureProblem:
    """The fit of measures to landmarks, in which poses are eliminated: they are fitted anew for any measures.

    If poses were held, measures would hardly change: a trunk that is too long for its landmarks is bent forward or
    backward, and in that pose its length fits. The method is variable projection (G. H. Golub, V. Pereyra, The
    differentiation of pseudo-inverses and nonlinear least squares problems whose variables separate, 1973). Every step
    is tested with poses that are fitted anew, because steps from poses at a limit, or not yet converged, may lead far
    away.

    Attributes
    ----------
    stature : float
    labels : list of str, length L
        Landmarks that the body has.
    targets : ndarray, shape (K, L, 3)
    average, sigma : ndarray, shape (M,)
        Measures of the average person of that height, and their standard deviations.
    """

    stature: float
    labels: list[str]
    targets: Array
    average: Array
    sigma: Array

    @classmethod
    def of(cls, stature: float, names: Sequence[str], targets: Array) -> _MeasureProblem:
        """Return the problem for landmarks (K, L, 3), without those that a body does not have."""
        average = default_measures(stature)
        sigma = [SHIFT_SIGMA if key in SHIFTS else MEASURE_SIGMA * value for key, value in average.items()]
        known = human(stature, solid=False).landmarks
        used = [i for i, name in enumerate(names) if name in known]
        return cls(
            stature, [names[i] for i in used], targets[:, used], np.array(list(average.values())), np.array(sigma)
        )

    def measures(self, values: Array) -> dict[str, float]:
        """Measures (M,) by name."""
        return dict(zip(default_measures(self.stature), values.tolist(), strict=True))

    def posed(
        self, values: Array, start: Motion | None, *, search: bool = False, tolerance: float = FINE_TOLERANCE
    ) -> _MeasuredPoses:
        """Return the body with some measures, posed on the landmarks from given poses; with `search` from others as
        well.
        """
        body = human(self.stature, self.measures(values), solid=False)
        searched = PoseSearch.RANDOM if search else PoseSearch.NONE
        poses = searched_poses(body, self.labels, self.targets, start, searched, tolerance=tolerance)
        return _MeasuredPoses(values, body, poses)

    def minimised(self, start: _MeasuredPoses, steps: int) -> _MeasuredPoses:
        """Return the measures after at most `steps` steps, each of which lowers the cost."""
        stopping: StoppingRule[_MeasuredPoses] = StoppingRule(steps, MIN_GAIN)
        return minimise(start, self._linearised, self._moved, damping=GAUSS_NEWTON, stopping=stopping).state

    def _moved(self, state: _MeasuredPoses, step: Array) -> _MeasuredPoses:
        least = [-np.inf if key in SHIFTS else 0.2 * value for key, value in default_measures(self.stature).items()]
        return self.posed(np.maximum(on_grid(state.values + step), least), state.poses)

    def _linearised(self, state: _MeasuredPoses) -> DenseEquations:
        """Return the normal equations of the measures, with the poses eliminated."""
        step = 1e-4
        base = landmark_positions(state.body, state.poses, self.labels)
        columns = []
        for row in step * np.eye(len(state.values)):
            other = human(self.stature, self.measures(state.values + row), solid=False)
            columns.append((landmark_positions(other, state.poses, self.labels) - base) / step)
        error = self.targets - base
        seen = np.isfinite(error).all(axis=-1)[..., None]
        K = len(error)
        error = np.where(seen, error, 0.0).reshape(K, -1)
        J = (np.stack(columns, axis=-1) * seen[..., None]).reshape(K, -1, len(columns))
        posing = (_free_jacobian(state.body, state.poses, self.labels) * seen[..., None]).reshape(K, -1, state.body.dof)
        across = np.swapaxes(posing, 1, 2)
        follow = np.linalg.solve(across @ posing + np.diag(posture_weights(state.body) + UNOBSERVED_WEIGHT), across @ J)
        departure = (state.values - self.average) / self.sigma
        cost = pose_costs(state.body, self.labels, self.targets, state.poses).sum() / LANDMARK_SIGMA**2
        return DenseEquations(
            np.einsum("kim,kin->mn", J, J - posing @ follow) / LANDMARK_SIGMA**2 + np.diag(self.sigma**-2),
            departure / self.sigma - np.einsum("kim,ki->m", J, error) / LANDMARK_SIGMA**2,
            float(cost + departure @ departure),
        )


def _free_jacobian(body: Body, poses: Motion, names: list[str]) -> Array:
    """Derivatives of landmarks by the degrees of freedom, zero for those at their limits, shape (K, L, 3, D)."""
    parts, local = body.landmark_arrays(names)
    R, T = part_poses(body, poses)
    J = point_jacobian(body, R, T, parts, np.einsum("klab,lb->kla", R[:, parts], local) + T[:, parts])
    turns, (low, high) = rotations.log(poses.rotations[:, 1:]), np.moveaxis(body.limits[1:], 2, 0)
    J[..., 6:] *= ((turns > low + LIMIT_TOLERANCE) & (turns < high - LIMIT_TOLERANCE)).reshape(len(turns), 1, 1, -1)
    return J
