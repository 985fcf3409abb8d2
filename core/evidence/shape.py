"""The body's shape as the key frames show it: parts are stretched and shifted until their outlines fit there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..visibility import Geometry, render_labels
from .gradients import Poses
from .images import ViewFrames
from .outlines import outline_lines

Array = NDArray[np.float64]

STRETCH = 0.2
"""Usual stretch of a part along each of its axes, beside the default body."""
SHIFT = 0.015
"""Usual shift of a part along each of its axes, metres."""
REACH = 0.12
"""How far from the model's outline the body's is looked for, metres."""
ITERATIONS = 4
TOLERANCE = 2.0
_STRIDE = 2


def fitted_shape(
    views: Sequence[ViewFrames], geometry: Geometry, poses: Mapping[float, Poses], frames: Sequence[int]
) -> Geometry:
    """Fit the parts' shapes to outlines on frames whose poses are known; joints stay where they are.

    Every part is stretched along its three axes and shifted, six unknowns, by Gauss-Newton over the lines of
    `core.evidence.outlines`; what no camera shows stays as it is.

    Parameters
    ----------
    views : sequence of ViewFrames
        With foreground images.
    geometry : Geometry
        Of all performers' P parts.
    poses : mapping of float to tuple
        (R, T) on these K frames, (K, P, 3, 3) and (K, P, 3), by the delay of the views that show them.
    frames : sequence of int
        Shot frames.
    """
    prior = np.diag([1 / STRETCH**2] * 3 + [1 / SHIFT**2] * 3)
    for _ in range(ITERATIONS):
        H, g = np.zeros((len(geometry.spans), 6, 6)), np.zeros((len(geometry.spans), 6))
        for view in views:
            R, T = poses[view.delay]
            for k, frame in enumerate(frames):
                _add_lines(H, g, view, geometry, (R[[k]], T[[k]]), frame)
        geometry = stretched(geometry, np.linalg.solve(H + prior, g[..., None])[..., 0])
    return geometry


def _add_lines(H: Array, g: Array, view: ViewFrames, geometry: Geometry, poses: Poses, frame: int) -> None:
    """Add one frame's normal equations of (stretch, shift) per part, (P, 6, 6) and (P, 6)."""
    (R,), (T,) = poses
    camera, (foreground,) = view.camera, view.foreground_at(frame, 1)
    labels = render_labels(geometry, camera.subsampled(_STRIDE), frame, *poses)
    reach = max(4, round(REACH * view.pixels_per_metre(T.mean(axis=0), frame)))
    lines = outline_lines(
        camera, frame, foreground[None], labels, geometry, poses, _STRIDE, reach, TOLERANCE, view.halo
    )
    Rc, tc = camera.pose(frame)
    to_part = np.einsum("ab,nbc->nac", Rc, R[lines.part])
    slope = np.einsum("na,nab->nb", lines.wrenches(camera)[:, :3], to_part)
    x_part = np.einsum("na,nab->nb", lines.points_cam - (T @ Rc.T + tc)[lines.part], to_part)
    rows = np.concatenate([slope * x_part, slope], axis=1)
    weighted = rows * (lines.weight * lines.length)[:, None]
    np.add.at(H, lines.part, weighted[:, :, None] * rows[:, None])
    np.add.at(g, lines.part, weighted * lines.shift[:, None])


def stretched(geometry: Geometry, change: Array) -> Geometry:
    """Parts with their points x moved to (1 + s) x + d, for changes (s, d) of shape (P, 6)."""
    stretch, shift = 1 + change[:, :3], change[:, 3:]
    vertices = geometry.vertices * stretch[geometry.owner] + shift[geometry.owner]
    of = geometry.face_owner
    normals = geometry.planes[:, :3] / stretch[of]
    offsets = geometry.planes[:, 3] - np.einsum("fa,fa->f", normals, shift[of])
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return replace(geometry, vertices=vertices, planes=np.concatenate([normals, offsets[:, None]], axis=1) / length)
