"""How well posed parts explain the foreground: log likelihood ratios of the pixels that they cover."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..numerics.arrays import Array, Ints
from .foreground_images.foreground import log_ratio
from .rendering.label_images import LabelImages
from .view_frames import ViewFrames


def explained_by_part(
    view: ViewFrames, foreground: NDArray[np.uint8], labels: LabelImages, parts: Ints, *, stride: int, first: int
) -> Array:
    """Sum the log likelihood ratios of the pixels that label images list, by part and frame, (P, n).

    Parameters
    ----------
    view : ViewFrames
    foreground : ndarray of uint8, shape (M, n, h, w)
        Foreground images of the frames of the labels.
    labels : LabelImages
    parts : ndarray of int, shape (P,)
        Indices of the labels' parts among those of all performers.
    stride : int
        Distance between the pixels of the label images, in rows and in columns.
    first : int
        Shot frame of the first of the n frames.
    """
    n, P = labels.share.shape
    count = np.diff(labels.ends)
    group = np.repeat(np.arange(n * P), count)
    ratio = log_ratio(labels.pixels_of(foreground, stride))
    explained = np.bincount(group, stride**2 * ratio, minlength=n * P).astype(float)
    coloured = view.part_colours(first, n)
    if coloured is not None:
        ratios = coloured.colours.ratio
        row = np.repeat(np.tile(parts * ratios.shape[1], n), count)
        own = ratios.reshape(-1).take(row + labels.pixels_of(coloured.palette[None], stride))
        explained = explained + np.bincount(group, stride**2 * own, minlength=n * P).astype(float)
    return np.ascontiguousarray(explained.reshape(n, P).T)
