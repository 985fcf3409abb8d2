"""Label and depth images: which part, and how far, every pixel of a posed scene shows (paper 000, section 2.3).

OpenCV fills the convex outlines of the parts, painted far to near. A convex polyhedron is entered through the farthest
of the planes of its faces that look at the camera, and in the image the inverse depth of a plane is linear, so the
depth of a pixel is the minimum of a few linear functions: exact, and without drawing a single triangle.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from .body import Body
from .cameras import Camera

Array = NDArray[np.float64]

NEAR = 0.05
"""Parts with a vertex nearer than this (metres before the camera) are not drawn."""
_SHIFT = 4  # fractional bits of the outlines given to OpenCV
_FARTHEST = 1 << 20


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
    """

    vertices: Array
    owner: NDArray[np.int64]
    spans: tuple[slice, ...]
    planes: Array
    face_owner: NDArray[np.int64]

    @property
    def counts(self) -> NDArray[np.int64]:
        """Number of vertices of each part, shape (P,)."""
        return np.array([span.stop - span.start for span in self.spans])

    @classmethod
    def of(cls, bodies: Sequence[Body]) -> Geometry:
        parts = [part for body in bodies for part in body.parts]
        return cls.joined([part.vertices for part in parts], [np.unique(p.planes.round(9), axis=0) for p in parts])

    @classmethod
    def joined(cls, vertices: Sequence[Array], planes: Sequence[Array]) -> Geometry:
        """From every part's vertices and planes."""
        count = np.arange(len(vertices))
        ends = np.cumsum([0] + [len(v) for v in vertices])
        return cls(
            np.concatenate(vertices),
            np.repeat(count, [len(v) for v in vertices]),
            tuple(slice(int(a), int(b)) for a, b in itertools.pairwise(ends)),
            np.concatenate(planes),
            np.repeat(count, [len(p) for p in planes]),
        )

    def subset(self, parts: Sequence[int]) -> Geometry:
        """Some of the parts alone, in that order."""
        vertices = [self.vertices[self.spans[part]] for part in parts]
        planes = [self.planes[self.face_owner == part] for part in parts]
        return Geometry.joined(vertices, planes)


@dataclass(frozen=True, eq=False)
class Outlines:
    """The convex outlines of the parts that are drawn, in n frames.

    Attributes
    ----------
    uv : ndarray, shape (n, V, 2)
        Where the vertices of all parts are in the image, pixels.
    depth : ndarray, shape (n, V)
        How far they are, metres.
    frame, part : ndarray of int, shape (N,)
        Of each outline.
    corners : list of ndarray of int
        Its vertices, of the V; clockwise as the image is seen.
    """

    uv: Array
    depth: Array
    frame: NDArray[np.intp]
    part: NDArray[np.intp]
    corners: list[NDArray[np.intp]]


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
    inverse_depth : ndarray of float32, shape (N,)
        1/z of the surface there, 1/metres.
    share : ndarray, shape (n, P)
        Visible area of each part over its whole projected area, 0 to 1 (section 5.3). Hidden by itself, by others, and
        beyond the picture's edge count alike.
    outlines : Outlines
    """

    part: NDArray[np.int16]
    index: NDArray[np.intp]
    ends: NDArray[np.intp]
    inverse_depth: NDArray[np.float32]
    share: Array
    outlines: Outlines

    def box(self) -> tuple[int, int, int, int]:
        """Left, top, right and bottom of the pixels that show a part in any frame, the latter two exclusive."""
        seen = self.part.max(axis=0) >= 0
        u, v = np.flatnonzero(seen.any(axis=0)), np.flatnonzero(seen.any(axis=1))
        return (int(u[0]), int(v[0]), int(u[-1]) + 1, int(v[-1]) + 1) if len(u) else (0, 0, 0, 0)

    def places(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Column and row, in their images, of the pixels of `index`."""
        n, height, width = self.part.shape
        per_frame = np.diff(self.ends[:: self.share.shape[1]])
        pixel = self.index - np.repeat(np.arange(n) * height * width, per_frame)
        v = pixel // width
        return pixel - v * width, v

    def part_at(self, frame: NDArray[np.intp], u: NDArray[np.floating], v: NDArray[np.floating]) -> NDArray[np.int16]:
        """The parts seen nearest to places in frames; -2 beyond the picture."""
        return pixels_at(self.part, frame, u, v, np.int16(-2))

    def depth_images(self) -> NDArray[np.float32]:
        """z in metres, infinite where there is no part, shape (n, h, w)."""
        images = np.full(self.part.size, np.inf, dtype=np.float32)
        images[self.index] = 1 / self.inverse_depth
        return images.reshape(self.part.shape)


