"""Loading modules without searching what they make, meanwhile, for cycles of objects that nothing refers to."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def without_garbage_collection() -> Iterator[None]:
    """Keep the garbage collector from going through objects while the block makes them.

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
