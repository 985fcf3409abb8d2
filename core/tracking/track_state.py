"""The state of a shot while it is tracked: the motion and the offsets that are known so far."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from ..body.motion import Motion
from ..evidence.time_offset import Offset
from ..numerics.arrays import Ints
from ..shot.segments import Segment
from ..shot.shot import Shot
from .solvers.protocol import SolvedFrames

Around = tuple[tuple[Motion, ...] | None, tuple[Motion, ...] | None]
"""Every performer's pose on the frame before a range of frames, and on the one after it; None where unknown."""


@dataclass(frozen=True, eq=False)
class TrackState:
    """The state of a shot that is being tracked, from its first frame on.

    Attributes
    ----------
    motions : tuple of Motion
        Per performer: the poses on every frame of the shot; the start where nothing is solved yet.
    around : tuple of (tuple of Motion or None)
        The poses before the shot's first frame and after its last, where they are known.
    solved : int
        The first frame that is not solved yet.
    offsets : tuple of Offset
        Measurements of the footage's offset on the solved segments.
    """

    motions: tuple[Motion, ...]
    around: Around = (None, None)
    solved: int = 0
    offsets: tuple[Offset, ...] = ()

    def with_solution(self, segment: Segment, solved: Sequence[Motion]) -> TrackState:
        """Return the state with the motions of a segment that was solved or refined."""
        first, last = segment
        motions = tuple(m.replaced(first, new) for m, new in zip(self.motions, solved, strict=True))
        return replace(self, motions=motions, solved=max(self.solved, last + 1))

    def with_offset(self, measured: Offset | None) -> TrackState:
        """Return the state with another measurement of the footage's offset; unchanged for None."""
        return self if measured is None else replace(self, offsets=(*self.offsets, measured))

    def footage_offset(self, shot: Shot) -> float:
        """Offset of the footage in frames: that of the settings, or the estimate from all measurements so far."""
        given = shot.settings.footage_offset
        return Offset.likeliest(self.offsets, several=len(shot.performers) > 1).value if given is None else given

    def beside(self, segment: Segment, ranges: Sequence[Segment], keys: Sequence[Ints] = ()) -> SolvedFrames:
        """Return the motions on a segment that is solved and on those next to it among all segments, as far as these
        are, and which of these frames are among each performer's key poses of the whole body, on shot frames `keys`.
        """
        k, (first, last) = ranges.index(segment), segment
        begin = ranges[max(k - 1, 0)][0]
        end = max(last, min(ranges[min(k + 1, len(ranges) - 1)][1], self.solved - 1))
        keyed = tuple(frames[(frames >= begin) & (frames <= end)] - begin for frames in keys)
        return SolvedFrames(tuple(motion[begin : end + 1] for motion in self.motions), first - begin, keyed)

    def poses_at(self, frame: int) -> tuple[Motion, ...] | None:
        """Return the poses on a frame that is solved, or next to the shot and known; None otherwise."""
        if frame < 0 or frame == len(self.motions[0]):
            return self.around[frame > 0]
        return tuple(m[[frame]] for m in self.motions) if frame < self.solved else None

    def poses_before(self, frame: int, count: int) -> tuple[Motion, ...] | None:
        """Return the poses on up to `count` frames before a frame, as far as they are solved; None for no frame."""
        stop = min(frame, self.solved)
        run = slice(max(frame - count, 0), stop)
        return tuple(m[run] for m in self.motions) if 0 < stop == frame else None

    def poses_after(self, frame: int, count: int) -> tuple[Motion, ...] | None:
        """Return the poses on up to `count` frames after a frame, as far as they are solved; None for no frame."""
        run = slice(frame + 1, min(frame + 1 + count, self.solved))
        return tuple(m[run] for m in self.motions) if run.start < run.stop else None


@dataclass(frozen=True, eq=False)
class EarlierTrack:
    """A shot as it was tracked before some key poses changed.

    Attributes
    ----------
    motions : tuple of Motion
        Per performer, every frame of the shot. On key frames these may be the key poses of then or of now.
    carried : TrackState
        With these motions bent to pass through the key poses of now; see `core.shot.motion_warping.carried`.
    """

    motions: tuple[Motion, ...]
    carried: TrackState
