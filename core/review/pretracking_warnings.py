"""What is to be asked about a shot before it is tracked: its performers' key poses, and its lenses."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..body.swapped_sides import swapped_sides
from ..cameras.fisheye_warning import fisheye_warning
from ..errors import listed
from ..shot.footage_faults.footage_checks import SAME_RATE
from ..shot.shot import Performer, Shot

_NAMED = 3


def key_rate_text(rate: float, fps: float) -> str:
    """Return a text that a file of key poses has another frame rate than its shot; empty if it has not, or states none
    (0).
    """
    if not rate or abs(rate - fps) <= SAME_RATE * fps:
        return ""
    return (
        f"the file of its key poses has {rate:.5g} frames per second, the shot {fps:.5g}; its rows are taken for the "
        f"shot's frames one by one: if both rates are right, resample it to {fps:.5g}"
    )


def first_row_text(rows: int, frames: Sequence[int]) -> str:
    """Return a text that it was not said which frame the first row of a file of key poses shows, though the shot (first
    and last frame) begins later than its footage, and the file may begin with the footage; else empty.
    """
    first, last = frames
    if first <= 0 or rows <= last + 1 - first:
        return ""
    return (
        f"the file of its key poses has {rows} rows for the shot's {last + 1 - first} frames; its first row is taken "
        f"for frame {first}: if the file begins with the footage, write first_row = 0 into the [[performer]], "
        f"otherwise first_row = {first}"
    )


def warnings_before_tracking(shot: Shot) -> list[str]:
    """Return what is to be asked about the cameras' lenses, and about the performers' key poses and their files, before
    a shot is tracked, as lines.
    """
    lenses = [f"{view.camera.name}: {text}" for view in shot.views if (text := fisheye_warning(view.camera))]
    return lenses + [
        f"{performer.name}: {text}"
        for performer in shot.performers
        for text in (
            key_rate_text(performer.file_fps, shot.fps),
            first_row_text(performer.file_rows, shot.frames),
            exchanged_text(exchanged_keyframes(shot, performer)),
            unposed_text(performer),
        )
        if text
    ]


def exchanged_text(frames: Sequence[int]) -> str:
    """Return a text that left and right are exchanged on some key frames; empty without any."""
    if not frames:
        return ""
    numbers = ", ".join(map(str, frames))
    return (
        f"left and right seem to be exchanged at key frames {numbers}, where both feet point backwards: exchange them "
        "there (RHip and LHip, and so on)"
    )


def exchanged_keyframes(shot: Shot, performer: Performer) -> list[int]:
    """Return the key frames on which a performer's left and right are exchanged, counted as in the shot file."""
    keys = performer.key_poses
    posed = keys.fixed.any(axis=1)
    return [shot.frames[0] + int(f) for f in keys.frames[posed & swapped_sides(performer.body, keys.poses)]]


def unposed_text(performer: Performer) -> str:
    """Return a text that some parts have no key pose, though others pose all of the rest of the body, which is more
    than half of it; else empty. Such parts may be small bones that were forgotten: footage hardly shows how they turn.
    """
    keys, names = performer.key_poses, performer.body.names
    posed = keys.fixed_axes.all(axis=2)
    rest = posed.any(axis=0)
    forgotten = [name for name in np.array(names)[~rest] if name not in performer.unknown]
    whole = (posed[:, rest].all(axis=1) & keys.fixed[:, :3].all(axis=1)).any()
    if not forgotten or not whole or 2 * rest.sum() <= len(names):
        return ""
    return (
        f"no key pose holds {listed(forgotten, _NAMED)}, so the footage alone decides how they turn, and no segment "
        "ends at these key poses: key the whole body, if they should stay as they are"
    )
