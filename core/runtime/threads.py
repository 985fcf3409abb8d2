"""Numbers of threads: one per core for work on images, a single one inside BLAS and OpenCV.

OpenBLAS divides even a banded solve of ten milliseconds among threads, which then takes a second on a busy machine.
Environment variables that prevent this are read when NumPy is loaded, which inside Blender was long ago. OpenCV's
threads keep spinning for a while after each picture, and block the core meanwhile.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

import cv2
from threadpoolctl import threadpool_limits


def worker_count(threads: int | None = None) -> int:
    """Return the number of worker threads to start.

    Parameters
    ----------
    threads : int, optional
        The user's setting (`core.shot.settings.Settings.threads`); by default one per core available to this process.
    """
    if threads is not None:
        return threads
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@contextmanager
def one_library_thread() -> Iterator[None]:
    """Limit OpenCV, and the BLAS of numpy and scipy, to one thread while the block runs.

    Blocks may be nested: each restores the number of threads that it found.
    """
    before = cv2.getNumThreads()
    with threadpool_limits(limits=1, user_api="blas"):
        cv2.setNumThreads(1)
        try:
            yield
        finally:
            cv2.setNumThreads(before)
