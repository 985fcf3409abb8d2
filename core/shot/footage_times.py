"""When a video's frames were taken, as its container says: frames are counted as if they came at a constant rate."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from ..numerics.arrays import Array
from .frame_numbers import file_index, frames_per_file_frame
from .image_sequences import image_files
from .shot import Shot, View

ASTRAY = 0.5
"""Frames that are up to this far from a constant rate are taken for frames at that rate, frames."""
_AHEAD = 32
"""Packets are stored in another order than frames are shown, by fewer places than this."""


@dataclass(frozen=True)
class FootageRate:
    """The rate at which the frames of a shot come in a view's footage.

    Attributes
    ----------
    rate : float
        Frames, or fields, per second; the nearest constant one.
    astray : float
        By how much a frame is earlier or later than at that rate at most, frames.
    frame : int
        The frame of the file that is.
    """

    rate: float
    astray: float
    frame: int

    @property
    def varies(self) -> bool:
        """Whether the frames cannot be taken for frames at a constant rate."""
        return self.astray > ASTRAY

    @property
    def text(self) -> str:
        """Say that it varies, and what to do."""
        return (
            f"its frame rate varies: frame {self.frame} of the file is {self.astray:.1f} frames off a constant rate of "
            f"{self.rate:.4g}; convert it, as with: ffmpeg -i FOOTAGE -vf fps={self.rate:.4g} -crf 14 CONVERTED.mp4"
        )


def footage_rate(shot: Shot, view: View) -> FootageRate | None:
    """Return the rate of the frames that a shot shows of a view; None where the container does not tell.

    Nothing is decoded.
    """
    first, last = (file_index(view, frame) for frame in shot.frames)
    return _rate(frame_times(view.footage, last + 1)[max(first, 0) :], first, frames_per_file_frame(view))


def video_rate(path: Path, count: int) -> FootageRate | None:
    """Return the rate of a video's first frames; None where the container does not tell. Nothing is decoded."""
    return _rate(frame_times(path, count), 0, 1)


def _rate(times: Array, first: int, each: int) -> FootageRate | None:
    """The rate of frames at some times, seconds, the first of them of a number in the file; `each` count for one."""
    if len(times) < 3 or times[-1] <= times[0]:
        return None
    number = np.arange(len(times))
    slope, start = np.polyfit(number, times, 1)
    off = (times - start - slope * number) / slope
    off -= (off.max() + off.min()) / 2
    worst = int(np.abs(off).argmax())
    return FootageRate(float(each / slope), float(abs(off[worst])), first + worst)


def frame_times(path: Path, count: int) -> Array:
    """The times of a video's first frames, shape (N,) with N at most `count`, seconds; none where they are not known.

    They are the packets' presentation times, in the order in which the frames are shown.
    """
    if not path.is_file() or image_files(path) is not None:
        return np.zeros(0)
    video = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG, [cv2.CAP_PROP_FORMAT, -1])
    times: list[float] = []
    try:
        while video.isOpened() and len(times) < count + _AHEAD and video.grab():
            times.append(video.get(cv2.CAP_PROP_POS_MSEC) / 1000)
    finally:
        video.release()
    return np.sort(times)[:count]
