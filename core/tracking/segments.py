"""Segments: runs of frames between key poses of the whole body, solved on their own."""

from __future__ import annotations

from functools import reduce
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..shot.shot import Shot

Segment = tuple[int, int]
"""First and last shot frame of frames that are solved together."""
LONGEST = 150
"""Frames that are solved together where key poses are proposed, at most."""


def segments(shot: Shot) -> list[Segment]:
    """First and last frames of the segments that are solved on their own.

    They meet where every performer has a key pose of the whole body; before the first and after the last of these
    a segment is held at one end only. Where key poses are only proposed, long segments are cut on some of these, to
    hold fewer pictures at a time.
    """
    cuts = sorted({*whole_keys(shot, 0, shot.length - 1).tolist(), 0, shot.length - 1})
    proposed = posed_frames(shot, 0, shot.length - 1)
    found = []
    for start, last in pairwise(cuts):
        first = start
        while last - first > LONGEST:
            near = [int(f) for f in proposed if first < f <= first + LONGEST]
            if not near:
                break
            found.append((first, near[-1]))
            first = near[-1]
        found.append((first, last))
    return found


def whole_keys(shot: Shot, first: int, last: int) -> NDArray[np.int64]:
    """Frames first to last on which every performer has a key pose of the whole body."""
    whole = reduce(set.intersection, [set(performer.key_poses.full().tolist()) for performer in shot.performers])
    return np.array(sorted(f for f in whole if first <= f <= last), dtype=np.int64)


def posed_frames(shot: Shot, first: int, last: int) -> NDArray[np.int64]:
    """Frames first to last that show how the performers look: each has a key pose of the whole body, or a proposed
    one.
    """
    posed = ({*p.key_poses.full().tolist(), *p.key_poses.proposals().tolist()} for p in shot.performers)
    return np.array(sorted(f for f in reduce(set.intersection, posed) if first <= f <= last), dtype=np.int64)
