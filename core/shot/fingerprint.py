"""What results depend on, as bytes to compute a checksum of: values, and the content of files."""

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
"""Pieces of a large file that count, of so many bytes each, from its beginning to its end."""


def checksum(*sources: Iterable[bytes]) -> str:
    """The checksum of what comes piece by piece from some sources, one after the other."""
    sha = hashlib.sha256()
    for piece in chain.from_iterable(sources):
        sha.update(piece)
    return sha.hexdigest()


def value_bytes(value: Any) -> list[bytes]:
    """A value piece by piece; fields of dataclasses that do not count in comparisons are left out, paths but for
    their names.
    """
    pieces: list[bytes] = []
    _append_pieces(pieces, value)
    return pieces


def _append_pieces(pieces: list[bytes], value: Any) -> None:
    # One list for all: generators within generators hand each piece up through every level.
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
        for item in fields(value):
            if item.compare:
                pieces.append(item.name.encode())
                _append_pieces(pieces, getattr(value, item.name))
    else:
        pieces.append(repr(value.name if isinstance(value, PurePath) else value).encode())


def file_bytes(path: Path) -> Iterator[bytes]:
    """Names and contents of the file at a path, or of the files of a folder or an image sequence.

    Of large files the size and pieces from the beginning to the end count. A file that cannot be read has no content:
    whoever needs it says so.
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
        if not file.is_file():  # a pipe or a device would be read for ever
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
