"""Checksums of everything that a result depends on: values, and the content of files."""

from __future__ import annotations

import hashlib
import os
import pickle
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import MISSING, fields, is_dataclass
from itertools import chain
from pathlib import Path, PurePath
from typing import Any

import numpy as np

from ..body import Body
from ..errors import FootageError
from .footage_files.image_sequences import image_files
from .shot import View

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
    """Return a value as pieces of bytes, with only the names of paths. Dataclass fields are left out if they are
    excluded from comparison, or have their default: a field that a later version adds changes no checksum by itself.
    """
    return ValueBytes().of(value)


class ValueBytes:
    """Returns values as `value_bytes` does. Bodies are remembered: they have hundreds of pieces, and all segments of a
    shot have the same.
    """

    def __init__(self) -> None:
        self._fields: dict[type[Any], tuple[tuple[str, bytes, Any], ...]] = {}
        self._bodies: dict[int, tuple[Body, list[bytes]]] = {}  # with the body, so that no other has its number

    def of(self, value: Any) -> list[bytes]:
        """Return a value as pieces of bytes."""
        pieces: list[bytes] = []
        self._append(pieces, value)
        return pieces

    def _append(self, pieces: list[bytes], value: Any) -> None:
        # One list for all levels: nested generators would pass each piece up through every level.
        if isinstance(value, np.ndarray):
            pieces.append(f"{value.dtype}{value.shape}".encode())
            pieces.append(np.ascontiguousarray(value).tobytes())
        elif isinstance(value, (tuple, list)):
            for item in value:
                self._append(pieces, item)
            pieces.append(b";")
        elif isinstance(value, Mapping):
            self._append(pieces, tuple(value.items()))
        elif isinstance(value, Body):
            pieces.extend(self._body(value))
        elif is_dataclass(value) and not isinstance(value, type):
            self._append_fields(pieces, value)
        else:
            pieces.append(repr(value.name if isinstance(value, PurePath) else value).encode())

    def _append_fields(self, pieces: list[bytes], value: Any) -> None:
        kind = type(value)
        if kind not in self._fields:
            compared = (item for item in fields(kind) if item.compare)
            self._fields[kind] = tuple((item.name, item.name.encode(), item.default) for item in compared)
        for name, encoded, default in self._fields[kind]:
            given = getattr(value, name)
            if default is MISSING or type(given) is not type(default) or given != default:
                pieces.append(encoded)
                self._append(pieces, given)
        pieces.append(b"}")

    def _body(self, body: Body) -> list[bytes]:
        if id(body) not in self._bodies:
            pieces: list[bytes] = []
            self._append_fields(pieces, body)
            self._bodies[id(body)] = body, pieces
        return self._bodies[id(body)][1]


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
                if place >= size:
                    break
                stream.seek(place)
                pieces.append(stream.read(_PIECE))
        return b"".join(pieces) + str(size).encode()
    except OSError:
        return b""


def made_of(view: View, factor: float) -> bytes:
    """Hash of everything that a view's reduced frames depend on: its files as they are now, and how they are read.

    Raises
    ------
    FootageError
        A file is gone, as when a drive was disconnected after the footage was read.
    """
    files = sorted((image_files(view.footage) or {0: view.footage}).values())
    states = [(str(file), *_state(file)) for file in files]
    camera = view.camera
    turning = camera.R_cam_world if camera.standing() else None
    lens = camera.size, camera.matrix, camera.distortions, camera.fisheye, turning, camera.zooms
    return pickle.dumps((states, lens, view.offset, view.fields, view.gaps, view.every, factor))


def _state(file: Path) -> tuple[int, int]:
    try:
        found = file.stat()
    except OSError as error:
        todo = "connect the drive that it is on, or put it back"
        raise FootageError(f"it cannot be read any more: {error.strerror}", where=str(file), todo=todo) from error
    return found.st_mtime_ns, found.st_size
