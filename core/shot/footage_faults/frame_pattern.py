"""Footage whose frames were made from others in a fixed pattern: woven of two fields, or repeated at regular intervals.

Programs put footage with fewer frames per second into a file with more by repeating some: every second one (30 in 60
frames per second), every fifth (24 in 30) or every sixth (25 in 30).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...numerics.arrays import Array, Bools
from .continuity import most_changed

_PERIODS = range(2, 7)
_MIN_RATIO = 3.0
"""How much more the pairs of frames on either side of a repeated frame change, at least."""
_MIN_REPEATED, _MIN_REPEATED_SHARE = 5, 0.9
"""How many frames must repeat the one before, and what share of those that are due while something moves."""


@dataclass(frozen=True)
class FramePattern:
    """How the frames of footage were made from others.

    Attributes
    ----------
    interlaced : bool
        Whether frames consist of two fields, though the footage is said to be progressive.
    every : int
        Every how many frames one repeats the one before; 0 if none do.
    """

    interlaced: bool = False
    every: int = 0

    @property
    def brief(self) -> str:
        """A few words on it; empty if the frames are as they were taken."""
        repeated = f"every {_ORDINALS[self.every]} frame repeats the one before" if self.every else ""
        return " and ".join(filter(None, ["its frames look interlaced" if self.interlaced else "", repeated]))

    @property
    def text(self) -> str:
        """What it is and what to do; empty if the frames are as they were taken."""
        return "; ".join(filter(None, [_INTERLACED if self.interlaced else "", self._repeated()]))

    def _repeated(self) -> str:
        if not self.every:
            return ""
        if self.every == 2:
            todo = (
                "write every = 2 into the [[view]] and half as many fps under [shot], and count frames and key frames "
                "by these"
            )
        else:
            todo = (
                f"take them out, as with: ffmpeg -i FOOTAGE -vf decimate=cycle={self.every} -crf 14 CONVERTED.mp4, "
                f"state {self.every - 1}/{self.every} of the fps, and count frames and key frames by those left"
            )
        return (
            f"every {_ORDINALS[self.every]} frame repeats the one before: it was taken with fewer frames per second "
            f"than its file has; {todo}"
        )


_ORDINALS = {2: "second", 3: "third", 4: "fourth", 5: "fifth", 6: "sixth"}
_INTERLACED = (
    "its frames look interlaced: what moves is in two places, line by line; state the order of its fields in the "
    '[[view]], mostly fields = "top-first" (DV: "bottom-first"), twice as many fps under [shot], and count frames and '
    "key frames in fields; or deinterlace it, as with: ffmpeg -i FOOTAGE -vf bwdif=send_frame -crf 14 CONVERTED.mp4"
)


def repeated_every(changes: Sequence[NDArray[np.floating[Any]]]) -> int:
    """Return every how many frames one repeats the frame before, from the `block_change` of consecutive pairs of them;
    0 if none do, or too little moves to tell.
    """
    most = np.array([most_changed(np.asarray(change, float)) for change in changes])
    return next((p for p in _PERIODS if any(_is_repeated(most, np.arange(k, len(most), p)) for k in range(p))), 0)


def _is_repeated(most: Array, pairs: NDArray[np.int64]) -> bool:
    """Whether nothing changes between some of the pairs of frames, though something does before and after them."""
    inner = pairs[(pairs > 0) & (pairs < len(most) - 1)]
    if len(inner) < _MIN_REPEATED:
        return False
    beside = np.minimum(most[inner - 1], most[inner + 1])
    moving: Bools = beside > _MIN_RATIO * np.median(most[inner])
    still = _MIN_RATIO * most[inner] < beside
    return bool(still[moving].sum() >= _MIN_REPEATED and still[moving].mean() >= _MIN_REPEATED_SHARE)
