"""Loading modules leaves the garbage collector as it was."""

from __future__ import annotations

import gc
import weakref

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


def test_what_the_block_made_is_collected_once_nothing_refers_to_it() -> None:
    """Blender's module ends Blender when it is collected: without that, Python would wait for it for ever."""
    with without_garbage_collection():
        made = Cycle()
        made.itself = made
        alive = weakref.ref(made)
    del made
    gc.collect()
    assert alive() is None
