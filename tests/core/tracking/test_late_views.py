"""A frame that one camera lost, or stored twice, is told by all that follows, and by nothing where none is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from kfmocap.core.shot.shot import Shot
from kfmocap.core.tracking.late_views import LateView
from kfmocap.core.tracking.retracking import Excerpt, track_excerpts
from kfmocap.core.tracking.tracker import track
from synthetic import figure, film, look_at, shot_of, swing

BODY, LENGTH, PLACE = figure(), 19, 12
TRUTH = swing(BODY, LENGTH + 1, size=1.2)
FRAMES = np.arange(LENGTH)
CAMERAS = {
    "front": look_at("front", (0.5, -2.8, 1.5)),
    "side": look_at("side", (-2.4, -1.4, 1.3)),
    "back": look_at("back", (1.5, 2.4, 1.4)),
}
SHIFTS = {"whole": 0, "missing": 1, "twice": -1}


@pytest.fixture(scope="module", params=SHIFTS)
def filmed(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[int, Shot]:
    """By how many frames what the camera at the side shows is ahead from one frame on, and the shot."""
    home, shift = tmp_path_factory.mktemp("film"), SHIFTS[request.param]
    shown = FRAMES + np.where(FRAMES >= PLACE, shift, 0)
    views = [
        view
        for name, camera in CAMERAS.items()
        for view in film(home / name, [BODY], [TRUTH[shown if name == "side" else FRAMES]], [camera])
    ]
    return shift, shot_of(views, [BODY], [TRUTH[FRAMES]], (0, 6, LENGTH - 1))


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
