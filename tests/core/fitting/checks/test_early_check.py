"""Footage that does not match the key poses is said before the shot is tracked, and tracking is not changed by it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from kfmocap.core.fitting.checks.early_check import EARLY_KEYS, EARLY_MISFITS, early_frames, early_misfits
from kfmocap.core.fitting.checks.view_findings import FootageMatch
from kfmocap.core.fitting.shot_cameras import track_and_check
from kfmocap.core.shot.footage import frames_at
from kfmocap.core.shot.settings import Settings
from kfmocap.core.shot.shot import Shot
from kfmocap.core.tracking.retracking import Excerpt
from kfmocap.core.tracking.scheduling.run_context import FirstPictures, RunContext
from kfmocap.core.tracking.tracker import track
from synthetic import figure, film, look_at, shot_of, swing

BODY = figure()
TRUTH = swing(BODY, 25, size=0.9)
CAMERAS = [look_at("front", (0.5, -2.8, 1.5)), look_at("side", (-2.4, -1.4, 1.3))]
KEYS = [0, 6, 12, 18, 24]


@pytest.fixture(scope="module")
def shot(tmp_path_factory: pytest.TempPathFactory) -> Shot:
    views = film(tmp_path_factory.mktemp("film"), [BODY], [TRUTH], CAMERAS)
    return shot_of(views, [BODY], [TRUTH], KEYS, Settings(threads=1, limb_search=False))


def exchanged(shot: Shot) -> Shot:
    a, b = shot.views
    return replace(shot, views=(replace(a, footage=b.footage), replace(b, footage=a.footage)))


def test_it_is_known_from_the_first_key_frames_before_a_segment_is_solved(shot: Shot) -> None:
    wrong, events = exchanged(shot), []

    def seen(pictures: Sequence[Mapping[int, Any]]) -> None:
        events.append([match.camera for match in early_misfits(wrong, pictures)])

    run = RunContext(show=lambda *_: events.append("segment"), first_pictures=FirstPictures(early_frames(wrong), seen))
    track(wrong, run=run)
    assert frozenset(KEYS[:EARLY_KEYS]) <= early_frames(wrong)
    [found] = [event for event in events if event != "segment"]
    assert found and events.index(found) < len(KEYS) - 2


def test_right_footage_is_not_named_and_tracked_the_same(shot: Shot) -> None:
    found: list[Any] = []
    first = FirstPictures(early_frames(shot), lambda pictures: found.append(early_misfits(shot, pictures)))
    result = track(shot, run=RunContext(first_pictures=first))
    assert found == [[]]
    assert result.pictures == ({}, {})
    assert result.motions[0].rotations.tobytes() == track(shot).motions[0].rotations.tobytes()


def test_another_offset_is_named_where_footage_matches_a_little_worse_than_usual(shot: Shot) -> None:
    """By how little it lacks alone it would not be named."""
    truth = swing(BODY, 22, size=0.9)
    late = shot_of([shot.views[0], replace(shot.views[1], offset=3.0)], [BODY], [truth], KEYS[:4], shot.settings)
    frames = sorted(early_frames(late))
    pictures = [dict(zip(frames, frames_at(view, frames, 1.0, grey=False), strict=True)) for view in late.views]
    [found] = early_misfits(late, pictures)
    assert isinstance(found, FootageMatch) and found.camera == "side" and found.match > 0.9
    assert found.offset is not None and abs(found.offset) <= 1


def test_blender_is_shown_it_once_and_only_if_the_whole_shot_is_tracked(
    shot: Shot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("kfmocap.core.fitting.shot_cameras.camera_fits", lambda *_: ())
    wrong, shown = exchanged(shot), {}
    track_and_check(wrong, [Excerpt(0, 24)], show=shown.__setitem__)
    assert {match.camera for match in shown.pop(EARLY_MISFITS)} <= {"front", "side"}
    assert all(isinstance(key, tuple) for key in shown)
    shown.clear()
    track_and_check(wrong, [Excerpt(0, 6)], show=shown.__setitem__)
    assert shown and EARLY_MISFITS not in shown


def test_footage_is_named_by_its_view_whatever_the_order_of_the_views(shot: Shot, tmp_path: Path) -> None:
    turned = replace(exchanged(shot), views=exchanged(shot).views[::-1])
    found: list[Any] = []
    for own in (exchanged(shot), turned):

        def seen(pictures: Sequence[Mapping[int, Any]], own: Shot = own) -> None:
            found.append(early_misfits(own, pictures))
            raise InterruptedError

        with pytest.raises(InterruptedError):  # no more is needed of the run
            track(own, run=RunContext(first_pictures=FirstPictures(early_frames(own), seen)))
    one, other = ({(match.camera, round(match.match, 6)) for match in matches} for matches in found)
    assert one == other
