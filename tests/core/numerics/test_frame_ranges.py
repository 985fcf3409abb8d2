"""Runs of flags, and ranges of frames that are joined where they meet."""

import numpy as np
from kfmocap.core.numerics.frame_ranges import adjacent_joined, lasting, runs, segments_joined


def test_runs_are_first_and_last_frames():
    assert runs(np.array([True, False, True, True, False])) == [(0, 0), (2, 3)]


def test_runs_may_touch_both_ends_or_be_none():
    assert runs(np.ones(3, bool)) == [(0, 2)]
    assert runs(np.zeros(3, bool)) == runs(np.zeros(0, bool)) == []


def test_flags_that_last_are_kept_and_shorter_runs_are_not():
    flags = np.array([1, 1, 0, 1, 0, 1, 1, 1], dtype=bool)
    assert lasting(flags, 2).tolist() == [True, True, False, False, False, True, True, True]
    assert lasting(flags, 3).tolist() == [False] * 5 + [True] * 3
    assert not lasting(flags, 4).any()


def test_adjacent_ranges_are_joined_if_no_frame_is_left_between_them():
    assert adjacent_joined([(6, 7), (0, 3), (4, 4), (9, 9)]) == [(0, 4), (6, 7), (9, 9)]


def test_a_range_within_another_does_not_end_it():
    assert adjacent_joined([(0, 8), (2, 3), (9, 10)]) == [(0, 10)]


def test_segments_are_joined_if_they_share_a_key_frame():
    assert segments_joined([(0, 5), (5, 10), (15, 20)]) == [(0, 10), (15, 20)]
    assert segments_joined([(10, 15), (0, 5)]) == [(0, 5), (10, 15)]
    assert segments_joined([(0, 5), (6, 10)]) == [(0, 5), (6, 10)]
    assert segments_joined([]) == []
