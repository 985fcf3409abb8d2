"""Loading modules leaves the garbage collector as it was, without what the modules made."""

from __future__ import annotations

import gc

import pytest
from kfmocap.core.runtime.loading import uncollected


@pytest.mark.parametrize("enabled", [True, False])
def test_the_collector_goes_on_as_before(enabled: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    (gc.enable if enabled else gc.disable)()
    monkeypatch.setattr(gc, "freeze", lambda: None)  # what this process has made would be kept
    try:
        with pytest.raises(ImportError), uncollected():
            assert not gc.isenabled()
            raise ImportError
        assert gc.isenabled() is enabled
    finally:
        gc.enable()


def test_what_the_block_made_is_not_searched() -> None:
    try:
        with uncollected():
            made = [[] for _ in range(1000)]
        found = {id(item) for item in gc.get_objects()}
        assert not any(id(item) in found for item in made)
    finally:
        gc.unfreeze()
