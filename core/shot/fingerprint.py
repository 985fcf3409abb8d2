"""Checksums of everything that a result depends on: values, and the content of files."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from itertools import chain
from pathlib import Path, PurePath
from typing import Any

import numpy as np

from .image_sequences import image_files

_PIECE = 65536
_SAMPLES = 64
"""Number of pieces of a large file that are included, from its beginning to its end, and bytes of each."""


def checksum(*sources: Iterable[bytes]) -> str:
    """Return the checksum of the bytes of some sources, one after the other."""
    sha = hashlib.sha256()
    for piece in chain.from_iterable(sources):
        sha.update(piece)
    return sha.hexdigest()


def value_bytes(value: Any) -> list[bytes]:
    """Return a value as pieces of bytes, without dataclass fields that are excluded from comparison, and with only the
    names of paths.
    """
    pieces: list[bytes] = []
    _append_pieces(pieces, value)
    return pieces


def _append_pieces(pieces: list[bytes], value: Any) -> None:
    # One list for all levels: nested generators would pass each piece up through every level.
    if isinstance(value, np.ndarray):
        pieces.append(f"{value.dtype}{value.shape}".encode())
        pieces.append(np.ascontiguousarray(value).tobytes())
    elif isinstance(value, (tuple, list)):
        for item in value:
            _append_pieces(pieces, item)
        pieces.append(b";")
    elif isinstance(value, Mapping):
        _append_pieces(pieces, tuple(value.items()))
    elif is_dataclass(value) and not isinstance(value, type):
        for name, encoded in _compared(type(value)):
            pieces.append(encoded)
            _append_pieces(pieces, getattr(value, name))
    else:
        pieces.append(repr(value.name if isinstance(value, PurePath) else value).encode())


def _compared(kind: type[Any]) -> tuple[tuple[str, bytes], ...]:
    """Return the names of the fields that are compared of a dataclass, also as bytes."""
    return tuple((item.name, item.name.encode()) for item in fields(kind) if item.compare)


def file_bytes(path: Path) -> Iterator[bytes]:
    """Generate names and contents of the file at a path, or of the files of a folder or an image sequence.

    Of large files, the size and pieces from beginning to end are included. A file that cannot be read counts as empty:
    whoever needs it reports the error.
    """
    images = image_files(path)
    if images is not None:
        files = [images[number] for number in sorted(images)]
    else:
        files = [file for file in sorted(path.rglob("*")) if file.is_file()] if path.is_dir() else [path]
    for file in files:
        yield os.fsencode(file.name)
        yield _content(file)


def _content(file: Path) -> bytes:
    pieces = []
    try:
        if not file.is_file():  # reading a pipe or a device might never end
            return b""
        with file.open("rb") as stream:
            size = os.fstat(stream.fileno()).st_size
            for k in range(_SAMPLES):
                place = max((size - _PIECE) * k // (_SAMPLES - 1), k * _PIECE)
                if place < size:
                    stream.seek(place)
                    pieces.append(stream.read(_PIECE))
        return b"".join(pieces) + str(size).encode()
    except OSError:
        return b""
