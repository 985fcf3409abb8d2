"""The body's shape as the key frames show it: parts are stretched and shifted until their outlines fit there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..visibility import Geometry, render_labels
from .gradients import Poses, camera_twist
from .images import ViewFrames
from .outlines import outline_lines

Array = NDArray[np.float64]

STRETCH = 0.2
"""Usual stretch of a part along each of its axes, beside the default body."""
SHIFT = 0.015
"""Usual shift of a part along each of its axes, metres."""
REACH = 0.12
"""How far from the model's outline the body's is looked for, metres."""
PRIOR = np.diag([1 / STRETCH**2] * 3 + [1 / SHIFT**2] * 3)
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
    for _ in range(ITERATIONS):
        H, g = outline_system(views, geometry, poses, frames)
        geometry = stretched(geometry, np.linalg.solve(H + PRIOR, g[..., None])[..., 0])
    return geometry


def outline_system(
    views: Sequence[ViewFrames],
    geometry: Geometry,
    poses: Mapping[float, Poses],
    frames: Sequence[int],
    twists: Mapping[float, Array] | None = None,
) -> tuple[Array, Array]:
    """Normal equations of every part's (stretch, shift), shape (P, 6, 6) and (P, 6).

    With `twists` of the parts about the world's origin (K, P, 6), by the delay of the views, a seventh unknown is how
    far the parts have gone on along them.
    """
    unknowns = 6 if twists is None else 7
    H, g = np.zeros((len(geometry.spans), unknowns, unknowns)), np.zeros((len(geometry.spans), unknowns))
    for view in views:
        R, T = poses[view.delay]
        for k, frame in enumerate(frames):
            twist = None if twists is None else twists[view.delay][k]
            _add_lines(H, g, view, geometry, (R[[k]], T[[k]]), frame, twist)
    return H, g


def _add_lines(
    H: Array, g: Array, view: ViewFrames, geometry: Geometry, poses: Poses, frame: int, twist: Array | None
) -> None:
    """Add one frame's normal equations."""
    (R,), (T,) = poses
    camera, (foreground,) = view.camera, view.foreground_at(frame, 1)
    labels = render_labels(geometry, camera.subsampled(_STRIDE), frame, *poses)
    reach = max(4, round(REACH * view.pixels_per_metre(T.mean(axis=0), frame)))
    lines = outline_lines(camera, foreground[None], labels, _STRIDE, reach, TOLERANCE, view.halo)
    Rc, tc = camera.pose(frame)
    wrenches = lines.wrenches(camera)
    to_part = np.einsum("ab,nbc->nac", Rc, R[lines.part])
    slope = np.einsum("na,nab->nb", wrenches[:, :3], to_part)
    x_part = np.einsum("na,nab->nb", lines.points_cam - (T @ Rc.T + tc)[lines.part], to_part)
    columns = [slope * x_part, slope]
    if twist is not None:
        columns.append(np.einsum("na,na->n", wrenches @ camera_twist(Rc, tc), twist[lines.part])[:, None])
    rows = np.concatenate(columns, axis=1)
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
