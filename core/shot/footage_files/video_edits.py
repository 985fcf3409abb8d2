"""What an MP4 or QuickTime file says of its tracks: whether there are any, and pictures, and how much of them is shown.

Programs trim an MP4 or QuickTime file without encoding it again by an edit list: the frames before and after stay in
the file and are counted, but are not decoded (ISO/IEC 14496-12, 8.6.6).
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

_MAX_BOXES, _MAX_EDITS = 4096, 64


def has_sound_alone(path: Path) -> bool:
    """Whether a file has a track of sound and none of pictures."""
    try:
        with path.open("rb") as file:
            kinds = {_handler(file, media) for _, _, media in _tracks(file)}
    except (OSError, struct.error):
        return False
    return b"soun" in kinds and b"vide" not in kinds


def lacks_index(path: Path) -> bool:
    """Whether the index of a file's tracks is missing, which programs write last; a photo (HEIC, AVIF) has none."""
    try:
        with path.open("rb") as file:
            top = _whole(file)
            return top is not None and not any(box.kind in (b"moov", b"meta") for box in _boxes(file, top))
    except (OSError, struct.error):
        return False


def shown_share(path: Path) -> float:
    """Return which share of its frames a video shows, 0 to 1; 1 for a file without an edit list."""
    try:
        with path.open("rb") as file:
            return _shown_share(file)
    except (OSError, struct.error):  # it ends early, and is no video of this kind, or a damaged one
        return 1.0


def _shown_share(file: BinaryIO) -> float:
    for movie, track, media in _tracks(file):
        if _handler(file, media) == b"vide":
            edits = _edits(file, track)
            whole, shown = _seconds(file, media, b"mdhd"), sum(edits) / (_timescale(file, movie, b"mvhd") or 1)
            return min(shown / whole, 1.0) if whole > 0 and shown > 0 and all(edits) else 1.0
    return 1.0


@dataclass(frozen=True)
class _Box:
    """A box of a file: its type, and where its contents begin and end."""

    kind: bytes
    begin: int
    end: int


def _whole(file: BinaryIO) -> _Box | None:
    """Return a file as a box of all its boxes; None for other kinds of files."""
    top = _Box(b"", 0, file.seek(0, 2))
    first = next(iter(_boxes(file, top)), top).kind
    return top if first in (b"ftyp", b"wide", b"moov", b"mdat", b"free", b"skip") else None


def _tracks(file: BinaryIO) -> Iterator[tuple[_Box, _Box, _Box]]:
    """Generate the movie of a file, each of its tracks, and that track's media; nothing for other kinds of files."""
    top = _whole(file)
    movie = None if top is None else _first(file, top, b"moov")
    for track in [] if movie is None else _boxes(file, movie):
        media = _first(file, track, b"mdia") if track.kind == b"trak" else None
        if movie is not None and media is not None:
            yield movie, track, media


def _boxes(file: BinaryIO, parent: _Box) -> Iterator[_Box]:
    place = parent.begin
    for _ in range(_MAX_BOXES):
        if place + 8 > parent.end:
            return
        file.seek(place)
        size, kind = struct.unpack(">I4s", file.read(8))
        header = 8
        if size == 1:
            (size,), header = struct.unpack(">Q", file.read(8)), 16
        end = parent.end if size == 0 else place + size
        if size and size < header:
            return
        yield _Box(kind, place + header, min(end, parent.end))
        place = end


def _first(file: BinaryIO, parent: _Box, kind: bytes) -> _Box | None:
    return next((box for box in _boxes(file, parent) if box.kind == kind), None)


def _handler(file: BinaryIO, media: _Box) -> bytes:
    box = _first(file, media, b"hdlr")
    return b"" if box is None else _read(file, box, 8, 4)


def _read(file: BinaryIO, box: _Box, offset: int, count: int) -> bytes:
    file.seek(box.begin + offset)
    return file.read(count)


def _timescale(file: BinaryIO, parent: _Box, kind: bytes) -> int:
    """Return the units per second of a header box; 0 if there is none."""
    return _header(file, parent, kind)[0]


def _seconds(file: BinaryIO, parent: _Box, kind: bytes) -> float:
    """Return the duration that a header box states; 0 if there is none."""
    timescale, duration = _header(file, parent, kind)
    return duration / timescale if timescale else 0.0


def _header(file: BinaryIO, parent: _Box, kind: bytes) -> tuple[int, int]:
    box = _first(file, parent, kind)
    if box is None:
        return 0, 0
    if _read(file, box, 0, 1) == b"\1":
        return struct.unpack(">IQ", _read(file, box, 20, 12))
    return struct.unpack(">II", _read(file, box, 12, 8))


def _edits(file: BinaryIO, track: _Box) -> list[int]:
    """Return the lengths of a track's edits in the movie's units; 0 is up to the end, and gaps before it are left
    out.
    """
    edits = _first(file, track, b"edts")
    box = None if edits is None else _first(file, edits, b"elst")
    if box is None:
        return []
    (count,) = struct.unpack(">I", _read(file, box, 4, 4))
    entry = struct.Struct(">QqI" if _read(file, box, 0, 1) == b"\1" else ">IiI")
    entries = [entry.unpack(_read(file, box, 8 + entry.size * k, entry.size)) for k in range(min(count, _MAX_EDITS))]
    return [length for length, begin, _ in entries if begin >= 0]
