"""The rest positions of finger bones, which the default body itself does not have.

No part belongs to them, because the tracker does not see single fingers. Their names are Rigify's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import BodyError
from ..numerics.arrays import Array
from .body import Body

_KNUCKLES = {
    "f_index": (0.47, 0.14, 0.46),
    "f_middle": (0.48, 0.03, 0.52),
    "f_ring": (0.46, -0.08, 0.47),
    "f_pinky": (0.43, -0.18, 0.37),
}
"""For each finger of an average adult, in hand lengths: the position of its knuckle along the hand and across it
towards the thumb, and the length of the finger."""
_BONE_SHARES = (0.50, 0.28, 0.22)
"""Lengths of a finger's bones as shares of the finger's length."""
_THUMB, _THUMB_BONES = (0.12, 0.12), (0.22, 0.17, 0.14)
_THUMB_DIRECTION = np.array([1.0, 1.0]) / np.sqrt(2)
"""Where the thumb begins and how long its bones are, hand lengths, and the unit vector of its direction: along the hand
and across it."""


@dataclass(frozen=True, eq=False)
class FingerBone:
    """A bone at rest.

    Attributes
    ----------
    name, parent : str
    head_world, tail_world : ndarray, shape (3,)
        Metres.
    """

    name: str
    parent: str
    head_world: Array
    tail_world: Array


def finger_bones(body: Body) -> list[FingerBone]:
    """Return the bones of all fingers of a body of the default shape, parents before children.

    Raises
    ------
    BodyError
        The body has no hands.
    """
    found = []
    for side in "LR":
        hand = body.parts[body.index(f"hand.{side}")]
        along = hand.tail_world - hand.head_world
        length = float(np.linalg.norm(along))
        along = along / length
        across = np.array([0.0, -1.0, 0.0])  # in the T pose palms are down and thumbs in front
        across = across - along * (across @ along)
        size = float(np.linalg.norm(across))
        if size < 0.1:
            raise BodyError("the hands do not point to the sides in the rest pose", where=f"part hand.{side}")
        axes = length * np.stack([along, across / size], axis=1)
        chains = {
            name: [np.array([start, aside]) + [reach * sum(_BONE_SHARES[:k]), 0.0] for k in range(4)]
            for name, (start, aside, reach) in _KNUCKLES.items()
        }
        chains["thumb"] = [np.array(_THUMB) + sum(_THUMB_BONES[:k]) * _THUMB_DIRECTION for k in range(4)]
        for name, joints in chains.items():
            places = [hand.head_world + axes @ joint for joint in joints]
            above = hand.name
            for k in range(3):
                bone = FingerBone(f"{name}.0{k + 1}.{side}", above, places[k], places[k + 1])
                found.append(bone)
                above = bone.name
    return found
