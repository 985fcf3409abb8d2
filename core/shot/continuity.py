"""Frames that do not continue from the one before: damaged, repeated or missing, as decoders hand them out in silence,
or taken in other light, as by a flash or when somebody steps out of the way of a low sun.

Movement lasts: where a block of the picture changes, it does so over some frames, or in few blocks. Where many blocks
change between two frames by several times as much as between those around them, one of the two frames is not what the
camera saw, or frames are missing between them: one frame that does not fit makes two such pairs, and a limb that swings
more of them. Where nothing changes in a picture that moves, a frame is repeated.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from ..numerics.arrays import Array, Bools, Ints

AROUND = 4
"""So many pairs of frames before and after a pair show how much changes."""
_BLOCKS = 32
"""Blocks along the longer side of a picture."""
_TIMES, _LEVELS, _SHARE = 4.0, 6.0, 0.02
"""A pair is torn where in this share of the blocks it differs by so many times as much, and so many grey levels."""
_ALIKE, _SINGLE = 0.5, 2
"""Neighbouring pairs differ alike in so many blocks, as a share of each other's. One frame that does not fit makes two
of them; where there are more, or one of the two is not torn by itself, something that was at rest moves."""
_MOVING, _STILL = 2.0, 0.1
"""Grey levels by which a twentieth of the blocks changes in a picture that moves; share of it in a repeated frame."""


def small(picture: NDArray[np.uint8]) -> Array:
    """Grey levels of the blocks of a picture, grey or in colour."""
    height, width = picture.shape[:2]
    scale = _BLOCKS * 4 / max(height, width)
    size = max(round(width * scale), 8), max(round(height * scale), 8)
    grey = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY) if picture.ndim == 3 else picture
    return np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), float)


def block_change(before: Array, after: Array) -> Array:
    """Mean difference of two small pictures in every block, grey levels."""
    difference = np.abs(after - before)
    size = max(difference.shape[1] // 4, 1), max(difference.shape[0] // 4, 1)
    return np.asarray(cv2.resize(difference, size, interpolation=cv2.INTER_AREA))


def single_frames(torn: Bools) -> Bools:
    """Which of N frames fit neither neighbour, by their N - 1 pairs."""
    return np.asarray(np.r_[False, torn[:-1] & torn[1:], False]) if len(torn) else np.zeros(1, bool)


def torn_pairs(changes: Sequence[Array]) -> Bools:
    """Which pairs of consecutive frames do not fit together.

    Parameters
    ----------
    changes : sequence of ndarray, shape (h, w)
        `block_change` of consecutive pairs of frames.

    Returns
    -------
    ndarray of bool, shape (n,)
        A frame that fits neither neighbour, and one that is repeated, is between two torn pairs.
    """
    if not len(changes):
        return np.zeros(0, bool)
    D = np.stack(changes)
    near = [[j for j in range(max(k - AROUND, 0), min(k + AROUND + 1, len(D))) if j != k] for k in range(len(D))]
    # What moves comes from the blocks beside.
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
    return torn


def _run(those: Bools, place: int) -> Ints:
    """The places around one, itself included, up to the next that are not among those."""
    others = np.flatnonzero(~those)
    after = np.searchsorted(others, place)
    begin = others[after - 1] + 1 if after else 0
    return np.arange(begin, others[after] if after < len(others) else len(those))


def _medians(values: Array, near: Sequence[Sequence[int]]) -> Array:
    """The medians of the values (n, ...) near each of n places, as many places at a time as have equally many near;
    the value itself where there are none.
    """
    found = values.copy()
    for count in {len(j) for j in near} - {0}:
        places = [k for k, j in enumerate(near) if len(j) == count]
        found[places] = np.median(values[[near[k] for k in places]], axis=1)
    return found
