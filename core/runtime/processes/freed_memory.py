"""Memory that was freed, back to the system."""

from __future__ import annotations

import ctypes
import gc
import sys
from contextlib import suppress


def return_freed_memory(*, in_cycles: bool = False) -> None:
    """Give memory that was freed back to the system, where the C library is glibc.

    It keeps arrays of less than 32 MB, as they come and go by the hundred; other arrays do not fit between those that
    are left, so that a process grows with every stage of a long segment.

    Parameters
    ----------
    in_cycles : bool
        Whether to free objects first that nothing but each other refers to: Python does so by the number of objects,
        whatever their size. It takes as long as evaluating the images of some ten frames.
    """
    if in_cycles:
        gc.collect()
    if sys.platform == "linux":
        with suppress(AttributeError, OSError):
            ctypes.CDLL(None).malloc_trim(0)
