"""The times of a video's frames, from its container: the tracker assumes a constant frame rate, which they may not
have.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from ...errors import listed
from ...numerics.arrays import Array, Bools, Ints
from ...numerics.frame_ranges import runs
from ..footage_files.image_sequences import image_files
from ..frame_numbers import file_index, frames_per_file_frame
from ..shot import Gap, Shot, View

MAX_DEVIATION = 0.5
"""Largest deviation of a frame from a constant rate that is ignored, frames."""
MAX_ASTRAY_COUNTED = 0.6
"""Largest deviation of a frame from the one that it is counted as, frames. With half a frame, frames that come halfway
between two would be counted now as the one, now as the other."""
_MAX_JUMPS_SHARE = 0.4
"""Share of a file's frames up to which they are counted by their times; beyond that the rate asked for is another."""
_WHOLE_TOLERANCE = 0.25
"""Largest deviation of a gap between two frames from a whole number of frames, for frames to be missing there."""
_COUNTED = "tracking numbers the other frames correctly, unless correct_gaps = false"
_MAX_SHOWN = 5
_MAX_REORDERING = 32
"""Upper limit to how many places a packet's order in the file differs from the order in which frames are shown."""


@dataclass(frozen=True)
class FootageRate:
    """The frame rate of a view's footage over the frames of a shot.

    Attributes
    ----------
    rate : float
        The constant rate that fits best, frames (or fields) per second.
    astray : float
        Largest deviation of a frame's time from that rate, frames.
    frame : int
        The frame of the file with that deviation.
    missing : sequence of (int, int)
        Frames of the file, and how many are missing before each, where the rate is otherwise constant.
    counted : sequence of (int, int)
        Where it is not: the same by the times at the rate that the shot asks for; where there are too many frames, how
        many, negative, from that frame on.
    """

    rate: float
    astray: float
    frame: int
    missing: Sequence[Sequence[int]] = ()
    counted: Sequence[Sequence[int]] = ()

    @property
    def varies(self) -> bool:
        """Whether the frame rate is too variable to be treated as constant, or frames are missing."""
        return self.astray > MAX_DEVIATION or len(self.missing) > 0

    def text(self, wanted: float | None = None) -> str:
        """Return the message that the frame rate varies and what to do, or which frames are missing.

        Parameters
        ----------
        wanted : float, optional
            Frames of the file per second that the shot asks for; by default `rate`.
        """
        if self.missing:
            gaps = listed([f"{count} before frame {frame}" for frame, count in self.missing], _MAX_SHOWN)
            return f"by the times in its file, frames are missing: {gaps} of the file; {_COUNTED}"
        off = f"{self.astray:.1f} frames off a constant rate of {self.rate:.4g}"
        what = f"its frame rate varies: frame {self.frame} of the file is {off}"
        if self.counted:
            lacks, extra = (sum(max(sign * count, 0) for _, count in self.counted) for sign in (1, -1))
            what += f"; {lacks} are missing, and {extra} too many, by their times; {_COUNTED}"
            return f"{what}; for Blender's pictures, {self._converted(wanted)}"
        return f"{what}; {self._converted(wanted)}"

    def _converted(self, wanted: float | None) -> str:
        return f"convert it, as with: ffmpeg -i FOOTAGE -vf fps={wanted or self.rate:.5g} -crf 14 CONVERTED.mp4"


def footage_rate(shot: Shot, view: View) -> FootageRate | None:
    """Return the frame rate of a view over the frames of a shot; None if the container does not state times.

    Nothing is decoded.
    """
    first, last = (file_index(view, frame) for frame in shot.frames)
    each = frames_per_file_frame(view)
    times = frame_times(view.footage, last + 1)[max(first, 0) :]
    return _rate(times, first, each, shot.fps * view.every / each)


def video_rate(path: Path, count: int, wanted: float | None = None) -> FootageRate | None:
    """Return the rate of a video's first frames, without decoding; None if the container does not state times.

    If frames per second are `wanted`, they are counted by their times where the rate varies.
    """
    return _rate(frame_times(path, count), 0, 1, wanted)


def _rate(times: Array, first: int, each: int, wanted: float | None) -> FootageRate | None:
    """Return the rate of frames at some times, seconds, from number `first` in the file; `each` fields make a frame."""
    if len(times) < 3 or times[-1] <= times[0]:
        return None
    number = np.arange(len(times))
    slope, off = _constant_rate(number, times)
    worst = int(np.abs(off).argmax())
    astray = float(abs(off[worst]))
    gaps = _missing(np.diff(times))
    if gaps.any():
        steady, left = _constant_rate(number + np.r_[0, np.cumsum(gaps)], times)
        if np.abs(left).max() <= MAX_DEVIATION / 2:
            missing = tuple((first + int(k) + 1, int(gaps[k])) for k in np.flatnonzero(gaps))
            return FootageRate(float(each / steady), astray, missing[0][0], missing)
    counted = _counted(times, first, wanted) if wanted and astray > MAX_DEVIATION else ()
    return FootageRate(float(each / slope), astray, first + worst, counted=counted)


