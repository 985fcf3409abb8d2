"""Occlusion: which parts the cameras do not see, when, and where a key pose would help (paper 000, sections 5.3, 6)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_closing

from ..shot.shot import KeyPoses

Array = NDArray[np.float64]

OCCLUDED_BELOW = 0.3
"""A part is occluded in a view where less than this share of its area is seen (paper 000, section 5.3)."""
LONG = 6
"""Frames that a part must be out of sight for a key pose to be worth the work: prediction bridges fewer."""
GLIMPSE = 3
"""Frames that a part must be in sight to be posed there."""
REACH = 5
"""A key pose may be suggested this many frames before or after those on which a part is out of sight."""
APART = 5
"""Frames between a suggested key frame and another, or one that there is, at least."""
MOST = 6
"""Key frames suggested for one performer, at most."""


@dataclass(frozen=True)
class Suggestion:
    """A key frame that would help: parts are seen there which are out of sight just before or after.

    Attributes
    ----------
    frame : int
    parts : tuple of int
        In the order of how long they are out of sight.
    hidden : tuple of int
        First and last of the frames on which the first of these parts is out of sight.
    """

    frame: int
    parts: tuple[int, ...]
    hidden: tuple[int, int]

    def with_part(self, part: int) -> Suggestion:
        """The same with another part."""
        return self if part in self.parts else replace(self, parts=(*self.parts, part))


def occluded(share: Array, predicted: Array | None = None) -> NDArray[np.bool_]:
    """Where a part counts as occluded in a view, of the shape of `share`.

    Parameters
    ----------
    share : ndarray, shape (..., P)
        Visible share of each part's projected area in its current pose, 0 to 1.
    predicted : ndarray, shape (..., P), optional
        The same in the pose predicted for the next frame: either is enough.
    """
    hidden = share < OCCLUDED_BELOW
    return hidden if predicted is None else hidden | (predicted < OCCLUDED_BELOW)


def unseen(share: Array, predicted: Array | None = None) -> NDArray[np.bool_]:
    """Frames on which no view sees a part, shape (F, P), of visible shares (V, F, P); see `occluded`."""
    return occluded(share, predicted).all(axis=0)


def intervals(mask: NDArray[np.bool_], first: int = 0) -> list[list[int]]:
    """First and last frame of each run of true values; the mask's frame 0 is frame `first`."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    return [[first + int(a), first + int(b) - 1] for a, b in zip(edges[::2], edges[1::2], strict=True)]


def suggested_keyframes(unseen: NDArray[np.bool_], keys: KeyPoses) -> list[Suggestion]:
    """Frames on which a key pose would help most: beside those on which parts are out of sight (section 6).

    Of the frames just before, or just after, it is the one on which the fewest parts are hidden.

    Parameters
    ----------
    unseen : ndarray of bool, shape (F, P)
        Frames on which no camera sees a part.
    keys : KeyPoses
        A part is known where its rotation is keyed, and needs no other key pose near.

    Returns
    -------
    list of Suggestion
        The longest hidden first, `MOST` at most.
    """
    hidden = unseen | binary_closing(unseen, np.ones((GLIMPSE, 1)))
    found: list[Suggestion] = []
    for part, first, last in _longest_hidden(hidden, keys):
        for beside in (range(first - 1, first - 1 - REACH, -1), range(last + 1, last + 1 + REACH)):
            near = [f for f in beside if 0 <= f < len(hidden) and not hidden[f, part]]
            near = apart(near, _keyed(keys, part))
            shared = next((i for i, other in enumerate(found) if other.frame in near), None)
            if shared is not None:
                found[shared] = found[shared].with_part(part)
            elif free := apart(near, [other.frame for other in found]):
                frame = min(free, key=lambda f: hidden[f].sum())
                found.append(Suggestion(frame, (part,), (first, last)))
    return found[:MOST]


def _longest_hidden(hidden: NDArray[np.bool_], keys: KeyPoses) -> list[tuple[int, int, int]]:
    """Part, first and last frame of every long stretch on which a part is neither seen nor keyed."""
    spans = []
    for part in range(hidden.shape[1]):
        unknown = hidden[:, part].copy()
        unknown[_keyed(keys, part)] = False
        spans += [(part, a, b) for a, b in intervals(unknown) if b + 1 - a >= LONG]
    return sorted(spans, key=lambda span: (span[1] - span[2], span[1]))


def _keyed(keys: KeyPoses, part: int) -> list[int]:
    return [int(f) for f in keys.frames[keys.fixed[:, 3 + 3 * part : 6 + 3 * part].all(axis=1)]]


def apart(frames: Sequence[int], others: Sequence[int]) -> list[int]:
    """Those frames that are far enough from others to be key frames beside them."""
    return [f for f in frames if all(abs(f - other) >= APART for other in others)]
