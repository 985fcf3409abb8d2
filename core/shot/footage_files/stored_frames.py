"""Frames of a video file or an image sequence as they are stored: neither rotated nor reduced."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
from numpy.typing import NDArray

from ...errors import FootageError
from .image_sequences import PATTERNS, check_size, image_files, read_image
from .video_edits import has_sound_alone, lacks_index
from .video_file import check_video_file

Image = NDArray[Any]

_CONVERT = "convert it to H.264, as with: ffmpeg -i FOOTAGE -c:v libx264 -crf 14 -fps_mode passthrough CONVERTED.mp4"


@dataclass(frozen=True, eq=False)
class StoredFrame:
    """A frame of a file as it is stored.

    Attributes
    ----------
    image : ndarray of uint8, shape (h, w, 3)
    turn : int
        Clockwise rotation that the metadata asks for, degrees: 0, 90, 180 or 270.
    parity : int or None
        Which of the stored lines make up the field: 0 even, 1 odd; None for progressive footage.
    """

    image: Image
    turn: int
    parity: int | None = None


def stored_frames(path: Path, numbers: Sequence[int], size: tuple[int, int], threads: int) -> Iterator[StoredFrame]:
    """Generate the frames of a file at increasing indices; `size` is the size of the frames after rotation.

    The image of a video's frame is valid until the next one is requested.
    """
    images = image_files(path)
    if images is None:
        yield from _video_frames(path, numbers, threads)
    else:
        yield from (StoredFrame(sequence_image(path, images, number, size), 0) for number in numbers)


def _video_frames(path: Path, numbers: Sequence[int], threads: int) -> Iterator[StoredFrame]:
    with opened_video(path, threads) as video:
        turn, position = quarter_turns(video), 0
        frame: Image | None = None
        for number in numbers:
            # Seeking is not exact in every container: go through the frames.
            while position < number and video.grab():
                position += 1
            # Reuse the memory of the frame before: allocating some megabytes takes as long as decoding.
            read, frame = video.read(frame) if position == number else (False, None)
            if not read or frame is None:
                if not position:
                    raise undecodable(path, codec_of(video))
                todo = "track the frames before it, or copy the file from the camera again if it should be longer"
                what = f"the footage ends or breaks at frame {position} of the file"
                raise FootageError(what, where=str(path), todo=todo)
            position += 1
            yield StoredFrame(frame, turn)


def sequence_image(path: Path, images: dict[int, Path], index: int, size: tuple[int, int]) -> Image:
    """Return an image of a sequence, whose files are given by their numbers.

    Raises
    ------
    FootageError
        It is missing, or has another size; names the file.
    """
    if index not in images:
        raise FootageError(f"the image of frame {index} is missing in the sequence", where=str(path))
    image = read_image(images[index])
    check_size(images[index], image, size)
    return image


@contextmanager
def opened_video(path: Path, threads: int = 0) -> Iterator[cv2.VideoCapture]:
    """Open a video whose frames are returned as they are stored; `quarter_turns` returns their rotation."""
    check_video_file(path)
    video = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG, [cv2.CAP_PROP_N_THREADS, threads])
    try:
        if not video.isOpened() or video.get(cv2.CAP_PROP_FRAME_WIDTH) <= 0:
            if has_sound_alone(path):
                raise FootageError("it has sound, but no pictures", where=str(path), todo=f"name {PATTERNS}")
            if lacks_index(path):
                what = "the footage cannot be read as a video: its index is missing, as where a copy was cut short"
                raise FootageError(what, where=str(path), todo="copy the file from the camera again")
            raise FootageError("the footage cannot be read as a video", where=str(path), todo=_CONVERT)
        # OpenCV's builds differ in whether they rotate frames themselves; rotating reduced frames is cheaper, too.
        video.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)
        yield video
    finally:
        video.release()


def codec_of(video: cv2.VideoCapture) -> str:
    """Return the four letters that name a video's codec, such as AV01."""
    letters = int(video.get(cv2.CAP_PROP_FOURCC)).to_bytes(4, "little", signed=True)
    return letters.decode("ascii", errors="replace").strip().upper() if letters.strip(b"\0 ") else "unknown"


def undecodable(path: Path, codec: str) -> FootageError:
    """Return the error that a video's frames cannot be decoded."""
    return FootageError(f"OpenCV cannot decode the footage (codec {codec})", where=str(path), todo=_CONVERT)


def quarter_turns(video: cv2.VideoCapture) -> int:
    """Return the clockwise rotation that the metadata asks for, degrees: 0, 90, 180 or 270."""
    return round(video.get(cv2.CAP_PROP_ORIENTATION_META) / 90) * 90 % 360
