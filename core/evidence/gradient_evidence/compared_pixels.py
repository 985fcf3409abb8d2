"""Pixels that show parts, and where their points are on the next frame."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from ...body.kinematics import Poses
from ...cameras.camera import Camera
from ..foreground_images.foreground import log_ratio
from ..rendering.label_images import LabelImages
from ..smoothed_images import Image, SmoothedImages

BACKGROUND_BELOW = -0.5
"""Log likelihood ratio below which a pixel within the model's outline counts as background."""


@dataclass(frozen=True, eq=False)
class Pixels:
    """The pixels of n label images that show a part.

    Attributes
    ----------
    frame, part : ndarray of int, shape (N,)
    ends : ndarray of int
        See `LabelImages`.
    uv : ndarray of int, shape (N, 2)
        Their positions in the view's frames, pixels.
    points_cam : ndarray of float32, shape (N, 3)
        The points that they show, in camera axes, metres.
    """

    frame: NDArray[np.intp]
    part: NDArray[np.intp]
    ends: NDArray[np.intp]
    uv: NDArray[np.intp]
    points_cam: Image

    @classmethod
    def of(cls, labels: LabelImages, camera: Camera, stride: int, frames: int) -> Pixels:
        """Return the pixels of the first `frames` label images, which have every stride-th pixel of the camera's
        frames.
        """
        P = labels.share.shape[1]
        ends = labels.ends[: frames * P + 1]
        frame, u, v = (a[: ends[-1]] for a in labels.places)
        part = np.repeat(np.tile(np.arange(P), frames), np.diff(ends))
        uv = stride * np.stack([u, v])
        K = camera.matrix.astype(np.float32)
        points = np.empty((3, ends[-1]), np.float32)
        points[2] = 1 / labels.inverse_depth[: ends[-1]]
        points[:2] = (uv.astype(np.float32) - K[:2, 2:]) / K[[0, 1], [0, 1]][:, None] * points[2]
        return cls(frame, part, ends, uv.T, points.T)


@dataclass(frozen=True, eq=False)
class LabelledFrames:
    """n consecutive frames of one view, with the label images of some poses.

    Attributes
    ----------
    camera : Camera
        The view's camera, for its reduced and rectified frames.
    images : SmoothedImages
        Brightness and derivatives of the frames.
    labels : LabelImages
        Label images of the frames, with every stride-th pixel.
    poses : tuple
        World poses (R, T) of all parts, (n, P, 3, 3) and (n, P, 3).
    first : int
        Shot frame of the first of them.
    stride : int
        Step between the pixels of the label images, in both directions.
    foreground : ndarray of uint8, shape (M, n, h, w), optional
        Foreground images of each performer, by which pixels that show something else are left out; see
        `core.evidence.foreground_images.foreground`.
    """

    camera: Camera
    images: SmoothedImages
    labels: LabelImages
    poses: Poses
    first: int
    stride: int
    foreground: NDArray[np.uint8] | None = None


@dataclass(frozen=True, eq=False)
class ComparedPixels:
    """N pixels that show parts on all but the last of n frames of a view, and their points on the next frame.

    Attributes
    ----------
    camera : Camera
        The view's camera, for its reduced and rectified frames.
    first : int
        Shot frame of the first frame.
    labels : LabelImages
        Label images of the n frames.
    pixels : Pixels
    points_there : ndarray, shape (N, 3)
        The points on the next frame, in its camera's axes, metres.
    uv_there : ndarray, shape (N, 2)
        Their positions in the next picture.
    here, there : ndarray, shape (3, N)
        Brightness and its derivatives on both frames.
    residual : ndarray, shape (N,)
        Difference of brightness.
    standing : ndarray, shape (N,)
        The same if the points stood still in the picture.
    seen : ndarray of bool, shape (N,)
        Which pixels are used.
    """

    camera: Camera
    first: int
    labels: LabelImages
    pixels: Pixels
    points_there: Image
    uv_there: Image
    here: Image
    there: Image
    residual: Image
    standing: Image
    seen: NDArray[np.bool_]

    @property
    def nbytes(self) -> int:
        """Size of what is stored by pixel, bytes."""
        arrays = (getattr(item, field.name) for item in (self, self.pixels, self.labels) for field in fields(item))
        return sum(array.nbytes for array in arrays if isinstance(array, np.ndarray))


def compare(frames: LabelledFrames) -> ComparedPixels:
    """Compare the pixels of parts on all but the last of some frames with their points on the next frame."""
    camera, images, labels, poses = frames.camera, frames.images, frames.labels, frames.poses
    m = len(poses[0]) - 1
    pixels = Pixels.of(labels, camera, frames.stride, m)
    x_b = _carried(pixels, camera.poses(frames.first, m + 1), poses)
    focal, centre = (a.astype(np.float32) for a in (camera.matrix[[0, 1], [0, 1]], camera.matrix[:2, 2]))
    uv_b = (x_b.T[:2] / x_b[:, 2] * focal[:, None] + centre[:, None]).T
    here, there = images.at(pixels.frame, pixels.uv), images.sample(pixels.frame + 1, uv_b)
    seen = labels.part_at(pixels.frame + 1, *(uv_b.T / frames.stride)) == pixels.part
    if frames.foreground is not None:
        seen &= log_ratio(labels.pixels_of(frames.foreground, frames.stride)[: len(seen)]) > BACKGROUND_BELOW
    standing = images.brightness_at(pixels.frame + 1, pixels.uv) - here[0]
    return ComparedPixels(
        camera=camera,
        first=frames.first,
        labels=labels,
        pixels=pixels,
        points_there=x_b,
        uv_there=uv_b,
        here=here,
        there=there,
        residual=there[0] - here[0],
        standing=standing,
        seen=seen,
    )


def _carried(pixels: Pixels, to_camera: Poses, poses: Poses) -> Image:
    """Return the pixels' points moved with their parts to the next frame, in its camera's axes, shape (N, 3)."""
    (Rc, tc), (R, T) = to_camera, poses
    R_cam, T_cam = Rc[:, None] @ R, T @ np.swapaxes(Rc, 1, 2) + tc[:, None]
    turn = R_cam[1:] @ np.swapaxes(R_cam[:-1], -1, -2)
    shift = T_cam[1:] - (turn @ T_cam[:-1, :, :, None])[..., 0]
    # In double precision: the last bit of a single-precision product depends on the alignment of arrays.
    rows = np.concatenate([turn, shift[..., None]], axis=-1).reshape(-1, 12).T
    move = np.repeat(np.ascontiguousarray(rows), np.diff(pixels.ends), axis=1)
    x, y, z = pixels.points_cam.T.astype(float)
    out = np.empty((3, len(x)), np.float32)
    for row, (a, b, c, d) in zip(out, move.reshape(3, 4, -1), strict=True):
        a *= x
        b *= y
        c *= z
        a += b
        a += c
        a += d
        row[:] = a
    return out.T
