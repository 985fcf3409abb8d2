"""Fitting the shapes of the parts to the key frames: parts are stretched and shifted until their outlines fit.

Two key frames show a limb from two sides at best. What a segment's own key frames say is therefore joined with what the
key frames of the segments beside it say, once these are solved (`FittedShape.joined`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..body.kinematics import Poses
from ..cameras.camera import Camera
from ..numerics.arrays import Array, Bools, Ints
from ..numerics.least_squares import GAUSS_NEWTON, StoppingRule, minimise
from ..numerics.normal_equations import DenseEquations
from .frame_comparison import EvidenceCaches
from .gradient_evidence.image_wrenches import camera_twist
from .outline_evidence.held_outlines import HeldOutlines
from .outline_evidence.outline_lines import Lines, LineSearch, outline_lines
from .rendering.label_images import render_labels
from .rendering.part_geometry import Geometry
from .view_frames import ViewFrames
from .view_work import IN_THIS_THREAD, ViewWork

STRETCH_SIGMA = 0.2
"""Standard deviation of the stretch of a part along each of its axes, relative to the default body."""
SHIFT_SIGMA = 0.015
"""Standard deviation of the shift of a part along each of its axes, metres."""
KEY_OUTLINE_REACH = 0.12
"""Distance from the model's outline within which that of the performer is searched for, metres."""
STEP_PRIOR = np.diag([1 / STRETCH_SIGMA**2] * 3 + [1 / SHIFT_SIGMA**2] * 3)
"""Precision of every step, not of their sum: parts that are hardly seen stay as they are, others may change by more."""
ITERATIONS = 4
"""Number of iterations of the fit."""
OUTLINE_TOLERANCE = 2.0
"""Robust limit of the outlines, in units of their usual one."""
_STRIDE = 2


@dataclass(frozen=True, eq=False)
class ShapeEvidence:
    """What the outlines on K frames say about the shapes of P parts.

    Frame k adds x H x / 2 + g x to the cost of a further change x of a part, (6,), without the prior.

    Attributes
    ----------
    frames : ndarray of int, shape (K,)
        Shot frames.
    change : ndarray, shape (P, 6)
        Stretches and shifts that were fitted to these frames: where the cost is expanded.
    matrix : ndarray, shape (K, P, 6, 6)
        H.
    gradient : ndarray, shape (K, P, 6)
        g.
    """

    frames: Ints
    change: Array
    matrix: Array
    gradient: Array


@dataclass(frozen=True, eq=False)
class FittedShape:
    """The shapes of all parts, and what the frames to which they were fitted say about them."""

    geometry: Geometry
    evidence: ShapeEvidence

    def joined(self, others: Sequence[ShapeEvidence]) -> FittedShape:
        """Return the shape that fits frames of others as well; frames that are among one's own count once.

        It is what a fit to all of these frames leads to: it begins with the default body again and makes as many steps.
        Begun where one's own fit ended, it would make twice as many, each with a prior of its own, and what the cameras
        hardly show would go far beyond what the fits say. The pictures are not looked at again. The evidence stays
        one's own.
        """
        own, known = self.evidence, set(self.evidence.frames.tolist())
        parts = [(own.change, own.matrix.sum(axis=0), own.gradient.sum(axis=0))]
        for other in others:
            new = [k for k, frame in enumerate(other.frames.tolist()) if frame not in known]
            known.update(other.frames.tolist())
            if new:
                parts.append((other.change, other.matrix[new].sum(axis=0), other.gradient[new].sum(axis=0)))
        if len(parts) == 1:
            return self
        matrix, change = sum((H for _, H, _ in parts), STEP_PRIOR), np.zeros_like(own.change)
        for _ in range(ITERATIONS):
            gradient = sum(g + np.einsum("pij,pj->pi", H, further(at, change)) for at, H, g in parts)
            change = compose(change, -np.linalg.solve(matrix, gradient[..., None]))
        return replace(self, geometry=stretched(self.geometry, further(own.change, change)))


