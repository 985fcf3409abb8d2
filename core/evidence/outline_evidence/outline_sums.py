"""Outline evidence summed up by part: the normal equations of the parts' twists."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...cameras.camera import Camera
from ...numerics.arrays import Array, Bools
from ..gradient_evidence.image_wrenches import camera_twist
from .outline_lines import Lines


@dataclass(frozen=True, eq=False)
class OutlineSums:
    """Normal equations of the twists of P parts in n frames.

    Attributes
    ----------
    H : ndarray, shape (n, P, 6, 6)
        Sums of products of wrenches about the world's origin per metre of outline.
    g : ndarray, shape (n, P, 6)
        Gradient of half the energy.
    energy : ndarray, shape (n,)
        Robust sum of the squared shifts (Tukey's error).
    """

    H: Array
    g: Array
    energy: Array

    def of_frames(self, whole: Array) -> OutlineSums:
        """Return the sums without those of damaged frames, where `whole`, shape (n,), is 0; elsewhere it is 1."""
        return OutlineSums(self.H * whole[:, None, None, None], self.g * whole[:, None, None], self.energy * whole)

    def of_parts(self, seen: Bools) -> OutlineSums:
        """Return the sums with the normal equations of some parts alone, (n, P); paper 1, equation (38)."""
        return replace(self, H=self.H * seen[..., None, None], g=self.g * seen[..., None])

    def without_equations(self) -> OutlineSums:
        """Return the sums without the normal equations."""
        return replace(self, H=self.H[:0].copy(), g=self.g[:0].copy())


def outline_sums(lines: Lines, camera: Camera, first: int, shape: tuple[int, int]) -> OutlineSums:
    """Sum the lines across the outlines of P parts in n frames of one view, given as shape (n, P).

    `first` is the shot frame of the first of them.
    """
    n, P = shape
    sums = lines.products(np.concatenate([lines.wrenches(camera), -lines.shift[:, None]], axis=1), n, P)
    A = camera_twist(*camera.poses(first, n))[:, None]
    A_t = np.swapaxes(A, -1, -2)
    energy = np.bincount(lines.frame, lines.error * lines.length, minlength=n).astype(float)
    return OutlineSums(A_t @ sums[..., :6, :6] @ A, (A_t @ sums[..., :6, 6:])[..., 0], energy)
