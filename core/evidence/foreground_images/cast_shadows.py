"""Cast shadows on the background of a fixed camera.

A shadow multiplies all colours of a pixel by nearly the same factor. How often shadows occur, with which factors and
tint, is learned on the key frames, from places that are in the light on one of them and in shadow on another.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ...numerics.arrays import Bools
from .masks import dilated, opened

Bytes = NDArray[np.uint8]
Array = NDArray[np.float32]

SHADOW_REACH = 0.4
"""Distance from the performers within which the frequency of shadows is learned, metres, the same as that within which
performers are searched for; and distance from known shadows within which others are searched for."""
MIN_SHADOW_RADIUS = 0.02
"""Smallest radius of a shadow, metres; anything smaller may be noise."""
MIN_SHADOW_AREA = 0.02
"""Smallest area seen both in the light and in shadow from which shadows can be learned, square metres at the distance
of the performers."""
MAX_LIGHT_DIFFERENCE = 3.0
"""Difference in standard deviations up to which two frames show the same light."""
_OUTLIER_SHARE = 0.05
"""Share of shadows that may dim by any factor."""
_FACTOR_STEPS = 64
"""Steps of a factor per unit."""
_MIN_LEVEL = 8
"""Darker colours, grey levels of 255, do not show what dimmed them."""
_LOGARITHMS = np.log(np.maximum(np.arange(256), 1)).astype(np.float32)


def _brightness(colours: Bytes) -> Array:
    """Mean of the colours of pixels (3, N), grey levels of 255."""
    b, g, r = colours.astype(np.float32)
    b += g
    b += r
    b *= np.float32(1 / 3)
    return np.asarray(b)


@dataclass(frozen=True, eq=False)
class ShadowModel:
    """How shadows look in a view of a fixed camera.

    Attributes
    ----------
    cost : ndarray of float32, shape (K + 1,)
        For each factor of brightness k / K: negative log likelihood ratio, per unit of the factor, of a pixel dimmed by
        it against one in the light.
    dimmed : ndarray of float32, shape (K + 1, 3)
        For each factor of brightness: factors of the three colours.
    sigma : float
        Standard deviation of colours in the same light, grey levels (of 255).
    """

    cost: Array
    dimmed: Array
    sigma: float

    @classmethod
    def of(cls, samples: Bytes, lit: Bytes, *, seen: int, sigma: float, least: float) -> ShadowModel | None:
        """Learn the model from places that are darker on one frame than on another.

        Parameters
        ----------
        samples, lit : ndarray of uint8, shape (N, 3)
            Colours of places when darker, and of the same places in the light.
        seen : int
            Number of samples there would be if all places were in shadow.
        sigma : float
            Standard deviation of colours in the same light, grey levels (of 255).
        least : float
            Smallest number of samples that must be dimmed alike.

        Returns
        -------
        ShadowModel or None
            None if fewer samples, or less than half of them, are dimmed alike, or one of their colours is not dimmed:
            then the cause is no shadow.
        """
        known = (np.minimum(samples, lit) >= _MIN_LEVEL).all(axis=1)
        samples, lit = samples[known], lit[known].astype(float)
        if not len(samples):
            return None
        factor = samples.mean(axis=1) / lit.mean(axis=1)
        tint = np.median(np.log(samples / lit) / np.log(factor)[:, None], axis=0)
        if (tint <= 0).any():
            return None
        miss = np.abs(samples - lit * factor[:, None] ** tint).max(axis=1)
        alike = miss < MAX_LIGHT_DIFFERENCE * sigma
        if alike.sum() < max(least, len(samples) / 2):
            return None
        steps = np.arange(_FACTOR_STEPS + 1) / _FACTOR_STEPS
        counts = np.bincount(np.rint(factor[alike] * _FACTOR_STEPS).astype(int), minlength=len(steps)).astype(float)
        counts = cv2.GaussianBlur(counts[:, None], (1, 0), 0, sigmaY=1.5, borderType=cv2.BORDER_REFLECT)[:, 0]
        density = (1 - _OUTLIER_SHARE) * counts / counts.sum() * _FACTOR_STEPS + _OUTLIER_SHARE
        share = min(alike.sum() / max(seen, 1), 0.5)
        cost = -np.log(share / (1 - share) * density)
        return cls(cost.astype(np.float32), (steps[:, None] ** tint).astype(np.float32), sigma)

    def distances(self, colours: Bytes, plate: Bytes) -> Array:
        """Negative log likelihood ratios of pixels being in shadow, or having been so on the background plate, against
        showing the plate as it is.

        Parameters
        ----------
        colours, plate : ndarray of uint8, shape (N, 3)

        Returns
        -------
        ndarray of float32, shape (N,)
        """
        seen, plain = colours.T, plate.T
        own, usual = _brightness(seen), _brightness(plain)
        swapped = (seen ^ plain) & np.negative((own > usual).view(np.uint8))  # the darker of the two comes first
        bounds = np.minimum(own, usual), np.maximum(own, usual)
        k, light, miss = self._explained(seen ^ swapped, plain ^ swapped, *bounds)
        np.square(miss, out=miss)
        misfit = (miss[0] + miss[1] + miss[2]) * np.float32(0.5 / self.sigma**2)
        # Of all factors those explain the pixel that are as near to this one as the deviation leaves open.
        within = np.float32(np.log(np.sqrt(3) / np.sqrt(2 * np.pi) / self.sigma)) + _LOGARITHMS.take(light)
        return np.asarray(misfit + self.cost.take(k) + within)

    def explains(self, colours: Bytes, lit: Bytes) -> Bools:
        """Whether colours (N, 3) can be those of shadows on places with known colours in the light, (N, 3)."""
        dark, light = colours.T, lit.T
        k, _, miss = self._explained(dark, light, _brightness(dark), _brightness(light))
        return (np.abs(miss).max(axis=0, initial=0) < MAX_LIGHT_DIFFERENCE * self.sigma) & (k < _FACTOR_STEPS)

    def _explained(
        self, dark: Bytes, lit: Bytes, darkness: Array, light: Array
    ) -> tuple[NDArray[np.intp], NDArray[np.intp], Array]:
        """Return the indices k of the factors, the brightness in the light, and the unexplained residual of dark
        colours (3, N).
        """
        light = np.maximum(light, np.float32(1))
        k = np.minimum(np.rint(darkness / light * np.float32(_FACTOR_STEPS)), _FACTOR_STEPS).astype(np.intp)
        miss = np.stack([dimmed.take(k) for dimmed in self.dimmed.T])
        miss *= lit
        return k, np.rint(light).astype(np.intp), np.subtract(dark, miss, out=miss)


@dataclass(frozen=True, eq=False)
class CastShadows:
    """The shadows in a view of a fixed camera.

    Attributes
    ----------
    model : ShadowModel
    plate : ndarray of uint8, shape (h, w, 3)
        The background, in the light wherever some frame shows it so.
    fall : ndarray of bool, shape (h, w)
        Where shadows are searched for.
    """

    model: ShadowModel
    plate: Bytes
    fall: Bools

    @classmethod
    def learned(
        cls, colour: Bytes, behind: Mapping[int, Bools], plate: Bytes, sigma: float, pixels_per_metre: float
    ) -> CastShadows | None:
        """Learn the shadows from places that some frames show in the light and others in shadow; None without any.

        Parameters
        ----------
        colour : ndarray of uint8, shape (F, h, w, 3)
        behind : mapping of int to ndarray of bool, shape (h, w)
            For some frames: where the background is seen.
        plate : ndarray of uint8, shape (h, w, 3)
            Mean of the background over these frames.
        sigma : float
            Standard deviation of colours in the same light, grey levels (of 255).
        pixels_per_metre : float
            Scale at the performers.
        """
        alike = MAX_LIGHT_DIFFERENCE * sigma
        changing, count = _changes(colour, behind, plate.shape[:2], alike)
        places = np.flatnonzero(changing)
        if not len(places):
            return None
        colours = np.stack([colour[frame].reshape(-1, 3).take(places, axis=0) for frame in behind])
        shown = np.stack([region.take(places) for region in behind.values()])
        light = np.where(shown, colours.mean(axis=-1), -np.inf)
        level = _level_in_the_light(light, alike)
        lit = np.broadcast_to(_mean_colours(colours, shown & (np.abs(light - level) <= alike)), colours.shape)
        dimmed, close, seen = shown & (light < level - alike), np.empty_like(shown), 0
        for k, region in enumerate(behind.values()):
            apart = cv2.distanceTransform(region.astype(np.uint8), cv2.DIST_L2, 3)
            beside = region & (apart < SHADOW_REACH * pixels_per_metre)
            close[k] = beside.take(places)
            seen += int(np.count_nonzero(beside & (count > 1)))
        sure = dimmed & close
        least = MIN_SHADOW_AREA * pixels_per_metre**2
        model = ShadowModel.of(colours[sure], lit[sure], seen=seen, sigma=sigma, least=least)
        if model is None:
            return None
        dimmed[dimmed] = model.explains(colours[dimmed], lit[dimmed])
        relit = dimmed.any(axis=0)
        plate, fall = plate.copy(), np.zeros(plate.shape[:2], bool)
        plate.reshape(-1, 3)[places[relit]] = _mean_colours(colours[:, relit], (shown & ~dimmed)[:, relit])
        fall.ravel()[places[relit]] = True
        fall = dilated(opened(fall, MIN_SHADOW_RADIUS * pixels_per_metre), SHADOW_REACH * pixels_per_metre)
        return cls(model, plate, fall)

    def shade(self, distance: Bytes, channels: Sequence[NDArray[Any]], steps: int) -> None:
        """Lower the distances from the plate of the pixels of an image's three channels, (h, w) each, where a shadow
        explains them better.

        Distances are changed in place; they count `steps` per unit of negative log likelihood, and 255 marks pixels
        whose background is unknown.
        """
        apart, (fall, plate) = distance.ravel(), self._lit
        some = apart.take(fall)
        chosen = np.flatnonzero((some >= steps) & (some < 255))
        places = fall.take(chosen)
        colours = np.stack([channel.ravel().take(places) for channel in channels])
        found = self.model.distances(colours.T, plate.take(chosen, axis=1).T) * np.float32(steps)
        np.clip(np.rint(found, out=found), 0, 254, out=found)
        apart[places] = np.minimum(some.take(chosen), found.astype(np.uint8))

    @cached_property
    def _lit(self) -> tuple[NDArray[np.intp], Bytes]:
        """Indices of the pixels where shadows are searched for, and the plate's colours there, (3, N)."""
        places = np.flatnonzero(self.fall)
        return places, np.ascontiguousarray(self.plate.reshape(-1, 3).take(places, axis=0).T)


