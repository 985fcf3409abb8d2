"""Label and depth images: which part, and how far, every pixel of a posed scene shows (paper 000, section 2.3).

A vertex of a convex polyhedron is on its outline where some of the faces that meet there look at the camera and others
do not. OpenCV fills the outlines of the parts, painted far to near. A convex polyhedron is entered through the farthest
of the planes of its faces that look at the camera, and in the image the inverse depth of a plane is linear, so the
depth of a pixel is the minimum of a few linear functions: exact, and without drawing a single triangle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from ..body import Body
from ..cameras.camera import Camera
from ..numerics.arrays import Array, Bools, Ints, slices_of

NEAR = 0.05
"""Parts with a vertex nearer than this (metres before the camera) are not drawn."""
_SHIFT = 4  # fractional bits of the outlines given to OpenCV
_FARTHEST = 1 << 20
_TOUCHING = 1e-6  # metres


@dataclass(frozen=True, eq=False)
class Geometry:
    """The polyhedra of all performers' parts, one after the other.

    Attributes
    ----------
    vertices : ndarray, shape (V, 3)
        In the part's frame, metres.
    owner : ndarray of int, shape (V,)
        The part that each vertex belongs to, counted over all performers.
    spans : tuple of slice
        The vertices of each part.
    planes : ndarray, shape (N, 4)
        The parts' face planes, see `Part.planes`; faces in one plane are listed once.
    face_owner : ndarray of int, shape (N,)
        The part that each plane belongs to.
    meeting : sparse array of int, shape (V, N)
        One where a plane goes through a vertex of its part.
    performer : ndarray of int, shape (P,)
        Whose part each is.
    """

    vertices: Array
    owner: Ints
    spans: tuple[slice, ...]
    planes: Array
    face_owner: Ints
    meeting: sparse.csr_array
    performer: Ints

    @property
    def counts(self) -> Ints:
        """Number of vertices of each part, shape (P,)."""
        return np.array([span.stop - span.start for span in self.spans])

    @classmethod
    def of(cls, bodies: Sequence[Body]) -> Geometry:
        """The parts of some bodies."""
        parts = [part for body in bodies for part in body.parts]
        planes = [np.unique(part.planes.round(9), axis=0) for part in parts]
        performer = np.repeat(np.arange(len(bodies)), [len(body) for body in bodies])
        return cls.joined([part.vertices for part in parts], planes, performer)

    @classmethod
    def joined(cls, vertices: Sequence[Array], planes: Sequence[Array], performer: Ints | None = None) -> Geometry:
        """From every part's vertices and planes, and whose it is: by default all are one performer's."""
        count = np.arange(len(vertices))
        touching = [v @ p[:, :3].T + p[:, 3] > -_TOUCHING for v, p in zip(vertices, planes, strict=True)]
        return cls(
            np.concatenate(vertices),
            np.repeat(count, [len(v) for v in vertices]),
            tuple(slices_of(len(v) for v in vertices)),
            np.concatenate(planes),
            np.repeat(count, [len(p) for p in planes]),
            sparse.csr_array(sparse.block_diag([touch.astype(np.int64) for touch in touching])),
            np.zeros(len(vertices), np.int64) if performer is None else performer,
        )

    def subset(self, parts: Sequence[int]) -> Geometry:
        """Some of the parts alone, in that order."""
        vertices = [self.vertices[self.spans[part]] for part in parts]
        planes = [self.planes[self.face_owner == part] for part in parts]
        return Geometry.joined(vertices, planes, self.performer[list(parts)])


@dataclass(frozen=True, eq=False)
class Outlines:
    """The convex outlines of the P parts in n frames, where they are drawn.

    Attributes
    ----------
    uv : ndarray, shape (K, 2)
        The outlines' corners in the image, pixels; each outline clockwise as the image is seen.
    depth : ndarray, shape (K,)
        How far they are, metres.
    ends : ndarray of int, shape (n P + 1,)
        Corners ends[k] to ends[k + 1] are those of part k % P in frame k // P.
    """

    uv: Array
    depth: Array
    ends: NDArray[np.intp]

    @property
    def group(self) -> NDArray[np.intp]:
        """The k that each corner belongs to, shape (K,)."""
        return np.repeat(np.arange(len(self.ends) - 1), np.diff(self.ends))

    @property
    def following(self) -> NDArray[np.intp]:
        """Which of the K corners comes after each on its outline, shape (K,)."""
        after = np.arange(1, len(self.uv) + 1)
        there = np.diff(self.ends) > 0
        after[self.ends[1:][there] - 1] = self.ends[:-1][there]
        return after


@dataclass(frozen=True, eq=False)
class Faces:
    """The faces of the P parts that look at the camera in n frames.

    Attributes
    ----------
    planes : ndarray of float32, shape (M, 3)
        1/z of each plane as a linear function of the pixel (u, v, 1).
    ends : ndarray of int, shape (n P + 1,)
        Planes ends[k] to ends[k + 1] are those of part k % P in frame k // P.
    farthest : ndarray of float32, shape (n P,)
        1/z of the farthest vertex of each part: a filled outline's rim lies just outside the part, where its planes may
        meet far behind it.
    """

    planes: NDArray[np.float32]
    ends: NDArray[np.intp]
    farthest: NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class LabelImages:
    """What a camera sees of the posed parts in n frames.

    Attributes
    ----------
    part : ndarray of int16, shape (n, h, w)
        The part seen, counted over all P parts of all performers; -1 where there is none.
    index : ndarray of int, shape (N,)
        The pixels of the flattened images that show a part, sorted by frame and part.
    ends : ndarray of int, shape (n P + 1,)
        Pixels ends[k] to ends[k + 1] of these show part k % P of frame k // P.
    share : ndarray, shape (n, P)
        Visible area of each part over its whole projected area, 0 to 1 (section 5.3). Hidden by itself, by others, and
        beyond the picture's edge count alike.
    outlines : Outlines
    faces : Faces
    performer : ndarray of int, shape (P,)
        Whose part each is.
    far_to_near : ndarray of int, shape (n, P)
        The parts in the order in which they were drawn.
    """

    part: NDArray[np.int16]
    index: NDArray[np.intp]
    ends: NDArray[np.intp]
    share: Array
    outlines: Outlines
    faces: Faces
    performer: Ints
    far_to_near: Ints

    @cached_property
    def inverse_depth(self) -> NDArray[np.float32]:
        """1/z of the surface at the pixels of `index`, 1/metres, shape (N,)."""
        _, u, v = self.places
        rays = np.ones((3, len(u)))
        rays[:2] = u, v
        planes = self.faces.planes.astype(float)  # processors differ in products of single precision
        entered = np.empty(len(u), dtype=np.float32)
        for (a, b), (c, d) in zip(pairwise(self.ends.tolist()), pairwise(self.faces.ends.tolist()), strict=True):
            if a < b:
                np.minimum.reduce(planes[c:d] @ rays[:, a:b], axis=0, out=entered[a:b])
        return np.maximum(entered, np.repeat(self.faces.farthest, np.diff(self.ends)))

    def areas(self, sought: Sequence[int] | None = None) -> Ints:
        """Pixels that show each part, and those that would without other performers, shape (2, P, n).

        The latter take time, and are those that show it for performers that are not sought; by default all are.
        """
        n, P = self.share.shape
        shown = np.diff(self.ends).reshape(n, P).T
        M = int(self.performer.max()) + 1
        if M == 1:
            return np.stack([shown, shown])
        corners, bounds = _subpixels(self.outlines.uv), self.outlines.ends.tolist()
        alone = shown.copy()
        for m in range(M) if sought is None else sought:
            own = self.performer == m
            number = np.cumsum(own)  # from 1 on
            for f in range(n):
                image = np.zeros(self.part.shape[1:], np.int16)
                for i in self.far_to_near[f, own[self.far_to_near[f]]].tolist():
                    a, b = bounds[f * P + i], bounds[f * P + i + 1]
                    if a < b:
                        cv2.fillConvexPoly(image, corners[a:b], int(number[i]), shift=_SHIFT)
                alone[own, f] = np.bincount(image.ravel(), minlength=number[-1] + 1)[1:]
        return np.stack([shown, alone])

    def of_performers(self, sought: Sequence[int]) -> LabelImages:
        """The same images, of whose pixels and outlines only those of some performers are listed."""
        n = len(self.part)
        kept = np.tile(np.isin(self.performer, sought), n)
        outlines, faces = self.outlines, self.faces
        return replace(
            self,
            index=self.index[np.repeat(kept, np.diff(self.ends))],
            ends=_kept_ends(self.ends, kept),
            outlines=Outlines(
                outlines.uv[np.repeat(kept, np.diff(outlines.ends))],
                outlines.depth[np.repeat(kept, np.diff(outlines.ends))],
                _kept_ends(outlines.ends, kept),
            ),
            faces=replace(
                faces, planes=faces.planes[np.repeat(kept, np.diff(faces.ends))], ends=_kept_ends(faces.ends, kept)
            ),
        )

    def box(self) -> tuple[int, int, int, int]:
        """Left, top, right and bottom of the pixels that show a part in any frame, the latter two exclusive."""
        seen = self.part.max(axis=0) >= 0
        u, v = np.flatnonzero(seen.any(axis=0)), np.flatnonzero(seen.any(axis=1))
        return (int(u[0]), int(v[0]), int(u[-1]) + 1, int(v[-1]) + 1) if len(u) else (0, 0, 0, 0)

    @cached_property
    def places(self) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]]:
        """Frame, and column and row in its image, of the pixels of `index`."""
        n, height, width = self.part.shape
        frame = np.repeat(np.arange(n), np.diff(self.ends[:: self.share.shape[1]]))
        pixel = self.index - frame * (height * width)
        v = pixel // width
        return frame, pixel - v * width, v

    def part_at(
        self, frame: NDArray[np.intp], u: NDArray[np.floating[Any]], v: NDArray[np.floating[Any]]
    ) -> NDArray[np.int16]:
        """The parts seen nearest to places in frames; -2 beyond the picture."""
        return pixels_at(self.part, frame, u, v, np.int16(-2))

    def depth_images(self) -> NDArray[np.float32]:
        """Depth z in metres, infinite where there is no part, shape (n, h, w)."""
        images = np.full(self.part.size, np.inf, dtype=np.float32)
        images[self.index] = 1 / self.inverse_depth
        return images.reshape(self.part.shape)


def pixels_at(
    images: NDArray[Any],
    frame: NDArray[np.intp],
    u: NDArray[np.floating[Any]],
    v: NDArray[np.floating[Any]],
    beyond: Any,
) -> NDArray[Any]:
    """The pixels of images (n, h, w) nearest to places in frames, which are broadcast to the places; `beyond` where
    there is none.
    """
    _, height, width = images.shape
    with np.errstate(invalid="ignore"):  # what is no number becomes one that is far beyond
        column, row = np.rint(u).astype(np.intp), np.rint(v).astype(np.intp)
    # As an unsigned number a negative one is large.
    inside = (column.view(np.uintp) < width) & (row.view(np.uintp) < height)
    index = row * width + column
    index += frame * (height * width)
    index *= inside
    found = images.ravel().take(index)
    np.copyto(found, beyond, where=~inside)
    return np.asarray(found)


def render_labels(geometry: Geometry, camera: Camera, first: int, R: Array, T: Array) -> LabelImages:
    """Label and depth images of posed parts in n consecutive frames.

    Parameters
    ----------
    geometry : Geometry
    camera : Camera
        Without lens distortion, of the size of the images wanted.
    first : int
        Shot frame of the first of them, for the pose of a moving camera.
    R, T : ndarray, shape (n, P, 3, 3) and (n, P, 3)
        World pose of every part, counted over all performers.
    """
    n, P = T.shape[:2]
    Rc, tc = camera.poses(first, n)
    R_cam, T_cam = Rc[:, None] @ R, T @ np.swapaxes(Rc, 1, 2) + tc[:, None]
    points = _turned(geometry.vertices, geometry.owner, R_cam) + np.swapaxes(T_cam, 1, 2)[..., geometry.owner]
    normals = _turned(geometry.planes[:, :3], geometry.face_owner, R_cam)
    distance = geometry.planes[:, 3] - (normals * np.swapaxes(T_cam, 1, 2)[..., geometry.face_owner]).sum(axis=1)
    facing = distance > _TOUCHING
    starts = [span.start for span in geometry.spans]
    nearest, farthest = (f.reduceat(points[:, 2], starts, axis=1) for f in (np.minimum, np.maximum))
    outlines = _outlines(geometry, camera, points, facing, nearest >= NEAR)
    corners = _subpixels(outlines.uv)

    label = np.full((n, camera.size[1], camera.size[0]), -1, dtype=np.int16)
    far_to_near = np.argsort(-np.add.reduceat(points[:, 2], starts, axis=1) / geometry.counts, axis=1)
    bounds = outlines.ends.tolist()
    for j, order in enumerate(far_to_near.tolist()):
        image = label[j]
        for i in order:
            a, b = bounds[j * P + i], bounds[j * P + i + 1]
            if a < b:
                cv2.fillConvexPoly(image, corners[a:b], i, shift=_SHIFT)

    flat = label.ravel()
    index = np.flatnonzero(flat >= 0)
    group = index // label[0].size * P + flat[index]
    order = np.argsort(group.astype(np.int16) if n * P < 1 << 15 else group, kind="stable")
    index, ends = index[order], np.searchsorted(group[order], np.arange(n * P + 1))
    frame, face = np.nonzero(facing)
    linear = -(normals[frame, :, face] / distance[frame, face, None]) @ np.linalg.inv(camera.matrix)
    faces = Faces(
        linear.astype(np.float32),
        np.searchsorted(frame * P + geometry.face_owner[face], np.arange(len(ends))),
        (1 / np.maximum(farthest, NEAR)).astype(np.float32).ravel(),
    )
    share = np.minimum(np.diff(ends) / _filled(outlines), 1.0).reshape(n, P)
    return LabelImages(label, index, ends, share, outlines, faces, geometry.performer, far_to_near)


def _subpixels(uv: Array) -> NDArray[np.int32]:
    """Corners of outlines as OpenCV fills them."""
    return np.clip(np.round(uv * (1 << _SHIFT)), -_FARTHEST, _FARTHEST).astype(np.int32)


def _kept_ends(ends: NDArray[np.intp], kept: Bools) -> NDArray[np.intp]:
    """The ends of runs some of which are left out."""
    return np.concatenate([[0], np.cumsum(np.diff(ends) * kept)])


def _turned(vectors: Array, owner: Ints, R: Array) -> Array:
    """Vectors (V, 3) of parts, sorted by part, turned by the parts' rotations (n, P, 3, 3); shape (n, 3, V)."""
    n, P = R.shape[:2]
    ends = np.searchsorted(owner, np.arange(P + 1))
    parts = (R[:, i].reshape(-1, 3) @ vectors[ends[i] : ends[i + 1]].T for i in range(P))
    return np.concatenate([part.reshape(n, 3, -1) for part in parts], axis=2)


