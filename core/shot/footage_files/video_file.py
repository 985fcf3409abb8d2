"""Refusing files that OpenCV must not open as videos: some crash it, and playlists make FFmpeg open other files."""

from __future__ import annotations

import difflib
import errno
import os
import re
import unicodedata
from pathlib import Path

from ...errors import FootageError
from .image_sequences import PATTERNS, named_footage

_HEAD = 64
"""Number of bytes examined: in every video container or stream, some of these do not occur in text."""
_TEXT = bytes([*b"\t\n\f\r", *range(0x20, 0x7F)])
_VIDEO_WITH_A_TEXT_FIRST = b"YUV4MPEG2"
_LARGE_FILE_POINTER = b"version https://git-lfs.github.com/spec/"
_ADDRESS = re.compile(r"(^|/)(smb|afp|nfs|ftp|sftp|https?|file):/")
"""What begins an address; a path has one slash where that has two."""
_LIKENESS = 0.8
"""Similarity, 0 to 1, from which a file's name may be what a misspelt one meant."""
_OTHERS = {
    rb"BLENDER": "a Blender file",
    rb"\x28\xb5\x2f\xfd": "a compressed Blender file",
    rb"PK\x03\x04": "a ZIP archive",
    rb"RIFF.{4}WAVE|ID3|fLaC": "a sound recording",
}
"""What begins like this, and is no video."""


def check_video_file(path: Path) -> None:
    """Check that a video is a regular file with a name that OpenCV can open, and not a playlist.

    A playlist, whatever its file ending, makes FFmpeg open the files that it names, and wait half a minute for those
    that do not exist.

    Raises
    ------
    FootageError
        It is not.
    """
    if path.is_dir():
        raise FootageError("this is a folder", where=str(path), todo=f"name {PATTERNS}, as {named_footage(path)}")
    if not path.is_file():
        if path.exists():
            raise FootageError("this is not a file but a pipe or a device", where=str(path), todo=f"name {PATTERNS}")
        if path.is_symlink():
            raise _leads_nowhere(path)
        if _ADDRESS.search(path.as_posix()):
            what = "this is an address, and footage is read from files only"
            raise FootageError(what, where=str(path), todo="connect the drive and name the file on it, or copy it")
        meant = _meant(path)
        todo = f"did you mean '{meant}'?" if meant else f"name {PATTERNS}"
        raise FootageError("there is no such footage", where=str(path), todo=todo)
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
    if head.startswith(_LARGE_FILE_POINTER):
        what = "this is the pointer that Git LFS leaves for a video that was not fetched"
        raise FootageError(what, where=str(path), todo="fetch it with: git lfs pull")
    if head and not head.translate(None, _TEXT) and not head.startswith(_VIDEO_WITH_A_TEXT_FIRST):
        what = "the footage cannot be read as a video: it is a text, such as a playlist"
        raise FootageError(what, where=str(path), todo=f"name {PATTERNS}")
    for begin, kind in _OTHERS.items():
        if re.match(begin, head, re.DOTALL):
            raise FootageError(f"this is {kind}, not a video", where=str(path), todo=f"name {PATTERNS}")


def _leads_nowhere(path: Path) -> FootageError:
    """Return the error for a symbolic link to a file that does not exist."""
    what = f"this is a link to '{os.readlink(path)}', which does not exist"
    try:
        path.stat()
    except OSError as error:
        if error.errno == errno.ELOOP:
            return FootageError("this link leads back to itself", where=str(path), todo="name the video's file")
    return FootageError(what, where=str(path), todo="connect the drive that it is on, or name another file")


def _meant(path: Path) -> str | None:
    """Return the name in a path's folder that is most like its own and has the same digits; None if none is like it.

    Names that differ in capitals alone, or in how a system writes letters with accents, count as the same.
    """
    try:
        names = {_plain(name): name for name in os.listdir(path.parent) if _digits(name) == _digits(path.name)}
    except OSError:
        return None
    near = difflib.get_close_matches(_plain(path.name), names, n=1, cutoff=_LIKENESS)
    return names[near[0]] if near else None


def _digits(name: str) -> list[str]:
    return re.findall(r"\d+", name.rpartition(".")[0])


def _plain(name: str) -> str:
    return unicodedata.normalize("NFC", name).casefold()
