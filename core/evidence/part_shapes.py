"""The body's shape as the key frames show it: parts are stretched and shifted until their outlines fit there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..body.kinematics import Poses
from ..cameras.camera import Camera
from .contours import Lines, outline_lines
from .gradients import camera_twist
from .label_images import Geometry, render_labels
from .view_frames import ViewFrames

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
    `core.evidence.contours`; what no camera shows stays as it is.

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
    P, unknowns = len(geometry.spans), 6 if twists is None else 7
    sums = np.zeros((P, unknowns + 1, unknowns + 1))
    for view in views:
        rows, lines = _rows(view, geometry, poses[view.delay], frames, None if twists is None else twists[view.delay])
        sums += lines.products(np.column_stack([rows, lines.shift]), len(frames), P).sum(axis=0)
    return sums[:, :-1, :-1], sums[:, :-1, -1]


def _rows(
    view: ViewFrames, geometry: Geometry, poses: Poses, frames: Sequence[int], twists: Array | None
) -> tuple[Array, Lines]:
    """One view's lines on all frames, and their rows against the unknowns of their parts."""
    (R, T), camera = poses, view.camera.at(frames)
    foreground = np.concatenate([view.foreground_at(frame, 1) for frame in frames])
    labels = render_labels(geometry, camera.subsampled(_STRIDE), 0, R, T)
    scale = max(view.pixels_per_metre(places.mean(axis=0), frame) for places, frame in zip(T, frames, strict=True))
    reach = max(4, round(REACH * scale))
    lines = outline_lines(camera, foreground, labels, stride=_STRIDE, reach=reach, tolerance=TOLERANCE, halo=view.halo)
    wrench = lines.wrenches(camera)
    columns = shape_columns(lines, wrench, camera, poses)
    if twists is not None:
        turned = np.einsum("na,nab->nb", wrench, camera_twist(*camera.poses(0, len(T)))[lines.frame])
        columns.append(np.einsum("na,na->n", turned, twists[lines.frame, lines.part])[:, None])
    return np.concatenate(columns, axis=1), lines


def shape_columns(lines: Lines, wrench: Array, camera: Camera, poses: Poses) -> list[Array]:
    """The lines' rows against their parts' stretches and shifts, (N, 3) each, of the rows against twists (N, 6)."""
    (R, T), (Rc, tc) = poses, camera.poses(0, len(poses[0]))
    of = lines.frame, lines.part
    to_part, joints = (Rc[:, None] @ R)[of], (T @ np.swapaxes(Rc, 1, 2) + tc[:, None])[of]
    place, slope = (np.einsum("na,nab->nb", a, to_part) for a in (lines.points_cam - joints, wrench[:, :3]))
    return [slope * place, slope]


def stretched(geometry: Geometry, change: Array) -> Geometry:
    """Parts with their points x moved to (1 + s) x + d, for changes (s, d) of shape (P, 6)."""
    stretch, shift = 1 + change[:, :3], change[:, 3:]
    vertices = geometry.vertices * stretch[geometry.owner] + shift[geometry.owner]
    of = geometry.face_owner
    normals = geometry.planes[:, :3] / stretch[of]
    offsets = geometry.planes[:, 3] - np.einsum("fa,fa->f", normals, shift[of])
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return replace(geometry, vertices=vertices, planes=np.concatenate([normals, offsets[:, None]], axis=1) / length)
