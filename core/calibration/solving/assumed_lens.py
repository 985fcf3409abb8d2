"""What is assumed of a camera whose lens is still to be found."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ...numerics.arrays import Array


@dataclass(frozen=True, eq=False)
class Lens:
    """What is assumed of a camera beforehand.

    Attributes
    ----------
    size : tuple of int
        Pixels.
    focals : ndarray, shape (G,)
        Focal lengths that come into question, pixels.
    matrix : ndarray, shape (3, 3), or None
        Where it is known.
    distortions : ndarray or None
        Where they are known.
    """

    size: tuple[int, int]
    focals: Array
    matrix: Array | None = None
    distortions: Array | None = None

    @property
    def centre(self) -> Array:
        """Principal point, pixels."""
        return (np.array(self.size) - 1) / 2 if self.matrix is None else self.matrix[:2, 2]

    def straight(self, points: Array, bend: float) -> Array:
        """Points, shape (n, 2), about the principal point with square pixels, as without distortion.

        `bend` is the coefficient of the division model (A. Fitzgibbon, CVPR 2001) on half the picture's diagonal;
        a known distortion goes before it.
        """
        if self.distortions is not None and self.matrix is not None:
            flat = cv2.undistortPoints(points[:, None], self.matrix, self.distortions)[:, 0]
            return np.asarray(flat * self.matrix[0, 0])
        stretch = 1.0 if self.matrix is None else np.array([1.0, self.matrix[0, 0] / self.matrix[1, 1]])
        x = (points - self.centre) * stretch
        r2 = (x**2).sum(axis=1, keepdims=True) / (np.array(self.size) ** 2).sum() * 4
        return np.asarray(x / (1 + bend * r2))

    def k1(self, focal: float, bend: float) -> float:
        """Return the coefficient k1 that bends nearly as much."""
        return 0.0 if self.distortions is not None else bend * 4 * focal**2 / float((np.array(self.size) ** 2).sum())
