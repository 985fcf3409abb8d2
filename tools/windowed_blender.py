"""Blender with its window, out of the bpy module: for versions whose application is not installed.

    .venv-4.5/bin/python tools/windowed_blender.py --window-geometry 0 0 1440 900 --python script.py -- arguments

The module has all of the application, but tells itself that it runs in the background, with factory settings. Two
bytes of its loaded code are changed here, so that it does not, and the application's main loop is called. This has
been tried with bpy 4.5.15 and 5.0.1 for Linux; it needs an X server and binutils' nm.
"""

from __future__ import annotations

import argparse
import ctypes
import importlib.util
import mmap
import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

_SYMBOLS = ("PyInit_bpy", "main_python_enter", "evil_C", "WM_main", "WM_init_state_size_set")
_MAIN_SIZE = 1280
"""Bytes from the beginning of `main_python_enter` in which both settings are written."""
_TRUE_INTO_G = re.compile(rb"\xc6\x83..\x00\x00(\x01)", re.DOTALL)
"""movb $1, offset(%rbx), with the address of Blender's globals G in rbx."""


def symbols(library: Path) -> dict[str, int]:
    """Offsets of the needed symbols in the module's library."""
    listed = subprocess.run(["nm", "-C", str(library)], capture_output=True, text=True, check=True).stdout
    found = {}
    for line in listed.splitlines():
        address, _, name = line.partition(" ")
        if (name := name[2:].partition("(")[0]) in _SYMBOLS:
            found[name] = int(address, 16)
    return found


def in_the_foreground(start: int) -> None:
    """Have `main_python_enter`, loaded at an address, neither force factory settings nor the background."""
    code = ctypes.string_at(start, _MAIN_SIZE)
    stores = [found.start(1) for found in _TRUE_INTO_G.finditer(code)][:2]
    if len(stores) < 2:
        raise SystemExit("this bpy is built in another way than those that are known here")
    page = start & -mmap.PAGESIZE
    everything = mmap.PROT_READ | mmap.PROT_WRITE | mmap.PROT_EXEC
    ctypes.CDLL(None).mprotect(ctypes.c_void_p(page), ctypes.c_size_t(start + _MAIN_SIZE - page), everything)
    for place in stores:
        ctypes.memset(start + place, 0, 1)


def main(arguments: Sequence[str]) -> None:
    """Open Blender's window and run a script in it, until Blender quits."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--window-geometry", type=int, nargs=4, default=(0, 0, 1440, 900))
    parser.add_argument("--gpu-backend", default="opengl", help="not used: the module has its own default")
    parser.add_argument("--python", type=Path, required=True, metavar="SCRIPT")
    parser.add_argument("rest", nargs="*", help="arguments for the script, after --")
    given = parser.parse_args(arguments)

    spec = importlib.util.find_spec("bpy")
    if spec is None or spec.origin is None:
        raise SystemExit("this Python has no bpy")
    library, places = Path(spec.origin), symbols(Path(spec.origin))
    loaded = ctypes.PyDLL(str(library))
    base = int(ctypes.cast(loaded.PyInit_bpy, ctypes.c_void_p).value or 0) - places["PyInit_bpy"]

    def function(name: str, *types: Any) -> Any:
        return ctypes.CFUNCTYPE(None, *types)(base + places[name])

    in_the_foreground(base + places["main_python_enter"])
    function("WM_init_state_size_set", *[ctypes.c_int] * 4)(*given.window_geometry)
    import bpy

    if bpy.app.background:
        raise SystemExit("this bpy stays in the background")
    sys.argv = ["blender", "--", *given.rest]
    code = compile(given.python.read_text(encoding="utf-8"), str(given.python), "exec")
    exec(code, {"__name__": "__main__", "__file__": str(given.python)})
    # ctypes gives Python's lock away meanwhile, as the application does.
    function("WM_main", ctypes.c_void_p)(ctypes.c_void_p.from_address(base + places["evil_C"]))


if __name__ == "__main__":
    main(sys.argv[1:])
