"""Detecting frames that are missing between two pictures, by motion.

In one view, either all points that can be followed go once as far as in two frames (`followed_points`), or
the picture changes more than twice as much as the pairs around let expect. Where several views show a shot, what the
performer does suddenly changes all of them, and a frame that is missing in one view changes that one alone.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...numerics.arrays import Array, Bools
from ...numerics.robust_kernels import NORMAL_MAD
from .continuity import most_changed
from .followed_points import FOLLOWED_PICTURES, follow_points, reduced

MIN_CHANGE_RATIO = 1.2
"""Ratio of a pair's changes to the geometric mean of those before and after it from which points are followed."""
MIN_WAY_RATIO = 1.25
"""Ratio of ways across a pair to those expected from which frames are missing. In 65 of 68 videos it is at most 1.16
where none is, in the others performers really go twice as far; where a frame is missing it is mostly 1.5 to 2."""
_MIN_EXCESS = 0.4
"""Logarithm of the ratio of a pair's change to what the pairs around it let expect, from which a frame is missing
within it. Twice the motion gives 0.3 to 0.6."""
_MIN_EXCESS_SIGMAS = 5.0
"""The same in standard deviations of this logarithm, which are measured on `_MIN_PAIRS` pairs or more."""
_MIN_PAIRS = 8
_MIN_START_RATIO = 4.0
"""How many times as much as the pair before it a pair changes, and less than the pair after it, as motion starts, or
the other way round as it ends: twice as much as a missing frame makes of even motion."""
_SURPLUS_WITH_MISSING, _MIN_SURPLUS = 0.35, 0.15
"""By how much a pair of one view stands out more than those of all others, natural logarithm: where a frame is missing,
and at least where the view by itself shows that one is."""


class PointsFollowed:
    """Says between which of consecutive pictures frames are missing by points that are followed; pictures are given one
    by one, and followed only where a pair's blocks change more than those of the pairs before and after.
    """

    def __init__(self) -> None:
        self._pictures: deque[NDArray[np.uint8]] = deque(maxlen=2 * FOLLOWED_PICTURES + 2)
        self._changes: deque[float] = deque(maxlen=FOLLOWED_PICTURES + 2)
        self._found = [False] * FOLLOWED_PICTURES

    def add(self, picture: NDArray[np.uint8], change: float) -> None:
        """Add a picture, grey or in colour, and how much its most changed blocks differ from the picture before; 0 for
        the first.
        """
        self._pictures.append(picture)
        self._changes.append(change)
        if len(self._pictures) == self._pictures.maxlen:
            before, here, after, _ = self._changes
            stands_out = here > MIN_CHANGE_RATIO * np.sqrt(before * after)
            self._found.append(
                bool(stands_out and follow_points([*map(reduced, self._pictures)]).excess > MIN_WAY_RATIO)
            )

    def between(self, first: int, last: int) -> Bools:
        """Return whether frames are missing after each of some pictures, shape (last - first,)."""
        found = np.array(self._found[first:last], bool)
        return np.pad(found, (0, last - first - len(found)))


@dataclass(frozen=True, eq=False)
class PairChanges:
    """How much n pairs of consecutive frames of a view stand out among those around them.

    Attributes
    ----------
    bends : ndarray, shape (n,)
        Logarithm of a pair's change over the geometric mean of those before and after it; 0 at the ends.
    moving : ndarray of bool, shape (n,)
        Where some of the picture changes much more than the rest: else it is noise or light, not motion. Neither
        where it starts, nor where it ends.
    skips : ndarray of bool, shape (n,)
        Where frames are missing by what this view shows.
    delay : float
        How much later than the shot's frames these were taken, frames.
    """

    bends: Array
    moving: Bools
    skips: Bools
    delay: float = 0.0

    @classmethod
    def of(cls, changes: Sequence[Array], followed_skips: Bools, delay: float = 0.0) -> PairChanges:
        """Compare the changes of n pairs (`core.shot.footage_faults.continuity.block_change`).

        Parameters
        ----------
        changes : sequence of ndarray, shape (h, w)
        followed_skips : ndarray of bool, shape (n,)
            Where frames are missing by points that were followed (`PointsFollowed`).
        delay : float
        """
        n = len(changes)
        most = np.maximum([most_changed(change) for change in changes], 1e-3)
        moving = most > [2 * float(np.median(change)) for change in changes]
        bends = np.zeros(n)
        if n > 2:
            before, here, after = most[:-2], most[1:-1], most[2:]
            bends[1:-1] = np.log(here / np.sqrt(before * after))
            least, greatest = np.sort([before, after], axis=0)
            moving[1:-1] &= (least > here / _MIN_START_RATIO) | (greatest < here)
        return cls(bends, moving, (_skips_by_change(most, bends) & moving) | followed_skips, delay)

    def known(self, those: Bools) -> PairChanges:
        """Return the same where only some of the pairs (n,) are known; the others do not stand out."""
        return replace(self, bends=np.where(those, self.bends, 0.0), skips=self.skips & those)

    def cut(self, first: int, last: int) -> PairChanges:
        """Return some of the pairs."""
        part = slice(first, last)
        return PairChanges(self.bends[part], self.moving[part], self.skips[part], self.delay)


def _skips_by_change(most: Array, bends: Array) -> Bools:
    """Return which pairs, shape (n,), change so much more than others that one frame between them is missing.

    Changes grow with motion, though less than in proportion. The most that whole footage lets expect is the change of
    the pairs before and after, or what it would be if it went on growing as it does up to there from either side.
    """
    skips = np.zeros(len(most), bool)
    if len(most) < _MIN_PAIRS:
        return skips
    before, here, after = most[1:-3], most[2:-2], most[3:-1]
    expected = np.max([before, after, 2 * before - most[:-4], 2 * after - most[4:]], axis=0)
    deviation = NORMAL_MAD * float(np.median(np.abs(bends[1:-1])))
    skips[2:-2] = np.log(here / expected) > max(_MIN_EXCESS, _MIN_EXCESS_SIGMAS * deviation)
    return skips


def skipped_pairs(views: Sequence[PairChanges]) -> list[Bools]:
    """Return for each view between which of n pairs of frames others are missing in it, shape (n,).

    Views that were not taken at the same instants may see a sudden motion one pair sooner or later.
    """
    if len(views) == 1:
        return [views[0].skips]
    bends = np.array([view.bends for view in views])
    around = bends
    if len({view.delay for view in views}) > 1:
        padded = np.pad(bends, ((0, 0), (1, 1)))
        around = np.max([padded[:, :-2], bends, padded[:, 2:]], axis=0)
    found = []
    for v, view in enumerate(views):
        others = np.delete(bends, v, axis=0)
        alone = view.bends - np.maximum(np.delete(around, v, axis=0).max(axis=0), 0.0)
        deviation = NORMAL_MAD * float(np.median(np.abs(view.bends - np.median(others, axis=0))))
        enough = len(alone) >= _MIN_PAIRS
        skips = enough & view.moving & (alone > max(_SURPLUS_WITH_MISSING, _MIN_EXCESS_SIGMAS * deviation))
        found.append(skips | (view.skips & (alone > _MIN_SURPLUS)))
    return found
