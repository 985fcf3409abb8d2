"""Ranges of frames, each given by its first and its last frame: found in flags, and joined where they meet.

There are two ways to meet. Damaged frames go on where one range begins on the frame after another (`adjacent_joined`).
Segments between key poses go on where one begins on the very frame on which another ends (`segments_joined`): two that
are only neighbours have no motion between them.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from .arrays import Bools

FrameRange = tuple[int, int]
"""First and last frame."""


def runs(flags: Bools) -> list[FrameRange]:
    """Return the first and the last index of every run of true values in flags (F,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def lasting(flags: Bools, least: int) -> Bools:
    """Return the flags (F,) that are true on `least` or more frames in a row."""
    found = flags.copy()
    for first, last in runs(flags):
        found[first : last + 1] = last + 1 - first >= least
    return found


def adjacent_joined(ranges: Iterable[FrameRange]) -> list[FrameRange]:
    """Sort ranges of frames, and join those between which no frame is left."""
    return _joined(ranges, 1)


def segments_joined(segments: Iterable[FrameRange]) -> list[FrameRange]:
    """Sort segments, and join those that share the key frame between them."""
    return _joined(segments, 0)


def _joined(ranges: Iterable[FrameRange], most: int) -> list[FrameRange]:
    """Join ranges of which one begins at most so many frames after the last frame of those before it."""
    found: list[FrameRange] = []
    for first, last in sorted(ranges):
        if found and first <= found[-1][1] + most:
            found[-1] = found[-1][0], max(found[-1][1], last)
        else:
            found.append((first, last))
    return found
