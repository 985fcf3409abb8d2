"""Frames of the shot and of footage that lacks frames, or has them twice, find each other."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from kfmocap.core.shot.frame_numbers import (
    NOWHERE,
    across_gaps,
    footage_delay,
    footage_index,
    frames_damaged,
    gap_frame,
    shot_frames,
    shown_delay,
    without_gaps_beyond,
)
from kfmocap.core.shot.settings import Settings
from kfmocap.core.shot.shot import Gap, View
from synthetic import look_at

OFFSETS = (0.0, 3.0, -2.4)
LENGTH = 40


def recorded(seed: int) -> tuple[list[int], tuple[Gap, ...]]:
    """The instants that a camera's frames show, some lost and some stored several times, and where."""
    rng, instants, gaps, instant = np.random.default_rng(seed), [0], list[Gap](), 0
    while instant < LENGTH + 10:
        chance = rng.random()
        if chance < 0.1:
            lost = int(rng.integers(1, 4))
            gaps.append(Gap(len(instants), lost))
            instant += lost
        elif chance < 0.2:
            often = int(rng.integers(1, 3))
            gaps.append(Gap(len(instants), -often))
            instants += [instant] * often
        instant += 1
        instants.append(instant)
    return instants, tuple(gaps)


def view_of(gaps: tuple[Gap, ...], offset: float) -> View:
    return View(look_at("cam", (0, -3, 1)), Path("cam.mp4"), offset, gaps=gaps)


@pytest.mark.parametrize("offset", OFFSETS)
@pytest.mark.parametrize("seed", range(20))
def test_frames_behind_gaps_show_the_instants_that_they_should(seed: int, offset: float) -> None:
    instants, gaps = recorded(seed)
    view, ahead = view_of(gaps, offset), round(offset)
    frames = range(max(-ahead, 0), LENGTH)
    for frame in frames:
        shown, asked = instants[footage_index(view, frame)], frame + ahead
        assert shown == asked if asked in instants else shown == max(one for one in instants if one < asked)
    found = shot_frames(view, np.arange(len(instants)))
    once = [k for k in range(len(instants)) if k == 0 or instants[k] != instants[k - 1]]
    np.testing.assert_array_equal(found[once] + ahead, np.array(instants)[once])
    assert (np.delete(found, once) == NOWHERE).all()


@pytest.mark.parametrize("offset", OFFSETS)
@pytest.mark.parametrize("every", [2, 3])
@pytest.mark.parametrize("seed", range(10))
def test_footage_with_several_frames_for_each_of_the_shot_shows_every_second_or_third_instant(
    seed: int, every: int, offset: float
) -> None:
    instants, gaps = recorded(seed)
    view = replace(view_of(gaps, offset), every=every)
    each = replace(view, every=1)
    frames = range(1, LENGTH // every)
    assert [footage_index(view, f) for f in frames] == [footage_index(each, every * f) for f in frames]
    found, all_found = (shot_frames(v, np.arange(len(instants))) for v in (view, each))
    shown = (all_found != NOWHERE) & (all_found % every == 0)
    np.testing.assert_array_equal(found, np.where(shown, all_found // every, NOWHERE))
    assert footage_delay(view) == pytest.approx(footage_delay(each) / every)
    for first, last in ((3, 5), (6, 11)):
        part = without_gaps_beyond(view, first, last)
        own = range(first, last + 1)
        assert [footage_index(part, f) for f in own] == [footage_index(view, f) for f in own]
        assert (across_gaps(part, own) == across_gaps(view, own)).all()


def test_a_gap_between_two_frames_of_the_shot_keeps_them_apart() -> None:
    view = replace(view_of((Gap(5, 1), Gap(8, 1)), 0.0), every=2)  # the footage lacks instants 5 and 9
    assert [footage_index(view, frame) for frame in range(6)] == [0, 2, 4, 5, 7, 8]
    assert across_gaps(view, range(6)).tolist() == [False, False, True, False, True]
    assert [gap_frame(view, gap) for gap in view.gaps] == [3, 5]


@pytest.mark.parametrize("seed", range(20))
def test_only_pairs_of_neighbouring_pictures_do_not_cross_a_gap(seed: int) -> None:
    instants, gaps = recorded(seed)
    view = view_of(gaps, 0.0)
    places = [footage_index(view, frame) for frame in range(LENGTH)]
    apart = [instants[b] - instants[a] != 1 or b - a != 1 for a, b in pairwise(places)]
    np.testing.assert_array_equal(across_gaps(view, range(LENGTH)), apart)


def test_gaps_are_named_by_the_frames_of_the_shot_that_they_concern() -> None:
    view = view_of((Gap(5, 2), Gap(9, -1)), 1.0)  # the footage lacks instants 5 and 6, and has instant 10 twice
    assert [gap_frame(view, gap) for gap in view.gaps] == [4, 10]


@pytest.mark.parametrize("offset", OFFSETS)
@pytest.mark.parametrize("seed", range(20))
def test_a_part_of_a_shot_has_the_same_footage_without_the_gaps_beside_it(seed: int, offset: float) -> None:
    view = view_of(recorded(seed)[1], offset)
    for first, last in ((8, 12), (20, 21), (3, 39)):
        part = without_gaps_beyond(view, first, last)
        frames = range(first, last + 1)
        assert [footage_index(part, f) for f in frames] == [footage_index(view, f) for f in frames]
        assert (across_gaps(part, frames) == across_gaps(view, frames)).all()
        assert footage_delay(part) == pytest.approx(footage_delay(view))
        begins = [(gap_frame(part, gap), max(gap.missing, 0)) for gap in part.gaps]
        assert all(begin + count > first and begin <= last for begin, count in begins)
    assert without_gaps_beyond(replace(view, gaps=()), 0, 9).offset == offset


def test_pictures_that_are_late_show_an_earlier_moment() -> None:
    """With a footage offset of 0.4, they show a key pose 0.4 frames after its key frame."""
    view = view_of((), -0.25)
    assert footage_delay(view) == 0.25
    assert shown_delay(view, Settings(footage_offset=0.4)) == pytest.approx(-0.15)
    assert shown_delay(view, Settings()) == 0.25


def test_damaged_frames_are_those_from_the_first_to_the_last_of_each_run() -> None:
    """As the file counts them: the view's frames are those of the shot and three more."""
    view = View(look_at("front", (0.5, -2.8, 1.5)), Path("none.mp4"), offset=3.0, damaged=((7, 8), (10, 10)))
    assert np.flatnonzero(frames_damaged(view, range(2, 10))).tolist() == [2, 3, 5]
    assert not frames_damaged(replace(view, damaged=()), range(2, 10)).any()
