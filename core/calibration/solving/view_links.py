"""Pairs of views that see the wand together, each with its epipolar geometry."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from .assumed_lens import Lens
from .pairwise import Epipolar, epipolar
from .wand_tracks import Tracks

MIN_LINK_FRAMES = 15
"""Least number of frames on which two linked views must see the wand together."""
MAX_PLANE_SHARE = 0.8
"""Fraction of correspondences in one plane from which a pair of views does not determine focal lengths."""
_UNCROSSED_SHARE = 0.4
"""Fraction of agreeing balls from which the other order of the ends is not tried."""

Cancel = Callable[[], None]


@dataclass(frozen=True, eq=False)
class Link:
    """Two views that see the wand together.

    Attributes
    ----------
    views : tuple of int
    frames : ndarray of int, shape (n,)
        Indices of the shared frames.
    geometry : Epipolar or None
        None if no epipolar geometry was found.
    crossed : bool
        Whether the first ball of one view is the second of the other.
    """

    views: tuple[int, int]
    frames: NDArray[np.int64]
    geometry: Epipolar | None
    crossed: bool

    @property
    def agreeing(self) -> int:
        """Number of balls that agree with the geometry."""
        return 0 if self.geometry is None else int(self.geometry.agreeing.sum())

    @property
    def worth(self) -> float:
        """Number of agreeing balls outside the plane that contains most."""
        return 0.0 if self.geometry is None else self.agreeing * (1 - self.geometry.flatness)


def find_links(tracks: Tracks, lenses: Sequence[Lens], cancel: Cancel) -> list[Link]:
    """Return all pairs of views that share enough frames."""
    links = []
    for i, j in combinations(range(len(lenses)), 2):
        cancel()
        frames = np.flatnonzero(tracks.seen[[i, j]].all(axis=(0, 2)))
        if len(frames) >= MIN_LINK_FRAMES:
            a, b = tracks.points[i, frames], tracks.points[j, frames]
            link = Link((i, j), frames, epipolar(a.reshape(-1, 2), b.reshape(-1, 2), lenses[i], lenses[j]), False)
            if link.agreeing < _UNCROSSED_SHARE * 2 * len(frames):
                geometry = epipolar(a.reshape(-1, 2), b[:, ::-1].reshape(-1, 2), lenses[i], lenses[j])
                other = Link((i, j), frames, geometry, True)
                link = max(link, other, key=lambda either: either.agreeing)
            links.append(link)
    return links


def crossed_views(links: Sequence[Link]) -> list[int]:
    """Return the views that list the wand's balls in the opposite order from the first view, as balls may look
    alike.
    """
    turned = {0: False}
    best_first = sorted(links, key=lambda link: -link.agreeing)
    while joining := [link for link in best_first if sum(v in turned for v in link.views) == 1]:
        i, j = joining[0].views
        new, old = (i, j) if j in turned else (j, i)
        turned[new] = turned[old] != joining[0].crossed
    return [v for v, other in turned.items() if other]
