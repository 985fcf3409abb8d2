"""Whether somebody or something moves beside the performers, by the pictures of key frames."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from ...evidence.foreground_images.foreground import strangers_beside
from ...numerics.arrays import Bools
from .picture_findings import Strangers
from .posed_views import PosedView

_MAX_LIGHT_SPREAD = 0.045
"""Median spread of the logarithms of the colour channels' ratios up to which only the light differs: 0.016 to 0.023 in
shadows and patches of sunlight, 0.08 to 0.76 on people, animals and things."""
_DARK = 4.0
"""Grey levels that are added to both pictures before they are divided: noise would else decide in the dark."""


def strangers_in(views: Sequence[PosedView], explained: Collection[str]) -> list[Strangers]:
    """Return the views in which others move beside the performers, of cameras that stand still; not those of which
    something else was found that changes whole pictures.
    """
    found = []
    for posed in views:
        if posed.stands_still and posed.name not in explained and len(posed.frames) > 1:
            beside = strangers_beside(posed.pictures, dict(enumerate(posed.performers)), posed.pixels_per_metre)
            areas = {k: int(image.sum()) for k, image in beside.items() if not _only_light(posed.pictures, k, image)}
            if areas:
                found.append(Strangers(posed.name, posed.frames[max(areas, key=lambda k: areas[k])]))
    return found


def _only_light(pictures: NDArray[np.uint8], number: int, region: Bools) -> bool:
    """Whether one of K pictures (K, h, w, 3) is darker or brighter in a region than the others usually are, by one
    factor in all channels; also where the region is empty.
    """
    if not region.any():
        return True
    smooth = [cv2.GaussianBlur(picture, (0, 0), 1.0)[region] for picture in pictures]
    usual = np.median(np.delete(smooth, number, axis=0), axis=0)
    ratio = np.log((smooth[number] + _DARK) / (usual + _DARK))
    return bool(np.median(np.ptp(ratio, axis=1)) < _MAX_LIGHT_SPREAD)
