"""Checking that footage fits a shot: its size against the camera's, and its range of frames."""

from __future__ import annotations

from collections.abc import Sequence

from ...cameras.camera import Camera, same_proportions
from ...errors import FootageError, located
from ..footage import Footage, decodable, probe
from ..frame_numbers import footage_index, frames_per_file_frame, is_interlaced
from ..image_sequences import check_images, image_files
from ..shot import View

SAME_RATE = 0.02
"""Relative difference within which frame rates that files state count as one, such as 29.97 and 30."""


def check_view(view: View, first: int, length: int) -> Footage:
    """Check that a view's footage fits a shot.

    Parameters
    ----------
    view : View
    first, length : int
        First shot frame, and number of frames.

    Raises
    ------
    FootageError
        The footage is missing or unreadable, of another size than its camera's, begins after the shot or ends
        before it.
    """
    footage = probe(view.footage)
    with located(str(view.footage)):
        camera_at_size(view.camera, footage.size, resized=False, declare="say so: resized = true under [calibration]")
    _check_range(view, footage, first, length)
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
    if not same_proportions(size, camera.size):
        what += ": it was cropped, not only resized" if resized else ""
        seen = "sizes are width x height after the rotation that the file asks for"
        raise FootageError(what, todo=f"calibrate at the footage's size; {seen}")
    if not resized:
        raise FootageError(what, todo=f"if the footage was resized after calibrating, {declare}")
    return camera.resized(size)


def check_rates(views: Sequence[View], footages: Sequence[Footage]) -> None:
    """Check that every frame of some views' footage lasts as long as those of the others, as far as files state it.

    Raises
    ------
    FootageError
        In one there are more frames for each of the shot than in another; names both and what to do.
    """
    rates = {
        view.camera.name: (footage.fps * frames_per_file_frame(view), view)
        for view, footage in zip(views, footages, strict=True)
        if footage.fps > 0
    }
    if not rates:
        return
    other, (slow, _) = min(rates.items(), key=lambda item: item[1][0])
    name, (fast, view) = max(rates.items(), key=lambda item: item[1][0])
    every = round(fast / slow)
    if fast <= slow * (1 + SAME_RATE):
        return
    if abs(fast / slow - every) <= SAME_RATE * every:
        todo = f"write every = {every} in its [[view]], and {slow:.5g} as the shot's fps"
    else:
        todo = f"convert it, as with: ffmpeg -i FOOTAGE -vf fps={slow:.5g} -crf 14 CONVERTED.mp4"
    raise FootageError(
        f"it has {fast:.5g} frames per second, the footage of '{other}' {slow:.5g}",
        where=f"{view.footage} (camera '{name}')",
        todo=f"{todo}; if its frames are the shot's one by one, whatever the file says, write every = 1",
    )


def stored_frames(view: View, footage: Footage, wanted: int) -> int:
    """Return how many frames, or fields, a view's footage has: at least `wanted`, or exactly."""
    each = frames_per_file_frame(view)
    count = each * footage.count
    if count < wanted and image_files(view.footage) is None:
        # Some containers understate their length; only decoding shows it.
        count = each * decodable(view.footage, (wanted - 1) // each + 1)
    return count


def _check_range(view: View, footage: Footage, first: int, length: int) -> None:
    start, end = footage_index(view, first), footage_index(view, first + length - 1)
    last, offset, each = first + length - 1, view.offset, frames_per_file_frame(view)
    unit = "fields" if is_interlaced(view) else "frames"
    every = f" and every = {view.every}" if view.every > 1 else ""
    asked = f"the shot's frames {first} to {last} with offset {offset:g}{every} are its {unit} {start} to {end}"
    where = f"{view.footage} (camera '{view.camera.name}')"
    if start < 0:
        raise FootageError(f"the shot begins before the footage: {asked}", where=where)
    count, images = stored_frames(view, footage, end + 1), image_files(view.footage)
    if end >= count:
        raise FootageError(f"the footage has only {count} {unit}: {asked}", where=where)
    if images is not None:
        check_images(view.footage, images, range(start // each, end // each + 1), footage.size)


def _by(size: tuple[int, int]) -> str:
    return f"{size[0]}x{size[1]}"
