"""The directions of a palm at rest, as the first joints of the fingers show them."""

from __future__ import annotations

import numpy as np

from ...body.skeleton_motion import RestSkeleton
from ...numerics.arrays import Array
from ..bone_roles.roles import BoneMap

_NARROW_PALM = 0.2
"""Least width of a palm between index and little finger, in units of its length."""


def palm_axes(rest: RestSkeleton, bones: BoneMap, side: str) -> Array | None:
    """Return the hand's axes at rest as columns, shape (3, 3): across the palm towards the index finger, along the
    middle finger, and perpendicular to both; None without fingers.
    """
    names = palm_bones(bones, side)
    if names is None:
        return None
    hand, middle, index, pinky = rest.heads[rest.indices(names)]
    return axes_of_palm(hand, middle, index, pinky)


def palm_bones(bones: BoneMap, side: str) -> list[str] | None:
    """Return the bones that begin at the wrist and at the knuckles of middle, index and little finger; None if one is
    missing.
    """
    roles = [f"{role}.{side}" for role in ("hand", "middle", "index", "pinky")]
    return [bones.bones[role][0] for role in roles] if all(role in bones.bones for role in roles) else None


def axes_of_palm(hand: Array, middle: Array, index: Array, pinky: Array) -> Array | None:
    """Return the axes of a palm, see `palm_axes`, from the wrist and the knuckles of three fingers, each (3,); None
    where the fingers begin in one place.
    """
    way, across = middle - hand, index - pinky
    length = float(np.linalg.norm(way))
    y = way / max(length, 1e-12)
    width = float(np.linalg.norm(across - y * (across @ y)))
    return palm_along(y, across) if width > _NARROW_PALM * length > 0 else None


def palm_along(y: Array, across: Array) -> Array:
    """Return the axes of a palm, see `palm_axes`, given its direction, a unit vector, and about where its index finger
    is, each (3,).
    """
    x = across - y * (across @ y)
    x = x / np.linalg.norm(x)
    return np.stack([x, y, np.cross(x, y)], axis=1)
