"""The colours of a body's parts, which distinguish a bare arm from the shirt behind it.

Foreground images show where a performer ends, but not where a limb is in front of the trunk. The colours of each part
are learned on the key frames. Where those of two parts differ, the edge between them is measured like the performer's
outline, and poses are likelier if parts lie on pixels of their colours.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from ...numerics.arrays import Bools, Ints
from ...runtime.processes.shared_arrays import each_row
from .foreground import HISTOGRAM_BINS, MAX_LOG_RATIO, bins, smoothed
from .masks import box_around, interior

Bytes = NDArray[np.uint8]

PALETTE_SIZE = 255
"""Largest number of colours of a palette."""
PRIOR_PATCH = 0.06
"""Weight of the whole performer's colours in those of a part, as the side of a square with as many pixels, metres: a
part of which hardly more is seen has no distinct colours."""
_EDGE_WIDTH = 1  # narrower than that of masks: a forearm is a few pixels wide


@dataclass(frozen=True, eq=False)
class PartColours:
    """The colour distributions of all performers' parts in one view.

    Attributes
    ----------
    nearest : ndarray of uint8, shape (HISTOGRAM_BINS^3,)
        Index of the palette's colour for each histogram bin.
    ratio : ndarray of float32, shape (P, K)
        Log likelihood ratio (part against its whole performer) of each of the palette's K colours; 0 for parts of which
        nothing is known.
    distinct : ndarray of bool, shape (P, P)
        Pairs of parts that are distinguished by their colours: those of one performer that do not touch.
    """

    nearest: Bytes
    ratio: NDArray[np.float32]
    distinct: Bools

    @classmethod
    def learned(
        cls, colour: Bytes, parts: Mapping[int, NDArray[np.int16]], performer: Ints, distinct: Bools, scale: float
    ) -> PartColours | None:
        """Learn the colours from some frames; None if they show nobody.

        Parameters
        ----------
        colour : ndarray, shape (N, h, w, 3)
        parts : mapping of int to ndarray of int, shape (h, w)
            By frame: index of the part that a pixel is known to show; -1 where none is.
        performer : ndarray of int, shape (P,)
            Index of the performer of every part.
        distinct : ndarray of bool, shape (P, P)
        scale : float
            Pixels per metre at the performers.
        """
        counts = np.zeros((len(performer), HISTOGRAM_BINS**3))
        for frame, label in parts.items():
            window = box_around(label >= 0, _EDGE_WIDTH)
            if not label[window].size:
                continue
            places, shown = bins(colour[frame][window]), label[window]
            for part in np.flatnonzero(np.bincount(shown[shown >= 0], minlength=len(performer))).tolist():
                counts[part] += np.bincount(places[interior(shown == part, _EDGE_WIDTH)], minlength=HISTOGRAM_BINS**3)
        total = counts.sum(axis=0)
        if not total.any():
            return None
        palette = np.sort(np.argsort(-total, kind="stable")[: min(PALETTE_SIZE, np.count_nonzero(total))])
        cube = (HISTOGRAM_BINS, HISTOGRAM_BINS, HISTOGRAM_BINS)
        _, nearest = KDTree(np.transpose(np.unravel_index(palette, cube))).query(
            np.transpose(np.unravel_index(np.arange(HISTOGRAM_BINS**3), cube))
        )
        ratio = np.zeros((len(performer), len(palette)), np.float32)
        usually = [smoothed(counts[performer == m].sum(axis=0))[palette] + 1 for m in range(int(performer.max()) + 1)]
        for part in np.flatnonzero(counts.any(axis=1)):
            usual = usually[performer[part]] / usually[performer[part]].sum()
            own = smoothed(counts[part])[palette] + (PRIOR_PATCH * scale) ** 2 * usual
            ratio[part] = np.clip(np.log(own / own.sum() / usual), -MAX_LOG_RATIO, MAX_LOG_RATIO)
        return cls(nearest.astype(np.uint8), ratio, distinct)

    def images(self, colour: Bytes) -> Iterator[Bytes]:
        """Generate the palette indices, (h, w) each, of frames (N, h, w, 3)."""
        for image in each_row(colour):
            yield self.nearest.take(bins(image))


@dataclass(frozen=True, eq=False)
class ColouredFrames:
    """The palette colours of n frames, with their likelihoods on the parts.

    Attributes
    ----------
    colours : PartColours
    palette : ndarray of uint8, shape (n, h, w)
        The palette's colour of every pixel.
    """

    colours: PartColours
    palette: Bytes

    def of(self, part: int) -> NDArray[np.float32]:
        """Log likelihood ratio of every pixel's colour on a part, see `PartColours.ratio`, shape (n, h, w)."""
        return self.colours.ratio[part][self.palette]
