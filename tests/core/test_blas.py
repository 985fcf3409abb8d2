"""BLAS uses one thread inside the block, and what it used before after it."""

from __future__ import annotations

import pytest
from kfmocap.core.runtime import threads


def test_threads_are_one_inside_and_restored_after() -> None:
    libraries = threads._openblas()
    if not libraries:
        pytest.skip("numpy and scipy bring no OpenBLAS here")
    before = [get() for get, _ in libraries]
    for _, set_threads in libraries:
        set_threads(2)
    try:
        with pytest.raises(ZeroDivisionError), threads.one_blas_thread():
            assert [get() for get, _ in libraries] == [1] * len(libraries)
            raise ZeroDivisionError
        assert [get() for get, _ in libraries] == [2] * len(libraries)
    finally:
        for (_, set_threads), count in zip(libraries, before, strict=True):
            set_threads(count)


def test_overlapping_blocks_restore_the_threads_when_the_last_ends() -> None:
    libraries = threads._openblas()
    if not libraries:
        pytest.skip("numpy and scipy bring no OpenBLAS here")
    before = [get() for get, _ in libraries]
    for _, set_threads in libraries:
        set_threads(2)
    try:
        first, second = threads.one_blas_thread(), threads.one_blas_thread()
        first.__enter__()
        second.__enter__()
        first.__exit__(None, None, None)
        assert [get() for get, _ in libraries] == [1] * len(libraries)
        second.__exit__(None, None, None)
        assert [get() for get, _ in libraries] == [2] * len(libraries)
    finally:
        for (_, set_threads), count in zip(libraries, before, strict=True):
            set_threads(count)
