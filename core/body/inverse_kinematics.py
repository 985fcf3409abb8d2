"""Key poses and body measures from landmarks: inverse kinematics with joint limits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ..errors import LandmarkError
from ..numerics import rotations
from ..numerics.arrays import Array
from ..numerics.least_squares import GAUSS_NEWTON, StoppingRule, minimise
from ..numerics.least_squares_batch import NormalSystems, minimise_each
from ..numerics.normal_equations import DenseEquations
from ..numerics.repeatable import on_grid
from . import Body, default_measures, human, landmark_positions, part_poses, point_jacobian
from .human import FRACTIONS, SHIFTS
from .motion import Motion, stacked

LANDMARK_SIGMA = 0.01
"""Expected error of a landmark, metres."""
SETTLED = 1e-9
"""Relative change at which a pose has converged. Smaller changes depend on rounding, which differs between
processors."""
EVALUATIONS = 200
"""Upper bound of the evaluations for a pose: landmarks that no pose fits would take thousands."""
ACCEPTED_MISFIT = 0.03
"""If a landmark of the body ends up farther than this from its target, metres, further starts with other poses of the
limbs are tried; if farther than its expected error, only starts with the arms turned."""
DRAWS = 12
"""Number of random starts. For a man who gets up from the floor, six in ten lead to the right pose."""
CLEARLY = 0.5
"""A pose from a random start replaces the first one only if its misfit is below this share of the first one's: on a
body of other proportions, all poses have a misfit."""
LIMIT_SIGMA = 0.02
"""Standard deviation of a joint beyond its limits while the fit is searching, radians."""
MEASURE_SIGMA = 0.12
"""Standard deviation of a measure from the average person's, as a share of it."""
SHIFT_SIGMA = 0.03
"""Standard deviation of a shift (`body.human.SHIFTS`) from the average person's, metres."""
LITTLE_GAIN = 1e-3
"""The fit of measures ends when a step lowers the cost by less than this share."""
AT_LIMIT = 1e-6
"""A joint this near to its limit is held while measures change, radians."""
TINY = 1e-12
"""Square metres per square unit of a degree of freedom that no landmark shows."""
ROUGH = 1e-4
"""The same of the first poses between which measures are fitted: the next round fits them again."""


def fit_poses(body: Body, names: Sequence[str], targets_world: Array, start: Motion | None = None) -> Motion:
    """Pose a body on landmarks.

    Parameters
    ----------
    body : Body
    names : sequence of str, length L
        Landmark names; those that the body does not have are left out.
    targets_world : ndarray, shape (K, L, 3)
        Metres; NaN where a landmark is not known.
    start : Motion, optional
        K poses to start from; by default the rest pose, placed and turned onto the landmarks.

    Returns
    -------
    Motion
        K poses within the joint limits.

    Raises
    ------
    LandmarkError
        If a pose has fewer than three landmarks.
    """
    return _fit_poses(body, names, targets_world, start, search=True, draw=start is None, tolerance=SETTLED)


def _fit_poses(
    body: Body,
    names: Sequence[str],
    targets_world: Array,
    start: Motion | None,
    *,
    search: bool,
    draw: bool = False,
    tolerance: float = 1e-6,
) -> Motion:
    """Fit poses. If one does not fit, `search` also tries starts with its arms turned, and `draw` random starts."""
    used = [i for i, name in enumerate(names) if name in body.landmarks]
    known, targets = [names[i] for i in used], np.asarray(targets_world, float)[:, used]
    seen = np.isfinite(targets).all(axis=2)
    for k in np.flatnonzero(seen.sum(axis=1) < 3):
        raise LandmarkError("fewer than three landmarks", where=f"pose {k}", todo="choose another key frame")
    if start is None and len(targets):
        rows = zip(targets, seen, strict=True)
        start = stacked([_placed(body, [n for n, s in zip(known, on, strict=True) if s], p[on]) for p, on in rows])
    if start is None:
        return Motion(np.empty((0, 3)), np.empty((0, len(body), 3, 3)))
    poses = _descended(body, known, targets, start, tolerance)
    for side in "LR" if search else "":
        tried = np.flatnonzero(_misfits(body, known, targets, poses) > LANDMARK_SIGMA)
        if not len(tried):
            continue
        turned = _elbow_turned(body, poses[tried], side)
        other = _descended(body, known, targets[tried], turned, tolerance)
        better = _costs(body, known, targets[tried], other) < _costs(body, known, targets[tried], poses[tried])
        _replace(poses, tried[better], other[better])
    if draw and _limited(body).any():
        misfit = _misfits(body, known, targets, poses)
        for k in np.flatnonzero(misfit > ACCEPTED_MISFIT):
            aims = np.repeat(targets[k : k + 1], DRAWS, axis=0)
            found = _descended(body, known, aims, _limbs_drawn(body, start[k : k + 1]), ROUGH)
            best = int(np.argmin(_misfits(body, known, aims, found)))
            other = _descended(body, known, targets[k : k + 1], found[best : best + 1], tolerance)
            if _misfits(body, known, targets[k : k + 1], other)[0] < CLEARLY * misfit[k]:
                _replace(poses, np.array([k]), other)
    return poses


