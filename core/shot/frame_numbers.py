"""Frame numbers: from frames of the shot to frames of the footage and of its file, and the delay between them.

The frames of an interlaced view are its fields, two to a frame of the file: field k consists of the lines of one parity
of the file's frame k // 2. A frame of the shot is a number in the count of `Shot.frames`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..numerics.arrays import Bools, Ints
from .settings import MAX_OFFSET, Settings
from .shot import Gap, View

_SURE_OFFSET = 0.4
"""Measured shift of key poses, frames, from which they may be a whole frame off: 0.46 was measured where they were."""
FIRST_PARITY = {"top-first": 0, "bottom-first": 1}
"""Parity of the lines that belong to the first field."""

NOWHERE = -(2**62)
"""No frame of any shot."""


def is_interlaced(view: View) -> bool:
    """Whether a view's footage frames are fields, two to a frame of the file."""
    return view.fields in FIRST_PARITY


def footage_index(view: View, frame: int) -> int:
    """Return the footage's frame, or field, that shows a frame of the shot: the nearest if the offset is fractional,
    and the one before the gap if the frame is missing.
    """
    index = view.every * frame + whole_offset(view)
    for gap in view.gaps:
        if index >= gap.frame:
            index = max(index - gap.missing, gap.frame - 1)
    return index


def shot_frames(view: View, indices: Ints) -> Ints:
    """Return the frames of the shot that N frames, or fields, of the footage show, shape (N,); `NOWHERE` for repeated
    frames, and for those between two frames of the shot.
    """
    instants, twice = _instants(view, indices)
    frames, between = np.divmod(instants - whole_offset(view), view.every)
    return np.where(twice | (between > 0), NOWHERE, frames)


def _instants(view: View, indices: Ints) -> tuple[Ints, Bools]:
    """Return which frames N frames of a view's footage would be if it had no gaps, and which of them are repeated."""
    instants, twice = indices.copy(), np.zeros(len(indices), bool)
    for gap in reversed(view.gaps):
        behind = instants >= gap.frame
        twice |= behind & (instants + gap.missing < gap.frame)
        instants = instants + np.where(behind, gap.missing, 0)
    return instants, twice


def _frame_from(view: View, index: int) -> int:
    """Return the first frame of the shot that a frame of the footage, or a later one, shows."""
    [instant] = _instants(view, np.array([index]))[0]
    return int(-((whole_offset(view) - instant) // view.every))


def gap_frame(view: View, gap: Gap) -> int:
    """Return the first frame of the shot that is missing in one of a view's gaps, or the first after its repeated
    frames.
    """
    [behind] = _instants(view, np.array([gap.frame + max(-gap.missing, 0)]))[0]
    first = int(behind) - max(gap.missing, 0) - whole_offset(view)
    return -(-first // view.every)


def without_gaps_beyond(view: View, first: int, last: int) -> View:
    """Return a view with the same footage on frames first to last of the shot, and no gaps before or after these."""
    offset, gaps = view.offset, []
    for gap in view.gaps:
        begin = gap_frame(view, gap)
        if _frame_from(view, gap.frame + max(-gap.missing, 0)) <= first:
            offset -= gap.missing
        elif begin <= last:
            gaps.append(gap)
    return replace(view, offset=offset, gaps=tuple(gaps))


def across_gaps(view: View, frames: range) -> Bools:
    """Return whether a gap lies between each of N consecutive frames of the shot and the next, shape (N - 1,)."""
    places = np.array([footage_index(view, frame) for frame in frames])
    across = np.diff(places) != view.every
    for gap in view.gaps:
        across |= (places[:-1] < gap.frame) & (gap.frame <= places[1:])
    return across


def frames_damaged(view: View, frames: range) -> Bools:
    """Return which of N consecutive frames of the shot a view's file shows damaged (`View.damaged`), shape (N,)."""
    places = np.array([file_index(view, frame) for frame in frames])
    return np.any([(first <= places) & (places <= last) for first, last in ((0, -1), *view.damaged)], axis=0)


def whole_offset(view: View) -> int:
    """Return by how many frames the footage would be ahead of the shot if there were no gaps."""
    return int(np.floor(view.offset + 0.5))


def footage_delay(view: View) -> float:
    """Return how much later than a frame of the shot its footage frame was taken, frames of the shot: over -1/2, up to
    1/2.
    """
    return (whole_offset(view) - view.offset) / view.every


def shown_delay(view: View, settings: Settings) -> float:
    """Return `footage_delay` plus the offset of all footage, if that is known, frames."""
    return footage_delay(view) - (settings.footage_offset or 0.0)


def footage_offset_text(offset: float) -> str:
    """Return what the offset of all footage (see `Settings`, frames, not 0) means, and what to do about it."""
    when = "later" if offset > 0 else "earlier"
    if abs(offset) < MAX_OFFSET:
        measured = f"{abs(offset):.2f} frames {when} than on their frames"
        done = "tracking allows for it"
        if abs(offset) < _SURE_OFFSET:
            return f"the footage shows the key poses {measured}; {done}, nothing needs to be done"
        return (
            f"the footage shows the key poses {measured}; {done}, but key poses that are a whole frame off may be "
            f"measured as no more than that: if one fits its pictures one frame {when}, move all of them there"
        )
    return (
        f"the footage shows the key poses half a frame or more {when} than on their frames; tracking allows for half a "
        f"frame only: if they fit the pictures one frame {when}, move them there"
    )


def file_index(view: View, frame: int) -> int:
    """Return the frame of the file that shows a frame of the shot; for interlaced footage, the one with its field."""
    return footage_index(view, frame) // frames_per_file_frame(view)


def frames_per_file_frame(view: View) -> int:
    """Return the number of the view's footage frames per frame of its file: 2 if interlaced, else 1."""
    return 2 if is_interlaced(view) else 1
