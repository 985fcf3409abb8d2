"""Gaps in a view's footage, as its slot of the scene's properties holds them."""

from __future__ import annotations

import re
from collections.abc import Sequence

import bpy

from ....core.shot.shot import Gap

_GAP = re.compile(r"(\d+):(-?\d+)(t?)")


def packed_gaps(gaps: Sequence[Gap]) -> str:
    """Return gaps as text."""
    return " ".join(f"{gap.frame}:{gap.missing}{'t' if gap.timed else ''}" for gap in gaps)


def unpacked_gaps(text: str) -> tuple[Gap, ...]:
    """Return the gaps of such a text."""
    return tuple(Gap(int(frame), int(missing), bool(timed)) for frame, missing, timed in _GAP.findall(text))


def remember_gaps(scene: bpy.types.Scene, gaps: Sequence[tuple[Gap, ...]]) -> None:
    """Store the gaps that tracking has found in the views of a scene, and show their footage without them."""
    for slot, own in zip(scene.kfmocap.views, gaps, strict=False):
        if packed_gaps(own) != slot.found_gaps:
            slot.found_gaps = packed_gaps(own)
