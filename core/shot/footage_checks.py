"""Whether footage can serve a shot: its size, beside the camera's, and its frames."""

from __future__ import annotations

from ..cameras.camera import Camera, same_proportions
from ..errors import FootageError
from .footage import Footage, decodable, probe
from .frame_numbers import footage_index, frames_per_file_frame, is_interlaced
from .image_sequences import check_images, image_files
from .shot import View


def check_view(view: View, first: int, length: int) -> Footage:
    """See that a view's footage can serve a shot.

    Raises
    ------
    FootageError
        The footage is missing or unreadable, of another size than its camera's, begins after the shot or ends
        before it.
    """
    footage, camera = probe(view.footage), view.camera
    if footage.size != camera.size:
        seen = "sizes are width x height after the rotation that the file asks for"
        scaled = "; if the footage was resized after calibrating, say so: resized = true under [calibration]"
        raise FootageError(
            _sizes(footage, camera),
            where=str(view.footage),
            todo=seen + (scaled if same_proportions(footage.size, camera.size) else ""),
        )
    _check_range(view, footage, first, length)
    return footage


def camera_of_resized(camera: Camera, footage: Footage) -> Camera:
    """The camera of footage that was resized, uncropped, after the camera was calibrated.

    Raises
    ------
    FootageError
        The footage has other proportions than the camera's pictures.
    """
    if footage.size == camera.size:
        return camera
    if not same_proportions(footage.size, camera.size):
        what = f"{_sizes(footage, camera)}: it was cropped, not only resized"
        raise FootageError(what, where=str(footage.path), todo="calibrate at the footage's size")
    return camera.resized(footage.size)


def _sizes(footage: Footage, camera: Camera) -> str:
    return f"the footage is {_by(footage.size)}, the calibration of '{camera.name}' {_by(camera.size)}"


def _check_range(view: View, footage: Footage, first: int, length: int) -> None:
    start, end = footage_index(view, first), footage_index(view, first + length - 1)
    last, offset, each = first + length - 1, view.offset, frames_per_file_frame(view)
    unit = "fields" if is_interlaced(view) else "frames"
    asked = f"the shot's frames {first} to {last} with offset {offset:g} are its {unit} {start} to {end}"
    where = f"{view.footage} (camera '{view.camera.name}')"
    if start < 0:
        raise FootageError(f"the shot begins before the footage: {asked}", where=where)
    count, images = each * footage.count, image_files(view.footage)
    if end >= count and images is None:
        # Some containers understate their length; only decoding shows it.
        count = each * decodable(view.footage, end // each + 1)
    if end >= count:
        raise FootageError(f"the footage has only {count} {unit}: {asked}", where=where)
    if images is not None:
        check_images(view.footage, images, range(start // each, end // each + 1), footage.size)


def _by(size: tuple[int, int]) -> str:
    return f"{size[0]}x{size[1]}"
