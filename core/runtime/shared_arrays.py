"""Arrays in files that several processes map into their memory: they are pickled by the files' names."""

from __future__ import annotations

import mmap
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

_ROWS = 16
"""Rows of a mapped array that are looked at before their memory is let go of."""


@dataclass(frozen=True)
class SharedArray:
    """An array of bytes in a file.

    Attributes
    ----------
    path : Path
    shape : tuple of int
    """

    path: Path
    shape: tuple[int, ...]

    @classmethod
    def write(cls, path: Path, rows: Iterable[NDArray[np.uint8]]) -> SharedArray:
        """Write rows of one shape to a file that does not exist yet, each as soon as it is there.

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
        """The array, mapped: it takes memory as it is looked at, and the system can do without."""
        return np.asarray(np.memmap(self.path, np.uint8, "r", shape=self.shape))

    def remove(self) -> None:
        """Remove the file; on Windows one that a process has mapped stays until its folder is removed."""
        with suppress(OSError):
            self.path.unlink()


def looked_at(array: NDArray[Any]) -> NDArray[Any]:
    """A part of an array; of a mapped one a copy, whose mapped memory is let go of: the system keeps or reads it again.

    A process that looks at a long file part by part so takes no more memory than the parts do.
    """
    if (mapping := _mapping(array)) is None:
        return array
    part = array.copy()
    _let_go(mapping)
    return part


def each_row(array: NDArray[Any]) -> Iterator[NDArray[Any]]:
    """The rows of an array one after the other; mapped ones are let go of as in `looked_at`."""
    mapping = _mapping(array)
    for k, row in enumerate(array):
        yield row
        if mapping is not None and k % _ROWS == _ROWS - 1:
            _let_go(mapping)


def _mapping(array: NDArray[Any]) -> mmap.mmap | None:
    """The mapping that an array is a part of, if any."""
    base: object = array
    while isinstance(base, np.ndarray):
        base = base.base
    return base if isinstance(base, mmap.mmap) else None


def _let_go(mapping: mmap.mmap) -> None:
    if hasattr(mmap, "MADV_DONTNEED"):  # Windows takes the memory back where it is needed
        mapping.madvise(mmap.MADV_DONTNEED)