def fitted_shape(
    views: Sequence[ViewFrames],
    geometry: Geometry,
    poses: Mapping[float, Poses],
    frames: Sequence[int],
    known: Bools | None = None,
    *,
    by: ViewWork = IN_THIS_THREAD,
) -> FittedShape:
    """Fit the parts' shapes to outlines on frames whose poses are known; joints stay where they are.

    Every part is stretched along its three axes and shifted, six unknowns, by Gauss-Newton over the lines of
    `core.evidence.outline_evidence.outline_lines`; what no camera shows stays as it is.

    Parameters
    ----------
    views : sequence of ViewFrames
        With foreground images.
    geometry : Geometry
        Shapes of all performers' P parts.
    poses : mapping of float to tuple
        (R, T) on these K frames, (K, P, 3, 3) and (K, P, 3), by the delay of the views that show them.
    frames : sequence of int
        Shot frames.
    known : ndarray of bool, shape (K, P), optional
        Parts whose poses are known on each frame; outlines of others are not used. By default all are known.
    by : ViewWork, optional
    """
    start, posed = np.zeros((len(geometry.spans), 6)), KeyFramePoses(frames, poses, known)
    result = minimise(
        start,
        lambda change: shape_equations(views, geometry, change, posed, by),
        compose,
        trial_cost=lambda change, equations: equations.cost_at(change, poses),
        damping=GAUSS_NEWTON,
        stopping=StoppingRule(ITERATIONS, relative_gain=0.0),
    )
    at_end = result.linearised().by_frame
    evidence = ShapeEvidence(np.array(frames), result.state, at_end[..., :6, :6], at_end[..., :6, -1])
    return FittedShape(stretched(geometry, result.state), evidence)


@dataclass(frozen=True, eq=False)
class KeyFramePoses:
    """Poses of all parts on the key frames.

    Attributes
    ----------
    frames, poses, known
        See `fitted_shape`.
    twists : mapping of float to ndarray, optional
        Twists of the parts about the world's origin per frame, (K, P, 6), by the delay of the views. With them there is
        one more unknown, the last: the time in frames by which all parts move along their twists.
    """

    frames: Sequence[int]
    poses: Mapping[float, Poses]
    known: Bools | None = None
    twists: Mapping[float, Array] | None = None

    def of_view(self, view: ViewFrames) -> tuple[Poses, Sequence[int], Array | None, Bools | None]:
        """Return what a view shows: poses, frames, twists, and which parts are known."""
        return self.poses[view.delay], self.frames, None if self.twists is None else self.twists[view.delay], self.known


@dataclass(frozen=True, eq=False)
class ShapeEquations(DenseEquations):
    """Normal equations of a further stretch and shift of every part, and optionally of a common time offset.

    Attributes
    ----------
    change : ndarray, shape (P, 6)
        Stretches and shifts at which they are linearised.
    by_frame : ndarray, shape (K, P, 7 or 8, 7 or 8)
        Products of the lines' rows, the last column of which is the residual, per frame and part.
    held : tuple
        For every view: its outlines, its camera on the key frames, and its delay.
    """

    change: Array
    by_frame: Array
    held: tuple[tuple[HeldOutlines, Camera, float], ...]

    def cost_at(self, change: Array, poses: Mapping[float, Poses]) -> float:
        """Return the cost of another shape and other poses by the same outlines, with that of the step there."""
        step = further(self.change, change)
        cost = sum(outlines.cost(camera, poses[delay], step) for outlines, camera, delay in self.held)
        return cost + float(np.einsum("pi,ij,pj->", step, STEP_PRIOR, step))


def compose(change: Array, step: Array) -> Array:
    """Compose stretches and shifts of parts (P, 6) with further ones (6 P,)."""
    further = step.reshape(change.shape)
    ratio = 1 + further[:, :3]
    return np.concatenate([(1 + change[:, :3]) * ratio - 1, change[:, 3:] * ratio + further[:, 3:]], axis=1)


def further(change: Array, after: Array) -> Array:
    """Return the stretches and shifts (P, 6) that lead from some to others, see `compose`."""
    ratio = (1 + after[:, :3]) / (1 + change[:, :3])
    return np.concatenate([ratio - 1, after[:, 3:] - ratio * change[:, 3:]], axis=1)


def shape_equations(
    views: Sequence[ViewFrames],
    geometry: Geometry,
    change: Array,
    posed: KeyFramePoses,
    by: ViewWork = IN_THIS_THREAD,
) -> ShapeEquations:
    """Build the normal equations from the outlines of all views.

    Parameters
    ----------
    views, geometry, by
        See `fitted_shape`.
    change : ndarray, shape (P, 6)
        Present stretches and shifts of the parts.
    posed : KeyFramePoses
    """
    P, own = len(geometry.spans), 6 if posed.twists is None else 7
    shape = stretched(geometry, change)
    tasks = [(view, (shape, *posed.of_view(view))) for view in views]
    by_frame, held = np.zeros((len(posed.frames), P, own + 1, own + 1)), []
    for view, (products, outlines) in zip(views, by.of_each(_view_products, tasks, EvidenceCaches()), strict=True):
        by_frame += products
        held.append((outlines, view.camera.at(posed.frames), view.delay))
    sums = by_frame.sum(axis=0)
    H, g = sums[:, :-1, :-1], sums[:, :-1, -1]
    n = 6 * P
    matrix, gradient = np.zeros((n + own - 6,) * 2), np.zeros(n + own - 6)
    for p in range(P):
        block = slice(6 * p, 6 * p + 6)
        matrix[block, block] = H[p, :6, :6] + STEP_PRIOR
        gradient[block] = g[p, :6]
        matrix[block, n:], matrix[n:, block] = H[p, :6, 6:], H[p, 6:, :6]
    matrix[n:, n:], gradient[n:] = H[:, 6:, 6:].sum(axis=0), g[:, 6:].sum(axis=0)
    return ShapeEquations(matrix, gradient, float(sums[:, -1, -1].sum()), change, by_frame, tuple(held))


