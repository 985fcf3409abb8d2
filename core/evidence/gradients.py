"""Spatio-temporal gradient evidence by wrench accumulation (paper 000, equations (8) to (12)).

A pixel that shows a part in frame a is a fixed point of that part and looks the same in frame b (brightness
constancy). With m = (dE/du)(du/dx), the gradient of the brightness against the point, the pixel's row against the
part's twist is its wrench (m, x cross m). Products of wrenches are summed per part, twelve by twelve (six for frame a,
six for frame b), so the cost per pixel does not depend on the number of joints, and cameras simply add.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from .. import rotations
from ..cameras import Camera
from ..visibility import LabelImage

Array = NDArray[np.float64]
Image = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class GradientImage:
    """A frame as the evidence needs it: brightness 0 to 1 and its derivatives per pixel, each (h, w)."""

    brightness: Image
    du: Image
    dv: Image

    @classmethod
    def of(cls, grey: NDArray[np.uint8], sigma: float) -> GradientImage:
        """From an 8-bit frame, smoothed by a Gaussian of `sigma` pixels."""
        smooth = cv2.GaussianBlur(grey.astype(np.float32) * (1 / 255), (0, 0), sigma)
        return cls(
            smooth,
            cv2.Scharr(smooth, cv2.CV_32F, 1, 0, scale=1 / 32),
            cv2.Scharr(smooth, cv2.CV_32F, 0, 1, scale=1 / 32),
        )

    def sample(self, pixels: NDArray[np.float32]) -> tuple[Image, Image, Image]:
        """Brightness and derivatives at sub-pixel places, shape (N, 2), bilinear."""
        places = np.ascontiguousarray(pixels, dtype=np.float32)[:, None]
        out = [cv2.remap(c, places, None, cv2.INTER_LINEAR)[:, 0] for c in (self.brightness, self.du, self.dv)]
        return out[0], out[1], out[2]


@dataclass(frozen=True, eq=False)
class WrenchSums:
    """Normal equations of the twists of P parts in two frames.

    Attributes
    ----------
    H : ndarray, shape (P, 12, 12)
        Sums of products of wrenches, frame a's six before frame b's, about the world's origin.
    g : ndarray, shape (P, 12)
        Sums of wrenches times residuals: the gradient of half the energy.
    energy : float
        Weighted sum of squared residuals.
    count : float
        Sum of weights.
    """

    H: Array
    g: Array
    energy: float
    count: float

    def __add__(self, other: WrenchSums) -> WrenchSums:
        return WrenchSums(
            self.H + other.H, self.g + other.g, self.energy + other.energy, self.count + other.count
        )


def huber_weights(residual: Image, scale: float) -> Image:
    """Weights of Huber's robust error: one up to 1.345 scales, then falling as 1/|r|."""
    limit = np.float32(1.345 * scale)
    return np.minimum(np.float32(1), limit / np.maximum(np.abs(residual), 1e-12))


def gradient_wrenches(
    camera: Camera,
    image_a: GradientImage,
    image_b: GradientImage,
    labels_a: LabelImage,
    labels_b: LabelImage,
    poses_a: tuple[Array, Array],
    poses_b: tuple[Array, Array],
    stride: int,
    frames: tuple[int, int],
    scale: float | None = None,
):
    R_a, T_a = poses_a
    R_b, T_b = poses_b
    P = len(T_a)
    flat = labels_a.part.ravel()
    index = np.flatnonzero(flat >= 0)
    part = flat[index]
    order = np.argsort(part, kind="stable")
    index, part = index[order], part[order]
    width = labels_a.part.shape[1]
    u = (index % width * stride).astype(np.float32)
    v = (index // width * stride).astype(np.float32)
    K = camera.matrix.astype(np.float32)
    z = 1 / labels_a.inverse_depth.ravel()[index]
    x_a = np.stack([(u - K[0, 2]) / K[0, 0] * z, (v - K[1, 2]) / K[1, 1] * z, z], axis=1)

    Rc_a, tc_a = camera.pose(frames[0])
    Rc_b, tc_b = camera.pose(frames[1])
    M = R_b @ np.swapaxes(R_a, -1, -2)
    G = Rc_b @ M @ Rc_a.T
    s = (T_b - np.einsum("pab,pb->pa", M, T_a)) @ Rc_b.T + tc_b - np.einsum("pab,b->pa", Rc_b @ M @ Rc_a.T, tc_a)
    # s: x_b = Rc_b (M (Rc_a^T (x_a - tc_a)) + T_b - M T_a) + tc_b
    starts = np.searchsorted(part, np.arange(P + 1))
    x_b = np.empty_like(x_a)
    for p in range(P):
        w = slice(starts[p], starts[p + 1])
        if w.stop > w.start:
            x_b[w] = x_a[w] @ G[p].T.astype(np.float32) + s[p].astype(np.float32)
    zi = 1 / x_b[:, 2]
    ub = np.stack([x_b[:, 0] * zi * K[0, 0] + K[0, 2], x_b[:, 1] * zi * K[1, 1] + K[1, 2]], axis=1)
    E_b, du_b, dv_b = image_b.sample(ub)
    ui, vi = u.astype(np.intp), v.astype(np.intp)
    residual = E_b - image_a.brightness[vi, ui]
    gu = 0.5 * (du_b + image_a.du[vi, ui])
    gv = 0.5 * (dv_b + image_a.dv[vi, ui])
    # still seen in b?
    hb, wb = labels_b.part.shape
    ib = np.round(ub / stride).astype(np.intp)
    inside = (ib[:, 0] >= 0) & (ib[:, 0] < wb) & (ib[:, 1] >= 0) & (ib[:, 1] < hb)
    ib[~inside] = 0
    seen = inside & (labels_b.part[ib[:, 1], ib[:, 0]] == part)
    if scale is None:
        scale = 1.4826 * float(np.median(np.abs(residual[seen]))) + 1e-4
    weight = huber_weights(residual, scale) * seen
    def wrench(x):
        zi = 1 / x[:, 2]
        mx, my = gu * K[0, 0] * zi, gv * K[1, 1] * zi
        mz = -(mx * x[:, 0] + my * x[:, 1]) * zi
        return np.stack([mx, my, mz, x[:, 1] * mz - x[:, 2] * my, x[:, 2] * mx - x[:, 0] * mz, x[:, 0] * my - x[:, 1] * mx], axis=1)
    rows = np.concatenate([-wrench(x_a), wrench(x_b), residual[:, None]], axis=1)
    weighted = rows * weight[:, None]
    S = np.zeros((P, 13, 13))
    for p in range(P):
        w = slice(starts[p], starts[p + 1])
        if w.stop > w.start:
            S[p] = rows[w].T @ weighted[w]
    A = np.zeros((12, 12))
    for k, (Rc, tc) in enumerate(((Rc_a, tc_a), (Rc_b, tc_b))):
        A[6 * k : 6 * k + 6, 6 * k : 6 * k + 6] = camera_twist(Rc, tc)
    H = A.T @ S[:, :12, :12] @ A
    g = S[:, :12, 12] @ A
    return WrenchSums(H, g, float(S[:, 12, 12].sum()), float(weight.sum())), scale


def camera_twist(Rc: Array, tc: Array) -> Array:
    """Takes a world twist (v, omega) about the world's origin to camera axes about the camera's centre, (6, 6)."""
    A = np.zeros((6, 6))
    A[:3, :3] = Rc
    A[3:, 3:] = Rc
    A[:3, 3:] = rotations.skew(tc) @ Rc
    return A
