"""Frames that repeat the one before at regular intervals are told, and what to do about them."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from kfmocap.core.shot.footage_faults.continuity import block_change, block_means
from kfmocap.core.shot.footage_faults.frame_pattern import FramePattern, repeated_every
from walking_film import FRAMES, film

PACE = [3, 4, 5, 5, 4, 3, 2, 2, 3, 4, 6, 5, 4, 3, 4, 5] * 3
"""Steps of somebody who walks, pixels."""


def repeats(frames: np.ndarray, shown: list[int]) -> int:
    blocks = [block_means(frames[k]) for k in shown]
    return repeated_every([block_change(a, b) for a, b in pairwise(blocks)])


@pytest.mark.parametrize("every", [2, 3, 4, 5, 6])
@pytest.mark.parametrize("phase", [0, 1])
def test_every_how_many_frames_one_is_repeated_is_told(every: int, phase: int) -> None:
    frames = film(steps=PACE)
    shown = [k for k in range(len(frames)) for _ in range(1 + ((k + phase) % (every - 1) == 0 if every > 2 else 1))]
    assert repeats(frames, shown) == every


@pytest.mark.parametrize("steps", [PACE, [0.0] * 30 + [6.0] * 4 + [0.0] * 30, [5, 0, 5, 5, 5, 5, 0, 5, 5, 0, 5, 5, 5]])
def test_movement_that_rests_and_turns_back_repeats_no_frame(steps: list[float]) -> None:
    frames = film(steps=steps)
    assert repeats(frames, list(range(len(frames)))) == 0


def test_where_nothing_moves_nothing_is_said() -> None:
    assert repeats(film(0), list(range(FRAMES))) == 0
    assert not FramePattern().text and not FramePattern().brief


def test_what_to_do_is_said_for_every_pattern() -> None:
    assert "every = 2" in FramePattern(every=2).text
    assert "decimate=cycle=5" in FramePattern(every=5).text and "4/5" in FramePattern(every=5).text
    both = FramePattern(interlaced=True, every=6)
    assert "fields" in both.text and "sixth" in both.text and "interlaced" in both.brief and "sixth" in both.brief
