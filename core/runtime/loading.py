"""Loading modules faster, with the garbage collector off."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def without_garbage_collection() -> Iterator[None]:
    """Switch the garbage collector off while the block runs.

    Modules are loaded in two thirds of the time: they make many objects, hardly any of which are not needed until the
    end. Later they are searched like others (no `gc.freeze`): Blender's module ends Blender when it is collected.
    """
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()