def pixels_at(
    images: NDArray[Any], frame: NDArray[np.intp], u: NDArray[np.floating], v: NDArray[np.floating], beyond: Any
) -> NDArray[Any]:
    """The pixels of images (n, h, w) nearest to places in frames, all broadcast; `beyond` where there is none."""
    _, height, width = images.shape
    column, row = np.rint(u), np.rint(v)
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    index = np.where(inside, (frame * height + row) * width + column, 0).astype(np.intp)
    return np.where(inside, images.ravel().take(index), beyond)


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
    points = np.einsum("nvab,vb->nva", R_cam[:, geometry.owner], geometry.vertices) + T_cam[:, geometry.owner]
    depth = np.maximum(points[..., 2], NEAR)
    pixels = points[..., :2] / depth[..., None] @ camera.matrix[:2, :2].T + camera.matrix[:2, 2]
    corners = np.clip(np.round(pixels * (1 << _SHIFT)), -_FARTHEST, _FARTHEST).astype(np.int32)
    exact = pixels.astype(np.float32)
    starts = [span.start for span in geometry.spans]
    drawn = np.minimum.reduceat(points[..., 2], starts, axis=1) >= NEAR
    far_to_near = np.argsort(-np.add.reduceat(points[..., 2], starts, axis=1) / geometry.counts, axis=1)

    label = np.full((n, camera.size[1], camera.size[0]), -1, dtype=np.int16)
    whole = np.ones((n, P))
    hulls = []
    for j in range(n):
        for i in far_to_near[j]:
            if drawn[j, i]:
                hull = starts[i] + cv2.convexHull(exact[j, geometry.spans[i]], returnPoints=False)[:, 0]
                hulls.append((j, int(i), hull))
                outline = corners[j, hull]
                cv2.fillConvexPoly(label[j], outline, int(i), shift=_SHIFT)
                # A filled outline also covers the pixels that it runs through: half its length more than its area.
                area = cv2.contourArea(outline) / 4**_SHIFT
                whole[j, i] = max(area + cv2.arcLength(outline, True) / 2 ** (_SHIFT + 1), 1.0)

    flat = label.ravel()
    index = np.flatnonzero(flat >= 0)
    group = index // label[0].size * P + flat[index]
    order = np.argsort(group.astype(np.int16) if n * P < 1 << 15 else group, kind="stable")
    index, ends = index[order], np.searchsorted(group[order], np.arange(n * P + 1))
    inverse_depth = _inverse_depths(geometry, R_cam, T_cam, np.linalg.inv(camera.matrix), index, ends, label.shape)
    # A filled outline's rim lies just outside the part, where its planes may meet far behind it.
    farthest = 1 / np.maximum.reduceat(depth, starts, axis=1)
    inverse_depth = np.maximum(inverse_depth, np.repeat(farthest.ravel(), np.diff(ends)).astype(np.float32))
    share = np.minimum(np.diff(ends).reshape(n, P) / whole, 1.0)
    frames, parts = (np.array([hull[k] for hull in hulls], dtype=np.intp) for k in range(2))
    outlines = Outlines(pixels, depth, frames, parts, [hull[2] for hull in hulls])
    return LabelImages(label, index, ends, inverse_depth, share, outlines)


def _inverse_depths(
    geometry: Geometry,
    R_cam: Array,
    T_cam: Array,
    K_inv: Array,
    index: NDArray[np.intp],
    ends: NDArray[np.intp],
    shape: tuple[int, ...],
) -> NDArray[np.float32]:
    """1/z where the rays of pixels enter the parts that they show, shape (N,)."""
    owner, P = geometry.face_owner, len(geometry.spans)
    normals = np.einsum("nfab,fb->nfa", R_cam[:, owner], geometry.planes[:, :3])
    distance = geometry.planes[:, 3] - np.einsum("nfa,nfa->nf", normals, T_cam[:, owner])
    frame, face = np.nonzero(distance > 1e-6)  # the camera is before these faces
    linear = (-(normals[frame, face] / distance[frame, face, None]) @ K_inv).astype(np.float32)
    faces = np.searchsorted(frame * P + owner[face], np.arange(len(ends)))
    rays = np.ones((3, len(index)), dtype=np.float32)
    row, rays[0] = np.divmod(index, shape[2])
    rays[1] = row % shape[1]
    out = np.empty(len(index), dtype=np.float32)
    for k in np.flatnonzero(np.diff(ends)):
        pixels = slice(ends[k], ends[k + 1])
        np.minimum.reduce(linear[faces[k] : faces[k + 1]] @ rays[:, pixels], axis=0, out=out[pixels])
    return out
