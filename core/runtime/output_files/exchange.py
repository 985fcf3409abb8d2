"""Exchanging two folders atomically, on systems that can."""

from __future__ import annotations

import ctypes
import os
import sys
from pathlib import Path

_RENAME_EXCHANGE = 2  # of Linux, <linux/fs.h>
_RENAME_SWAP = 2  # of macOS, <sys/stdio.h>
_CURRENT_FOLDER = {"linux": -100, "darwin": -2}  # AT_FDCWD


def exchange_paths(one: Path, other: Path) -> bool:
    """Exchange the files or folders at two paths of one file system atomically.

    Returns
    -------
    bool
        False if the system cannot do so, or not for these paths; nothing has changed then.
    """
    call = _system_call()
    if call is None:
        return False
    function, flag = call
    here = ctypes.c_int(_CURRENT_FOLDER[sys.platform])
    paths = ctypes.c_char_p(os.fsencode(one)), ctypes.c_char_p(os.fsencode(other))
    return bool(function(here, paths[0], here, paths[1], ctypes.c_uint(flag)) == 0)


def _system_call() -> tuple[ctypes._NamedFuncPointer, int] | None:
    """Return the C library's function and its flag, or None if there is none."""
    if sys.platform not in _CURRENT_FOLDER:
        return None
    library = ctypes.CDLL(None, use_errno=True)
    name, flag = ("renameat2", _RENAME_EXCHANGE) if sys.platform == "linux" else ("renameatx_np", _RENAME_SWAP)
    function = getattr(library, name, None)
    return None if function is None else (function, flag)
