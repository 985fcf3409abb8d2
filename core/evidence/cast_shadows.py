"""Cast shadows: the background of a fixed camera where less light falls on it than at other times.

A shadow dims all colours of a pixel by nearly the same factor. How much of the background is in shadow, by which
factors and with which tint, the key frames show: where one of them has a place in the light and another one in shadow.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ..numerics.arrays import Bools

Bytes = NDArray[np.uint8]
Array = NDArray[np.float32]

AGREEMENT = 3.0
"""Standard deviations within which two frames show the same light."""
_UNUSUAL = 0.05
"""Share of shadows that may dim by any factor."""
_STEPS = 64
"""Of a factor, per unit."""
_DARKEST = 8
"""Darker colours, grey levels of 255, do not tell what dimmed them."""
_LOGARITHMS = np.log(np.maximum(np.arange(256), 1)).astype(np.float32)


def _brightness(colours: Bytes) -> Array:
    """Mean of the colours of pixels (N, 3), grey levels of 255."""
    b, g, r = colours.astype(np.float32).T
    return np.asarray((b + g + r) * np.float32(1 / 3))


@dataclass(frozen=True, eq=False)
class ShadowModel:
    """How shadows look before a fixed camera.

    Attributes
    ----------
    cost : ndarray of float32, shape (K + 1,)
        By the factor of the brightness, k / K: the negative logarithm of how likely a pixel is dimmed by it, per unit
        of the factor, against not being in shadow.
    dimmed : ndarray of float32, shape (K + 1, 3)
        What the colours are multiplied by.
    deviation : float
        Of colours where the light is the same, grey levels of 255.
    """

    cost: Array
    dimmed: Array
    deviation: float

    @classmethod
    def of(cls, samples: Bytes, lit: Bytes, *, seen: int, deviation: float, least: float) -> ShadowModel | None:
        """Learn it from colours that are darker than the same places are in the light.

        Parameters
        ----------
        samples, lit : ndarray of uint8, shape (N, 3)
        seen : int
            How many samples there would be, were all places in shadow.
        deviation : float
            Of colours where the light is the same, grey levels of 255.
        least : float
            How many samples must be dimmed alike.

        Returns
        -------
        ShadowModel or None
            None where fewer are, or most are not: what darkens them is no shadow.
        """
        told = (np.minimum(samples, lit) >= _DARKEST).all(axis=1)
        samples, lit = samples[told], lit[told].astype(float)
        if not len(samples):
            return None
        factor = samples.mean(axis=1) / lit.mean(axis=1)
        tint = np.median(np.log(samples / lit) / np.log(factor)[:, None], axis=0)
        miss = np.abs(samples - lit * factor[:, None] ** tint).max(axis=1)
        alike = miss < AGREEMENT * deviation
        if alike.sum() < max(least, len(samples) / 2):
            return None
        steps = np.arange(_STEPS + 1) / _STEPS
        counts = np.bincount(np.rint(factor[alike] * _STEPS).astype(int), minlength=len(steps)).astype(float)
        counts = cv2.GaussianBlur(counts[:, None], (1, 0), 0, sigmaY=1.5, borderType=cv2.BORDER_REFLECT)[:, 0]
        density = (1 - _UNUSUAL) * counts / counts.sum() * _STEPS + _UNUSUAL
        share = min(alike.sum() / max(seen, 1), 0.5)
        cost = -np.log(share / (1 - share) * density)
        return cls(cost.astype(np.float32), (steps[:, None] ** tint).astype(np.float32), deviation)

    def distances(self, colours: Bytes, plate: Bytes) -> Array:
        """Negative logarithms of how likely it is that pixels are in shadow, or were when the plate was taken, against
        showing the plate as it is.

        Parameters
        ----------
        colours, plate : ndarray of uint8, shape (N, 3)

        Returns
        -------
        ndarray of float32, shape (N,)
        """
        brighter = (_brightness(colours) > _brightness(plate))[:, None]
        k, light, miss = self._explained(*(np.where(brighter, a, b) for a, b in ((plate, colours), (colours, plate))))
        squares = np.square(miss)
        misfit = (squares[:, 0] + squares[:, 1] + squares[:, 2]) * np.float32(0.5 / self.deviation**2)
        # Of all factors those explain the pixel that are as near to this one as the deviation leaves open.
        within = np.float32(np.log(np.sqrt(3) / np.sqrt(2 * np.pi) / self.deviation)) + _LOGARITHMS[light]
        return np.asarray(misfit + self.cost[k] + within)

    def explains(self, colours: Bytes, lit: Bytes) -> Bools:
        """Whether colours (N, 3) are those of places in shadow whose colours in the light (N, 3) are known."""
        k, _, miss = self._explained(colours, lit)
        return (np.abs(miss).max(axis=1, initial=0) < AGREEMENT * self.deviation) & (k < _STEPS)

    def _explained(self, dark: Bytes, lit: Bytes) -> tuple[NDArray[np.intp], NDArray[np.intp], Array]:
        """Steps of factors, brightness in the light, and what of the dark colours (N, 3) is left unexplained."""
        light = np.maximum(_brightness(lit), np.float32(1))
        k = np.minimum(np.rint(_brightness(dark) / light * np.float32(_STEPS)), _STEPS).astype(np.intp)
        return k, np.rint(light).astype(np.intp), dark - self.dimmed[k] * lit
