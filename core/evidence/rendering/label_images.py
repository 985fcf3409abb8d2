"""Label and depth images: which part, and how far, every pixel of a posed scene shows (paper 1, section 2.3).

A vertex of a convex polyhedron is on its outline if some of the faces that meet there face the camera and others do
not. OpenCV fills the outlines of the parts, painted from far to near. A ray enters a convex polyhedron at the farthest
of the planes of its front faces, and in the image the inverse depth of a plane is linear, so the inverse depth of a
pixel is the minimum of a few linear functions. This is exact, and no triangles are drawn.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from ...cameras.camera import Camera
from ...numerics.arrays import Array, Bools, Ints
from .nearest_pixels import pixels_at
from .part_geometry import PLANE_TOLERANCE, Geometry
from .part_outlines import FRACTION_BITS, Outlines

NEAR_PLANE = 0.05
"""Parts with a vertex nearer to the camera plane than this, metres, are not drawn."""
DEPTH_STEP = 0.002
"""Unit of depth images of whole numbers, metres."""
EMPTY_DEPTH = (1 << 16) - 1
"""Depth where there is no part, in units of `DEPTH_STEP`."""


@dataclass(frozen=True, eq=False)
class Faces:
    """The front faces of the P parts in n frames.

    Attributes
    ----------
    planes : ndarray of float32, shape (M, 3)
        1/z of each plane as a linear function of the pixel (u, v, 1).
    ends : ndarray of int, shape (n P + 1,)
        Planes ends[k] to ends[k + 1] are those of part k % P in frame k // P.
    farthest : ndarray of float32, shape (n P,)
        1/z of the farthest vertex of each part, as a bound: the rim of a filled outline lies just outside the part,
        where its planes may meet far behind it.
    """

    planes: NDArray[np.float32]
    ends: NDArray[np.intp]
    farthest: NDArray[np.float32]


class DrawnBefore(Protocol):
    """Parts that are drawn once, while others move in front of and behind them."""

    @property
    def depth(self) -> NDArray[np.float32]:
        """Depth images of these parts, metres, shape (n, h, w)."""
        ...

    @property
    def depth_steps(self) -> NDArray[np.uint16]:
        """The same in units of `DEPTH_STEP`."""
        ...


@dataclass(frozen=True, eq=False)
class LabelImages:
    """What a camera sees of the posed parts in n frames.

    Attributes
    ----------
    part : ndarray of int16, shape (n, h, w)
        Index of the part seen, among all P parts of all performers; -1 where there is none.
    index : ndarray of int, shape (N,)
        The pixels of the flattened images that show a part, sorted by frame and part.
    ends : ndarray of int, shape (n P + 1,)
        Pixels ends[k] to ends[k + 1] of these show part k % P of frame k // P.
    share : ndarray, shape (n, P)
        Visible area of each part over its whole projected area, 0 to 1 (section 5.3). It does not matter whether the
        rest is hidden by the same performer, by others, or lies outside of the image.
    outlines : Outlines
    faces : Faces
    performer : ndarray of int, shape (P,)
        Whose part each is; in order.
    distance : ndarray, shape (n, P)
        Depth of the centre of each part's vertices, metres; the farthest part is drawn first.
    still : DrawnBefore, optional
        Parts that were drawn before; `index`, `outlines` and `faces` list only the other parts.
    """

    part: NDArray[np.int16]
    index: NDArray[np.intp]
    ends: NDArray[np.intp]
    share: Array
    outlines: Outlines
    faces: Faces
    performer: Ints
    distance: Array
    still: DrawnBefore | None = None

    @cached_property
    def far_to_near(self) -> Ints:
        """Indices of the parts in the order in which they were drawn, shape (n, P)."""
        return np.argsort(-self.distance, axis=1)

    @cached_property
    def inverse_depth(self) -> NDArray[np.float32]:
        """1/z of the surface at the pixels of `index`, 1/metres, shape (N,)."""
        _, u, v = self.places
        rays = np.ones((len(u), 3))
        rays[:, 0], rays[:, 1] = u, v
        planes = self.faces.planes.astype(float).T  # processors differ in products of single precision
        pixels, faces = np.diff(self.ends), np.diff(self.faces.ends)
        begins = np.concatenate([[0], np.cumsum(pixels * faces)])
        at_planes = np.empty(begins[-1])  # of each pixel after the other, at all planes of its part
        parts = zip(pairwise(self.ends.tolist()), pairwise(self.faces.ends.tolist()), begins.tolist(), strict=False)
        for (a, b), (c, d), begin in parts:
            if a < b:
                out = at_planes[begin : begin + (b - a) * (d - c)].reshape(b - a, d - c)
                np.dot(rays[a:b], planes[:, c:d], out=out)
        each = np.repeat(faces, pixels)
        entered = np.minimum.reduceat(at_planes, np.cumsum(each) - each).astype(np.float32)
        return np.maximum(entered, np.repeat(self.faces.farthest, np.diff(self.ends)))

    def areas(self) -> Ints:
        """Number of pixels that show each part, and that would show it without other performers, (2, P, n)."""
        n, P = self.share.shape
        shown = np.diff(self.ends).reshape(n, P).T
        M = int(self.performer.max()) + 1
        if M == 1:
            return np.stack([shown, shown])
        corners, bounds = self.outlines.fixed_point, self.outlines.ends.tolist()
        alone = shown.copy()
        starts = (P * np.arange(n)[:, None] + np.searchsorted(self.performer, np.arange(M))).ravel()
        low, high = self.outlines.boxes(starts, self.part.shape[:0:-1]).reshape(2, n, M, 2)
        meeting = (low[:, None] < high[:, :, None]).all(axis=-1)
        meeting &= meeting.swapaxes(1, 2) & ~np.eye(M, dtype=bool)
        for m in range(M):
            own = self.performer == m
            number = np.cumsum(own)  # from 1 on
            for f in np.flatnonzero(meeting[:, m].any(axis=1)).tolist():
                image = np.zeros(self.part.shape[1:], np.int16)
                for i in self.far_to_near[f, own[self.far_to_near[f]]].tolist():
                    a, b = bounds[f * P + i], bounds[f * P + i + 1]
                    if a < b:
                        cv2.fillConvexPoly(image, corners[a:b], int(number[i]), shift=FRACTION_BITS)
                (left, top), (right, bottom) = low[f, m], high[f, m]
                around = image[top:bottom, left:right]  # counting takes longer than drawing
                alone[own, f] = np.bincount(around.ravel(), minlength=number[-1] + 1)[1:]
        return np.stack([shown, alone])

    def box(self) -> tuple[int, int, int, int]:
        """Bounding box of all pixels that show a part in any frame: left, top, right, bottom (exclusive)."""
        seen = self.part.max(axis=0) >= 0
        u, v = np.flatnonzero(seen.any(axis=0)), np.flatnonzero(seen.any(axis=1))
        return (int(u[0]), int(v[0]), int(u[-1]) + 1, int(v[-1]) + 1) if len(u) else (0, 0, 0, 0)

    @cached_property
    def places(self) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]]:
        """Frame, column and row of the pixels of `index`, shape (N,) each."""
        n, height, width = self.part.shape
        frame = np.repeat(np.arange(n), np.diff(self.ends[:: self.share.shape[1]]))
        pixel = self.index - frame * (height * width)
        v = pixel // width
        return frame, pixel - v * width, v

    def places_in(self, stride: int, size: tuple[int, int]) -> NDArray[np.intp]:
        """Indices of the pixels of `index` in flattened images of the n frames, of size (height, width), of which these
        label images have every stride-th pixel; shape (N,).
        """
        frame, u, v = self.places
        index = frame * size[0]
        index += stride * v
        index *= size[1]
        index += stride * u
        return index

    def pixels_of(self, images: NDArray[np.uint8], stride: int) -> NDArray[np.uint8]:
        """Look up the pixels of `index` in the images (M, n, h, w) of the performers whose parts they show, shape (N,);
        `stride` as above.
        """
        place = self.places_in(stride, (images.shape[2], images.shape[3]))
        found = images[0].reshape(-1).take(place)  # many times as fast as an index for each axis
        if len(images) > 1:
            n, P = self.share.shape
            whose = np.repeat(np.tile(self.performer[:P], n), np.diff(self.ends))
            for performer, own in enumerate(images[1:], 1):
                rows = np.flatnonzero(whose == performer)
                found[rows] = own.reshape(-1).take(place[rows])
        return found

    def part_at(
        self, frame: NDArray[np.intp], u: NDArray[np.floating[Any]], v: NDArray[np.floating[Any]]
    ) -> NDArray[np.int16]:
        """Look up the parts seen at the nearest pixels to positions in frames; -2 outside of the image."""
        return pixels_at(self.part, frame, u, v, np.int16(-2))

    def depth_images(self) -> NDArray[np.float32]:
        """Depth z in metres, infinite where there is no part, shape (n, h, w)."""
        images = np.full(self.part.size, np.inf, np.float32) if self.still is None else self.still.depth.flatten()
        images[self.index] = 1 / self.inverse_depth
        return images.reshape(self.part.shape)

    def labels_without(self, parts: Sequence[int]) -> NDArray[np.int16]:
        """Return label images as they would be without some parts, (n, h, w); only of parts that were all drawn
        together.
        """
        assert self.still is None
        gone = np.isin(np.arange(self.share.shape[1]), parts)
        return _painted(self.outlines, self.distance, self.part.shape[:0:-1], left_out=gone)

    def without(self, parts: Sequence[int]) -> tuple[NDArray[np.int16], NDArray[np.uint16]]:
        """Return label and depth images, in units of `DEPTH_STEP`, as they would be without some parts, (n, h, w) each;
        only of parts that were all drawn together.
        """
        n, P = self.share.shape
        gone, label = np.isin(np.arange(P), parts), self.labels_without(parts)
        index = self.index[np.repeat(np.tile(gone, n), np.diff(self.ends))]
        behind = np.full(label.shape, -1, np.int16)
        behind.ravel()[index] = label.ravel()[index]
        there, ends = _pixels_by_part(behind, P)
        depth = self.depth_steps()
        depth.ravel()[index] = EMPTY_DEPTH
        depth.ravel()[there] = in_depth_steps(1 / replace(self, part=label, index=there, ends=ends).inverse_depth)
        return label, depth

    def depth_steps(self) -> NDArray[np.uint16]:
        """Depth in units of `DEPTH_STEP`, `EMPTY_DEPTH` where there is no part, shape (n, h, w)."""
        images = (
            np.full(self.part.size, EMPTY_DEPTH, np.uint16) if self.still is None else self.still.depth_steps.flatten()
        )
        images[self.index] = in_depth_steps(1 / self.inverse_depth)
        return images.reshape(self.part.shape)


def in_depth_steps(depth: NDArray[np.float32]) -> NDArray[np.uint16]:
    """Return depths, metres, in units of `DEPTH_STEP`."""
    return np.minimum(depth / np.float32(DEPTH_STEP), np.float32(EMPTY_DEPTH)).astype(np.uint16)


def render_labels(geometry: Geometry, camera: Camera, first: int, R: Array, T: Array) -> LabelImages:
    """Render label and depth images of posed parts in n consecutive frames.

    Parameters
    ----------
    geometry : Geometry
    camera : Camera
        Without lens distortion; its size is that of the images.
    first : int
        Shot frame of the first frame, for the pose of a moving camera.
    R, T : ndarray, shape (n, P, 3, 3) and (n, P, 3)
        World poses of all performers' parts.
    """
    n, P = T.shape[:2]
    Rc, tc = camera.poses(first, n)
    R_cam, T_cam = Rc[:, None] @ R, T @ np.swapaxes(Rc, 1, 2) + tc[:, None]
    points = _turned(geometry.vertices, geometry.owner, R_cam) + np.swapaxes(T_cam, 1, 2)[..., geometry.owner]
    normals = _turned(geometry.planes[:, :3], geometry.face_owner, R_cam)
    distance = geometry.planes[:, 3] - (normals * np.swapaxes(T_cam, 1, 2)[..., geometry.face_owner]).sum(axis=1)
    facing = distance > PLANE_TOLERANCE
    starts = [span.start for span in geometry.spans]
    nearest, farthest = (f.reduceat(points[:, 2], starts, axis=1) for f in (np.minimum, np.maximum))
    outlines = Outlines.of(geometry, camera, points, facing, nearest >= NEAR_PLANE)
    middle = np.add.reduceat(points[:, 2], starts, axis=1) / geometry.counts
    label = _painted(outlines, middle, camera.size)
    index, ends = _pixels_by_part(label, P)
    frame, face = np.nonzero(facing)
    linear = -(normals[frame, :, face] / distance[frame, face, None]) @ np.linalg.inv(camera.matrix)
    faces = Faces(
        linear.astype(np.float32),
        np.searchsorted(frame * P + geometry.face_owner[face], np.arange(len(ends))),
        (1 / np.maximum(farthest, NEAR_PLANE)).astype(np.float32).ravel(),
    )
    share = np.minimum(np.diff(ends) / outlines.areas, 1.0).reshape(n, P)
    return LabelImages(
        part=label,
        index=index,
        ends=ends,
        share=share,
        outlines=outlines,
        faces=faces,
        performer=geometry.performer,
        distance=middle,
    )


def _painted(
    outlines: Outlines, distance: Array, size: tuple[int, ...], *, left_out: Bools | None = None
) -> NDArray[np.int16]:
    """Draw the outlines of P parts in n frames from the farthest to the nearest, given their distances (n, P), but for
    those that are left out, (P,); see `LabelImages.part`.
    """
    (n, P), (width, height) = distance.shape, size
    label = np.full((n, height, width), -1, dtype=np.int16)
    corners, bounds = outlines.fixed_point, outlines.ends.tolist()
    nearer = np.argsort(-distance, axis=1)
    if left_out is not None:
        nearer = nearer[~left_out[nearer]].reshape(n, -1)
    for j, order in enumerate(nearer.tolist()):
        image = label[j]
        for i in order:
            a, b = bounds[j * P + i], bounds[j * P + i + 1]
            if a < b:
                cv2.fillConvexPoly(image, corners[a:b], i, shift=FRACTION_BITS)
    return label


def _pixels_by_part(label: NDArray[np.int16], P: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Sort the pixels that show one of P parts by frame and part; see `LabelImages.index` and `LabelImages.ends`."""
    n, flat = len(label), label.ravel()
    index = np.flatnonzero(flat >= 0)
    group = index // label[0].size * P + flat[index]
    order = np.argsort(group.astype(np.int16) if n * P < 1 << 15 else group, kind="stable")
    return index[order], np.searchsorted(group[order], np.arange(n * P + 1))


def _turned(vectors: Array, owner: Ints, R: Array) -> Array:
    """Rotate vectors (V, 3), sorted by part, by the rotations of their parts (n, P, 3, 3); shape (n, 3, V)."""
    n, P = R.shape[:2]
    ends = np.searchsorted(owner, np.arange(P + 1))
    parts = (R[:, i].reshape(-1, 3) @ vectors[ends[i] : ends[i + 1]].T for i in range(P))
    return np.concatenate([part.reshape(n, 3, -1) for part in parts], axis=2)
