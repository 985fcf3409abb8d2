"""Residuals of a bundle adjustment of cameras, clocks and a wand of known length, and their sparse Jacobian.

The wand is parametrised by its middle and direction on each frame, so its length is exact. A camera that sees the wand
between frames sees an interpolated one, which couples neighbouring frames.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy import sparse

from ...numerics.arrays import Array, Bools, Ints
from .ball_observations import BallObservations
from .bundle_scene import BundleEvidence, Scene, first_camera, first_lframe, unknowns
from .camera_rig import CAMERA_DOF, CENTRE, DRIFT, FOCAL, K1, K2, OFFSET, SHIFT, TURN, Rig
from .frame_stencil import Stencil
from .wand_motion import WAND_DOF, Wand, tangents

Rows = tuple[Array, sparse.csr_array]

BEND_SIGMA = 0.02
"""Standard deviation of the fourth differences of a waved wand's ends, metres per frame^4: that of waving at about 2
Hz.
"""
_FOURTH_DIFFERENCE = np.array([1.0, -4, 6, -4, 1])
_MIN_DEPTH = 1e-3
"""Least depth in front of a camera, metres; points behind it are moved there."""


@dataclass(frozen=True, eq=False)
class BundleResiduals:
    """Residuals in standard deviations and their Jacobian.

    Attributes
    ----------
    points : ndarray, shape (n, 2)
        Residuals of the balls: the wand's, then the L-frame's.
    others : ndarray, shape (m,)
        Residuals of the priors.
    jacobian : sparse array, shape (2 n + m, unknowns)
    """

    points: Array
    others: Array
    jacobian: sparse.csr_array


def linearise(scene: Scene, evidence: BundleEvidence) -> BundleResiduals:
    """Evaluate residuals and their Jacobian by all unknowns of `Scene.moved`."""
    blocks = [_wand_rows(scene, evidence.wand)]
    if evidence.lframe is not None:
        blocks.append(_lframe_rows(scene, evidence.lframe))
    known = _known_rows(scene, evidence)
    if evidence.smooth:
        known.append((_bends(scene.wand), _bend_jacobian(scene)))
    others = np.concatenate([np.zeros(0), *(r for r, _ in known)])
    jacobian = sparse.vstack([J for _, J in blocks + known], format="csr")
    return BundleResiduals(np.concatenate([r for r, _ in blocks]), others, jacobian)


def residuals(scene: Scene, evidence: BundleEvidence) -> tuple[Array, Array]:
    """Evaluate the residuals alone, which is much cheaper: `points` and `others` of `BundleResiduals`."""
    uv, reached = predicted(scene, evidence.wand)
    points = [_weighted(uv, evidence.wand, reached)]
    if evidence.lframe is not None and scene.lframe_world is not None:
        balls = scene.lframe_world[evidence.lframe.ball]
        points.append(_weighted(_projected(scene.rig, evidence.lframe.camera, balls)[0], evidence.lframe))
    others = [r for r, _ in _known_rows(scene, evidence)]
    if evidence.smooth:
        others.append(_bends(scene.wand))
    return np.concatenate(points), np.concatenate([np.zeros(0), *others])


def _known_rows(scene: Scene, evidence: BundleEvidence) -> list[Rows]:
    """Return residuals and Jacobians of the L-frame's measures and of given focal lengths."""
    return [rows for rows in (_measure_rows(scene, evidence), _focal_rows(scene, evidence)) if rows is not None]


def _weighted(uv: Array, seen: BallObservations, reached: Bools | bool = True) -> Array:
    """Return predicted minus observed balls, in standard deviations; zero if no frame of the wand is near."""
    return seen.whitened((uv - seen.uv) * np.broadcast_to(reached, len(uv))[:, None])