def _outlines(geometry: Geometry, camera: Camera, points: Array, facing: Bools, drawn: Bools) -> Outlines:
    """The outlines of the parts that are drawn (n, P), from vertices in camera axes (n, 3, V) and which faces look at
    the camera (n, N).
    """
    n, P = drawn.shape
    looking = (geometry.meeting @ facing.T.astype(np.int64)).T
    edge = (looking > 0) & (looking < geometry.meeting.sum(axis=1)) & drawn[:, geometry.owner]
    frame, vertex = np.nonzero(edge)
    x, y, z = points[frame, :, vertex].T
    uv = np.stack([x / z, y / z], axis=1) @ camera.matrix[:2, :2].T + camera.matrix[:2, 2]
    group = frame * P + geometry.owner[vertex]
    count = np.bincount(group, minlength=n * P)
    middle = np.stack([np.bincount(group, a, minlength=n * P) for a in uv.T], axis=1) / np.maximum(count, 1)[:, None]
    u, v = (uv - middle[group]).T
    order = np.lexsort((np.arctan2(v, u), group))
    return Outlines(uv[order], z[order], np.concatenate([[0], np.cumsum(count)]))


def _filled(outlines: Outlines) -> Array:
    """How many pixels each filled outline covers where nothing is before it, at least 1, shape (n P,)."""
    (u, v), after = outlines.uv.T, outlines.following
    twice = np.bincount(outlines.group, u * v[after] - u[after] * v, minlength=len(outlines.ends) - 1)
    length = np.hypot(u[after] - u, v[after] - v)
    # A filled outline also covers the pixels that it runs through: half its length more than its area.
    return np.maximum((twice + np.bincount(outlines.group, length, minlength=len(twice))) / 2, 1.0)