def _changes(colour: Bytes, behind: Mapping[int, Bools], shape: tuple[int, ...], alike: float) -> tuple[Bools, Bytes]:
    """Return where the background changes between frames, and how many frames show it, both (h, w)."""
    brightest, darkest, count = np.zeros(shape, np.uint8), np.full(shape, 255, np.uint8), np.zeros(shape, np.uint8)
    for frame, region in behind.items():
        grey, mask = cv2.cvtColor(colour[frame], cv2.COLOR_BGR2GRAY), region.astype(np.uint8)
        cv2.copyTo(cv2.max(brightest, grey), mask, brightest)
        cv2.copyTo(cv2.min(darkest, grey), mask, darkest)
        cv2.add(count, mask, count)
    return np.asarray(cv2.subtract(brightest, darkest) > alike), count


def _level_in_the_light(light: Array, alike: float) -> Array:
    """Brightest level (1, n) on which two of K frames (K, n) agree; where none do, the brightest of all."""
    order = np.sort(light, axis=0)[::-1]
    agreed = np.isfinite(order[1:]) & (order[:-1] <= order[1:] + alike)
    return np.take_along_axis(order, np.argmax(agreed, axis=0)[None], axis=0)


def _mean_colours(colours: Bytes, counted: Bools) -> Bytes:
    """Mean over the first axis of those colours (K, n, 3) that are counted (K, n)."""
    total = (colours * counted[..., None]).sum(axis=0)
    return np.round(total / np.maximum(counted.sum(axis=0), 1)[:, None]).astype(np.uint8)
