"""Images in which a limb is searched for: uncovered pixels that look like the performer, and slopes of brightness."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from ....body.kinematics import scene_poses
from ....body.limbs import limbs, without_end
from ....body.motion import Motion
from ....cameras.camera import Camera
from ....evidence.foreground_images.foreground import LEVELS_PER_UNIT, MAX_LOG_RATIO, log_ratio
from ....evidence.foreground_images.part_colours import ColouredFrames
from ....evidence.limb_sides import PartSides, SideRatios, SlopeImages
from ....evidence.rendering.label_images import DEPTH_STEP, NEAR_PLANE, LabelImages, render_labels
from ....evidence.rendering.part_geometry import Geometry
from ....evidence.rendering.static_parts import StaticParts
from ....evidence.view_frames import ViewFrames
from ....numerics.arrays import Array, Bools
from ....numerics.repeatable import transformed
from ..equations.problem import SegmentProblem

PartPoses = tuple[Array, Array]
"""K world orientations and positions of a part on each of m frames: (m, K, 3, 3) and (m, K, 3)."""
LimbBone = tuple[Array, Array, float]
"""Where a bone begins and where it ends in K poses on each of m frames, (m, K, 3) each, and its radius, metres."""
EVEN_LEVEL = 128
"""Value of a foreground image whose log likelihood ratio is 0: performer and background are equally likely."""
_LONG_ROW = 256
MAX_STRIDE = 3
"""Largest distance between the pixels that are used, in rows and in columns."""
MIN_WIDTH = 2.5
"""Pixels that are used across the thinnest limb, if the images have as many: a limb of one or two pixels hardly differs
from the background beside it."""


@dataclass(frozen=True, eq=False)
class ViewRatios:
    """What a view shows of a performer, at every `stride`-th pixel.

    Attributes
    ----------
    camera : Camera
        At the reduced resolution.
    first : int
        Shot frame of the first image.
    foreground : ndarray of uint8, shape (F, h, w)
        The performer's foreground images, see `core.evidence.foreground_images.foreground`.
    coloured : ColouredFrames or None
        Colours of the performer's parts.
    still : StaticParts or None
        Label images of the other performers, where their motion is given.
    slopes : SlopeImages or None
        How brightness changes, at full resolution.
    stride : int
        See `search_stride`.
    """

    camera: Camera
    first: int
    foreground: NDArray[np.uint8]
    coloured: ColouredFrames | None
    still: StaticParts | None
    slopes: SlopeImages | None
    stride: int = MAX_STRIDE

    @classmethod
    def of(
        cls,
        view: ViewFrames,
        problem: SegmentProblem,
        performer: int,
        motions: Sequence[Motion],
        stride: int | None = None,
    ) -> ViewRatios:
        """Collect what a view shows of a performer on the frames of a problem; the others are posed as in `motions`.

        `stride` is by default that of the search.
        """
        if stride is None:
            stride = search_stride(view, problem, performer, motions)
        foreground = view.foreground_at(problem.first, problem.length, stride)[performer]
        coloured = view.part_colours(problem.first, problem.length, stride)
        camera, still = view.camera.subsampled(stride), None
        if problem.only is not None:
            geometry = problem.geometry()
            others = np.flatnonzero(geometry.performer != performer)
            still = StaticParts.drawn(geometry, others, camera, problem.first, scene_poses(problem.bodies, motions))
        slopes = None if coloured is None else _slopes_around(view, problem, foreground, stride)
        return cls(camera, problem.first, foreground, coloured, still, slopes, stride)

    def labels(self, geometry: Geometry, poses: tuple[Array, Array]) -> LabelImages:
        """Render label images of all parts. They are kept for the next time that these have the same poses, as when
        limb after limb is found where it was.
        """
        if not self._last or any(not np.array_equal(a, b) for a, b in zip(self._last[0][0], poses, strict=True)):
            self._last[:] = [(poses, self._rendered(geometry, poses))]
        return self._last[0][1]

    @cached_property
    def _last(self) -> list[tuple[tuple[Array, Array], LabelImages]]:
        return []

    def _rendered(self, geometry: Geometry, poses: tuple[Array, Array], without: Sequence[int] = ()) -> LabelImages:
        parts = np.setdiff1d(np.arange(len(geometry.spans)), without)
        if self.still is not None:
            parts = np.setdiff1d(parts, self.still.parts)
        some = geometry if len(parts) == len(geometry.spans) else geometry.subset(parts.tolist())
        moving = render_labels(some, self.camera, self.first, poses[0][:, parts], poses[1][:, parts])
        return moving if self.still is None else self.still.among(moving, parts)

    def uncovered(self, geometry: Geometry, poses: tuple[Array, Array], parts: Sequence[int]) -> UncoveredImages:
        """Compute the log likelihood ratios of a limb's parts at all pixels that the limb can reach."""
        if self.still is None:
            labels, depth = self.labels(geometry, poses).without(parts)
        else:
            drawn = self._rendered(geometry, poses, parts)
            labels, depth = drawn.part, drawn.depth_steps()
        rows, columns = self._within_reach(geometry, poses[1][:, list(parts)], parts)
        window, corner = (slice(None), rows, columns), (columns.start, rows.start)
        shown, foreground = labels[window], self.foreground[window]
        nobody, beside = shown < 0, log_ratio(np.arange(256, dtype=np.uint8))
        if self.coloured is None:
            image = np.where(nobody, _as_steps(beside)[foreground], np.uint8(EVEN_LEVEL))
            return UncoveredImages(
                self.camera, self.first, (image,) * len(parts), None, None, origin=corner, stride=self.stride
            )
        colours, palette = self.coloured.colours, self.coloured.palette[window]
        others = np.arange(len(geometry.spans))
        # The ratio at a pixel depends on its colour and on what is there now: another part, or a foreground value.
        row = np.where(nobody, foreground.astype(np.int32) + np.int32(len(others)), shown)
        place = row * np.int32(colours.ratio.shape[1]) + palette
        images = []
        for part in parts:
            own = colours.ratio[part]
            before = np.where(colours.distinct[part][others, None], own - colours.ratio[others], np.float32(0))
            images.append(_as_steps(np.concatenate([before, beside[:, None] + own])).take(place))
        return UncoveredImages(
            self.camera, self.first, tuple(images), depth[window], self.slopes, origin=corner, stride=self.stride
        )

    def _within_reach(self, geometry: Geometry, joints: Array, parts: Sequence[int]) -> tuple[slice, slice]:
        """Rows and columns of the pixels that a chain of parts with joints (F, n, 3) may cover, however they turn."""
        sizes = [float(np.linalg.norm(geometry.vertices[geometry.spans[part]], axis=1).max()) for part in parts]
        lengths = np.linalg.norm(np.diff(joints, axis=1), axis=-1).max(axis=0, initial=0.0)
        reach = max(size + before for size, before in zip(sizes, np.cumsum([0.0, *lengths]), strict=True))
        Rc, tc = self.camera.poses(self.first, len(joints))
        x = np.einsum("fij,fj->fi", Rc, joints[:, 0]) + tc
        near, far = x[:, 2] - reach, x[:, 2] + reach
        _, *size = self.foreground.shape
        if near.min() <= NEAR_PLANE:
            return slice(0, size[0]), slice(0, size[1])
        edges = []
        for axis, pixels in ((1, size[0]), (0, size[1])):
            ends = [(x[:, axis] + end) / depth for end in (-reach, reach) for depth in (near, far)]
            places = self.camera.matrix[axis, axis] * np.array(ends) + self.camera.matrix[axis, 2]
            first = 2 * int(np.clip((places.min() - 1) // 2, 0, (pixels - 1) // 2))  # even: halves round as without it
            edges.append(slice(first, int(np.clip(np.ceil(places.max()) + 2, first + 1, pixels))))
        return edges[0], edges[1]


def search_stride(view: ViewFrames, problem: SegmentProblem, performer: int, motions: Sequence[Motion]) -> int:
    """Return the distance between the pixels of a view that are used to search for a performer's limbs, from 1 to
    `MAX_STRIDE`: the largest with which the thinnest of them is `MIN_WIDTH` pixels wide.
    """
    body, geometry, begin = problem.bodies[performer], problem.geometry(), problem.spans()[performer].start
    chains = [without_end(chain) for chain in limbs(body)]
    parts = [begin + part for chain in chains for part in chain]
    if not parts:
        return MAX_STRIDE
    scale = view.camera.pixels_per_metre(motions[performer].translations.mean(axis=0), problem.first)
    return int(np.clip(scale * min(shown_widths(geometry, parts)) / MIN_WIDTH, 1, MAX_STRIDE))


def _slopes_around(
    view: ViewFrames, problem: SegmentProblem, foreground: NDArray[np.uint8], stride: int
) -> SlopeImages | None:
    """Slopes of brightness within the box of pixels that may show the performer on some frame."""
    shown = (foreground > EVEN_LEVEL).any(axis=0)
    if not shown.any():
        return None
    rows, columns = (np.flatnonzero(shown.any(axis=axis)) for axis in (1, 0))
    left, top = stride * int(columns[0]), stride * int(rows[0])
    right, bottom = stride * (int(columns[-1]) + 1), stride * (int(rows[-1]) + 1)
    start = problem.first - view.first
    grey = view.grey[start : start + problem.length, top:bottom, left:right]
    return SlopeImages.of(view.camera, problem.first, grey, (left, top))


@dataclass(frozen=True, eq=False)
class UncoveredImages:
    """Log likelihood ratios of a view's pixels for each part of a limb, against what is there without the limb.

    Attributes
    ----------
    camera : Camera
    first : int
        Shot frame of the first image.
    ratio : tuple of ndarray of uint8, shape (F, h, w)
        Per part: log likelihood ratios, encoded as in foreground images (`EVEN_LEVEL`).
    depth : ndarray of uint16, shape (F, h, w), or None
        Depth of all other parts in units of `DEPTH_STEP`; None where it does not matter.
    slopes : SlopeImages or None
    sides : SideRatios or None
        Distribution of brightness changes across the limb's sides, once learned.
    origin : tuple of int
        Column and row of the view's pixel that is the first of the images.
    stride : int
        See `search_stride`.
    """

    camera: Camera
    first: int
    ratio: tuple[NDArray[np.uint8], ...]
    depth: NDArray[np.uint16] | None
    slopes: SlopeImages | None
    sides: SideRatios | None = None
    origin: tuple[int, int] = (0, 0)
    stride: int = MAX_STRIDE

    def changes(self, sides: PartSides, frames: slice, poses: PartPoses) -> tuple[NDArray[np.float32], Bools]:
        """Return the brightness changes across the sides of a part in K poses on m frames, grey levels per pixel, and
        which of them other parts do not hide; shapes (m, 2, n, K) for n points on either side.
        """
        assert self.slopes is not None and self.depth is not None
        centre = self._centre(frames, poses).astype(np.float32)
        R, T = (each.astype(np.float32) for each in poses)
        change, seen = self.slopes.steepest(frames, *sides.seen_from(centre, R, T))
        pixels = seen[:, :2].reshape(len(seen), 2, -1, seen.shape[-1]) / np.float32(self.stride)
        others = self._looked_up(self.depth[frames], pixels[:, 0], pixels[:, 1], 0).reshape(change.shape)
        return change, seen[:, 2] < others * np.float32(DEPTH_STEP)

    def beside(self, sides: PartSides, frames: slice, poses: PartPoses) -> NDArray[np.float32]:
        """Log likelihood ratio of the brightness across the sides of a part in K poses on m frames, (m, K)."""
        if self.sides is None:
            return np.zeros(poses[1].shape[:2], np.float32)
        return self.sides.of(*self.changes(sides, frames, poses)).sum(axis=(1, 2))

    def seen_areas(self, areas: Array, frames: slice, poses: PartPoses) -> Array:
        """Projected areas of a part in K poses on m frames, square metres, (m, K), from those along its axes (3,): as
        of an ellipsoid, which a limb's part resembles.
        """
        R, T = poses
        if (areas == areas[0]).all():
            return np.broadcast_to(areas[0], T.shape[:2])
        # Coordinate by coordinate: long rows take half the time.
        x, y, z = np.moveaxis(T - self._centre(frames, poses)[:, None], 2, 0)
        along = (a * x + b * y + c * z for a, b, c in np.moveaxis(R, (3, 2), (0, 1)))
        squared = sum((area * own) ** 2 for area, own in zip(areas, along, strict=True))
        return np.asarray(np.sqrt(squared / (x * x + y * y + z * z)))

    def _centre(self, frames: slice, poses: PartPoses) -> Array:
        """Positions of the camera on the frames of poses, (m, 3)."""
        Rc, tc = self.camera.poses(self.first + frames.start, len(poses[0]))
        return np.asarray(-np.einsum("mji,mj->mi", Rc, tc))

    def at(
        self, part: int, frames: slice, points_world: NDArray[np.float32], bones: Sequence[LimbBone] = ()
    ) -> NDArray[np.float32]:
        """Mean log likelihood ratio of the pixels that a part's points (m, 3, K, points) fall on, shape (m, K).

        Points outside of the image, behind other parts, or on pixels that the given bones of the same limb cover, which
        have been counted for these, count 0.
        """
        Rc, tc = self.camera.poses(self.first + frames.start, len(points_world))
        K = self.camera.matrix
        x = transformed((K @ Rc).astype(np.float32), points_world.reshape(len(points_world), 3, -1))
        x += (tc @ K.T).astype(np.float32)[..., None]
        depth = np.maximum(x[:, 2:], np.float32(NEAR_PLANE))
        columns, rows = (x[:, :2] / depth).reshape(points_world[:, :2].shape).swapaxes(0, 1)
        steps = self._looked_up(self.ratio[part][frames], columns, rows, EVEN_LEVEL).astype(np.int16) - np.int16(
            EVEN_LEVEL
        )
        if self.depth is not None:
            others = self._looked_up(self.depth[frames], columns, rows, 0)
            steps *= depth.reshape(others.shape) < others * np.float32(DEPTH_STEP)
        for bone in bones:
            steps *= ~self._on_bone(bone, K @ Rc, tc @ K.T, columns, rows)
        count = steps.shape[-1]  # a product of matrices is the fastest sum; it is exact, as all steps are whole
        return np.asarray(steps.astype(np.float32) @ np.ones(count, np.float32) / np.float32(count * LEVELS_PER_UNIT))

    def _on_bone(
        self, bone: LimbBone, turned: Array, shifted: Array, columns: NDArray[np.float32], rows: NDArray[np.float32]
    ) -> Bools:
        """Whether pixels (m, K, points) lie on a bone in K poses on m frames; the view's frames project a point x to
        `turned` @ x + `shifted`, (m, 3, 3) and (m, 3).
        """
        begin, end, radius = bone
        ends = np.stack(np.broadcast_arrays(begin, end)) @ np.swapaxes(turned, 1, 2) + shifted[:, None]
        depth = np.maximum(ends[..., 2:], NEAR_PLANE)
        (u, v), (right, down) = (
            np.moveaxis(each.astype(np.float32), -1, 0)[..., None]
            for each in (ends[0, ..., :2] / depth[0], ends[1, ..., :2] / depth[1] - ends[0, ..., :2] / depth[0])
        )
        width = (self.camera.matrix[0, 0] * radius / depth[0]).astype(np.float32)
        x, y = columns - u, rows - v
        share = x * right
        share += y * down
        share /= np.maximum(right * right + down * down, np.float32(1e-6))
        np.clip(share, 0, 1, out=share)
        x -= share * right
        y -= share * down
        x *= x
        y *= y
        x += y
        return np.asarray(x < width * width)

    def _looked_up(self, images: NDArray[Any], columns: Array, rows: Array, beyond: float) -> NDArray[Any]:
        """Look up the nearest pixels of images (m, h, w) at positions (m, K, points) in the view."""
        left, top = (np.float32(edge) for edge in self.origin)
        found = np.empty(columns.shape, images.dtype)
        # OpenCV goes row by row: of thousands of poses with two points each, long rows take a third of the time.
        shape = (len(columns), -1, _LONG_ROW) if columns[0].size % _LONG_ROW == 0 else columns.shape
        places = (values.reshape(shape) for values in (columns - left, rows - top, found))
        for image, u, v, out in zip(images, *places, strict=True):
            cv2.remap(image, u, v, cv2.INTER_NEAREST, out, cv2.BORDER_CONSTANT, beyond)
        return found


def _as_steps(ratio: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Encode log likelihood ratios as bytes, as in foreground images, to save memory."""
    return np.rint(
        np.clip(ratio, -MAX_LOG_RATIO, MAX_LOG_RATIO) * np.float32(LEVELS_PER_UNIT) + np.float32(EVEN_LEVEL)
    ).astype(np.uint8)


def shown_areas(geometry: Geometry, parts: Sequence[int]) -> Array:
    """Mean projected areas of parts, square metres, shape (n,): by Cauchy's formula a quarter of their surfaces."""
    return np.array([ConvexHull(geometry.vertices[geometry.spans[part]]).area / 4 for part in parts])


def axis_areas(geometry: Geometry, part: int) -> Array:
    """Projected areas of a part's convex hull along the axes of its frame, square metres, (3,): half of what its faces
    cover on either side.
    """
    vertices = geometry.vertices[geometry.spans[part]]
    a, b, c = np.moveaxis(vertices[ConvexHull(vertices).simplices], 1, 0)
    return np.asarray(np.abs(np.cross(b - a, c - a)).sum(axis=0) / 4)


def shown_widths(geometry: Geometry, parts: Sequence[int]) -> Array:
    """Mean widths of parts, metres, shape (n,): their mean projected areas over their lengths."""
    vertices = [geometry.vertices[geometry.spans[part]] for part in parts]
    return shown_areas(geometry, parts) / np.array([np.ptp(each, axis=0).max() for each in vertices])
