"""The colours of a body's parts: in front of a shirt, a bare arm is told from it.

Foreground images say where a performer ends. Within its outline they are silent, and a limb in front of the trunk might
be anywhere there. The key frames also show which colours each part has: where those of two parts differ, their limit is
looked for as the performer's own outline is, and a pose is the likelier the more its parts lie on their colours.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from ..numerics.arrays import Bools, Ints
from ..runtime.shared_arrays import each_row
from .foreground import LEVELS, STRONGEST, bins, smoothed
from .masks import within

Bytes = NDArray[np.uint8]

PALETTE_SIZE = 255
"""Colours of a palette, at most."""
PATCH = 0.06
"""A square of this side, metres, is as much of a part as all of its performer counts for in what its colours are: a
part that shows hardly more has none of its own."""
_RIM = 1  # narrower than that of masks: a forearm is a few pixels wide


@dataclass(frozen=True, eq=False)
class PartColours:
    """Which colours the parts of all performers have in one view.

    Attributes
    ----------
    nearest : ndarray of uint8, shape (LEVELS^3,)
        The colour of the palette that stands for each bin of colours.
    ratio : ndarray of float32, shape (P, K)
        Logarithm of how likely each of the palette's K colours is on a part, over how likely it is on all of its
        performer; 0 for parts of which nothing is known.
    distinct : ndarray of bool, shape (P, P)
        Which parts are told apart by their colours: those of one performer that do not meet.
    """

    nearest: Bytes
    ratio: NDArray[np.float32]
    distinct: Bools

    @classmethod
    def learned(
        cls, colour: Bytes, parts: Mapping[int, NDArray[np.int16]], performer: Ints, distinct: Bools, scale: float
    ) -> PartColours | None:
        """The colours that some frames show; None if they show nobody.

        Parameters
        ----------
        colour : ndarray, shape (N, h, w, 3)
        parts : mapping of int to ndarray of int, shape (h, w)
            By frame: the part that is known to show at each pixel; -1 where none is.
        performer : ndarray of int, shape (P,)
            Whose part each is.
        distinct : ndarray of bool, shape (P, P)
        scale : float
            Pixels per metre at the performers.
        """
        counts = np.zeros((len(performer), LEVELS**3))
        for frame, label in parts.items():
            places = bins(colour[frame])
            for part in np.unique(label[label >= 0]).tolist():
                counts[part] += np.bincount(places[within(label == part, _RIM)], minlength=LEVELS**3)
        total = counts.sum(axis=0)
        if not total.any():
            return None
        palette = np.sort(np.argsort(-total, kind="stable")[: min(PALETTE_SIZE, np.count_nonzero(total))])
        cube = (LEVELS, LEVELS, LEVELS)
        _, nearest = KDTree(np.transpose(np.unravel_index(palette, cube))).query(
            np.transpose(np.unravel_index(np.arange(LEVELS**3), cube))
        )
        ratio = np.zeros((len(performer), len(palette)), np.float32)
        for part in np.flatnonzero(counts.any(axis=1)):
            usual = smoothed(counts[performer == performer[part]].sum(axis=0))[palette]
            usual = (usual + 1) / (usual + 1).sum()
            own = smoothed(counts[part])[palette] + (PATCH * scale) ** 2 * usual
            ratio[part] = np.clip(np.log(own / own.sum() / usual), -STRONGEST, STRONGEST)
        return cls(nearest.astype(np.uint8), ratio, distinct)

    def images(self, colour: Bytes) -> Iterator[Bytes]:
        """Give the palette's colours of frames (N, h, w, 3), one after the other, shape (h, w)."""
        for image in each_row(colour):
            yield self.nearest.take(bins(image))


@dataclass(frozen=True, eq=False)
class ColouredFrames:
    """What n frames say of the parts by their colours.

    Attributes
    ----------
    colours : PartColours
    palette : ndarray of uint8, shape (n, h, w)
        The palette's colour of every pixel.
    """

    colours: PartColours
    palette: Bytes

    def of(self, part: int) -> NDArray[np.float32]:
        """How likely every pixel's colour is on a part, see `PartColours.ratio`, shape (n, h, w)."""
        return self.colours.ratio[part][self.palette]