def _projected(rig: Rig, camera: Ints, points_world: Array) -> tuple[Array, Array, Array]:
    """Return pixels (n, 2), and their Jacobians by the world point (n, 2, 3) and by the camera's step (n, 2, 13)."""
    n = len(points_world)
    uv, by_point, by_camera = np.zeros((n, 2)), np.zeros((n, 2, 3)), np.zeros((n, 2, CAMERA_DOF))
    zero = np.zeros(3)
    for c in range(len(rig)):
        rows = np.flatnonzero(camera == c)
        if not len(rows):
            continue
        x = points_world[rows] @ rig.R_cam_world[c].T + rig.t_cam_world[c]
        x[:, 2] = np.maximum(x[:, 2], _MIN_DEPTH)
        at, J = cv2.projectPoints(x[:, None], zero, zero, rig.matrix(c), rig.distortions[c])
        J = J.reshape(len(rows), 2, -1)
        uv[rows], by_point[rows] = at[:, 0], J[:, :, 3:6] @ rig.R_cam_world[c]
        by_camera[rows, :, TURN], by_camera[rows, :, SHIFT] = J[:, :, :3], J[:, :, 3:6]
        by_camera[rows, :, FOCAL] = J[:, :, 6:8] @ rig.focal[c]
        by_camera[rows, :, CENTRE] = J[:, :, 8:10]
        by_camera[rows, :, K1], by_camera[rows, :, K2] = J[:, :, 10], J[:, :, 11]
    return uv, by_point, by_camera


def _wand_at(scene: Scene, seen: BallObservations) -> tuple[Stencil, Array, Array, Array]:
    """Return the ends that were seen: stencil, positions (n, 3), velocities (n, 3) per frame, and summed directions."""
    rig, wand = scene.rig, scene.wand
    stencil = Stencil.create(wand.frames, rig.times(seen.camera, seen.frame))
    half = wand.length / 2 * np.where(seen.ball == 0, 1.0, -1.0)[:, None]
    total = stencil.value(wand.direction)
    norm = np.linalg.norm(total, axis=1, keepdims=True)
    unit = total / norm
    by_total = half[..., None] * (np.eye(3) - unit[:, :, None] * unit[:, None, :]) / norm[..., None]
    places = stencil.value(wand.middle) + half * unit
    velocity = stencil.slope(wand.middle) + np.einsum("nij,nj->ni", by_total, stencil.slope(wand.direction))
    return stencil, places, velocity, by_total


def predicted(scene: Scene, seen: BallObservations) -> tuple[Array, Bools]:
    """Return the predicted pixels (n, 2) of the wand's ends, and which of them the wand's frames reach."""
    stencil, places, _, _ = _wand_at(scene, seen)
    return _projected(scene.rig, seen.camera, places)[0], stencil.reached


def _wand_rows(scene: Scene, seen: BallObservations) -> Rows:
    stencil, places, velocity, by_total = _wand_at(scene, seen)
    uv, by_point, by_camera = _projected(scene.rig, seen.camera, places)
    rig, c = scene.rig, seen.camera
    pace = 1 / (rig.rate * (1 + rig.drift))[c]
    by_time = np.einsum("nij,nj->ni", by_point, velocity)
    by_camera[:, :, OFFSET] = -by_time * pace[:, None]
    by_camera[:, :, DRIFT] = -by_time * (rig.times(c, seen.frame) / (1 + rig.drift[c]))[:, None]
    by_wand = np.empty((len(seen), 2, stencil.nodes.shape[1], WAND_DOF))
    by_wand[..., :3] = by_point[:, :, None, :] * stencil.weights[:, None, :, None]
    by_direction = np.einsum("nij,nkjl->nikl", by_point @ by_total, tangents(scene.wand.direction)[stencil.nodes])
    by_wand[..., 3:] = by_direction * stencil.weights[:, None, :, None]
    columns = stencil.nodes[..., None] * WAND_DOF + np.arange(WAND_DOF)
    by_wand = by_wand.reshape(len(seen), 2, -1) * stencil.reached[:, None, None]
    by_camera *= stencil.reached[:, None, None]
    rows = _rows(scene, seen, by_camera, columns.reshape(len(seen), -1), by_wand)
    return _weighted(uv, seen, stencil.reached), rows


