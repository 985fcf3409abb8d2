"""What each view shows for a limb: pixels that look like the performer and nobody covers, and edges of brightness."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from ...body.kinematics import scene_poses
from ...body.motion import Motion
from ...cameras.camera import Camera
from ...evidence.foreground import SCALE, STRONGEST, log_ratio
from ...evidence.label_images import NEAR, LabelImages, StillParts, render_labels
from ...evidence.limb_sides import PartSides, SideRatios, SlopeImages
from ...evidence.part_colours import ColouredFrames
from ...evidence.part_geometry import Geometry
from ...evidence.view_frames import ViewFrames
from ...numerics.arrays import Array, Bools
from ...numerics.repeatable import transformed
from .problem import SegmentProblem

PartPoses = tuple[Array, Array]
"""Orientations and places of a part on m frames, K each: (m, K, 3, 3) and (m, K, 3)."""
ZERO = 128
"""What a foreground image has where a performer is as likely as anything else."""
DEPTH_STEP = 0.002
"""Metres."""
NOBODY = (1 << 16) - 1
"""Depth where there is no part, in steps of `DEPTH_STEP`."""
STRIDE = 3
"""From one pixel that is looked at to the next, in rows and in columns."""


@dataclass(frozen=True, eq=False)
class ViewRatios:
    """Every STRIDE-th pixel of a view's frames: a performer's foreground images, (F, h, w), and the colours of its
    parts; and how brightness changes.
    """

    camera: Camera
    first: int
    foreground: NDArray[np.uint8]
    coloured: ColouredFrames | None
    still: StillParts | None
    slopes: SlopeImages | None

    @classmethod
    def of(cls, view: ViewFrames, problem: SegmentProblem, performer: int, motions: Sequence[Motion]) -> ViewRatios:
        """What a view shows of a performer on the frames of a problem, among the others as `motions` have them."""
        foreground = view.foreground_at(problem.first, problem.length, STRIDE)[performer]
        coloured = view.part_colours(problem.first, problem.length, STRIDE)
        camera, still = view.camera.subsampled(STRIDE), None
        if problem.only is not None:
            geometry = problem.geometry()
            others = np.flatnonzero(geometry.performer != performer)
            still = StillParts.drawn(geometry, others, camera, problem.first, scene_poses(problem.bodies, motions))
        slopes = None if coloured is None else _slopes_around(view, problem, foreground)
        return cls(camera, problem.first, foreground, coloured, still, slopes)

    def labels(self, geometry: Geometry, poses: tuple[Array, Array], without: Sequence[int] = ()) -> LabelImages:
        """Label images of all parts but for some; beside those that are still, numbered as all are."""
        parts = np.setdiff1d(np.arange(len(geometry.spans)), without)
        if self.still is not None:
            parts = np.setdiff1d(parts, self.still.parts)
        some = geometry if len(parts) == len(geometry.spans) else geometry.subset(parts.tolist())
        moving = render_labels(some, self.camera, self.first, poses[0][:, parts], poses[1][:, parts])
        return moving if self.still is None else self.still.among(moving, parts)

    def uncovered(self, geometry: Geometry, poses: tuple[Array, Array], parts: Sequence[int]) -> UncoveredImages:
        """What the pixels that a limb, a chain of parts, can reach show for it where others do not hide it."""
        labels = self.labels(geometry, poses, parts)
        rows, columns = self._within_reach(geometry, poses[1][:, list(parts)], parts)
        window, corner = (slice(None), rows, columns), (columns.start, rows.start)
        shown, foreground = labels.part[window], self.foreground[window]
        nobody, beside = shown < 0, log_ratio(np.arange(256, dtype=np.uint8))
        if self.coloured is None:
            image = np.where(nobody, _as_steps(beside)[foreground], np.uint8(ZERO))
            return UncoveredImages(self.camera, self.first, (image,) * len(parts), None, None, origin=corner)
        colours, palette = self.coloured.colours, self.coloured.palette[window]
        others = np.arange(len(geometry.spans))
        if self.still is None:
            others = np.setdiff1d(others, parts)
        # What an image has at a pixel is decided by the colour there and by who shows: another part, or the foreground.
        row = np.where(nobody, foreground.astype(np.int32) + np.int32(len(others)), shown)
        place = row * np.int32(colours.ratio.shape[1]) + palette
        images = []
        for part in parts:
            own = colours.ratio[part]
            before = np.where(colours.distinct[part][others, None], own - colours.ratio[others], np.float32(0))
            images.append(_as_steps(np.concatenate([before, beside[:, None] + own])).take(place))
        depth = depth_steps(labels)[window]
        return UncoveredImages(self.camera, self.first, tuple(images), depth, self.slopes, origin=corner)

    def _within_reach(self, geometry: Geometry, joints: Array, parts: Sequence[int]) -> tuple[slice, slice]:
        """Rows and columns of the pixels that may show a chain of parts with joints (F, n, 3), however these turn."""
        sizes = [float(np.linalg.norm(geometry.vertices[geometry.spans[part]], axis=1).max()) for part in parts]
        lengths = np.linalg.norm(np.diff(joints, axis=1), axis=-1).max(axis=0, initial=0.0)
        reach = max(size + before for size, before in zip(sizes, np.cumsum([0.0, *lengths]), strict=True))
        Rc, tc = self.camera.poses(self.first, len(joints))
        x = np.einsum("fij,fj->fi", Rc, joints[:, 0]) + tc
        near, far = x[:, 2] - reach, x[:, 2] + reach
        _, *size = self.foreground.shape
        if near.min() <= NEAR:
            return slice(0, size[0]), slice(0, size[1])
        edges = []
        for axis, pixels in ((1, size[0]), (0, size[1])):
            ends = [(x[:, axis] + end) / depth for end in (-reach, reach) for depth in (near, far)]
            places = self.camera.matrix[axis, axis] * np.array(ends) + self.camera.matrix[axis, 2]
            first = 2 * int(np.clip((places.min() - 1) // 2, 0, (pixels - 1) // 2))  # even: halves round as without it
            edges.append(slice(first, int(np.clip(np.ceil(places.max()) + 2, first + 1, pixels))))
        return edges[0], edges[1]


def _slopes_around(view: ViewFrames, problem: SegmentProblem, foreground: NDArray[np.uint8]) -> SlopeImages | None:
    """How brightness changes where some frame may show the performer."""
    shown = (foreground > ZERO).any(axis=0)
    if not shown.any():
        return None
    rows, columns = (np.flatnonzero(shown.any(axis=axis)) for axis in (1, 0))
    left, top = STRIDE * int(columns[0]), STRIDE * int(rows[0])
    right, bottom = STRIDE * (int(columns[-1]) + 1), STRIDE * (int(rows[-1]) + 1)
    start = problem.first - view.first
    grey = view.grey[start : start + problem.length, top:bottom, left:right]
    return SlopeImages.of(view.camera, problem.first, grey, (left, top))


@dataclass(frozen=True, eq=False)
class UncoveredImages:
    """How much likelier each pixel of a view is with each of some parts there than as the others are.

    `ratio` are n images (F, h, w) as foreground images are; `depth` (F, h, w) is how far the others are, in steps of
    `DEPTH_STEP`, if it matters. `origin` is the view's pixel (column, row) that is the first of these.
    """

    camera: Camera
    first: int
    ratio: tuple[NDArray[np.uint8], ...]
    depth: NDArray[np.uint16] | None
    slopes: SlopeImages | None
    sides: SideRatios | None = None
    origin: tuple[int, int] = (0, 0)

    def changes(self, sides: PartSides, frames: slice, poses: PartPoses) -> tuple[NDArray[np.float32], Bools]:
        """The changes of brightness across the sides of a part in its poses on some frames, grey levels per pixel, and
        which of them others do not hide; shape (m, 2, n, K).
        """
        assert self.slopes is not None and self.depth is not None
        Rc, tc = self.camera.poses(self.first + frames.start, len(poses[0]))
        centre = -np.einsum("mji,mj->mi", Rc, tc).astype(np.float32)
        R, T = (each.astype(np.float32) for each in poses)
        change, seen = self.slopes.steepest(frames, *sides.seen_from(centre, R, T))
        pixels = seen[:, :2].reshape(len(seen), 2, -1, seen.shape[-1]) / np.float32(STRIDE)
        others = self._looked_up(self.depth[frames], pixels[:, 0], pixels[:, 1], 0).reshape(change.shape)
        return change, seen[:, 2] < others * np.float32(DEPTH_STEP)

    def beside(self, sides: PartSides, frames: slice, poses: PartPoses) -> NDArray[np.float32]:
        """How much likelier what shows across the sides of a part is with it in its poses, (m, K)."""
        if self.sides is None:
            return np.zeros(poses[1].shape[:2], np.float32)
        return self.sides.of(*self.changes(sides, frames, poses)).sum(axis=(1, 2))

    def at(self, part: int, frames: slice, points_world: NDArray[np.float32]) -> NDArray[np.float32]:
        """Ratios of the pixels that points (m, 3, K, points) of a part on some frames fall on, 0 beyond the picture and
        behind others; shape (m, K).
        """
        Rc, tc = self.camera.poses(self.first + frames.start, len(points_world))
        K = self.camera.matrix
        x = transformed((K @ Rc).astype(np.float32), points_world.reshape(len(points_world), 3, -1))
        x += (tc @ K.T).astype(np.float32)[..., None]
        depth = np.maximum(x[:, 2:], np.float32(NEAR))
        columns, rows = (x[:, :2] / depth).reshape(points_world[:, :2].shape).swapaxes(0, 1)
        steps = self._looked_up(self.ratio[part][frames], columns, rows, ZERO).astype(np.int16) - np.int16(ZERO)
        if self.depth is not None:
            others = self._looked_up(self.depth[frames], columns, rows, 0)
            steps *= depth.reshape(others.shape) < others * np.float32(DEPTH_STEP)
        return np.asarray(steps.mean(axis=-1, dtype=np.float32) / np.float32(SCALE))

    def _looked_up(self, images: NDArray[Any], columns: Array, rows: Array, beyond: float) -> NDArray[Any]:
        """The nearest pixels of images (m, h, w) to places (m, K, points) in the view."""
        left, top = (np.float32(edge) for edge in self.origin)
        found = np.empty(columns.shape, images.dtype)
        for image, u, v, out in zip(images, columns - left, rows - top, found, strict=True):
            cv2.remap(image, u, v, cv2.INTER_NEAREST, out, cv2.BORDER_CONSTANT, beyond)
        return found


def depth_steps(labels: LabelImages) -> NDArray[np.uint16]:
    """How far the parts are, in steps of `DEPTH_STEP`."""
    if labels.still is None:
        images = np.full(labels.part.shape, NOBODY, np.uint16)
    else:
        images = _in_depth_steps(labels.still.depth)
    images.ravel()[labels.index] = _in_depth_steps(1 / labels.inverse_depth)
    return images


def _in_depth_steps(depth: NDArray[np.float32]) -> NDArray[np.uint16]:
    return np.minimum(depth / np.float32(DEPTH_STEP), np.float32(NOBODY)).astype(np.uint16)


def _as_steps(ratio: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Log likelihood ratios as foreground images have them: there may be many images."""
    return np.rint(np.clip(ratio, -STRONGEST, STRONGEST) * np.float32(SCALE) + np.float32(ZERO)).astype(np.uint8)


def shown_areas(geometry: Geometry, parts: Sequence[int]) -> Array:
    """The areas that parts show on the average, square metres: by Cauchy's formula a quarter of their surfaces."""
    return np.array([ConvexHull(geometry.vertices[geometry.spans[part]]).area / 4 for part in parts])