def _replace(poses: Motion, which: NDArray[np.intp], others: Motion) -> None:
    """Replace some of the poses by others, in place."""
    poses.translations[which] = others.translations
    poses.rotations[which] = others.rotations


def _limited(body: Body) -> NDArray[np.bool_]:
    """Return which parts have joints with limits, shape (P,)."""
    limited = np.ptp(body.limits, axis=2).max(axis=1) < 2 * np.pi - 1e-6
    limited[0] = False
    return np.asarray(limited)


def _limbs_drawn(body: Body, pose: Motion) -> Motion:
    """`DRAWS` copies of one pose whose limited joints are drawn at random within their limits.

    The draws are the same for every pose. They are needed because limits separate poses: a fit that starts from rest
    may end with a leg on the wrong side of a limit, and the trunk turned to make up for it.
    """
    low, high = body.limits[:, :, 0], body.limits[:, :, 1]
    drawn = np.random.default_rng(0).uniform(low, high, size=(DRAWS, len(body), 3))
    Q = np.where(_limited(body)[:, None, None], rotations.exp(drawn), pose.rotations)
    return Motion(np.repeat(pose.translations, DRAWS, axis=0), Q)


def _misfits(body: Body, names: list[str], targets: Array, poses: Motion) -> Array:
    """Return the largest distance of a landmark from its target in each pose, metres, shape (K,)."""
    distance = np.linalg.norm(landmark_positions(body, poses, names) - targets, axis=2)
    return np.asarray(np.nanmax(distance, axis=1))


def _costs(body: Body, names: list[str], targets: Array, poses: Motion) -> Array:
    """Return the objective of poses that are within the joint limits, square metres, shape (K,)."""
    turns = rotations.log(poses.rotations[:, 1:]).reshape(len(poses), -1)
    error = landmark_positions(body, poses, names) - targets
    return np.asarray(np.nansum(error**2, axis=(1, 2)) + turns**2 @ _posture(body)[6:])


def _posture(body: Body) -> Array:
    """Weight of the square of each degree of freedom, (D,): joints stay near rest where landmarks do not show them."""
    posture = np.zeros(body.dof)
    posture[6:] = np.repeat((LANDMARK_SIGMA / body.departures[1:]) ** 2, 3)
    return posture


def _elbow_turned(body: Body, poses: Motion, side: str) -> Motion:
    """Return the poses with an elbow bent and turned to the other side, for fits that end with a wrongly twisted
    arm.
    """
    Q = poses.rotations.copy()
    if f"forearm.{side}" in body.names:
        upper, lower = body.index(f"upper_arm.{side}"), body.index(f"forearm.{side}")
        Q[:, upper] = Q[:, upper] @ rotations.exp(np.array([0.0, np.pi, 0.0]))
        Q[:, lower] = rotations.exp(np.array([np.pi / 2, 0.0, 0.0]))
    return Motion(poses.translations, Q)


def _placed(body: Body, names: list[str], points: Array) -> Motion:
    """Return the rest pose moved rigidly onto the landmarks (Kabsch), with those of the trunk weighted most."""
    rest = Motion(body.offsets[:1], np.tile(np.eye(3), (1, len(body), 1, 1)))
    model = landmark_positions(body, rest, names)[0]
    trunk = [n.endswith(("Hip", "Shoulder", "Neck")) for n in names]
    weight = np.where(trunk, 1.0, 0.02)
    centre = [np.average(x, axis=0, weights=weight) for x in (model, points)]
    turn, _ = Rotation.align_vectors(points - centre[1], model - centre[0], weights=weight)
    R0 = body.R_parent_rest[0]
    rest.rotations[0, 0] = R0.T @ turn.as_matrix() @ R0
    return Motion(turn.apply(rest.translations - centre[0]) + centre[1], rest.rotations)


