"""Spatio-temporal gradient evidence by wrench accumulation (paper 000, equations (8) to (12)).

A pixel that shows a part in frame a is a fixed point of that part and looks the same in frame b (brightness
constancy). With m = (dE/du)(du/dx), the derivative of the brightness by the point, the pixel's row against the part's
twist is its wrench (m, x cross m). Products of wrenches are summed per part, twelve by twelve (six for frame a, six
for frame b), so the cost per pixel does not depend on the number of joints, and cameras simply add.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .. import rotations
from ..cameras import Camera
from ..visibility import LabelImage
from .images import GradientImage, Image

Array = NDArray[np.float64]
Poses = tuple[Array, Array]

HUBER = 1.345
"""Where Huber's error turns from square to linear, in standard deviations (95 % efficiency under normal noise)."""
_LEAST_NOISE = 2e-4


@dataclass(frozen=True, eq=False)
class Pixels:
    """The pixels of a label image that show a part, sorted by part.

    Attributes
    ----------
    part : ndarray of int16, shape (N,)
    spans : tuple of slice
        The pixels of each of the P parts.
    uv : ndarray of float32, shape (N, 2)
        Their places in the view's frame, pixels.
    points_cam : ndarray of float32, shape (N, 3)
        What they show, in camera axes, metres.
    """

    part: NDArray[np.int16]
    spans: tuple[slice, ...]
    uv: Image
    points_cam: Image

    @classmethod
    def of(cls, labels: LabelImage, camera: Camera, stride: int) -> Pixels:
        """Of a label image that has every stride-th pixel of the camera's frame."""
        v, u = np.divmod(labels.index, labels.part.shape[1])
        uv = np.stack([u, v], axis=1).astype(np.float32) * np.float32(stride)
        K = camera.matrix.astype(np.float32)
        z = 1 / labels.inverse_depth
        points = np.empty((len(z), 3), np.float32)
        points[:, :2] = (uv - K[:2, 2]) / K[[0, 1], [0, 1]] * z[:, None]
        points[:, 2] = z
        return cls(labels.part.ravel()[labels.index], labels.spans, uv, points)


@dataclass(frozen=True, eq=False)
class WrenchSums:
    """Normal equations of the twists of P parts in two frames.

    Attributes
    ----------
    H : ndarray, shape (P, 12, 12)
        Weighted sums of products of wrenches about the world's origin, frame a's six before frame b's.
    g : ndarray, shape (P, 12)
        Weighted sums of wrenches times residuals: the gradient of half the energy.
    energy : float
        Weighted sum of squared residuals, (grey level 0 to 1)^2.
    weight : float
        Sum of the weights.
    noise : float
        Robust standard deviation of the residuals, grey level 0 to 1.
    """

    H: Array
    g: Array
    energy: float
    weight: float
    noise: float


