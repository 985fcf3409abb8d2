"""Which constraints have an effect."""

from __future__ import annotations

from typing import Any

_WITHOUT_TARGET = ("ACTION", "PIVOT")
"""Types that may act though they have a target that is empty."""


def acts(constraint: Any) -> bool:
    """Return whether a constraint has an effect: it is not muted, has influence, and its target is there.

    Blender notices a target that was deleted only when the file is opened again.
    """
    there = getattr(constraint, "target", constraint) is not None or constraint.type in _WITHOUT_TARGET
    return bool(not constraint.mute and constraint.influence > 0 and constraint.is_valid and there)
