"""Reading footage segment by segment: frames are decoded once and in order, reduced in size, and rectified.

Pictures of a camera that only turns, as one that is held in the hand, are turned to one of its poses: its background
stands still then. Those of a lens that zooms are reduced to its shortest focal length.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import repeat
from threading import Event

import numpy as np
from numpy.typing import NDArray

from ...cameras.camera import Camera
from ...errors import CancelledError, FootageError
from ...numerics.arrays import Array, Bools
from ...runtime.processes.worker_memory import WorkerMemory
from ...runtime.threads import worker_count
from ...shot.fingerprint import checksum, made_of, value_bytes
from ...shot.footage import Album, frames_at, working_factor
from ...shot.footage_faults.continuity import COMPARED_PAIRS, block_change, block_means, most_changed, torn_pairs
from ...shot.footage_faults.footage_times import FootageRate, footage_rate, frames_missing
from ...shot.footage_faults.frame_pattern import FramePattern, repeated_every
from ...shot.footage_faults.skipped_frames import PairChanges, PointsFollowed
from ...shot.frame_numbers import across_gaps, footage_delay, frames_damaged
from ...shot.segments import Segment
from ...shot.shot import Shot, View
from .frames_ahead import taken_ahead
from .picture_store import COLOUR, PictureStore

Image = NDArray[np.uint8]

NEIGHBOURING_PAIRS = 2
"""How many pairs beside damaged ones are not compared with those around them."""
_UNKNOWN_CHANGE = 1e6
"""Change of a pair of frames beside which no other one stands out."""


@dataclass(frozen=True, eq=False)
class ColourFrames:
    """Consecutive frames of one view, reduced in size and without lens distortion.

    Attributes
    ----------
    camera : Camera
        The camera for the reduced frames, without lens distortion; it stands still if the view's only turns a little.
    colour : ndarray of uint8, shape (N, h, w, 3)
        Blue, green, red.
    first : int
        Shot frame of the first of them.
    delay : float
        How much later than the shot's frames these were taken, in frames.
    torn : ndarray of bool, shape (N - 1,), optional
        Pairs of frames that do not continue each other, see `core.shot.footage_faults.continuity`.
    damaged : ndarray of bool, shape (N,), optional
        Frames that are known to be damaged, see `View.damaged`.
    changes : PairChanges, optional
        How much these pairs stand out, by which missing frames are found once all views are read.
    """

    camera: Camera
    colour: Image
    first: int
    delay: float
    torn: Bools | None = None
    damaged: Bools | None = None
    changes: PairChanges | None = None


class SegmentReader:
    """Reads the frames of one view, segment after segment.

    Parameters
    ----------
    shot : Shot
    view : View
    album : Album
        Collects the pictures of some frames on the way.
    stopped : threading.Event
        Once it is set, reading raises a CancelledError.
    memory : WorkerMemory, optional
        Cache of frames for the next job; frames in it are not decoded again.
    """

    def __init__(
        self, shot: Shot, view: View, album: Album, stopped: Event, *, memory: WorkerMemory | None = None
    ) -> None:
        factor = working_factor(view, shot.settings.working_size)
        camera = view.camera.at(range(shot.length))  # it may have poses for other frames, too
        view = replace(view, camera=camera)
        standing = camera.standing()
        turned = camera.unzooming(range(shot.length)) if standing is None else camera.turns_to(standing)
        self._camera = (standing or camera).reduced(factor).rectified()
        self._delay = footage_delay(view)
        threads = max(1, worker_count(shot.settings.threads) // len(shot.views))  # the views are read side by side
        frames = range(shot.frames[0], shot.frames[1] + 1)
        self._damaged = frames_damaged(view, frames)
        turns = None if turned is None else dict(zip(frames, turned, strict=True))
        decoded = _frames(view, frames, factor, album, memory=memory, threads=threads, turns=turns)
        self._stream = sound_pictures(decoded, self._damaged)
        self._album, self._stopped = album, stopped
        self._length = shot.length
        self._gaps = frames_missing(kept_rate(shot, view, memory), view, frames) | across_gaps(view, frames)
        self._begins = 0 if self._damaged.all() else int(np.argmin(self._damaged))
        damaged = self._damaged[:-1] | self._damaged[1:]
        self._apart = self._gaps | damaged
        self._beside = np.convolve(damaged, np.ones(2 * NEIGHBOURING_PAIRS + 1), mode="same") > 0
        self._ahead: list[Image] = []
        self._read = 0
        self._before: Image | None = None
        self._small: Array | None = None
        self._memory, self._first = memory, shot.frames[0]
        self._made_of = b"" if memory is None else made_of(view, factor)
        self._changes: list[NDArray[np.float16]] = []
        self._points = PointsFollowed()

    def read(self, segment: Segment, store: PictureStore) -> ColourFrames:
        """Read the next segment, which begins on the last frame of the one before; its frames go to a store.

        Raises
        ------
        FootageError
            The footage ends or breaks early.
        CancelledError
        """
        first, last = segment
        # As an iterator: the frames of a long segment should not be in memory twice.
        frames = store.kept(COLOUR, self._one_by_one(first, last), last + 1 - first)
        torn, changes = self._continuity(first, last)
        damaged = self._damaged[first : last + 1]
        return ColourFrames(
            camera=self._camera,
            colour=frames,
            first=first,
            delay=self._delay,
            torn=torn,
            damaged=damaged,
            changes=changes,
        )

    @property
    def pattern(self) -> FramePattern:
        """How the frames that were read were made from others."""
        return FramePattern(self._album.fields.interlaced, repeated_every(self._changes))

    def _one_by_one(self, first: int, last: int) -> Iterator[Image]:
        """Generate the frames of a segment; the last one is also the first of the next segment."""
        for frame in range(first, last + 1):
            while self._read < min(frame + 1 + COMPARED_PAIRS, self._length):
                if self._stopped.is_set():
                    raise CancelledError
                self._take(next(self._stream))
            yield self._ahead[0] if frame == last else self._ahead.pop(0)

    def _take(self, image: Image) -> None:
        """Take the next frame, and measure how much it differs from the one before."""
        change = 0.0
        if self._before is not None:
            if self._changes and self._apart[len(self._changes)]:
                # What is known to be no continuation must not make the pairs beside it stand out.
                self._changes.append(self._changes[-1])
                self._small = None
            else:
                self._changes.append(self._change(self._before, image))
            # Where the first frames are damaged, no change is known before theirs.
            known = self._read > self._begins
            change = most_changed(self._changes[-1].astype(float)) if known else _UNKNOWN_CHANGE
        self._points.add(image, change)
        self._before = image
        self._ahead.append(image)
        self._read += 1

    def _change(self, before: Image, image: Image) -> NDArray[np.float16]:
        """Return the `block_change` of the next frame, from memory if it was measured in an earlier job."""
        blocks: Array | None = None

        def measured() -> NDArray[np.float16]:
            nonlocal blocks
            blocks = block_means(image)
            change = block_change(block_means(before) if self._small is None else self._small, blocks)
            return np.asarray(change, np.float16)

        key = "change", self._made_of, self._first + self._read
        change: NDArray[np.float16] = measured() if self._memory is None else self._memory.value(key, measured)
        self._small = blocks
        return change

    def _continuity(self, first: int, last: int) -> tuple[Bools, PairChanges]:
        """Return which pairs of a segment's frames do not continue each other, and how much they stand out."""
        start = max(first - COMPARED_PAIRS, 0)
        changes = [change.astype(float) for change in self._changes[start : last + COMPARED_PAIRS]]
        unknown = max(self._begins - start, 0)
        if unknown < len(changes):
            changes[:unknown] = [changes[unknown]] * unknown
        followed = self._points.between(start, start + len(changes)) & ~self._apart[start : start + len(changes)]

        def compared() -> tuple[Bools, PairChanges]:
            return torn_pairs(changes), PairChanges.of(changes, followed, self._delay)

        known = "pairs", self._delay, checksum(value_bytes((changes, followed)))
        torn, found = compared() if self._memory is None else self._memory.value(known, compared)
        torn = torn[first - start : last - start] & ~self._apart[first:last] | self._gaps[first:last]
        return torn, found.known(~self._beside[start : start + len(changes)]).cut(first - start, last - start)


