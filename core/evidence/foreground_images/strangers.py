"""The colours of strangers: people or things that move beside the performers, before a camera that stands still.

A stranger differs from the background as performers do, and may stand before one of them on a key frame, whose colours
would then be learned as the performer's. Beside the performers, key frames show which colours a stranger has.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from ...numerics.arrays import Bools
from .masks import opened

Bytes = NDArray[np.uint8]
Array = NDArray[np.float64]

MIN_AREA = 0.15
"""Smallest area of strangers on the mean key frame, square metres, half of what a person covers from the side: less may
be clothes or shadows."""
MIN_SHARE_RATIO = 10.0
"""Ratio of a colour's shares on strangers and on a performer from which on it tells one from the other: in equal
clothes the shares differ less."""
_MIN_RADIUS = 0.05
"""Half the thickness, metres, below which something is no stranger but loose clothes or the edge of a shadow."""
_SAMPLED_FRAMES = 8


def strangers_on(
    colour: Bytes, behind: Mapping[int, Bools], plate: Bytes, known: Bools, *, unlike: float, scale: float
) -> dict[int, Bools]:
    """Find the pixels that show strangers on some frames of a camera that stands still.

    These are pixels beside the performers that differ from what most frames show there, while another of the given
    frames shows just that: where none does, the light is changing.

    Parameters
    ----------
    colour : ndarray, shape (N, h, w, 3)
    behind : mapping of int to ndarray of bool, shape (h, w)
        By frame: pixels that show no performer.
    plate : ndarray of uint8, shape (h, w, 3)
        Mean of the background on these frames.
    known : ndarray of bool, shape (h, w)
        Where there is a plate.
    unlike : float
        Distance between two colours, grey levels, from which on they show different things.
    scale : float
        Pixels per metre at the performers.

    Returns
    -------
    dict of int to ndarray of bool, shape (h, w)
        By frame; empty where strangers cover less than `MIN_AREA`.
    """
    changed = np.zeros(known.shape, bool)
    for frame, region in behind.items():
        b, g, r = cv2.split(cv2.absdiff(colour[frame], plate))
        most = cv2.max(cv2.max(b, g), r)
        changed |= region & known & (most > unlike)
    if not changed.any():
        return {}
    places = np.nonzero(changed)
    some = colour[:: max(1, len(colour) // _SAMPLED_FRAMES)]
    usual = np.median([image[places] for image in some], axis=0)
    off = {frame: _apart(colour[frame][places], usual) > unlike for frame in behind}
    seen = {frame: region[places] for frame, region in behind.items()}
    confirmed = np.any([seen[frame] & ~off[frame] for frame in behind], axis=0)
    found = {}
    for frame in behind:
        image = np.zeros(known.shape, bool)
        image[places] = seen[frame] & off[frame] & confirmed
        found[frame] = opened(image, _MIN_RADIUS * scale)
    area = sum(np.count_nonzero(image) for image in found.values()) / scale**2
    return found if area > MIN_AREA * len(behind) else {}


def without_strangers(share: Array, each: Sequence[Array], strangers: NDArray[np.float32]) -> Array:
    """Share of each colour on a performer, (bins,), less what strangers who stood before it on some frames have added.

    `share` is that on all frames together, and `each` those on single frames. Of colours that strangers have far more
    often (`MIN_SHARE_RATIO`) than the performer usually has, the median over the frames is taken.
    """
    usual = np.sort(each, axis=0)[(len(each) - 1) // 2]
    share = np.where(strangers > MIN_SHARE_RATIO * usual, np.minimum(usual, share), share)
    return np.asarray(share / max(float(share.sum()), 1e-9))


def _apart(a: NDArray[np.uint8], b: NDArray[np.generic]) -> NDArray[np.float32]:
    """Distances between the colours (..., 3) of two pictures, grey levels."""
    return np.asarray(np.sqrt(((a.astype(np.float32) - b.astype(np.float32)) ** 2).sum(axis=-1)))
