"""Loading modules leaves the garbage collector as it was."""

from __future__ import annotations

import gc
import subprocess
import sys
import weakref

import numpy as np
import pytest
from kfmocap.core.runtime.loading import without_garbage_collection


class Cycle:
    itself: Cycle


@pytest.mark.parametrize("enabled", [True, False])
def test_the_collector_goes_on_as_before(enabled: bool) -> None:
    (gc.enable if enabled else gc.disable)()
    try:
        with pytest.raises(ImportError), without_garbage_collection():
            assert not gc.isenabled()
            raise ImportError
        assert gc.isenabled() is enabled
    finally:
        gc.enable()


def test_only_what_a_process_loads_first_is_not_searched_later() -> None:
    code = """
import gc, sys
from kfmocap.core.runtime.loading import without_garbage_collection

sys.modules["bpy"] = None
with without_garbage_collection():
    pass
assert gc.get_freeze_count() == 0  # where Blender's module is loaded
del sys.modules["bpy"]
with without_garbage_collection():
    import numpy
first = gc.get_freeze_count()
with without_garbage_collection():
    made = [[] for _ in range(1000)]
assert gc.get_freeze_count() == first > 1000
"""
    subprocess.run([sys.executable, "-c", code], check=True)


def test_what_the_block_made_is_collected_once_nothing_refers_to_it() -> None:
    """Blender's module ends Blender when it is collected: without that, Python would wait for it for ever."""
    assert np  # has been loaded before
    with without_garbage_collection():
        made = Cycle()
        made.itself = made
        alive = weakref.ref(made)
    del made
    gc.collect()
    assert alive() is None
