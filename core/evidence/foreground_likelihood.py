"""How well posed parts explain the foreground: log likelihood ratios of the pixels that they cover."""

from __future__ import annotations

from functools import partial

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
    frame, _, _ = labels.places
    n, P = labels.share.shape
    group = np.repeat(np.arange(n * P), np.diff(labels.ends))
    part = group % P
    by_part = partial(np.bincount, part * n + frame, minlength=n * P)
    ratio = log_ratio(labels.pixels_of(foreground, stride))
    explained = by_part(stride**2 * ratio).astype(float).reshape(P, n)
    coloured = view.part_colours(first, n)
    if coloured is not None:
        ratios = coloured.colours.ratio
        own = ratios.reshape(-1).take(parts[part] * ratios.shape[1] + labels.pixels_of(coloured.palette[None], stride))
        explained = explained + by_part(stride**2 * own).astype(float).reshape(P, n)
    return np.asarray(explained)
