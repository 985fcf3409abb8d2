"""Runs of flags."""

import numpy as np
from kfmocap.core.numerics.arrays import runs


def test_runs_are_first_and_last_frames():
    assert runs(np.array([True, False, True, True, False])) == [(0, 0), (2, 3)]


def test_runs_may_touch_both_ends_or_be_none():
    assert runs(np.ones(3, bool)) == [(0, 2)]
    assert runs(np.zeros(3, bool)) == runs(np.zeros(0, bool)) == []
