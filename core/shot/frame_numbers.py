"""Frame numbers: from frames of the shot to frames of the footage and of its file, and the delay between them.

The frames of an interlaced view are its fields, two to a frame of the file: field k consists of the lines of one parity
of the file's frame k // 2. A frame of the shot is a number in the count of `Shot.frames`.
"""

from __future__ import annotations

import numpy as np

from .shot import LARGEST_OFFSET, Settings, View

FIRST_PARITY = {"top-first": 0, "bottom-first": 1}
"""Parity of the lines that belong to the first field."""


def is_interlaced(view: View) -> bool:
    """Whether a view's footage frames are fields, two to a frame of the file."""
    return view.fields in FIRST_PARITY


def footage_index(view: View, frame: int) -> int:
    """Return the footage's frame, or field, that shows a frame of the shot: the nearest if the offset is fractional."""
    return int(np.floor(frame + view.offset + 0.5))


def footage_delay(view: View) -> float:
    """Return how much later than a frame of the shot its footage frame was taken, frames: over -1/2, up to 1/2."""
    return footage_index(view, 0) - view.offset


def shown_delay(view: View, settings: Settings) -> float:
    """Return `footage_delay` plus the offset of all footage, if that is known, frames."""
    return footage_delay(view) - (settings.footage_offset or 0.0)


def footage_offset_text(offset: float) -> str:
    """Return what the offset of all footage (see `Settings`, frames, not 0) means, and what to do about it."""
    when = "later" if offset > 0 else "earlier"
    if abs(offset) < LARGEST_OFFSET:
        measured = f"{abs(offset):.2f} frames {when} than on their frames"
        return f"the footage shows the key poses {measured}; tracking allows for it, nothing needs to be done"
    return (
        f"the footage shows the key poses half a frame or more {when} than on their frames; tracking allows for half a "
        f"frame only: see whether they fit the pictures one frame {when}, and move them there"
    )


def file_index(view: View, frame: int) -> int:
    """Return the frame of the file that shows a frame of the shot; for interlaced footage, the one with its field."""
    return footage_index(view, frame) // frames_per_file_frame(view)


def frames_per_file_frame(view: View) -> int:
    """Return the number of the view's footage frames per frame of its file: 2 if interlaced, else 1."""
    return 2 if is_interlaced(view) else 1