def _counted(times: Array, first: int, rate: float) -> tuple[tuple[int, int], ...]:
    """Return before which frames at some times, seconds, others are missing at a constant rate, and how many, or how
    many are too many; none where that would be most of them.
    """
    places = (times - times[0]) * rate
    places -= np.angle(np.exp(2j * np.pi * places).mean()) / (2 * np.pi)  # the mean of what is off whole numbers
    number, jumps = round(float(places[0])), []
    for k, place in enumerate(places[1:], 1):
        number += 1
        if abs(place - number) > MAX_ASTRAY_COUNTED:
            jumps.append((first + k, round(place - number)))
            number += jumps[-1][1]
    return tuple(jumps) if len(jumps) <= _MAX_JUMPS_SHARE * len(times) else ()


def _missing(lasting: Array) -> Ints:
    """Return how many frames each of some intervals lacks, by the others, shape (n,)."""
    usual = float(np.median(lasting))
    if usual <= 0:
        return np.zeros(len(lasting), int)
    times = lasting / lasting[lasting < 1.5 * usual].mean()
    whole = np.rint(times)
    return np.where((np.abs(times - whole) < _WHOLE_TOLERANCE) & (whole > 1), whole - 1, 0).astype(int)


def _constant_rate(number: Ints, times: Array) -> tuple[float, Array]:
    """Return the interval between frames that fits times best, seconds, and the frames' deviations, frames."""
    slope, start = np.polyfit(number, times, 1)
    off = (times - start - slope * number) / slope
    return float(slope), np.asarray(off - (off.max() + off.min()) / 2)


def timed_gaps(view: View, rate: FootageRate | None) -> tuple[Gap, ...]:
    """Return the gaps in a view's footage that the times in its file show."""
    each, found = frames_per_file_frame(view), () if rate is None else rate.missing or rate.counted
    return tuple(Gap(each * frame, each * count, timed=True) for frame, count in found)


def frames_missing(rate: FootageRate | None, view: View, frames: range) -> Bools:
    """Return whether frames are missing in a view's file between each of N consecutive frames of a shot and the next,
    shape (N - 1,).
    """
    places = np.array([file_index(view, frame) for frame in frames])
    missing = np.zeros(len(frames) - 1, bool)
    for frame, _ in () if rate is None else rate.missing:
        missing |= (places[:-1] < frame) & (frame <= places[1:])
    return missing


def frame_times(path: Path, count: int) -> Array:
    """Return the times of a video's first N <= `count` frames, seconds, shape (N,); empty if they are not known.

    These are the packets' presentation times, in the order in which the frames are shown.
    """
    return np.array([time for time, _ in _packets(path, count)])


def whole_pictures(path: Path, count: int) -> Ints:
    """Return which of a video's first `count` frames are stored whole, not as what has changed since others."""
    return np.flatnonzero([is_whole for _, is_whole in _packets(path, count)])


def made_from(path: Path, read: Sequence[int], count: int) -> tuple[tuple[int, int], ...]:
    """Return the stretches of a video's first `count` frames, first and last of each, that are made from what its
    decoder takes in while it returns some of them.

    It takes in frames in the order in which they are stored, as many ahead as the most that one is stored before it is
    shown. What is made from a wrong one is wrong, too, up to the next that is stored whole.
    """
    stored = _stored_packets(path, count)
    shown = np.argsort(np.argsort([time for time, _ in stored], kind="stable"), kind="stable")
    ahead = int((np.arange(len(stored)) - shown).max(initial=0))
    whole = np.flatnonzero([is_whole for _, is_whole in stored])
    wrong = np.zeros(count, bool)
    for frame in read:
        first = min(frame + ahead, len(stored) - 1) if frame else 0
        after = whole[whole > first]
        own = shown[first : after[0] if len(after) else len(stored)]
        wrong[own[own < count]] = True
        wrong[frame] = True
    return tuple(runs(wrong))


def _packets(path: Path, count: int) -> list[tuple[float, bool]]:
    """Return the times of a video's first frames, seconds, and whether they are stored whole; none if unknown."""
    return sorted(_stored_packets(path, count))[:count]


def _stored_packets(path: Path, count: int) -> list[tuple[float, bool]]:
    """Return the same of some more frames, in the order in which they are stored.

    A file cut without encoding it again also stores what comes before the cut, back to a whole picture: frames that are
    decoded, but not shown, and all have the time of the first that is.
    """
    if not path.is_file() or image_files(path) is not None:
        return []
    video = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG, [cv2.CAP_PROP_FORMAT, -1])
    found: list[tuple[float, bool]] = []
    cut = 0
    try:
        while video.isOpened() and len(found) - cut < count + _MAX_REORDERING and video.grab():
            is_whole = video.get(cv2.CAP_PROP_LRF_HAS_KEY_FRAME) > 0
            found.append((video.get(cv2.CAP_PROP_POS_MSEC) / 1000, is_whole))
            cut += len(found) > 1 and found[-1][0] == found[0][0]
    finally:
        video.release()
    if not cut or cut == len(found) - 1:  # nothing was cut, or there are no times, as in a bare stream
        return found
    at_start = [k for k, (time, _) in enumerate(found) if time == found[0][0]]
    return [packet for k, packet in enumerate(found) if k not in at_start[:-1]]
