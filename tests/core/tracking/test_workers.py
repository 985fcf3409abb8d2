"""How many processes a shot is tracked in makes no difference to the motion."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from kfmocap.core.body.motion import Motion
from kfmocap.core.shot.shot import Shot
from kfmocap.core.tracking import tracker
from kfmocap.core.tracking.track_result import TrackResult
from synthetic import figure, film, look_at, shot_of, swing

BODY = figure()
LENGTH = 13
TRUTH = swing(BODY, LENGTH)
CAMERAS = (look_at("front", (0.5, -2.8, 1.5)), look_at("side", (-2.4, -1.4, 1.3)))


@pytest.fixture(scope="module")
def filmed(tmp_path_factory: pytest.TempPathFactory) -> Shot:
    return shot_of(film(tmp_path_factory.mktemp("film"), [BODY], [TRUTH], CAMERAS), [BODY], [TRUTH], (0, 4, 8, 12))


def tracked_by(workers: int, shot: Shot, monkeypatch: pytest.MonkeyPatch) -> TrackResult:
    monkeypatch.setattr(tracker, "WORTH_PROCESSES", 0)
    return tracker.track(replace(shot, settings=replace(shot.settings, threads=workers)))


def same(one: Motion, other: Motion) -> bool:
    return np.array_equal(one.translations, other.translations) and np.array_equal(one.rotations, other.rotations)


def test_one_and_two_processes_find_the_same_motion_to_the_last_bit(
    filmed: Shot, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(tracker.tempfile, "gettempdir", lambda: str(tmp_path))
    alone, together = (tracked_by(n, filmed, monkeypatch) for n in (1, 2))
    assert same(alone.motions[0], together.motions[0])
    np.testing.assert_array_equal(alone.deviation[0], together.deviation[0])
    assert alone.footage_offset == together.footage_offset
    assert [s.energy for s in alone.segments] == [s.energy for s in together.segments]
    assert not list(tmp_path.iterdir())  # the frames that the processes shared are gone