def _view_products(
    view: ViewFrames,
    _: EvidenceCaches,
    asked: tuple[Geometry, Poses, Sequence[int], Array | None, Bools | None],
) -> tuple[Array, HeldOutlines]:
    """Return the products of the rows of one view's outlines by frame and part, and these outlines; see
    `shape_equations` for what is asked: shape, poses, frames, twists, and which parts are known.
    """
    shape, poses, frames, twists, known = asked
    camera, lines = view.camera.at(frames), _lines(view, shape, poses, frames)
    if known is not None:
        lines = lines.where(known[lines.frame, lines.part])
    sound = np.array([view.sound(frame, 1)[0][0] for frame in frames])
    if not sound.all():
        lines = lines.where(sound[lines.frame])
    rows = np.column_stack([_rows(lines, camera, poses, twists), -lines.shift])
    return lines.products(rows, len(frames), len(shape.spans)), HeldOutlines.at(lines, camera, poses, 1.0)


def _lines(view: ViewFrames, geometry: Geometry, poses: Poses, frames: Sequence[int]) -> Lines:
    """Measure the outlines in one view on all frames."""
    (R, T), camera = poses, view.camera.at(frames)
    foreground = np.concatenate([view.foreground_at(frame, 1) for frame in frames], axis=1)
    labels = render_labels(geometry, camera.subsampled(_STRIDE), 0, R, T)
    scale = max(
        view.camera.pixels_per_metre(places.mean(axis=0), frame) for places, frame in zip(T, frames, strict=True)
    )
    reach = max(4, round(KEY_OUTLINE_REACH * scale))
    search = LineSearch(_STRIDE, reach, OUTLINE_TOLERANCE)
    return outline_lines(camera, foreground, labels, search, halo=view.halo)


def _rows(lines: Lines, camera: Camera, poses: Poses, twists: Array | None) -> Array:
    """Jacobian rows of the lines by the unknowns of their parts, shape (N, 6 or 7)."""
    wrench = lines.wrenches(camera)
    columns = shape_columns(lines, wrench, camera, poses)
    if twists is not None:
        turned = np.einsum("na,nab->nb", wrench, camera_twist(*camera.poses(0, len(poses[1])))[lines.frame])
        columns.append(np.einsum("na,na->n", turned, twists[lines.frame, lines.part])[:, None])
    return np.concatenate(columns, axis=1)


def shape_columns(lines: Lines, wrench: Array, camera: Camera, poses: Poses) -> list[Array]:
    """Return the derivatives of search lines by the stretches and by the shifts of their parts, shape (N, 3) each.

    Parameters
    ----------
    lines : Lines
        N search lines.
    wrench : ndarray, shape (N, 6)
        Derivatives of the lines by twists of their parts, in camera axes.
    camera : Camera
    poses : tuple
        World poses (R, T) of all parts on the camera's frames.
    """
    (R, T), (Rc, tc) = poses, camera.poses(0, len(poses[0]))
    of = lines.frame, lines.part
    to_part, joints = (Rc[:, None] @ R)[of], (T @ np.swapaxes(Rc, 1, 2) + tc[:, None])[of]
    place, slope = (np.einsum("na,nab->nb", a, to_part) for a in (lines.points_cam - joints, wrench[:, :3]))
    return [slope * place, slope]


def stretched(geometry: Geometry, change: Array) -> Geometry:
    """Move the points x of all parts to (1 + s) x + d, for stretches and shifts (s, d), shape (P, 6)."""
    stretch, shift = 1 + change[:, :3], change[:, 3:]
    vertices = geometry.vertices * stretch[geometry.owner] + shift[geometry.owner]
    of = geometry.face_owner
    normals = geometry.planes[:, :3] / stretch[of]
    offsets = geometry.planes[:, 3] - np.einsum("fa,fa->f", normals, shift[of])
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return replace(geometry, vertices=vertices, planes=np.concatenate([normals, offsets[:, None]], axis=1) / length)