def brightness_constancy(
    camera: Camera,
    frames: tuple[int, int],
    images: tuple[GradientImage, GradientImage],
    pixels: Pixels,
    labels_b: LabelImage | None,
    poses: tuple[Poses, Poses],
    stride: int,
    tolerance: float,
) -> WrenchSums:
    """Sum the gradient constraint between two frames of one view.

    Parameters
    ----------
    camera : Camera
        Of the view's reduced, rectified frames.
    frames : tuple of int
        Shot frames a and b.
    images : tuple of GradientImage
        Of frames a and b.
    pixels : Pixels
        Of frame a.
    labels_b : LabelImage or None
        Of frame b, with every stride-th pixel: a point that it does not show is left out. None leaves none out.
    poses : tuple
        (R, T) of all parts, (P, 3, 3) and (P, 3), in frames a and b.
    tolerance : float
        Huber's limit in units of `HUBER` standard deviations: 1 near the solution, more far from it.
    """
    image_a, image_b = images
    to_a, to_b = (camera.pose(f) for f in frames)
    x_a = pixels.points_cam
    x_b = _carried(pixels, to_a, to_b, *poses)
    K = camera.matrix.astype(np.float32)
    uv_b = x_b[:, :2] / x_b[:, 2:] * K[[0, 1], [0, 1]] + K[:2, 2]
    here, there = image_a.at(pixels.uv), image_b.sample(uv_b)
    residual = there[0] - here[0]
    du, dv = 0.5 * (here[1:] + there[1:])
    seen = _still_seen(pixels.part, uv_b, labels_b, stride)
    noise = 1.4826 * float(np.median(np.abs(residual[seen]))) if seen.any() else 0.0
    weight = huber_weights(residual, tolerance * max(noise, _LEAST_NOISE)) * seen

    focal = K[[0, 1], [0, 1]]
    rows = np.concatenate(
        [-_wrenches(x_a, du, dv, focal), _wrenches(x_b, du, dv, focal), residual[:, None]], axis=1
    )
    weighted = rows * weight[:, None]
    sums = np.zeros((len(pixels.spans), 13, 13))
    for i, span in enumerate(pixels.spans):
        if span.stop > span.start:
            sums[i] = rows[span].T @ weighted[span]
    A = np.zeros((12, 12))
    A[:6, :6], A[6:, 6:] = camera_twist(*to_a), camera_twist(*to_b)
    return WrenchSums(
        A.T @ sums[:, :12, :12] @ A,
        sums[:, :12, 12] @ A,
        float(sums[:, 12, 12].sum()),
        float(weight.sum()),
        noise,
    )


def _carried(pixels: Pixels, to_a: Poses, to_b: Poses, poses_a: Poses, poses_b: Poses) -> Image:
    """The pixels' points, moved with their parts from frame a to frame b, in camera axes, shape (N, 3)."""
    (Rc_a, tc_a), (Rc_b, tc_b) = to_a, to_b
    (R_a, T_a), (R_b, T_b) = poses_a, poses_b
    turn = Rc_b @ (R_b @ np.swapaxes(R_a, -1, -2)) @ Rc_a.T
    joint_a, joint_b = T_a @ Rc_a.T + tc_a, T_b @ Rc_b.T + tc_b
    turn, shift = turn.astype(np.float32), (joint_b - np.einsum("pab,pb->pa", turn, joint_a)).astype(np.float32)
    points = np.empty_like(pixels.points_cam)
    for i, span in enumerate(pixels.spans):
        np.matmul(pixels.points_cam[span], turn[i].T, out=points[span])
        points[span] += shift[i]
    return points


def _still_seen(
    part: NDArray[np.int16], uv: Image, labels: LabelImage | None, stride: int
) -> NDArray[np.bool_]:
    """Which points at (N, 2) pixels of a frame show there the part that they belong to."""
    if labels is None:
        return np.ones(len(part), dtype=bool)
    height, width = labels.part.shape
    column, row = np.round(uv.T / stride).astype(np.intp)
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    return inside & (labels.part[row * inside, column * inside] == part)


def _wrenches(points: Image, du: Image, dv: Image, focal: Image) -> Image:
    """(m, x cross m) of brightness derivatives at points in camera axes, shape (N, 6)."""
    x, y, z = points.T
    out = np.empty((len(points), 6), np.float32)
    mx, my = du * focal[0] / z, dv * focal[1] / z
    mz = -(mx * x + my * y) / z
    out[:, 0], out[:, 1], out[:, 2] = mx, my, mz
    out[:, 3], out[:, 4], out[:, 5] = y * mz - z * my, z * mx - x * mz, x * my - y * mx
    return out


def huber_weights(residual: Image, deviation: float) -> Image:
    """Weights of Huber's error: one up to `HUBER` deviations, then falling as 1/|r|."""
    return np.minimum(np.float32(1), np.float32(HUBER * deviation) / np.maximum(np.abs(residual), np.float32(1e-12)))


def camera_twist(R_cam_world: Array, t_cam_world: Array) -> Array:
    """Takes a twist (v, omega) about the world's origin to camera axes and the camera's centre, shape (6, 6)."""
    A = np.zeros((6, 6))
    A[:3, :3] = A[3:, 3:] = R_cam_world
    A[:3, 3:] = rotations.skew(t_cam_world) @ R_cam_world
    return A
