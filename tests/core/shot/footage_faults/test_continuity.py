"""Damaged, repeated and missing frames are told from what moves."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from kfmocap.core.shot.footage_faults.continuity import (
    block_change,
    block_means,
    lit_differently,
    single_frames,
    torn_pairs,
)
from walking_film import FRAMES, film


def torn(frames: np.ndarray) -> np.ndarray:
    blocks = [block_means(frame) for frame in frames]
    return torn_pairs([block_change(a, b) for a, b in pairwise(blocks)])


@pytest.mark.parametrize("speed", [0, 1, 4, 9, 15])
def test_whole_footage_is_not_torn(speed: float) -> None:
    assert not torn(film(speed)).any()


@pytest.mark.parametrize("swing", [(6, 12, 8, 3), (3, 9, 6)])
def test_somebody_who_stands_still_and_strikes_once_does_not_look_like_damage(swing: tuple[float, ...]) -> None:
    rest = [0.0] * 6
    assert not torn(film(steps=[*rest, *swing, *rest])).any()


def test_who_turns_back_is_nearly_still_for_a_moment_and_is_no_repeated_frame() -> None:
    """The noise of the pictures goes on meanwhile."""
    assert not torn(film(steps=[4.0] * 7 + [0.0] + [-4.0] * 7)).any()


@pytest.mark.parametrize("frame", [0, 1, FRAMES - 1])
def test_at_the_ends_nothing_shows_whether_a_change_lasts(frame: int) -> None:
    frames = film()
    frames[frame, 64:112, 160:320] = np.kron(np.random.default_rng(2).integers(0, 255, (3, 10)), np.ones((16, 16)))
    assert not torn(frames)[[0, 1, -2, -1]].any()


def test_a_frame_with_broken_blocks_fits_neither_neighbour() -> None:
    frames = film()
    frames[7, 64:112, 160:320] = np.kron(np.random.default_rng(2).integers(0, 255, (3, 10)), np.ones((16, 16)))
    found = torn(frames)
    assert np.flatnonzero(found).tolist() == [6, 7]
    assert np.flatnonzero(single_frames(found)).tolist() == [7]


def test_damage_that_lasts_is_torn_where_it_begins_and_ends() -> None:
    frames = film()
    frames[6:11, 64:112, 160:300] = 128
    assert np.flatnonzero(torn(frames)).tolist() == [5, 10]


def test_light_that_changes_suddenly_is_torn_and_light_that_fades_is_not() -> None:
    frames = film().astype(float)
    flash, fading = frames.copy(), frames + np.linspace(0, 40, FRAMES)[:, None, None]
    flash[8:, :, 100:] += 40
    assert np.flatnonzero(torn(np.clip(flash, 0, 255).astype(np.uint8))).tolist() == [7]
    assert not torn(np.clip(fading, 0, 255).astype(np.uint8)).any()


@pytest.mark.parametrize("speed", [0.5, 4.0])
def test_a_repeated_frame_has_no_weight(speed: float) -> None:
    frames = film(speed)
    frames[8] = frames[7]
    assert np.flatnonzero(single_frames(torn(frames))).tolist() == [8]


def test_missing_frames_are_torn() -> None:
    assert np.flatnonzero(torn(film(3.0, moved=25))).tolist() == [FRAMES // 2 - 1]


@pytest.mark.parametrize("instead", ["brighter", "darker", "flat", "other", "same"])
def test_light_changes_blocks_in_one_sense_and_leaves_what_is_in_them(instead: str) -> None:
    before, shade = np.random.default_rng(5).uniform(20, 90, (72, 130)), np.linspace(0.2, 1.0, 130)
    after = {
        "brighter": before * (1 + shade),
        "darker": before * (1 - 0.6 * shade),
        "flat": np.full_like(before, 128.0),
        "other": np.roll(before, 40, axis=1) + 60,
        "same": before,
    }[instead]
    assert lit_differently(before, after) == (instead in ("brighter", "darker"))
