"""Arrays in files that several processes map into memory; only the files' names are pickled."""

from __future__ import annotations

import math
import mmap
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

_ROWS = 16
"""Number of rows of a mapped array that are read before their memory is released."""
_ROWS_COPIED = 64
"""The same where they are copied, more than an evaluation of the pictures takes at a time."""

MAX_HELD = 16 << 20
"""Largest number of bytes that `collected` keeps in memory."""


@dataclass(frozen=True)
class SharedArray:
    """An array of bytes in a file: the file's path, and the array's shape."""

    path: Path
    shape: tuple[int, ...]

    @classmethod
    def write(cls, path: Path, rows: Iterable[NDArray[np.uint8]]) -> SharedArray:
        """Write rows of one shape to a new file, as the iterable yields them.

        Raises
        ------
        OSError
            The disk is full.
        """
        count, shape = 0, tuple[int, ...]()
        with path.open("xb") as file:
            for row in rows:
                file.write(np.ascontiguousarray(row).data)
                count, shape = count + 1, row.shape
        return cls(path, (count, *shape))

    def array(self) -> NDArray[np.uint8]:
        """Return the array, mapped into memory, which the system can reclaim."""
        return np.asarray(np.memmap(self.path, np.uint8, "r", shape=self.shape))

    def remove(self) -> None:
        """Remove the file; on Windows, a mapped file stays until its folder is removed."""
        with suppress(OSError):
            self.path.unlink()


def copied_from_map(array: NDArray[Any]) -> NDArray[Any]:
    """Return a part of an array, as a copy if it is mapped; the mapped memory is released.

    A process that reads a long file part by part then takes no more memory than the parts do.
    """
    if (mapping := _mapping(array)) is None:
        return array
    part, along = np.empty(array.shape, array.dtype), int(np.argmax(array.strides))
    rows, out = (np.moveaxis(each, along, 0) for each in (array, part))
    for first in range(0, len(rows), _ROWS_COPIED):
        some = slice(first, first + _ROWS_COPIED)
        out[some] = rows[some]
        _release(mapping)
    return part


def picked_rows(array: NDArray[Any], rows: NDArray[np.intp], axis: int = 0) -> NDArray[Any]:
    """Return some rows of an array; those of a mapped one are mapped as well, from an unnamed temporary file."""
    if (mapping := _mapping(array)) is None:
        return array.take(rows, axis)
    source = np.moveaxis(array, axis, 0)
    with tempfile.TemporaryFile() as file:
        for k, row in enumerate(rows):
            file.write(np.ascontiguousarray(source[row]).data)
            if k % _ROWS == _ROWS - 1:
                _release(mapping)
        _release(mapping)
        file.flush()
        kept = np.memmap(file, array.dtype, "r", shape=(len(rows), *source.shape[1:]))
    return np.moveaxis(np.asarray(kept), 0, axis)


def collected(rows: Iterable[NDArray[np.uint8]], shape: tuple[int, ...]) -> NDArray[np.uint8]:
    """Return rows as an array of a shape, mapped from an unnamed temporary file if it takes more than `MAX_HELD`."""
    if math.prod(shape) <= MAX_HELD:
        held = np.empty(shape, np.uint8)
        for row, out in zip(rows, held, strict=True):
            out[:] = row
        return held
    with tempfile.TemporaryFile() as file:
        for row in rows:
            file.write(np.ascontiguousarray(row).data)
        file.flush()
        return np.asarray(np.memmap(file, np.uint8, "r", shape=shape))


def each_row(array: NDArray[Any]) -> Iterator[NDArray[Any]]:
    """Generate the rows of an array; mapped memory is released as in `copied_from_map`."""
    mapping = _mapping(array)
    for k, row in enumerate(array):
        yield row
        if mapping is not None and k % _ROWS == _ROWS - 1:
            _release(mapping)


def _mapping(array: NDArray[Any]) -> mmap.mmap | None:
    """Return the memory mapping that an array is part of, if any."""
    base: object = array
    while isinstance(base, np.ndarray):
        base = base.base
    return base if isinstance(base, mmap.mmap) else None


def _release(mapping: mmap.mmap) -> None:
    if hasattr(mmap, "MADV_DONTNEED"):  # Windows reclaims the memory when it is needed
        mapping.madvise(mmap.MADV_DONTNEED)
