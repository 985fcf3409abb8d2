"""Suggestions: the frames on which one more key pose would help most."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..evidence.occlusion import apart
from ..shot.shot import KeyPoses
from ..tracking.uncertainty import expected_errors, joint_parts

Array = NDArray[np.float64]

MOST = 5
"""Key frames suggested for one performer, at most."""
NAMED = 3
"""Parts that are named with a suggestion, at most."""
DOUBTFUL = 0.7
"""A part is named that is at least this far off, as a share of the farthest."""
WORTH = 0.05
"""A suggestion removes at least this share of what is expected to be wrong."""


@dataclass(frozen=True)
class HelpfulKey:
    """A key frame that would help.

    Attributes
    ----------
    frame : int
    deviation : float
        Expected error there, mean over the joints, metres.
    gain : float
        By how much a key pose there, after those that stand before it in the list, would lower the expected error
        over the whole shot, mean, metres.
    parts : tuple of int
        Those whose tips, where they are joints, are expected to be farthest off there, the farthest first.
    """

    frame: int
    deviation: float
    gain: float
    parts: tuple[int, ...]


def helpful_keys(deviation: Array, keys: KeyPoses, parents: Sequence[int]) -> list[HelpfulKey]:
    """Frames on which one more key pose would help most, the most helpful first.

    A correction spreads to the key poses on both sides, fading evenly on the way. The frame whose correction takes
    away most of the expected error comes first; the next is found as if that one were keyed.

    Parameters
    ----------
    deviation : ndarray, shape (F, P)
        Expected error of every part, metres; see `uncertainty.joint_deviations`.
    keys : KeyPoses
    parents : sequence of int
        Of the body's parts.
    """
    expected, joints = expected_errors(deviation, parents), np.array(joint_parts(parents))
    keyed = {int(f) for f in keys.full()}
    found: list[HelpfulKey] = []
    least = WORTH * float(expected.sum())
    while len(found) < MOST:
        spreads = {c: _spread(c, keyed, len(expected)) for c in apart(range(len(expected)), sorted(keyed))}
        gains = {c: float(spread @ expected) for c, spread in spreads.items()}
        best = max(gains, key=lambda c: gains[c], default=None)
        if best is None or gains[best] <= least:
            break
        row = deviation[best, joints]
        worst = [int(joints[p]) for p in np.argsort(-row, kind="stable")[:NAMED] if row[p] >= DOUBTFUL * row.max()]
        found.append(HelpfulKey(best, float(row.mean()), gains[best] / len(expected), tuple(worst)))
        expected = expected * (1 - spreads[best])
        keyed.add(best)
    return found


def _spread(frame: int, keyed: set[int], length: int) -> Array:
    """How far a correction on a frame reaches: 1 there, fading evenly to 0 at the key frames beside it; beyond the
    first and last key frame it is held.
    """
    beside = [max((k for k in keyed if k < frame), default=None), min((k for k in keyed if k > frame), default=None)]
    knots = sorted([frame, *(key for key in beside if key is not None)])
    return np.interp(np.arange(length), knots, [float(knot == frame) for knot in knots])
