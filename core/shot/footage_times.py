"""The times of a video's frames, from its container: the tracker assumes a constant frame rate, which they may not
have.
"""

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
"""Largest deviation of a frame from a constant rate that is ignored, frames."""
_AHEAD = 32
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
    """

    rate: float
    astray: float
    frame: int

    @property
    def varies(self) -> bool:
        """Whether the frame rate is too variable to be treated as constant."""
        return self.astray > ASTRAY

    @property
    def text(self) -> str:
        """Message that the frame rate varies, and what to do."""
        return (
            f"its frame rate varies: frame {self.frame} of the file is {self.astray:.1f} frames off a constant rate of "
            f"{self.rate:.4g}; convert it, as with: ffmpeg -i FOOTAGE -vf fps={self.rate:.4g} -crf 14 CONVERTED.mp4"
        )


def footage_rate(shot: Shot, view: View) -> FootageRate | None:
    """Return the frame rate of a view over the frames of a shot; None if the container does not state times.

    Nothing is decoded.
    """
    first, last = (file_index(view, frame) for frame in shot.frames)
    return _rate(frame_times(view.footage, last + 1)[max(first, 0) :], first, frames_per_file_frame(view))


def video_rate(path: Path, count: int) -> FootageRate | None:
    """Return the rate of a video's first frames, without decoding; None if the container does not state times."""
    return _rate(frame_times(path, count), 0, 1)


def _rate(times: Array, first: int, each: int) -> FootageRate | None:
    """Return the rate of frames at some times, seconds, from number `first` in the file; `each` fields make a frame."""
    if len(times) < 3 or times[-1] <= times[0]:
        return None
    number = np.arange(len(times))
    slope, start = np.polyfit(number, times, 1)
    off = (times - start - slope * number) / slope
    off -= (off.max() + off.min()) / 2
    worst = int(np.abs(off).argmax())
    return FootageRate(float(each / slope), float(abs(off[worst])), first + worst)


def frame_times(path: Path, count: int) -> Array:
    """Return the times of a video's first N <= `count` frames, seconds, shape (N,); empty if they are not known.

    These are the packets' presentation times, in the order in which the frames are shown.
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
