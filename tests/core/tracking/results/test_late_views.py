"""A frame that one camera lost, or stored twice, is found from all that follows it; nothing is found where none is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from kfmocap.core.shot.settings import Settings
from kfmocap.core.shot.shot import Shot
from kfmocap.core.tracking.results.late_views import LateView, late_views
from kfmocap.core.tracking.retracking import Excerpt, track_excerpts
from kfmocap.core.tracking.solvers.equations.view_delays import DelayEvidence
from kfmocap.core.tracking.tracker import track
from late_footage import CAMERAS, LENGTH, PLACE, SHIFTS, late_film

GIVEN = Settings(correct_gaps=False, limb_search=False)


@pytest.fixture(scope="module", params=SHIFTS)
def filmed(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[int, Shot]:
    """By how many frames what the camera at the side shows is ahead from one frame on, and the shot."""
    shift = SHIFTS[request.param]
    return shift, late_film(tmp_path_factory.mktemp("film"), shift, GIVEN)


def found(late: tuple[LateView | None, ...]) -> dict[str, LateView]:
    return {name: one for name, one in zip(CAMERAS, late, strict=True) if one is not None}


def test_the_view_and_the_frame_are_told(filmed: tuple[int, Shot]) -> None:
    shift, shot = filmed
    late = found(track(shot).late)
    assert set(late) == ({"side"} if shift else set())
    for one in late.values():
        assert abs(one.frame - PLACE) <= 1
        assert np.sign(one.delay) == shift
        assert ("missing" in one.text) == (shift > 0)


def delays_of(delays: list[float], deviations: list[float]) -> DelayEvidence:
    """What a segment of ten frames says if views are off by some delays from frame 5 on, that many deviations sure."""
    precision = np.full((len(delays), 10), 400.0)
    gradient, coupling = np.zeros_like(precision), np.zeros_like(precision)
    precision[:, 0] = 0.0
    precision[:, 5] = (np.array(deviations) / delays) ** 2
    gradient[:, 5] = -precision[:, 5] * delays
    return DelayEvidence(np.arange(10), gradient, precision, coupling)


@pytest.mark.parametrize(
    ("other", "torn", "view", "clear"),
    [(-7.5, [(), ()], 0, True), (-9.5, [(), ()], 0, False), (-9.5, [(), (5,)], 1, True), (-9.5, [(), (7,)], 0, False)],
)
def test_it_is_clear_which_of_two_views_is_wrong_only_where_one_is_likelier(
    other: float, torn: list[tuple[int, ...]], view: int, clear: bool
) -> None:
    late = late_views([(20, delays_of([0.5, -0.5], [10.0, other]))], [tuple(20 + f for f in frames) for frames in torn])
    assert [own is not None for own in late] == [view == 0, view == 1]
    own = late[view]
    assert own is not None
    assert (own.frame, own.clear) == (25, clear)
    assert ("another view" in own.text) == (not clear)


@pytest.mark.parametrize(
    ("delay", "deviations", "torn", "told"),
    [
        (0.31, 6.5, (), False),
        (0.31, 7.0, (), True),
        (0.24, 7.0, (), False),
        (0.2, 11.0, (), True),
        (0.2, 8.7, (), False),
        (0.2, 8.7, (25,), True),
        (0.2, 6.5, (25,), False),
        (0.1, 30.0, (), False),
    ],
)
def test_a_small_delay_must_be_surer_and_may_be_less_sure_where_pictures_do_not_continue(
    delay: float, deviations: float, torn: tuple[int, ...], told: bool
) -> None:
    said = delays_of([delay, 0.01], [deviations, 0.1])
    [own, other] = late_views([(20, said)], [torn, ()])
    assert (own is not None, other is not None) == (told, False)


def test_what_is_told_follows_the_views_whatever_their_order(filmed: tuple[int, Shot]) -> None:
    _, shot = filmed
    turned = replace(shot, views=shot.views[::-1])
    assert track(turned).late == track(shot).late[::-1]


def test_frames_count_from_the_first_of_what_was_tracked(filmed: tuple[int, Shot]) -> None:
    shift, shot = filmed
    [result] = track_excerpts(shot, [Excerpt(6, LENGTH - 1, footage_offset=0.0)])
    late = found(result.late)
    assert set(late) == ({"side"} if shift else set())
    if shift:
        assert abs(late["side"].counted_from(6).frame - PLACE) <= 1