def _lframe_rows(scene: Scene, seen: BallObservations) -> Rows:
    assert scene.lframe_world is not None
    uv, by_point, by_camera = _projected(scene.rig, seen.camera, scene.lframe_world[seen.ball])
    columns = first_lframe(scene) + seen.ball[:, None] * 3 + np.arange(3)
    return _weighted(uv, seen), _rows(scene, seen, by_camera, columns, by_point)


def _rows(scene: Scene, seen: BallObservations, by_camera: Array, columns: Ints, by_columns: Array) -> sparse.csr_array:
    """Return two whitened rows per observation: derivatives by its camera, and by some further columns."""
    n = len(seen)
    values = seen.whitened(np.concatenate([by_columns, by_camera], axis=2))
    own = first_camera(scene) + seen.camera[:, None] * CAMERA_DOF + np.arange(CAMERA_DOF)
    at = np.concatenate([columns, own], axis=1)
    index = np.repeat(at[:, None], 2, axis=1)
    kept = values != 0
    counts = np.concatenate([[0], np.cumsum(kept.sum(axis=2).ravel())])
    return sparse.csr_array((values[kept], index[kept], counts), shape=(2 * n, unknowns(scene)))


def _measure_rows(scene: Scene, evidence: BundleEvidence) -> Rows | None:
    """Return the rows that tie the L-frame's balls to its measures."""
    if evidence.lframe_measures is None or scene.lframe_world is None:
        return None
    n, first, weight = scene.lframe_world.size, first_lframe(scene), 1 / evidence.lframe_sigma
    J = sparse.csr_array((np.full(n, weight), (np.arange(n), first + np.arange(n))), (n, unknowns(scene)))
    return ((scene.lframe_world - evidence.lframe_measures) * weight).ravel(), J


def _focal_rows(scene: Scene, evidence: BundleEvidence) -> Rows | None:
    """Return the rows that tie focal lengths to the given ones."""
    if evidence.focal is None or not np.isfinite(evidence.focal).any():
        return None
    c = np.flatnonzero(np.isfinite(evidence.focal))
    weight = np.full(len(c), 1 / evidence.focal_sigma)
    J = sparse.csr_array(
        (weight, (np.arange(len(c)), first_camera(scene) + c * CAMERA_DOF + FOCAL)), (len(c), unknowns(scene))
    )
    return np.log(scene.rig.focal[c].mean(axis=1) / evidence.focal[c]) * weight, J


def _runs_of_five(wand: Wand) -> Ints:
    """Return the indices of all runs of five consecutive frames, shape (n, 5)."""
    first = np.flatnonzero(wand.frames[4:] - wand.frames[:-4] == 4)
    return first[:, None] + np.arange(5)


def _bends(wand: Wand) -> Array:
    """Return the fourth differences of middle and half length over consecutive frames, in standard deviations, (6 n,).

    They damp a solution that oscillates from frame to frame, which cameras that see the wand midway between its frames
    would not notice.
    """
    nodes = _runs_of_five(wand)
    each = np.concatenate([wand.middle[nodes], wand.length / 2 * wand.direction[nodes]], axis=2)
    return np.asarray(np.einsum("k,nki->ni", _FOURTH_DIFFERENCE, each).ravel() / BEND_SIGMA)


def _bend_jacobian(scene: Scene) -> sparse.csr_array:
    wand = scene.wand
    nodes = _runs_of_five(wand)
    n = len(nodes)
    J = np.zeros((n, 6, 5, WAND_DOF))
    J[:, :3, :, :3] = np.eye(3)[:, None, :] * _FOURTH_DIFFERENCE[:, None]
    J[:, 3:, :, 3:] = np.einsum("k,nkij->nikj", wand.length / 2 * _FOURTH_DIFFERENCE, tangents(wand.direction)[nodes])
    columns = (nodes[..., None] * WAND_DOF + np.arange(WAND_DOF)).reshape(n, 1, -1)
    index = np.repeat(columns, 6, axis=1)
    values = J.reshape(n, 6, -1) / BEND_SIGMA
    kept = values != 0
    counts = np.concatenate([[0], np.cumsum(kept.sum(axis=2).ravel())])
    return sparse.csr_array((values[kept], index[kept], counts), (6 * n, unknowns(scene)))
