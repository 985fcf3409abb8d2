"""Balls of the wand and of the L-frame as the cameras of a capture see them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...numerics.arrays import Array, Ints


@dataclass(frozen=True, eq=False)
class BallObservations:
    """Balls seen by cameras.

    Attributes
    ----------
    camera : ndarray of int, shape (n,)
    ball : ndarray of int, shape (n,)
        0 or 1 of the wand; 0 to 3 of the L-frame.
    frame : ndarray, shape (n,)
        Frame of the camera's video; unused for the L-frame.
    uv : ndarray, shape (n, 2)
        Pixels, distorted.
    sigma : ndarray, shape (n,)
        Pixels.
    elongation : ndarray, shape (n, 2), optional
        See `Markers.elongation`.
    """

    camera: Ints
    ball: Ints
    frame: Array
    uv: Array
    sigma: Array
    elongation: Array | None = None

    def __len__(self) -> int:
        return len(self.camera)

    @classmethod
    def joined(cls, parts: Sequence[BallObservations]) -> BallObservations:
        """Return the observations of several sets."""
        longer = [np.zeros_like(part.uv) if part.elongation is None else part.elongation for part in parts]
        columns = zip(*((part.camera, part.ball, part.frame, part.uv, part.sigma) for part in parts), strict=True)
        camera, ball, frame, uv, sigma = (np.concatenate(column) for column in columns)
        return cls(camera, ball, frame, uv, sigma, np.concatenate(longer))

    def take(self, chosen: NDArray[Any]) -> BallObservations:
        """Return some of the observations."""
        longer = None if self.elongation is None else self.elongation[chosen]
        camera, ball, frame, uv, sigma = (x[chosen] for x in (self.camera, self.ball, self.frame, self.uv, self.sigma))
        return BallObservations(camera, ball, frame, uv, sigma, longer)

    def whitened(self, values: Array) -> Array:
        """Convert pixels (n, 2, ...) to standard deviations, with the square root of the inverse covariance."""
        return self._scaled(values, -0.5)

    def in_pixels(self, values: Array) -> Array:
        """Convert standard deviations (n, 2, ...) to pixels, same shape."""
        return self._scaled(values, 0.5)

    def _scaled(self, values: Array, power: float) -> Array:
        column = (slice(None), *(None,) * (values.ndim - 1))
        scaled = values * (self.sigma ** (2 * power))[column]
        if self.elongation is None or not self.elongation.any():
            return np.asarray(scaled)
        e = np.linalg.norm(self.elongation, axis=1)
        way = self.elongation / np.maximum(e, 1e-12)[:, None]
        along = np.einsum("ni,nj,nj...->ni...", way, way, scaled)
        across, longer = ((1 - e) ** power)[column], ((1 + e) ** power)[column]
        return np.asarray(across * scaled + (longer - across) * along)
