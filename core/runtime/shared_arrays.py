"""Arrays in files that several processes map into their memory: they are pickled by the files' names."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class SharedArray:
    """An array in a file.

    Attributes
    ----------
    path : Path
    """

    path: Path

    @classmethod
    def write(cls, path: Path, array: NDArray[Any]) -> SharedArray:
        """Write an array to a file that does not exist yet.

        Raises
        ------
        OSError
            The disk is full.
        """
        with path.open("xb") as file:
            np.save(file, array, allow_pickle=False)
        return cls(path)

    def array(self) -> NDArray[Any]:
        """The array, mapped: it takes memory as it is looked at, and the system can do without."""
        return np.asarray(np.load(self.path, mmap_mode="r"))

    def remove(self) -> None:
        """Remove the file; on Windows one that a process has mapped stays until its folder is removed."""
        with suppress(OSError):
            self.path.unlink()
