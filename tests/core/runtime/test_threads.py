"""BLAS and OpenCV use one thread inside the block, and as many as before after it; workers are as many as the cores."""

from __future__ import annotations

import os

import cv2
import numpy as np  # noqa: F401  (loads a BLAS)
import pytest
import scipy.linalg  # noqa: F401
from kfmocap.core.runtime.threads import one_library_thread, worker_count
from threadpoolctl import threadpool_info, threadpool_limits


def blas_threads() -> set[int]:
    """Threads of the libraries that can use several: OpenCV brings one that cannot."""
    able = [library for library in threadpool_info() if "opencv" not in library["filepath"]]
    return {library["num_threads"] for library in able if library["user_api"] == "blas"}


def test_threads_are_one_inside_and_restored_after_an_error() -> None:
    with threadpool_limits(2, user_api="blas"):
        if blas_threads() != {2}:
            pytest.skip("this BLAS cannot use two threads")
        with pytest.raises(ZeroDivisionError), one_library_thread():
            assert blas_threads() == {1}
            raise ZeroDivisionError
        assert blas_threads() == {2}


def test_the_inner_of_two_blocks_leaves_the_limit_of_the_outer() -> None:
    with threadpool_limits(2, user_api="blas"):
        if blas_threads() != {2}:
            pytest.skip("this BLAS cannot use two threads")
        with one_library_thread():
            with one_library_thread():
                assert blas_threads() == {1}
            assert blas_threads() == {1}
        assert blas_threads() == {2}


def test_opencv_has_one_thread_inside_and_those_of_before_after_it() -> None:
    before = cv2.getNumThreads()
    try:
        cv2.setNumThreads(2)
        with pytest.raises(ZeroDivisionError), one_library_thread():
            with one_library_thread():
                assert cv2.getNumThreads() == 1
            assert cv2.getNumThreads() == 1
            raise ZeroDivisionError
        assert cv2.getNumThreads() == 2
    finally:
        cv2.setNumThreads(before)


def test_a_worker_for_every_core_unless_the_user_says_otherwise() -> None:
    assert 1 <= worker_count() <= (os.cpu_count() or 1)
    assert worker_count(3) == 3
