"""What results depend on, as bytes to compute a checksum of: values, and the content of files."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from itertools import chain
from pathlib import Path, PurePath
from typing import Any

import numpy as np

from .image_sequences import image_files

_HEAD = 65536


def checksum(*sources: Iterable[bytes]) -> str:
    """The checksum of what comes piece by piece from some sources, one after the other."""
    sha = hashlib.sha256()
    for piece in chain.from_iterable(sources):
        sha.update(piece)
    return sha.hexdigest()


def value_bytes(value: Any) -> Iterable[bytes]:
    """A value piece by piece; fields of dataclasses that do not count in comparisons are left out, paths but for
    their names.
    """
    if is_dataclass(value):
        for item in (item for item in fields(value) if item.compare):
            yield item.name.encode()
            yield from value_bytes(getattr(value, item.name))
    elif isinstance(value, np.ndarray):
        yield f"{value.dtype}{value.shape}".encode()
        yield np.ascontiguousarray(value).tobytes()
    elif isinstance(value, Mapping):
        yield from value_bytes(tuple(value.items()))
    elif isinstance(value, (tuple, list)):
        for item in value:
            yield from value_bytes(item)
        yield b";"
    else:
        yield repr(value.name if isinstance(value, PurePath) else value).encode()


def file_bytes(path: Path) -> Iterator[bytes]:
    """Names and contents of the file at a path, or of the files of a folder or an image sequence.

    Of large files the size, the beginning and the end count. A file that cannot be read has no content: whoever needs
    it says so.
    """
    images = image_files(path)
    if images is not None:
        files = [images[number] for number in sorted(images)]
    else:
        files = [file for file in sorted(path.rglob("*")) if file.is_file()] if path.is_dir() else [path]
    for file in files:
        yield file.name.encode()
        yield _content(file)


def _content(file: Path) -> bytes:
    try:
        with file.open("rb") as stream:
            head, size = stream.read(_HEAD), file.stat().st_size
            stream.seek(max(_HEAD, size - _HEAD))
            return head + stream.read() + str(size).encode()
    except OSError:
        return b""
