"""Segments: runs of frames between key poses of the whole body, solved on their own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import pairwise

import numpy as np

from ..numerics.arrays import Bools, Ints
from ..shot.shot import Shot

Segment = tuple[int, int]
"""First and last shot frame of frames that are solved together."""
LONGEST = 150
"""Frames that are solved together where key poses are proposed, or not on the same frames, at most."""

NEVER = 1 << 30
"""Frames to the nearest pose of a performer that has none."""


@dataclass(frozen=True, eq=False)
class PosedFrames:
    """K frames on some of which each of M performers is posed.

    Attributes
    ----------
    frames : ndarray of int, shape (K,)
        Shot frames, increasing.
    posed : ndarray of bool, shape (K, M)
        Who is.
    apart : ndarray of int, shape (K, M)
        How many frames each performer's nearest pose is away, among these frames or not.
    """

    frames: Ints
    posed: Bools
    apart: Ints

    @classmethod
    def of(cls, each: Sequence[Ints], first: int, last: int) -> PosedFrames:
        """Return those of every performer's frames that are among the frames first to last."""
        frames = np.unique(np.concatenate(each)).astype(np.int64)
        frames = frames[(frames >= first) & (frames <= last)]
        apart = [np.abs(frames[:, None] - own).min(axis=1, initial=NEVER) for own in each]
        return cls(frames, np.stack([np.isin(frames, own) for own in each], axis=1), np.stack(apart, axis=1))


def segments(shot: Shot) -> list[Segment]:
    """First and last frames of the segments that are solved on their own.

    They meet where every performer has a key pose of the whole body; before the first and after the last of these
    a segment is held at one end only. Where key poses are only proposed, or performers have theirs on different frames,
    long segments are cut on some of these, to hold fewer pictures at a time.
    """
    cuts = sorted({*whole_keys(shot, 0, shot.length - 1).tolist(), 0, shot.length - 1})
    proposed = posed_frames(shot, 0, shot.length - 1).frames
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


def whole_keys(shot: Shot, first: int, last: int) -> Ints:
    """Frames first to last on which every performer has a key pose of the whole body."""
    whole = reduce(set.intersection, [set(performer.key_poses.full().tolist()) for performer in shot.performers])
    return np.array(sorted(f for f in whole if first <= f <= last), dtype=np.int64)


def keyed_frames(shot: Shot, first: int, last: int) -> PosedFrames:
    """Frames first to last on which a performer has a key pose of the whole body."""
    return PosedFrames.of([p.key_poses.full() for p in shot.performers], first, last)


def posed_frames(shot: Shot, first: int, last: int) -> PosedFrames:
    """Frames first to last that show how a performer looks: it has a key pose of the whole body, or a proposed one."""
    each = [np.concatenate([p.key_poses.full(), p.key_poses.proposals()]) for p in shot.performers]
    return PosedFrames.of(each, first, last)
