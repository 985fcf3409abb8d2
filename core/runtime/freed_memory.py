"""Memory that was freed, back to the system."""

from __future__ import annotations

import ctypes
import sys
from contextlib import suppress


def return_freed_memory() -> None:
    """Give memory that was freed back to the system, where the C library is glibc.

    It keeps arrays of less than 32 MB, as they come and go by the hundred; other arrays do not fit between those that
    are left, so that a process grows with every stage of a long segment.
    """
    if sys.platform == "linux":
        with suppress(AttributeError, OSError):
            ctypes.CDLL(None).malloc_trim(0)
