"""Segments: ranges of frames between key poses of the whole body, each of which is solved on its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import pairwise

import numpy as np

from ..numerics.arrays import Bools, Ints
from .shot import Shot

Segment = tuple[int, int]
"""First and last shot frame of a range that is solved together."""
MAX_LENGTH = 150
"""Largest length of segments where key poses are only proposed, or on different frames for different performers."""

NEVER = 1 << 30
"""Distance in frames to the nearest pose of a performer that has none."""


@dataclass(frozen=True, eq=False)
class PosedFrames:
    """K frames on which the poses of some of M performers are known.

    Attributes
    ----------
    frames : ndarray of int, shape (K,)
        Shot frames, increasing.
    posed : ndarray of bool, shape (K, M)
        Whose pose is known on each frame.
    apart : ndarray of int, shape (K, M)
        Distance in frames to each performer's nearest known pose, which may be on a frame that is not among these.
    """

    frames: Ints
    posed: Bools
    apart: Ints

    @classmethod
    def of(cls, each: Sequence[Ints], first: int, last: int) -> PosedFrames:
        """Collect the known poses on frames first to last, from the frames of each performer."""
        frames = np.unique(np.concatenate(each)).astype(np.int64)
        frames = frames[(frames >= first) & (frames <= last)]
        apart = [np.abs(frames[:, None] - own).min(axis=1, initial=NEVER) for own in each]
        return cls(frames, np.stack([np.isin(frames, own) for own in each], axis=1), np.stack(apart, axis=1))

    def where(self, chosen: Bools) -> PosedFrames:
        """Return some of the frames."""
        return PosedFrames(self.frames[chosen], self.posed[chosen], self.apart[chosen])


def segments(shot: Shot) -> list[Segment]:
    """Divide a shot into segments.

    They meet where every performer has a key pose of the whole body; those before the first and after the last of these
    frames have a key pose at one end only. Where key poses are only proposed, or performers have theirs on different
    frames, segments longer than `MAX_LENGTH` are divided on some of these, so that fewer pictures are held at a time.
    """
    cuts = sorted({*whole_keys(shot, 0, shot.length - 1).tolist(), 0, shot.length - 1})
    proposed = posed_frames(shot, 0, shot.length - 1).frames
    found = []
    for start, last in pairwise(cuts):
        first = start
        while last - first > MAX_LENGTH:
            near = [int(f) for f in proposed if first < f <= first + MAX_LENGTH]
            if not near:
                break
            found.append((first, near[-1]))
            first = near[-1]
        found.append((first, last))
    return found


def whole_keys(shot: Shot, first: int, last: int) -> Ints:
    """Return those of frames first to last on which every performer has a key pose of the whole body."""
    whole = reduce(set.intersection, [set(performer.key_poses.full().tolist()) for performer in shot.performers])
    return np.array(sorted(f for f in whole if first <= f <= last), dtype=np.int64)


def keyed_frames(shot: Shot, first: int, last: int) -> PosedFrames:
    """Return those of frames first to last on which some performer has a key pose of the whole body."""
    return PosedFrames.of([p.key_poses.full() for p in shot.performers], first, last)


def posed_frames(shot: Shot, first: int, last: int) -> PosedFrames:
    """Return those of frames first to last on which the look of some performer is learned: with a key pose of the whole
    body, set or proposed.
    """
    each = [np.concatenate([p.key_poses.full(), p.key_poses.proposals()]) for p in shot.performers]
    return PosedFrames.of(each, first, last)
