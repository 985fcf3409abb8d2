"""Detecting frames that do not continue the frame before.

They are damaged, repeated or missing, which decoders do not report, or lit differently, as by a flash. Movement changes
a block of the picture over several frames, or few blocks at a time. If many blocks change between two frames several
times as much as between the frames around them, one of the two was damaged or lit differently, or frames are missing
between them. A single such frame makes two such pairs; a swinging limb makes more. If nothing changes in a picture that
otherwise moves, a frame is repeated. If everything moves once as far as in two frames, one is missing.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from ..numerics.arrays import Array, Bools, Ints
from ..numerics.robust_kernels import NORMAL_MAD

AROUND = 4
"""Number of pairs of frames before and after a pair with which it is compared."""
_BLOCKS = 32
"""Number of blocks along the longer side of a picture."""
_TIMES, _LEVELS, _SHARE = 4.0, 6.0, 0.02
"""A pair is discontinuous ("torn") if at least a share of its blocks changes by several times as much as usual, and by
a number of grey levels: factor, grey levels, share of the blocks."""
_ALIKE, _SINGLE = 0.5, 2
"""Neighbouring pairs show the same change if they share this fraction of their changed blocks. One bad frame makes two
such pairs; if there are more, or one of the two is not torn by itself, something starts to move."""
_MOVING, _STILL = 2.0, 0.1
"""Change, in grey levels, of the most changed twentieth of the blocks in a picture that moves, and the largest share of
it in a repeated frame."""
_SKIPPED, _DEVIATIONS, _FEWEST = 0.4, 5.0, 8
"""A frame is missing within a pair whose change exceeds all that the pairs around it let expect: least excess, natural
logarithm, and in standard deviations of this logarithm, which are measured on at least so many pairs. Twice the motion
gives 0.3 to 0.6; at the take-off of a jump the excess was 0.38."""


def small(picture: NDArray[np.uint8]) -> Array:
    """Return the mean grey level of every block of a picture, grey or in colour."""
    height, width = picture.shape[:2]
    scale = _BLOCKS * 4 / max(height, width)
    size = max(round(width * scale), 8), max(round(height * scale), 8)
    grey = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY) if picture.ndim == 3 else picture
    return np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), float)


def block_change(before: Array, after: Array) -> Array:
    """Return the mean absolute difference of two results of `small`, in blocks of 4 x 4 of theirs, grey levels."""
    difference = np.abs(after - before)
    size = max(difference.shape[1] // 4, 1), max(difference.shape[0] // 4, 1)
    return np.asarray(cv2.resize(difference, size, interpolation=cv2.INTER_AREA))


def single_frames(torn: Bools) -> Bools:
    """Return which of N frames fit neither neighbour, from their N - 1 torn pairs."""
    return np.asarray(np.r_[False, torn[:-1] & torn[1:], False]) if len(torn) else np.zeros(1, bool)


def torn_pairs(changes: Sequence[Array]) -> Bools:
    """Return which pairs of consecutive frames do not continue each other.

    Parameters
    ----------
    changes : sequence of ndarray, shape (h, w)
        `block_change` of consecutive pairs of frames.

    Returns
    -------
    ndarray of bool, shape (n,)
        Whether each pair is torn. A damaged frame lies between two torn pairs.
    """
    if not len(changes):
        return np.zeros(0, bool)
    D = np.stack(changes)
    near = [[j for j in range(max(k - AROUND, 0), min(k + AROUND + 1, len(D))) if j != k] for k in range(len(D))]
    # Whatever moves into a block comes from a neighbouring one.
    usual = [cv2.dilate(m, np.ones((3, 3))) if j else m for m, j in zip(_medians(D, near), near, strict=True)]
    changed = np.array([(np.maximum(_TIMES * u, _LEVELS) < d).mean() for u, d in zip(usual, D, strict=True)])
    moved = np.quantile(D.reshape(len(D), -1), 0.95, axis=1)
    changed_around, moved_around = _medians(changed, near), _medians(moved, near)
    torn = np.zeros(len(D), bool)
    # Something large and fast changes other blocks every time, but so it does before and after.
    most = _SHARE + _TIMES * changed_around
    for k in range(2, len(D) - 2):  # at the ends nothing shows whether a change lasts
        alike = _run(changed > _ALIKE * changed[k], k)
        torn[k] |= changed[k] > most[k] and len(alike) <= _SINGLE and bool((changed[alike] > most[alike]).all())
        if moved_around[k] > _MOVING and moved[k] < _STILL * moved_around[k]:
            torn[k : k + 2] = True
    return torn | _skipping(D)


def _skipping(changes: Array) -> Bools:
    """Return which pairs, shape (n,), show twice the motion of a pair, as one frame between them is missing.

    Changes grow with motion, though less than in proportion. The most that whole footage lets expect is the change of
    the pairs before and after, or what it would be if it went on growing as it does up to there from either side. Where
    most of the picture changes alike, it is noise or light, not motion.
    """
    skipping = np.zeros(len(changes), bool)
    if len(changes) < _FEWEST:
        return skipping
    blocks = np.sort(changes.reshape(len(changes), -1), axis=1)
    most = np.maximum(blocks[:, -max(blocks.shape[1] // 20, 1) :].mean(axis=1), 1e-3)
    before, here, after = most[1:-3], most[2:-2], most[3:-1]
    expected = np.max([before, after, 2 * before - most[:-4], 2 * after - most[4:]], axis=0)
    bends = np.log(most[1:-1] / np.sqrt(most[:-2] * most[2:]))
    deviation = NORMAL_MAD * float(np.median(np.abs(bends)))
    moving = most > 2 * np.median(blocks, axis=1)
    skipping[2:-2] = np.log(here / expected) > max(_SKIPPED, _DEVIATIONS * deviation)
    return skipping & moving


def _run(those: Bools, place: int) -> Ints:
    """Return the run of True values around an index, as indices."""
    others = np.flatnonzero(~those)
    after = np.searchsorted(others, place)
    begin = others[after - 1] + 1 if after else 0
    return np.arange(begin, others[after] if after < len(others) else len(those))


def _medians(values: Array, near: Sequence[Sequence[int]]) -> Array:
    """Return the median of the values (n, ...) at the indices near each of n places; the value itself if there are
    none.

    Places with equally many indices are computed together.
    """
    found = values.copy()
    for count in {len(j) for j in near} - {0}:
        places = [k for k, j in enumerate(near) if len(j) == count]
        found[places] = np.median(values[[near[k] for k in places]], axis=1)
    return found
