"""Whether somebody or something moves beside the performers, by the pictures of key frames."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from ..evidence.foreground_images.foreground import strangers_beside
from .picture_findings import Strangers
from .posed_views import PosedView


def strangers_in(views: Sequence[PosedView], explained: Collection[str]) -> list[Strangers]:
    """Return the views in which others move beside the performers, of cameras that stand still; not those of which
    something else was found that changes whole pictures.
    """
    found = []
    for posed in views:
        if posed.stands_still and posed.name not in explained and len(posed.frames) > 1:
            beside = strangers_beside(posed.pictures, dict(enumerate(posed.performers)), posed.pixels_per_metre)
            areas = {posed.frames[k]: image.sum() / posed.pixels_per_metre**2 for k, image in beside.items()}
            if areas:
                found.append(Strangers(posed.name, max(areas, key=lambda frame: areas[frame])))
    return found
