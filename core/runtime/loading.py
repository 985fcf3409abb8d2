"""Loading modules without searching what they make for cycles of objects that nothing refers to."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def uncollected() -> Iterator[None]:
    """Keep the garbage collector from going through the objects made in the block, now and later.

    Modules are loaded in two thirds of the time: they make many objects, hardly any of which are not needed until the
    end.
    """
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        if enabled:
            gc.enable()
