"""How many threads a job uses: one per core for work on images, a single one inside BLAS and OpenCV.

OpenBLAS shares even a banded solve of ten milliseconds among threads, which makes it take a second on a busy machine.
The environment variables that forbid it are read when numpy is loaded, and inside Blender that was long ago. OpenCV's
threads look for work for a while after each picture, and keep others from the core meanwhile.
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
        The user's setting (`core.shot.shot.Settings.threads`); by default as many as this process may use cores.
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
