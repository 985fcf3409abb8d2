"""Files that are not given to OpenCV as videos: those it crashes on, and texts by which FFmpeg reads something else."""

from __future__ import annotations

from pathlib import Path

from ..errors import FootageError
from .image_sequences import PATTERNS

_HEAD = 64
"""Bytes that are looked at: every container and stream of video has some among them that no text has."""
_TEXT = bytes([*b"\t\n\f\r", *range(0x20, 0x7F)])
_VIDEO_WITH_A_TEXT_FIRST = b"YUV4MPEG2"


def check_video_file(path: Path) -> None:
    """See that a video is a file, under a name that OpenCV can open, and no playlist.

    A playlist, whatever its name ends in, has FFmpeg open the files that it names, and wait half a minute for those
    that are not there.

    Raises
    ------
    FootageError
    """
    if not path.is_file():
        raise FootageError("there is no such footage", where=str(path), todo=f"name {PATTERNS}")
    try:
        str(path).encode()
    except UnicodeEncodeError as error:
        what = "OpenCV cannot open it, as its path is not written in UTF-8"
        raise FootageError(what, where=str(path), todo="rename the file, or the folder that it is in") from error
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD)
    except OSError as error:
        raise FootageError(f"the footage cannot be read: {error.strerror}", where=str(path)) from error
    if head and not head.translate(None, _TEXT) and not head.startswith(_VIDEO_WITH_A_TEXT_FIRST):
        what = "the footage cannot be read as a video: it is a text, such as a playlist"
        raise FootageError(what, where=str(path), todo=f"name {PATTERNS}")
