"""Label and depth images: which part, and how far, every pixel of a posed scene shows (paper 000, section 2.3).

OpenCV fills the convex outlines of the parts, painted far to near. A convex polyhedron is entered through the farthest
of the planes of its faces that look at the camera, and in the image the inverse depth of a plane is linear, so the
depth of a pixel is the minimum of a few linear functions: exact, and without drawing a single triangle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

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
    face_spans : tuple of slice
        The planes of each part.
    """

    vertices: Array
    owner: NDArray[np.int64]
    spans: tuple[slice, ...]
    planes: Array
    face_owner: NDArray[np.int64]
    face_spans: tuple[slice, ...]

    @classmethod
    def of(cls, bodies: Sequence[Body]) -> Geometry:
        parts = [part for body in bodies for part in body.parts]
        vertices = [part.vertices for part in parts]
        planes = [np.unique(part.planes.round(9), axis=0) for part in parts]
        return cls(
            np.concatenate(vertices), *_grouped(vertices), np.concatenate(planes), *_grouped(planes)
        )


def _grouped(arrays: Sequence[Array]) -> tuple[NDArray[np.int64], tuple[slice, ...]]:
    """Which array each row of a concatenation comes from, and each array's rows."""
    ends = np.cumsum([0] + [len(array) for array in arrays])
    spans = tuple(slice(int(a), int(b)) for a, b in zip(ends[:-1], ends[1:], strict=True))
    return np.repeat(np.arange(len(arrays)), np.diff(ends)), spans


@dataclass(frozen=True, eq=False)
class LabelImage:
    """What a camera sees of the posed parts.

    Attributes
    ----------
    part : ndarray of int16, shape (h, w)
        The part seen, counted over all P parts of all performers; -1 where there is none.
    spans : tuple of slice
        Which of the N pixels that show a part belong to each of the P parts.
    index : ndarray of int, shape (N,)
        Those pixels in the flattened image, sorted by part.
    inverse_depth : ndarray of float32, shape (N,)
        1/z of the surface there, 1/metres.
    share : ndarray, shape (P,)
        Visible area of each part over its whole projected area, 0 to 1 (section 5.3). Hidden by itself, by others, and
        beyond the picture's edge count alike.
    """

    part: NDArray[np.int16]
    spans: tuple[slice, ...]
    index: NDArray[np.intp]
    inverse_depth: NDArray[np.float32]
    share: Array

    def box(self) -> tuple[int, int, int, int]:
        """Left, top, right and bottom of the pixels that show a part, the latter two exclusive; all 0 if none does."""
        return _box(self.index, self.part.shape[1])

    def depth_image(self) -> NDArray[np.float32]:
        """z in metres, infinite where there is no part, shape (h, w)."""
        image = np.full(self.part.size, np.inf, dtype=np.float32)
        image[self.index] = 1 / self.inverse_depth
        return image.reshape(self.part.shape)


def render_labels(geometry: Geometry, camera: Camera, frame: int, R: Array, T: Array) -> LabelImage:
    """Label and depth image of posed parts.

    Parameters
    ----------
    geometry : Geometry
    camera : Camera
        Without lens distortion, of the size of the image wanted.
    frame : int
        Shot frame, for the pose of a moving camera.
    R, T : ndarray, shape (P, 3, 3) and (P, 3)
        World pose of every part, counted over all performers.
    """
    Rc, tc = camera.pose(frame)
    R_cam, T_cam = Rc @ R, T @ Rc.T + tc
    points = (R_cam[geometry.owner] @ geometry.vertices[..., None])[..., 0] + T_cam[geometry.owner]
    K = camera.matrix
    z = np.maximum(points[:, 2:], NEAR)
    pixels = (points[:, :2] / z) @ K[:2, :2].T + K[:2, 2]
    corners = np.clip(np.round(pixels * (1 << _SHIFT)), -_FARTHEST, _FARTHEST).astype(np.int32)
    starts = [span.start for span in geometry.spans]
    before = np.minimum.reduceat(points[:, 2], starts) >= NEAR
    middle = np.add.reduceat(points[:, 2], starts) / [span.stop - span.start for span in geometry.spans]

    label = np.full((camera.size[1], camera.size[0]), -1, dtype=np.int16)
    whole = np.ones(len(starts))
    for i in np.argsort(-middle):
        if before[i]:
            outline = cv2.convexHull(corners[geometry.spans[i]])
            cv2.fillConvexPoly(label, outline, int(i), shift=_SHIFT)
            # A filled outline also covers the pixels that it runs through: half its length more than its area.
            area = cv2.contourArea(outline) / 4**_SHIFT
            whole[i] = max(area + cv2.arcLength(outline, True) / 2 ** (_SHIFT + 1), 1.0)

    flat = label.ravel()
    index = np.flatnonzero(flat >= 0)
    index = index[np.argsort(flat[index], kind="stable")]
    ends = np.searchsorted(flat[index], np.arange(len(starts) + 1))
    spans = tuple(slice(a, b) for a, b in zip(ends[:-1], ends[1:], strict=True))
    inverse_depth = _inverse_depths(geometry, R_cam, T_cam, np.linalg.inv(K), index, spans, camera.size[0])
    return LabelImage(label, spans, index, inverse_depth, np.minimum(np.diff(ends) / whole, 1.0))


def _inverse_depths(
    geometry: Geometry,
    R_cam: Array,
    T_cam: Array,
    K_inv: Array,
    index: NDArray[np.intp],
    spans: tuple[slice, ...],
    width: int,
) -> NDArray[np.float32]:
    """1/z where the rays of pixels enter the parts that they show, shape (N,)."""
    normals = (R_cam[geometry.face_owner] @ geometry.planes[:, :3, None])[..., 0]
    distance = geometry.planes[:, 3] - np.einsum("na,na->n", normals, T_cam[geometry.face_owner])
    facing = distance > 1e-6  # the camera is before the face
    linear = -(normals / np.where(facing, distance, np.inf)[:, None]) @ K_inv
    linear[~facing] = 0.0, 0.0, 1 / NEAR**2  # farther in than any other
    linear = linear.astype(np.float32)
    rays = np.ones((3, len(index)), dtype=np.float32)
    rays[1], rays[0] = np.divmod(index, width)
    out = np.empty(len(index), dtype=np.float32)
    for faces, span in zip(geometry.face_spans, spans, strict=True):
        if span.stop > span.start:
            np.min(linear[faces] @ rays[:, span], axis=0, out=out[span])
    return out


def _box(index: NDArray[np.intp], width: int) -> tuple[int, int, int, int]:
    if not len(index):
        return 0, 0, 0, 0
    v, u = np.divmod(index, width)
    return int(u.min()), int(v.min()), int(u.max()) + 1, int(v.max()) + 1
