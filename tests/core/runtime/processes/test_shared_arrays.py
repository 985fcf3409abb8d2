"""Arrays in files: they come back as they were, and looking at a long one takes only the memory of a part."""

from __future__ import annotations

import mmap
import sys
import tracemalloc
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from kfmocap.core.runtime.processes import shared_arrays
from kfmocap.core.runtime.processes.shared_arrays import SharedArray, collected, copied_from_map, each_row, picked_rows

ROWS, SHAPE = 400, (64, 1024)


def rows() -> Iterator[np.ndarray]:
    for k in range(ROWS):
        yield np.full(SHAPE, k % 251, np.uint8)


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> SharedArray:
    return SharedArray.write(tmp_path_factory.mktemp("pictures") / "long", rows())


def mapped_kilobytes(path: Path) -> int:
    """How much of a file that this process has mapped is in its memory."""
    own, total = False, 0
    for line in Path("/proc/self/smaps").read_text().splitlines():
        name = line.split()[0]
        if not name.endswith(":"):
            own = line.endswith(str(path))
        elif own and name == "Rss:":
            total += int(line.split()[1])
    return total


def test_rows_come_back_as_they_were_written(kept: SharedArray) -> None:
    np.testing.assert_array_equal(kept.array(), np.stack(list(rows())))


def test_rows_are_written_without_holding_more_than_a_few(tmp_path: Path) -> None:
    tracemalloc.start()
    try:
        SharedArray.write(tmp_path / "long", rows())
        assert tracemalloc.get_traced_memory()[1] < 4 * np.prod(SHAPE)
    finally:
        tracemalloc.stop()


@pytest.mark.skipif(sys.platform != "linux", reason="/proc tells what is in memory")
def test_a_long_array_that_is_read_part_by_part_does_not_stay_in_memory(kept: SharedArray) -> None:
    array, seen = kept.array(), []
    for first in range(0, ROWS, 20):
        np.testing.assert_array_equal(
            copied_from_map(array[first : first + 20])[:, 0, 0], np.arange(first, first + 20) % 251
        )
        seen.append(mapped_kilobytes(kept.path))
    for k, row in enumerate(each_row(array)):
        assert row[3, 5] == k % 251
        if k % 40 == 0:
            seen.append(mapped_kilobytes(kept.path))
    assert max(seen) < array.nbytes / 1024 / 4
    array.sum()
    assert mapped_kilobytes(kept.path) > array.nbytes / 1024 / 2, "it is this that is told"


@pytest.mark.skipif(sys.platform != "linux", reason="/proc tells what is in memory")
@pytest.mark.parametrize("axis", [0, 1])
def test_a_long_array_is_copied_some_rows_at_a_time(
    kept: SharedArray, axis: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen, release = [], shared_arrays._release

    def seen_and_released(mapping: mmap.mmap) -> None:
        seen.append(mapped_kilobytes(kept.path))
        release(mapping)

    monkeypatch.setattr(shared_arrays, "_release", seen_and_released)
    monkeypatch.setattr(shared_arrays, "_ROWS_COPIED", 16)
    array = np.moveaxis(kept.array(), 0, axis)
    copied = copied_from_map(array)
    assert max(seen) < array.nbytes / 1024 / 4
    np.testing.assert_array_equal(copied, array)


def test_an_array_in_memory_is_read_without_a_copy() -> None:
    array = np.zeros((5, 4, 3), np.uint8)
    assert np.shares_memory(copied_from_map(array[1:3]), array)


@pytest.mark.skipif(sys.platform != "linux", reason="/proc tells what is in memory")
def test_picked_rows_of_a_mapped_array_are_mapped_too(kept: SharedArray) -> None:
    chosen = np.array([0, 3, 4, ROWS - 1])
    picked = picked_rows(kept.array(), chosen)
    np.testing.assert_array_equal(picked[:, 0, 0], chosen % 251)
    assert mapped_kilobytes(kept.path) < 20 * np.prod(SHAPE) / 1024
    assert copied_from_map(picked) is not picked
    columns = picked_rows(np.moveaxis(kept.array(), 1, 0), chosen, axis=1)
    np.testing.assert_array_equal(columns[0], picked[:, 0])


def test_picked_rows_of_an_array_in_memory_are_a_copy() -> None:
    array = np.arange(12, dtype=np.uint8).reshape(2, 6)
    np.testing.assert_array_equal(picked_rows(array, np.array([0, 5]), axis=1), array[:, [0, 5]])


def test_large_arrays_are_collected_in_a_file_and_small_ones_in_memory(monkeypatch) -> None:
    rows = np.random.default_rng(0).integers(0, 256, (40, 3, 5), dtype=np.uint8)
    small = collected(iter(rows), rows.shape)
    monkeypatch.setattr(shared_arrays, "MAX_HELD", rows.nbytes - 1)
    large = collected(iter(rows), rows.shape)
    assert isinstance(large.base, np.memmap) and not isinstance(small.base, np.memmap)
    np.testing.assert_array_equal(small, rows)
    np.testing.assert_array_equal(large, rows)
    np.testing.assert_array_equal(list(each_row(large[5:35])), rows[5:35])
