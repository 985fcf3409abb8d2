"""Memory that was freed, back to the system."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
import weakref

import pytest
from kfmocap.core.runtime.processes.freed_memory import return_freed_memory

CODE = """
import numpy as np
from kfmocap.core.runtime.processes.freed_memory import return_freed_memory

def held():
    with open("/proc/self/status") as status:
        return next(int(line.split()[1]) for line in status if line.startswith("RssAnon"))

np.ones(3 << 20)  # of 24 MB: from now on, glibc gives back no array that is smaller
arrays = [np.ones(1 << 18) for _ in range(60)]  # of 2 MB
most = held()
del arrays[:-1]
kept = held()
return_freed_memory()
print(most, kept, held())
"""


@pytest.mark.skipif(sys.platform != "linux", reason="only glibc keeps it")
def test_what_was_freed_below_an_array_that_is_left_is_given_back() -> None:
    if not os.confstr("CS_GNU_LIBC_VERSION"):
        pytest.skip("only glibc keeps it")
    told = subprocess.run([sys.executable, "-c", CODE], check=True, capture_output=True, text=True)
    most, kept, left = map(int, told.stdout.split())
    assert kept > most - 20_000, "it is this that is told"
    assert left < most - 100_000


def test_arrays_that_only_refer_to_each_other_are_freed() -> None:
    class Kept:
        own: object = None

    kept = Kept()
    kept.own, left = kept, weakref.ref(kept)
    gc.disable()
    try:
        del kept
        return_freed_memory()
        assert left() is not None, "it is this that is told"
        return_freed_memory(in_cycles=True)
    finally:
        gc.enable()
    assert left() is None