def _descended(body: Body, names: list[str], targets: Array, start: Motion, tolerance: float) -> Motion:
    """K poses fitted to landmarks (K, L, 3), NaN where they are not known, each from its start."""
    parts, local = body.landmark_arrays(names)
    low, high = np.full(body.dof, -np.inf), np.full(body.dof, np.inf)
    low[6:], high[6:] = body.limits[1:, :, 0].ravel(), body.limits[1:, :, 1].ravel()
    posture, stop = _posture(body), (LANDMARK_SIGMA / LIMIT_SIGMA) ** 2
    moves = body.ancestry[parts].astype(float)  # which joints move each landmark, (L, P)
    known = np.isfinite(targets).all(axis=2)
    aims = np.where(known[..., None], targets, 0.0)
    diagonal = np.arange(body.dof)

    def linearise(x: Array, which: NDArray[np.intp]) -> NormalSystems:
        turns = x[:, 3:].reshape(len(x), -1, 3)
        R, T = part_poses(body, Motion(x[:, :3], rotations.exp(turns)))
        placed = np.einsum("klab,lb->kla", R[:, parts], local) + T[:, parts]
        error = (placed - aims[which]) * known[which][..., None]
        beyond = x - np.clip(x, low, high)
        axes = R @ rotations.right_jacobian(turns)  # of every rotation vector's components, in the world
        arms = (placed[:, :, None] - T[:, None]) * (moves * known[which][..., None])[..., None]
        J = np.zeros((len(x), len(parts), 3, body.dof))
        J[..., :3] = np.eye(3) * known[which][..., None, None]
        lever = -rotations.skew(arms) @ axes[:, None]  # (K, L, P, 3, 3)
        J[..., 3:] = lever.swapaxes(2, 3).reshape(*J.shape[:3], -1)
        rows = J.reshape(len(x), -1, body.dof)
        across = np.swapaxes(rows, 1, 2)
        A = across @ rows
        A[:, diagonal, diagonal] += posture + stop * (beyond != 0)
        g = (across @ error.reshape(len(x), -1, 1))[..., 0] + posture * x + stop * beyond
        cost = (error**2).sum(axis=(1, 2)) + (x**2) @ posture + stop * (beyond**2).sum(axis=1)
        return cost, A, g

    x0 = np.concatenate([start.translations, rotations.log(start.rotations).reshape(len(start), -1)], axis=1)
    x = minimise_each(x0, linearise, tolerance=tolerance, evaluations=EVALUATIONS)
    x = np.clip(on_grid(x), low, high)
    return Motion(x[:, :3], rotations.exp(x[:, 3:].reshape(len(x), -1, 3)))


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
        Metres; by default estimated from the lengths of the limbs.
    rounds : int
        Largest number of steps of the measures.
    """
    targets = np.asarray(targets_world, float)
    stature = estimate_height(names, targets) if height is None else height
    problem = _MeasureProblem.of(stature, names, targets)
    rough = problem.minimised(problem.posed(problem.average, None, tolerance=ROUGH), 1)
    # With the second round the body nearly fits.
    found = problem.minimised(problem.posed(rough.values, rough.poses, search=True), rounds - 1)
    return human(stature, problem.measures(found.values))


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
        self, values: Array, start: Motion | None, *, search: bool = False, tolerance: float = SETTLED
    ) -> _MeasuredPoses:
        """Return the body with some measures, posed on the landmarks from given poses; with `search` from others as
        well.
        """
        body = human(self.stature, self.measures(values), solid=False)
        poses = _fit_poses(body, self.labels, self.targets, start, search=search, draw=search, tolerance=tolerance)
        return _MeasuredPoses(values, body, poses)

    def minimised(self, start: _MeasuredPoses, steps: int) -> _MeasuredPoses:
        """Return the measures after at most `steps` steps, each of which lowers the cost."""
        stopping: StoppingRule[_MeasuredPoses] = StoppingRule(steps, LITTLE_GAIN)
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
        follow = np.linalg.solve(across @ posing + np.diag(_posture(state.body) + TINY), across @ J)
        departure = (state.values - self.average) / self.sigma
        cost = _costs(state.body, self.labels, self.targets, state.poses).sum() / LANDMARK_SIGMA**2
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
    J[..., 6:] *= ((turns > low + AT_LIMIT) & (turns < high - AT_LIMIT)).reshape(len(turns), 1, 1, -1)
    return J
