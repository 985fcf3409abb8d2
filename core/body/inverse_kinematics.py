"""Key poses from landmarks: inverse kinematics with joint limits."""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ..errors import LandmarkError
from ..numerics import rotations
from ..numerics.arrays import Array
from ..numerics.least_squares_batch import NormalSystems, minimise_each
from ..numerics.repeatable import on_grid
from ..numerics.sequences import first_repeated
from . import Body, landmark_positions, part_poses
from .motion import Motion, stacked

LANDMARK_SIGMA = 0.01
"""Expected error of a landmark, metres."""
FINE_TOLERANCE = 1e-9
"""Relative change at which a pose has converged. Smaller changes depend on rounding, which differs between
processors."""
COARSE_TOLERANCE = 1e-4
"""Relative change at which a pose has converged if it is fitted again afterwards: between fits of measures, and from
random starts."""
MAX_EVALUATIONS = 200
"""Upper bound of the evaluations for a pose: landmarks that no pose fits would take thousands."""
ACCEPTED_MISFIT = 0.03
"""If a landmark of the body ends up farther than this from its target, metres, further starts with other poses of the
limbs are tried; if farther than its expected error, only starts with the arms turned."""
RANDOM_STARTS = 12
"""Number of random starts. For a man who gets up from the floor, six in ten lead to the right pose."""
MAX_MISFIT_RATIO = 0.5
"""A pose from a random start replaces the first one only if its misfit is below this share of the first one's: on a
body of other proportions, all poses have a misfit."""
COLLINEAR_SPREAD = 1e-9
"""Squared ratio of the landmarks' spread across a line to that along it, below which they do not determine the rotation
about the line."""
SEARCH_LIMIT_SIGMA = 0.02
"""Standard deviation of a joint beyond its limits while the fit is searching, radians."""


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
        If a pose has fewer than three landmarks, there is not a position for each name, or a name comes twice.
    """
    shape = np.shape(targets_world)
    if len(shape) != 3 or shape[1:] != (len(names), 3):
        raise LandmarkError(f"positions of shape {shape}", todo=f"give those of each pose, (poses, {len(names)}, 3)")
    if (repeated := first_repeated(names)) is not None:
        raise LandmarkError(f"'{repeated}' comes twice among the names", todo="give each landmark once")
    search = PoseSearch.RANDOM if start is None else PoseSearch.ARMS
    return searched_poses(body, names, targets_world, start, search, tolerance=FINE_TOLERANCE)


class PoseSearch(Enum):
    """What is tried where a pose does not fit its landmarks."""

    NONE = "none"
    """Nothing."""
    ARMS = "arms"
    """Starts with the arms turned."""
    RANDOM = "random"
    """The same, then random starts."""


def searched_poses(
    body: Body,
    names: Sequence[str],
    targets_world: Array,
    start: Motion | None,
    search: PoseSearch,
    *,
    tolerance: float,
) -> Motion:
    """Pose a body on landmarks as `fit_poses`, with a choice of what is tried where a pose does not fit.

    Parameters
    ----------
    search : PoseSearch
    tolerance : float
        Relative change at which a pose has converged.
    """
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
    if search is not PoseSearch.NONE:
        for side in "LR":
            _turn_arms(body, known, targets, poses, side, tolerance=tolerance)
    if search is PoseSearch.RANDOM and _limited(body).any():
        _draw_limbs(body, known, targets, poses, start, tolerance=tolerance)
    return poses


def _turn_arms(body: Body, known: list[str], targets: Array, poses: Motion, side: str, *, tolerance: float) -> None:
    """Replace those of K poses that do not fit by what a start with an arm turned leads to, if it costs less."""
    tried = np.flatnonzero(_misfits(body, known, targets, poses) > LANDMARK_SIGMA)
    if not len(tried):
        return
    turned = _elbow_turned(body, poses[tried], side)
    rough = _descended(body, known, targets[tried], turned, COARSE_TOLERANCE)
    better = pose_costs(body, known, targets[tried], rough) < pose_costs(body, known, targets[tried], poses[tried])
    if better.any():
        tried = tried[better]
        _replace(poses, tried, _descended(body, known, targets[tried], rough[better], tolerance))


def _draw_limbs(
    body: Body, known: list[str], targets: Array, poses: Motion, start: Motion, *, tolerance: float
) -> None:
    """Replace those of K poses that do not fit by what the best of several random starts leads to, if it fits clearly
    better.
    """
    misfit = _misfits(body, known, targets, poses)
    for k in np.flatnonzero(misfit > ACCEPTED_MISFIT):
        aims = np.repeat(targets[k : k + 1], RANDOM_STARTS, axis=0)
        found = _descended(body, known, aims, _limbs_drawn(body, start[k : k + 1]), COARSE_TOLERANCE)
        best = int(np.argmin(_misfits(body, known, aims, found)))
        other = _descended(body, known, targets[k : k + 1], found[best : best + 1], tolerance)
        if _misfits(body, known, targets[k : k + 1], other)[0] < MAX_MISFIT_RATIO * misfit[k]:
            _replace(poses, np.array([k]), other)


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
    """`RANDOM_STARTS` copies of one pose whose limited joints are drawn at random within their limits.

    The draws are the same for every pose. They are needed because limits separate poses: a fit that starts from rest
    may end with a leg on the wrong side of a limit, and the trunk turned to make up for it.
    """
    low, high = body.limits[:, :, 0], body.limits[:, :, 1]
    drawn = np.random.default_rng(0).uniform(low, high, size=(RANDOM_STARTS, len(body), 3))
    Q = np.where(_limited(body)[:, None, None], rotations.exp(drawn), pose.rotations)
    return Motion(np.repeat(pose.translations, RANDOM_STARTS, axis=0), Q)


def _misfits(body: Body, names: list[str], targets: Array, poses: Motion) -> Array:
    """Return the largest distance of a landmark from its target in each pose, metres, shape (K,)."""
    distance = np.linalg.norm(landmark_positions(body, poses, names) - targets, axis=2)
    return np.asarray(np.nanmax(distance, axis=1))


def pose_costs(body: Body, names: list[str], targets: Array, poses: Motion) -> Array:
    """Return the objective of poses that are within the joint limits, square metres, shape (K,)."""
    turns = rotations.log(poses.rotations[:, 1:]).reshape(len(poses), -1)
    error = landmark_positions(body, poses, names) - targets
    return np.asarray(np.nansum(error**2, axis=(1, 2)) + turns**2 @ posture_weights(body)[6:])


def posture_weights(body: Body) -> Array:
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
    turn = _turn_onto(model - centre[0], points - centre[1], weight)
    R0 = body.R_parent_rest[0]
    rest.rotations[0, 0] = R0.T @ turn.as_matrix() @ R0
    return Motion(turn.apply(rest.translations - centre[0]) + centre[1], rest.rotations)


def _turn_onto(model: Array, points: Array, weight: Array) -> Rotation:
    """Return the rotation that takes centred points (L, 3) best onto others of weights (L,). About a line on which all
    of them lie, such as that of the straight arm of the rest pose, it is the shortest.
    """
    U, spread, Vt = np.linalg.svd(points.T @ (weight[:, None] * model))
    if spread[0] > 0 and spread[1] < COLLINEAR_SPREAD * spread[0]:
        return Rotation.align_vectors(U[:, 0], Vt[0])[0]
    return Rotation.align_vectors(points, model, weights=weight)[0]


def _descended(body: Body, names: list[str], targets: Array, start: Motion, tolerance: float) -> Motion:
    """K poses fitted to landmarks (K, L, 3), NaN where they are not known, each from its start."""
    parts, local = body.landmark_arrays(names)
    low, high = np.full(body.dof, -np.inf), np.full(body.dof, np.inf)
    low[6:], high[6:] = body.limits[1:, :, 0].ravel(), body.limits[1:, :, 1].ravel()
    posture, stop = posture_weights(body), (LANDMARK_SIGMA / SEARCH_LIMIT_SIGMA) ** 2
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
    x = minimise_each(x0, linearise, tolerance=tolerance, evaluations=MAX_EVALUATIONS)
    x = np.clip(on_grid(x), low, high)
    return Motion(x[:, :3], rotations.exp(x[:, 3:].reshape(len(x), -1, 3)))
