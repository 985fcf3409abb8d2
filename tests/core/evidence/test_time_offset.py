"""Key poses and footage out of step: the offset is found, allowed for, and left alone where it may be chance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from kfmocap.core.body import landmark_positions
from kfmocap.core.body.motion import Motion
from kfmocap.core.errors import ShotError
from kfmocap.core.evidence.time_offset import OFFSET_SIGMA, Offset
from kfmocap.core.shot.frame_numbers import shown_delay
from kfmocap.core.shot.settings import Settings
from kfmocap.core.shot.shot import KeyPoses, Performer, Shot
from kfmocap.core.tracking.results.track_result import TrackResult
from kfmocap.core.tracking.retracking import Excerpt, track_excerpts
from kfmocap.core.tracking.tracker import track
from synthetic import figure, film, look_at, shot_of, swing

BODY, LENGTH = figure(), 13
KEYS = (0, 6, 12)
FINE = swing(BODY, 4 * LENGTH, size=1.2)
"""The truth at every quarter of a frame."""
CAMERAS = (
    look_at("front", (0.5, -2.8, 1.5)),
    look_at("side", (-2.4, -1.4, 1.3)),
    look_at("back", (1.5, 2.4, 1.4)),
)


@pytest.fixture(scope="module")
def shots(tmp_path_factory: pytest.TempPathFactory) -> dict[int, Shot]:
    """By how many quarters of a frame the key poses are late: they, and the truth, are those of a later instant."""
    home = tmp_path_factory.mktemp("film")
    views = film(home, [BODY], [FINE[0 : 4 * LENGTH : 4]], CAMERAS)
    return {late: shot_of(views, [BODY], [truth(late)], KEYS, Settings(limb_search=False)) for late in (0, 1, 2)}


@pytest.fixture(scope="module")
def tracked(shots: dict[int, Shot]) -> dict[int, TrackResult]:
    """The offsets unknown."""
    return {late: track(shot) for late, shot in shots.items()}


def truth(late: int) -> Motion:
    return FINE[np.minimum(np.arange(LENGTH) * 4 + late, len(FINE) - 1)]


def error_mm(result: TrackResult, late: int) -> float:
    names = list(BODY.landmarks)
    found, true = (landmark_positions(BODY, m, names) for m in (result.motions[0], truth(late)))
    return 1000 * float(np.linalg.norm(found - true, axis=2).mean())


@pytest.mark.parametrize("late", [1, 2])
def test_the_offset_of_key_poses_that_are_late_is_found(tracked: dict[int, TrackResult], late: int) -> None:
    assert tracked[late].footage_offset == pytest.approx(late / 4, abs=0.08)


def test_what_key_poses_out_of_step_would_cost_is_saved(
    shots: dict[int, Shot], tracked: dict[int, TrackResult]
) -> None:
    ignored, known = (error_mm(track(shots[2].with_footage_offset(offset)), 2) for offset in (0.0, 0.5))
    unknown, in_step = error_mm(tracked[2], 2), error_mm(tracked[0], 0)
    assert known < unknown < 0.3 * ignored
    assert known < 1.1 * in_step + 2


def test_the_offset_of_a_shot_with_one_segment_is_found_too(shots: dict[int, Shot]) -> None:
    ends = replace(shots[2], performers=tuple(only_ends(p) for p in shots[2].performers))
    result = track(ends)
    assert result.footage_offset > 0.3
    assert error_mm(result, 2) < 0.6 * error_mm(track(ends.with_footage_offset(0.0)), 2)


def only_ends(performer: Performer) -> Performer:
    return replace(performer, key_poses=KeyPoses.whole([KEYS[0], KEYS[-1]], truth(2)[[KEYS[0], KEYS[-1]]]))


def test_what_is_in_step_is_left_alone_to_the_last_bit(shots: dict[int, Shot], tracked: dict[int, TrackResult]) -> None:
    found, told = tracked[0], track(shots[0].with_footage_offset(0.0))
    assert found.footage_offset == 0
    np.testing.assert_array_equal(found.motions[0].rotations, told.motions[0].rotations)


def test_key_poses_are_met_exactly_also_where_the_footage_shows_them_elsewhen(
    tracked: dict[int, TrackResult],
) -> None:
    motion = tracked[2].motions[0]
    np.testing.assert_array_equal(motion.rotations[list(KEYS)], truth(2).rotations[list(KEYS)])


def test_a_part_of_a_shot_is_tracked_with_the_offset_of_the_whole(shots: dict[int, Shot]) -> None:
    [part] = track_excerpts(shots[2], [Excerpt(6, 12, footage_offset=0.4)])
    assert part.footage_offset == 0.4


def test_relaxation_looks_for_no_offset_and_takes_one_that_is_given(shots: dict[int, Shot]) -> None:
    few = Settings(solver="relaxation", sweeps=3)
    assert track(replace(shots[2], settings=few)).footage_offset == 0
    assert track(replace(shots[2], settings=replace(few, footage_offset=0.5))).footage_offset == 0.5


def test_an_offset_that_is_next_to_nothing_or_hardly_measured_is_none() -> None:
    assert Offset.likeliest([]).value == 0
    assert Offset.likeliest([Offset(0.09, 1e6)]).value == 0
    assert Offset.likeliest([Offset(0.4, 0.3 * OFFSET_SIGMA**-2)]).value == 0
    assert Offset.likeliest([Offset(0.4, 100.0)]).value == pytest.approx(0.4 * 100 / (100 + OFFSET_SIGMA**-2))


@pytest.mark.parametrize(
    ("precision", "several", "found"), [(9.0, False, True), (9.0, True, False), (15.0, True, True)]
)
def test_with_several_performers_an_offset_counts_from_two_standard_deviations_on(
    precision: float, several: bool, found: bool
) -> None:
    """-0.39 with a standard deviation of 0.22, and -0.5 with 0.19."""
    assert (Offset.likeliest([Offset(-0.9, precision)], several=several).value < -0.3) == found


def test_measurements_count_by_their_precision_and_end_at_half_a_frame() -> None:
    both = Offset.likeliest([Offset(0.4, 300.0), Offset(0.2, 100.0)])
    assert both.value == pytest.approx((0.4 * 300 + 0.2 * 100) / (400 + OFFSET_SIGMA**-2))
    assert Offset.likeliest([Offset(-1.0, 500.0)]).value == -0.5


def test_an_offset_of_more_than_half_a_frame_is_refused() -> None:
    with pytest.raises(ShotError, match="footage_offset"):
        Settings(footage_offset=0.7)


def test_a_later_offset_shows_the_body_earlier(shots: dict[int, Shot]) -> None:
    view = replace(shots[0].views[0], offset=2.25)
    assert shown_delay(view, Settings()) == -0.25
    assert shown_delay(view, Settings(footage_offset=0.25)) == -0.5
