"""A few hand shapes, as rotations of the finger bones of any rig."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from ...body.skeleton_motion import RestSkeleton
from ...errors import BodyError
from ...numerics import rotations
from ...numerics.arrays import Array
from ..bone_roles.roles import FINGERS, BoneMap
from ..rest_poses.palms import palm_axes

_Bends = tuple[float, float, float]


def _shape(thumb: _Bends, index: _Bends, others: _Bends) -> Mapping[str, _Bends]:
    return MappingProxyType({"thumb": thumb, "index": index, **dict.fromkeys(("middle", "ring", "pinky"), others)})


FLEXIONS: Mapping[str, Mapping[str, _Bends]] = MappingProxyType(
    {
        "flat": _shape((0, 0, 0), (0, 0, 0), (0, 0, 0)),
        "relaxed": _shape((5, 10, 10), (15, 25, 15), (20, 30, 20)),
        "grip": _shape((15, 20, 20), (35, 50, 30), (40, 55, 35)),
        "fist": _shape((20, 35, 40), (75, 95, 60), (80, 95, 60)),
        "point": _shape((20, 35, 40), (0, 5, 5), (80, 95, 60)),
    }
)
"""Flexion of each joint of a finger from the rest pose, degrees, beginning at the knuckle."""


def finger_turns(rest: RestSkeleton, bones: BoneMap, side: str, shape: str, amount: float = 1.0) -> dict[str, Array]:
    """Return the rotation (3, 3) of each finger bone of a hand relative to its parent, in world axes at rest.

    Parameters
    ----------
    rest : RestSkeleton
    bones : BoneMap
    side : str
        "L" or "R".
    shape : str
        One of `core.choices.HAND_SHAPES`.
    amount : float
        Strength of the shape: 0 is the rest pose, 1 the full shape.

    Raises
    ------
    BodyError
        The index, middle or little finger, which define the palm, is unknown.
    """
    palm = palm_axes(rest, bones, side)
    if palm is None:
        raise BodyError(
            f"the fingers of hand.{side} are not known",
            where="bone map",
            todo="name the bones of its index, middle and little finger",
        )
    across, inward = palm[:, 0], palm[:, 2] * (-1.0 if side == "L" else 1.0)
    found = {}
    for finger in FINGERS:
        chain = rest.indices(bones.bones.get(f"{finger}.{side}", ()))
        for k, j in enumerate(chain[:3]):
            end = rest.heads[chain[k + 1]] if k + 1 < len(chain) else rest.tails[j]
            along = end - rest.heads[j]
            # Fingers bend towards the palm, the thumb across it.
            axis = np.cross(along, inward - across if finger == "thumb" else inward)
            length = np.linalg.norm(axis)
            if np.isfinite(length) and length > 0:
                angle = amount * np.radians(FLEXIONS[shape][finger][k])
                found[rest.names[j]] = rotations.exp(angle * axis / length)
    return found
