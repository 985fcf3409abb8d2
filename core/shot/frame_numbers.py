"""Which frame of the footage, and of its file, shows a frame of the shot, and how much later it was taken.

The frames of an interlaced view are its fields, two to a frame of the file: field k is the lines of one parity of the
file's frame k // 2.
"""

from __future__ import annotations

import numpy as np

from .shot import Settings, View

FIRST_PARITY = {"top-first": 0, "bottom-first": 1}
"""Of the lines that interlaced footage shows first."""


def is_interlaced(view: View) -> bool:
    """Whether a view's footage frames are fields, two to a frame of the file."""
    return view.fields in FIRST_PARITY


def footage_index(view: View, frame: int) -> int:
    """The footage's frame, or field, that shows a frame of the shot: the nearest where the offset is fractional.

    Parameters
    ----------
    frame : int
        In the count of the shot's first and last frame.
    """
    return int(np.floor(frame + view.offset + 0.5))


def footage_delay(view: View) -> float:
    """Return how much later than a frame of the shot its footage frame was taken, above -1/2 to 1/2 frames."""
    return footage_index(view, 0) - view.offset


def shown_delay(view: View, settings: Settings) -> float:
    """Return `footage_delay` with the offset of all footage, where that is known, frames."""
    return footage_delay(view) - (settings.footage_offset or 0.0)


def file_index(view: View, frame: int) -> int:
    """The frame of the file that shows a frame of the shot; of interlaced footage the one with its field.

    Parameters
    ----------
    frame : int
        In the count of the shot's first and last frame.
    """
    return footage_index(view, frame) // frames_per_file_frame(view)


def frames_per_file_frame(view: View) -> int:
    """How many of the view's footage frames there are in a frame of its file."""
    return 2 if is_interlaced(view) else 1
