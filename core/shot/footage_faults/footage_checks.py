"""Checking that footage fits a shot: its size against the camera's, and its range of frames."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

from ...cameras.camera import Camera, same_proportions
from ...errors import FootageError, located
from ..footage import Footage, decodable, probe
from ..footage_files.image_sequences import check_images, footage_of, image_files
from ..frame_numbers import footage_index, frames_per_file_frame, is_interlaced
from ..shot import View
from .footage_times import timed_gaps, video_rate

_UNTURN = "ffmpeg -display_rotation 0 -i FOOTAGE -c copy CONVERTED.mp4"
SAME_RATE = 0.02
"""Relative difference within which frame rates that files state count as one, such as 29.97 and 30."""


def check_view(view: View, first: int, length: int, fps: float | None = None) -> Footage:
    """Check that a view's footage fits a shot.

    Parameters
    ----------
    view : View
    first, length : int
        First shot frame, and number of frames.
    fps : float, optional
        The shot's frames per second, at which frames are counted by their times if they do not come at a constant rate.

    Raises
    ------
    FootageError
        The footage is missing or unreadable, of another size than its camera's, begins after the shot or ends
        before it.
    """
    footage = probe(view.footage)
    with located(str(view.footage)):
        declare = "say so: resized = true under [calibration], or Resized Footage of Import Calibration in Blender"
        camera_at_size(view.camera, footage.size, resized=False, declare=declare)
    _check_range(view, footage, first, length, fps)
    return footage


def camera_at_size(camera: Camera, size: tuple[int, int], *, resized: bool, declare: str = "") -> Camera:
    """Return a camera for footage of a size: the same camera, or the camera of the resized footage.

    Parameters
    ----------
    camera : Camera
    size : tuple of int
        Width and height of the footage, pixels.
    resized : bool
        Whether the footage may have been resized, uncropped, after the camera was calibrated.
    declare : str
        How the user says that it was, for the error where `resized` is False.

    Raises
    ------
    FootageError
        The sizes differ, and the footage was not resized, or has other proportions than the camera's pictures.
    """
    if size == camera.size:
        return camera
    what = f"the footage is {_by(size)}, the calibration of '{camera.name}' {_by(camera.size)}"
    if size == camera.size[::-1]:
        as_stored = f"for a camera calibrated on pictures as they are stored, take that out with {_UNTURN}"
        raise FootageError(what, todo=f"footage is turned as its metadata says; {as_stored}")
    if not same_proportions(size, camera.size):
        what += ": it was cropped, not only resized" if resized else ""
        seen = "sizes count stored pixels, square or not: width x height after the rotation that the file asks for"
        raise FootageError(what, todo=f"calibrate at the footage's size; {seen}")
    if not resized:
        raise FootageError(what, todo=f"if the footage was resized after calibrating, {declare}")
    return camera.resized(size)


def check_rates(views: Sequence[View], footages: Sequence[Footage], fps: float) -> None:
    """Check that every frame of some views' footage lasts as long as those of the others, as far as files state it.

    Files are looked through for the times of their frames only where what they state differs.

    Parameters
    ----------
    views : sequence of View
    footages : sequence of Footage
        Of these views.
    fps : float
        The shot's frames per second.

    Raises
    ------
    FootageError
        In one there are more frames for each of the shot than in another, or they do not come at a constant rate and
        cannot be counted by their times at the shot's; names it and what to do.
    """
    stated = {v: footage.fps * frames_per_file_frame(views[v]) for v, footage in enumerate(footages) if footage.fps > 0}
    if _are_the_same(stated.values()):
        return
    measured = {v: video_rate(footages[v].path, footages[v].count, _file_rate(views[v], fps)) for v in stated}
    for v, rate in measured.items():
        if rate is not None and rate.varies and not (rate.missing or rate.counted):
            raise FootageError(rate.text(_file_rate(views[v], fps)), where=_named(views[v]))
    rates = {
        v: stated[v] if rate is None else rate.rate * frames_per_file_frame(views[v])
        for v, rate in measured.items()
        if rate is None or not rate.counted
    }
    if _are_the_same(rates.values()):
        if len(rates) < len(measured) and not _are_the_same((*rates.values(), fps)):
            v, constant = next(iter(rates.items()))
            what = f"it has {constant:.5g} frames per second, the shot {fps:.5g}"
            todo = f"write fps = {constant:.5g} under [shot]: views whose rate varies are counted by their times"
            raise FootageError(what, where=_named(views[v]), todo=todo)
        return
    slow, fast = min(rates, key=rates.__getitem__), max(rates, key=rates.__getitem__)
    wanted = f"{rates[slow]:.5g}"
    if every := frames_for_each(rates[fast], rates[slow]):
        todo = f"write every = {every} in its [[view]], and {wanted} as the shot's fps"
    else:
        todo = f"convert it, as with: ffmpeg -i FOOTAGE -vf fps={wanted} -crf 14 CONVERTED.mp4"
    raise FootageError(
        f"it has {rates[fast]:.5g} frames per second, the footage of '{views[slow].camera.name}' {wanted}",
        where=_named(views[fast]),
        todo=f"{todo}; if its frames are the shot's one by one, whatever the file says, write every = 1",
    )


def _are_the_same(rates: Collection[float]) -> bool:
    """Whether frame rates are the same, as files state them."""
    return not rates or max(rates) <= min(rates) * (1 + SAME_RATE)


def frames_for_each(fast: float, slow: float) -> int | None:
    """Return how many frames at one rate there are for each at another, as files state them; None if that is not a
    whole number.
    """
    every = round(fast / slow)
    return every if every and _are_the_same((fast, every * slow)) else None


def _named(view: View) -> str:
    return f"{view.footage} (camera '{view.camera.name}')"


def stored_frames(view: View, footage: Footage, wanted: int) -> int:
    """Return how many frames, or fields, a view's footage has: at least `wanted`, or exactly."""
    each = frames_per_file_frame(view)
    count = each * footage.count
    if count < wanted and image_files(view.footage) is None:
        # Some containers understate their length; only decoding shows it.
        count = each * decodable(view.footage, (wanted - 1) // each + 1)
    return count


def _check_range(view: View, footage: Footage, first: int, length: int, fps: float | None) -> None:
    start, end = footage_index(view, first), footage_index(view, first + length - 1)
    last, offset, each = first + length - 1, view.offset, frames_per_file_frame(view)
    unit = "fields" if is_interlaced(view) else "frames"
    every = f" and every = {view.every}" if view.every > 1 else ""
    asked = f"with offset {offset:g}{every} the shot's {length} frames are its {unit} {start} to {end}"
    where = _named(view)
    if start < 0:
        todo = _fitting_frames(view, range(first, last + 1), range(end + 1))
        raise FootageError(f"the shot begins before the footage: {asked}", where=where, todo=todo)
    count, images = stored_frames(view, footage, end + 1), image_files(view.footage)
    if end >= count and _end_by_times(view, footage, first + length - 1, fps) >= count:
        if images is not None and view.footage in images.values():
            [pattern] = footage_of([view.footage])
            todo = f"this is a single image: name the sequence that it belongs to, as {pattern}"
            raise FootageError("the footage has only one frame", where=where, todo=todo)
        todo = _fitting_frames(view, range(first, last + 1), range(count))
        has = f"the footage has only {count} {unit}" + (f", 0 to {count - 1}" if count > 1 else "")
        raise FootageError(f"{has}: {asked}", where=where, todo=todo)
    if images is not None:
        check_images(view.footage, images, range(start // each, end // each + 1), footage.size)


def _fitting_frames(view: View, frames: range, stored: range) -> str:
    """Return what to do about a shot with frames, not all of which a view's footage has."""
    fitting = [frame for frame in frames if footage_index(view, frame) in stored]
    if not fitting:
        return "correct the view's offset"
    end = "first" if fitting[0] == frames[0] else "last"  # Blender's scene counts its frames from another number
    in_file = f"in a shot file frames = [{fitting[0]}, {fitting[-1]}]"
    return f"track only the shot's {end} {len(fitting)} frames, {in_file}, or correct the view's offset"


def _end_by_times(view: View, footage: Footage, last: int, fps: float | None) -> int:
    """Return the frame, or field, of footage that shows the shot's last if those that lack by its times are counted."""
    wanted = None if fps is None else _file_rate(view, fps)
    rate = None if view.gaps else video_rate(footage.path, footage.count, wanted)
    return footage_index(replace(view, gaps=view.gaps or timed_gaps(view, rate)), last)


def _file_rate(view: View, fps: float) -> float:
    """Return how many frames of a view's file per second a shot's frame rate asks for."""
    return fps * view.every / frames_per_file_frame(view)


def _by(size: tuple[int, int]) -> str:
    return f"{size[0]}x{size[1]}"
