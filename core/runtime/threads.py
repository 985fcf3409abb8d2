"""One BLAS thread for small linear algebra.

OpenBLAS shares even a banded solve of ten milliseconds among threads, which makes it a second on a busy machine. The
environment variables that forbid it are read when numpy is loaded: inside Blender that was long ago.
"""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import numpy as np
import scipy

_lock = threading.Lock()
_before: list[list[int]] = []
"""Threads as they were before the first of the blocks that run now, once for every one of these."""


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Let numpy and scipy use one thread while the block runs, where their OpenBLAS can be told so.

    Blocks may overlap, as that of a job which was given up and has not noticed: the last to end gives the threads back.
    """
    libraries = _openblas()
    with _lock:
        _before.append(_before[0] if _before else [get() for get, _ in libraries])
        for _, set_threads in libraries:
            set_threads(1)
    try:
        yield
    finally:
        with _lock:
            before = _before.pop()
            if not _before:
                for (_, set_threads), count in zip(libraries, before, strict=True):
                    set_threads(count)


@cache
def _openblas() -> list[tuple[Callable[[], int], Callable[[int], None]]]:
    """How to get and set the number of threads of each OpenBLAS that came with numpy and scipy."""
    found = []
    for package in (np, scipy):
        home = Path(str(package.__file__)).parent
        folders = (home.with_name(f"{home.name}.libs"), home / ".dylibs")
        for file in (file for folder in folders for file in sorted(folder.glob("*openblas*"))):
            try:
                library = ctypes.CDLL(str(file))
            except OSError:  # not loaded by anything either, then
                continue
            names = [
                f"{prefix}openblas_{{}}_num_threads{suffix}" for prefix in ("scipy_", "") for suffix in ("", "64_")
            ]
            for name in names:
                if hasattr(library, name.format("set")):
                    found.append((getattr(library, name.format("get")), getattr(library, name.format("set"))))
                    break
    return found
