"""Label and depth images: which part, and how far, every pixel of a posed scene shows (paper 000, section 2.3).

A convex polyhedron is entered through the farthest of the planes of its faces that look at the camera. In the image
the inverse depth of a plane is linear, so the depth of a part is the minimum of a few linear functions of the pixel:
exact, and without drawing a single triangle. OpenCV fills the parts' outlines; a depth buffer decides between parts.
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
    planes : tuple of ndarray, shape (N, 4)
        Each part's face planes, see `Part.planes`; faces in one plane are listed once.
    """

    vertices: Array
    owner: NDArray[np.int64]
    spans: tuple[slice, ...]
    planes: tuple[Array, ...]

    @classmethod
    def of(cls, bodies: Sequence[Body]) -> Geometry:
        parts = [part for body in bodies for part in body.parts]
        ends = np.cumsum([0] + [len(part.vertices) for part in parts])
        return cls(
            np.concatenate([part.vertices for part in parts]),
            np.repeat(np.arange(len(parts)), np.diff(ends)),
            tuple(slice(a, b) for a, b in zip(ends[:-1], ends[1:], strict=True)),
            tuple(np.unique(part.planes.round(9), axis=0) for part in parts),
        )


@dataclass(frozen=True, eq=False)
class LabelImage:
    """What a camera sees of the posed parts.

    Attributes
    ----------
    part : ndarray of int16, shape (h, w)
        The part seen, counted over all performers; -1 where there is none.
    inverse_depth : ndarray of float32, shape (h, w)
        1/z of the surface, 1/metres; 0 where there is none.
    share : ndarray, shape (P,)
        Visible area of each part over its whole projected area, 0 to 1 (section 5.3). Hidden by itself, by others, and
        beyond the picture's edge count alike.
    """

    part: NDArray[np.int16]
    inverse_depth: NDArray[np.float32]
    share: Array


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
    points = np.einsum("vab,vb->va", R_cam[geometry.owner], geometry.vertices) + T_cam[geometry.owner]
    K = camera.matrix
    with np.errstate(divide="ignore", invalid="ignore"):
        pixels = (points[:, :2] / points[:, 2:]) @ K[:2, :2].T + K[:2, 2]
    K_inv = np.linalg.inv(K)

    width, height = camera.size
    label = np.full((height, width), -1, dtype=np.int16)
    buffer = np.zeros((height, width), dtype=np.float32)
    whole = np.zeros(len(geometry.spans))
    for i, span in enumerate(geometry.spans):
        if points[span, 2].min() < NEAR:
            continue
        outline = cv2.convexHull(pixels[span].astype(np.float32))[:, 0]
        x0, y0 = np.floor(outline.min(axis=0)).astype(int)
        x1, y1 = np.ceil(outline.max(axis=0)).astype(int) + 1
        left, top, right, bottom = max(x0, 0), max(y0, 0), min(x1, width), min(y1, height)
        if left >= right or top >= bottom:
            whole[i] = max(cv2.contourArea(outline), 1.0)
            continue
        mask = np.zeros((bottom - top, right - left), dtype=np.uint8)
        corners = np.round((outline - [left, top]) * (1 << _SHIFT)).astype(np.int32)
        cv2.fillConvexPoly(mask, corners, 1, shift=_SHIFT)
        clipped = left > x0 or top > y0 or right < x1 or bottom < y1
        whole[i] = max(cv2.countNonZero(mask), cv2.contourArea(outline) if clipped else 0.0, 1.0)
        window = (slice(top, bottom), slice(left, right))
        inverse = _inverse_depth(geometry.planes[i], R_cam[i], T_cam[i], K_inv, window)
        nearer = (inverse > buffer[window]) & mask.view(bool)
        np.copyto(buffer[window], inverse, where=nearer)
        np.copyto(label[window], np.int16(i), where=nearer)
    visible = np.bincount(label.ravel() + 1, minlength=len(whole) + 1)[1:]
    return LabelImage(label, buffer, np.divide(visible, whole, out=np.zeros_like(whole), where=whole > 0))


def _inverse_depth(
    planes: Array, R_cam: Array, T_cam: Array, K_inv: Array, window: tuple[slice, slice]
) -> NDArray[np.float32]:
    """1/z where the rays of a window's pixels enter a convex part, shape of the window."""
    normals = planes[:, :3] @ R_cam.T
    distance = planes[:, 3] - normals @ T_cam  # of the camera before each plane
    facing = distance > 1e-6
    a, b, c = (-(normals[facing] / distance[facing, None]) @ K_inv).astype(np.float32).T
    v, u = (np.arange(w.start, w.stop, dtype=np.float32) for w in window)
    along_u, along_v = np.outer(a, u) + c[:, None], np.outer(b, v)
    return (along_v[:, :, None] + along_u[:, None, :]).min(axis=0)
