"""Detecting frames that do not continue the frame before.

They are damaged, repeated or missing, which decoders do not report, or lit differently, as by a flash. Movement changes
a block of the picture over several frames, or few blocks at a time. If many blocks change between two frames several
times as much as between the frames around them, one of the two was damaged or lit differently, or frames are missing
between them. A single such frame makes two such pairs; a swinging limb makes more. If nothing changes in a picture that
otherwise moves, a frame is repeated. Few missing frames are found by `core.shot.footage_faults.skipped_frames`.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from ...numerics.arrays import Array, Bools, Ints

COMPARED_PAIRS = 4
"""Number of pairs of frames before and after a pair with which it is compared."""
_BLOCKS = 32
"""Number of blocks along the longer side of a picture."""
_MIN_CHANGE_RATIO, _MIN_CHANGE, _MIN_BLOCK_SHARE = 4.0, 6.0, 0.02
"""A pair is discontinuous ("torn") if at least a share of its blocks changes by several times as much as usual, and by
a number of grey levels: factor, grey levels, share of the blocks."""
_SAME_CHANGE_SHARE, _MAX_SINGLE_PAIRS = 0.5, 2
"""Neighbouring pairs show the same change if they share this fraction of their changed blocks. One bad frame makes two
such pairs; if there are more, or one of the two is not torn by itself, something starts to move."""
_SAME_SIGN_SHARE, _SAME_DETAIL = 0.95, 0.5
"""Share of the changed blocks that change in the same sense, and correlation of what is in them, from which light alone
has changed. They were 0.99 and 0.93 to 0.96 where the sun came out behind a head; in 53 pairs across the end of damage
the share was at most 0.91, and where damage leaves flat grey nothing is correlated."""
_MIN_MOTION, _MAX_STILL_RATIO, _MIN_NOISE_RATIO = 1.0, 0.1, 0.5
"""Change, in grey levels, of the most changed twentieth of the blocks in a picture that moves; the change in a repeated
frame compared with the stillest quarter around, and that of its median block, which shows noise, compared with the
usual one: where a fist turns back it is nearly still, but noise goes on."""


def block_means(picture: NDArray[np.uint8]) -> Array:
    """Return the mean grey level of every block of a picture, grey (H, W) or in colour (H, W, 3); shape (h, w)."""
    height, width = picture.shape[:2]
    scale = _BLOCKS * 4 / max(height, width)
    size = max(round(width * scale), 8), max(round(height * scale), 8)
    grey = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY) if picture.ndim == 3 else picture
    return np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), float)


def block_change(before: Array, after: Array) -> Array:
    """Return the mean absolute difference of two results of `block_means`, in blocks of 4 x 4 of theirs, grey
    levels.
    """
    difference = np.abs(after - before)
    size = max(difference.shape[1] // 4, 1), max(difference.shape[0] // 4, 1)
    return np.asarray(cv2.resize(difference, size, interpolation=cv2.INTER_AREA))


def most_changed(change: Array) -> float:
    """Return the mean of the most changed twentieth of the blocks in a result of `block_change`."""
    values = np.sort(change, axis=None)
    return float(values[-max(values.size // 20, 1) :].mean())


def lit_differently(before: Array, after: Array) -> bool:
    """Whether two pictures differ in light alone, from their `block_means`.

    Light makes all blocks brighter that it changes, or all darker, and leaves what is in them; damage, a cut and
    movement do both, or put something else there.
    """
    height, width = (max(n // 4, 1) for n in before.shape)  # blocks of 4 x 4, as in `block_change`, but with their sign
    each = [picture[: 4 * height, : 4 * width].reshape(height, 4, width, 4) for picture in (before, after)]
    means = [blocks.mean(axis=(1, 3), keepdims=True) for blocks in each]
    difference = (means[1] - means[0])[:, 0, :, 0]
    changed = np.abs(difference) > _MIN_CHANGE
    if not changed.any():
        return False
    brighter = float((difference[changed] > 0).mean())
    a, b = ((blocks - mean).transpose(0, 2, 1, 3)[changed] for blocks, mean in zip(each, means, strict=True))
    same = float((a * b).sum()) > _SAME_DETAIL * float(np.sqrt((a**2).sum() * (b**2).sum()))
    return same and max(brighter, 1 - brighter) > _SAME_SIGN_SHARE


def single_frames(torn: Bools) -> Bools:
    """Return which of N frames fit neither neighbour, shape (N,), from their torn pairs (N - 1,)."""
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
    near = [
        [j for j in range(max(k - COMPARED_PAIRS, 0), min(k + COMPARED_PAIRS + 1, len(D))) if j != k]
        for k in range(len(D))
    ]
    # Whatever moves into a block comes from a neighbouring one.
    usual = [cv2.dilate(m, np.ones((3, 3))) if j else m for m, j in zip(_medians(D, near), near, strict=True)]
    changed = np.array(
        [(np.maximum(_MIN_CHANGE_RATIO * u, _MIN_CHANGE) < d).mean() for u, d in zip(usual, D, strict=True)]
    )
    moved = np.array([most_changed(change) for change in D])
    changed_around, moved_around = _medians(changed, near), _medians(moved, near)
    noise = np.median(D.reshape(len(D), -1), axis=1)
    noise_around = _medians(noise, near)
    torn = np.zeros(len(D), bool)
    # Something large and fast changes other blocks every time, but so it does before and after.
    most = _MIN_BLOCK_SHARE + _MIN_CHANGE_RATIO * changed_around
    for k in range(2, len(D) - 2):  # at the ends nothing shows whether a change lasts
        alike = _run(changed > _SAME_CHANGE_SHARE * changed[k], k)
        torn[k] |= (
            changed[k] > most[k] and len(alike) <= _MAX_SINGLE_PAIRS and bool((changed[alike] > most[alike]).all())
        )
        if moved_around[k] > _MIN_MOTION and noise[k] <= _MIN_NOISE_RATIO * noise_around[k]:
            torn[k : k + 2] |= moved[k] < _MAX_STILL_RATIO * np.quantile(moved[near[k]], 0.25)
    return torn


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
        ordered = np.sort(values[[near[k] for k in places]], axis=1)  # of so few values half of the time of np.median
        found[places] = (ordered[:, (count - 1) // 2] + ordered[:, count // 2]) / 2
    return found
