"""Reading footage segment by segment: decoded once and in order, reduced and rectified, and nothing else."""

from __future__ import annotations

from dataclasses import dataclass
from threading import Event

import numpy as np
from numpy.typing import NDArray

from ..cameras.camera import Camera
from ..errors import CancelledError
from ..shot.footage import Album, footage_delay, frames_at, working_factor
from ..shot.shot import Shot, View
from .segments import Segment

Image = NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class ColourFrames:
    """Consecutive frames of one view, reduced and rectified.

    Attributes
    ----------
    camera : Camera
        The camera for the reduced frames, without lens distortion.
    colour : ndarray of uint8, shape (N, h, w, 3)
        Blue, green, red.
    first : int
        Shot frame of the first of them.
    delay : float
        How much later than the shot's frames these were taken, frames.
    """

    camera: Camera
    colour: Image
    first: int
    delay: float


class SegmentReader:
    """Reads the frames of one view, segment after segment.

    Parameters
    ----------
    shot : Shot
    view : View
    album : Album
        Pictures that are kept on the way.
    stopped : threading.Event
        Once it is set, reading ends with a CancelledError.
    """

    def __init__(self, shot: Shot, view: View, album: Album, stopped: Event) -> None:
        factor = working_factor(view, shot.settings.working_size)
        self._camera = view.camera.reduced(factor).rectified()
        self._delay = footage_delay(view)
        self._stream = frames_at(view, range(shot.frames[0], shot.frames[1] + 1), factor, grey=False, album=album)
        self._stopped = stopped
        self._last: list[Image] = []

    def read(self, segment: Segment) -> ColourFrames:
        """Read a segment that begins on the frame where the one before it ended.

        Raises
        ------
        FootageError
            The footage ends or breaks early.
        CancelledError
        """
        first, last = segment
        frames = self._last
        while len(frames) < last + 1 - first:
            if self._stopped.is_set():
                raise CancelledError
            frames.append(next(self._stream))
        self._last = frames[-1:]
        return ColourFrames(self._camera, np.stack(frames), first, self._delay)