def _frames(
    view: View,
    frames: range,
    factor: float,
    album: Album,
    *,
    memory: WorkerMemory | None,
    threads: int,
    turns: Mapping[int, Array] | None,
) -> Iterator[Image]:
    """Generate the frames of a view in colour, decoding those that are not in memory."""

    def decoding(some: Sequence[int]) -> Iterator[Image]:
        there = None if turns is None else [turns[f] for f in some]
        return frames_at(view, some, factor, grey=False, album=album, threads=threads, turns=there)

    if memory is None:
        yield from decoding(frames)
        return
    of = made_of(view, factor)
    # Reserved from the beginning: frames that others add meanwhile must not displace one that is relied upon.
    kept = {f: image for f in frames if f not in album.frames and (image := memory.picture((of, f))) is not None}
    missing = [f for f in frames if f not in kept]
    begun = taken_ahead(memory, of, frames, album) if turns is None and len(missing) == len(frames) else None
    decoded = decoding(missing) if begun is None else begun
    for f in frames:
        image = kept.pop(f, None)
        if image is None:
            image = next(decoded)
            memory.keep((of, f), image)
        yield image


def sound_pictures(pictures: Iterator[Image], damaged: Bools) -> Iterator[Image]:
    """Generate N pictures, each damaged one replaced by the sound one before it, or at the start by the first.

    Damaged ones have no weight, but foregrounds and colours are learned from all frames of a view together.
    """
    if damaged.all():
        yield from pictures
        return
    sound, waiting = None, 1
    for picture, is_damaged in zip(pictures, damaged, strict=True):
        if not is_damaged:
            sound = picture
        if sound is None:
            waiting += 1
        else:
            yield from repeat(sound, waiting)
            waiting = 1


def is_kept(shot: Shot, view: View, memory: WorkerMemory) -> bool:
    """Whether all frames of a view that a shot needs are in memory, and its files have not changed since."""
    try:
        of = made_of(view, working_factor(view, shot.settings.working_size))
    except (OSError, FootageError):
        return False
    return all(memory.picture((of, f)) is not None for f in range(shot.frames[0], shot.frames[1] + 1))


def kept_rate(shot: Shot, view: View, memory: WorkerMemory | None) -> FootageRate | None:
    """Return the rate of a view's frames (`footage_rate`); files that have not changed since are not opened again."""
    if memory is None or not view.footage.is_file():
        return footage_rate(shot, view)
    of = made_of(view, working_factor(view, shot.settings.working_size)), shot.frames
    rate: FootageRate | None = memory.value(("rate", *of), partial(footage_rate, shot, view))
    return rate
