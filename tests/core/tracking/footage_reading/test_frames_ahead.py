"""Frames that are decoded while key poses are fitted are those that the tracker would have decoded."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from kfmocap.core.errors import FootageError
from kfmocap.core.runtime.processes.worker_memory import WorkerMemory
from kfmocap.core.runtime.timing import Seconds
from kfmocap.core.shot.fingerprint import made_of
from kfmocap.core.shot.footage import Album, frames_at
from kfmocap.core.shot.interlacing import FieldWatch
from kfmocap.core.shot.settings import Settings
from kfmocap.core.shot.shot import Shot, View
from kfmocap.core.tracking.footage_reading import frames_ahead, reader
from kfmocap.core.tracking.footage_reading.frames_ahead import FramesAhead, remember_ahead, taken_ahead
from kfmocap.core.tracking.footage_reading.segment_footage import ReadingResources, SegmentFootage
from kfmocap.core.tracking.solvers.registry import solver_named
from synthetic import CAMERAS, figure, film, shot_of, swing

BODY, LENGTH = figure(), 9
TRUTH = swing(BODY, LENGTH)
SETTINGS = Settings(threads=2)


@pytest.fixture(scope="module")
def filmed(tmp_path_factory: pytest.TempPathFactory) -> Shot:
    views = film(tmp_path_factory.mktemp("film"), [BODY], [TRUTH], CAMERAS[:2])
    return shot_of(views, [BODY], [TRUTH], (0, 4, 8), SETTINGS)


@pytest.fixture(autouse=True)
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(frames_ahead, "MAX_AHEAD", 4)


def begun(views: Sequence[View], pictures: set[int]) -> FramesAhead:
    """The first frames of some views, decoded ahead."""
    ahead = FramesAhead((0, LENGTH - 1), pictures, SETTINGS)
    with ahead.decoding(views):
        while not ahead.done:
            time.sleep(0.001)
    return ahead


def test_the_frames_and_pictures_are_the_same(filmed: Shot) -> None:
    view, album, usual = filmed.views[0], Album(frozenset({1, 7}), 1.0), Album(frozenset({1, 7}), 1.0)
    ahead = begun(filmed.views[:1], {1, 3, 7})
    taken = ahead.taken(made_of(view, 1.0), range(LENGTH), album)
    assert taken is not None
    expected = list(frames_at(view, range(LENGTH), 1.0, grey=False, album=usual))
    assert np.array_equal(list(taken), expected)
    assert album.pictures.keys() == usual.pictures.keys() == {1, 7}
    assert all(np.array_equal(album.pictures[f], usual.pictures[f]) for f in (1, 7))


def test_two_fields_are_seen_in_frames_that_were_decoded_ahead(filmed: Shot, tmp_path: Path) -> None:
    w, h = filmed.views[0].camera.size
    for k in range(LENGTH):
        picture = np.full((h, w, 3), 60, np.uint8)
        for field, left in enumerate((10 + 6 * k, 13 + 6 * k)):
            picture[h // 4 + field : h // 2 : 2, left : left + 40] = 200
        cv2.imwrite(str(tmp_path / f"{k:04d}.png"), picture)
    view, album = replace(filmed.views[0], footage=tmp_path / "%04d.png"), Album(frozenset({1, 7}), 1.0)
    usual = replace(album, fields=FieldWatch())
    taken = begun([view], {1, 7}).taken(made_of(view, 1.0), range(LENGTH), album)
    assert taken is not None and len(list(taken)) == len(list(frames_at(view, range(LENGTH), 1.0, album=usual)))
    assert album.fields.interlaced and usual.fields.interlaced


@pytest.mark.parametrize(
    ("frames", "album"),
    [
        (range(1, LENGTH), Album(frozenset({1}), 1.0)),
        (range(LENGTH), Album(frozenset({2}), 1.0)),
        (range(LENGTH), Album(frozenset({1}), 2.0)),
    ],
)
def test_other_frames_or_pictures_are_not_taken(filmed: Shot, frames: range, album: Album) -> None:
    ahead = begun(filmed.views[:1], {1})
    assert ahead.taken(made_of(filmed.views[0], 1.0), frames, album) is None


def test_footage_that_has_changed_is_not_taken(filmed: Shot) -> None:
    ahead = begun(filmed.views[:1], set())
    file = next(Path(filmed.views[0].footage).parent.iterdir())
    os.utime(file, (1, 1))
    assert ahead.taken(made_of(filmed.views[0], 1.0), range(LENGTH), Album(frozenset(), 1.0)) is None


def test_footage_that_cannot_be_read_is_left_to_those_who_read_it(tmp_path: Path) -> None:
    ends = film(tmp_path, [BODY], [TRUTH[:2]], CAMERAS[:1])[0]
    missing = replace(ends, footage=tmp_path / "none.mp4")
    ahead, album = begun((ends, missing), set()), Album(frozenset(), 1.0)
    assert ahead.taken(made_of(ends, 1.0), range(LENGTH), album) is None
    with pytest.raises(FootageError):
        list(frames_at(ends, range(LENGTH), 1.0))


def test_the_tracker_reads_on_where_decoding_ahead_ended(filmed: Shot, monkeypatch: pytest.MonkeyPatch) -> None:
    """All views are begun; none is decoded from its first frame once more."""

    def read(memory: WorkerMemory) -> list[bytes]:
        footage = SegmentFootage(filmed, solver_named("relaxation"), {0, 4}, ReadingResources(memory=memory))
        segments = list(footage.by_segment([TRUTH], (), Seconds()))
        assert all(own.keys() == {0, 4} for own in footage.pictures)
        return [view.grey.tobytes() for views in segments for view in views]

    usual, memory = read(WorkerMemory(limit=0)), WorkerMemory(limit=0)
    remember_ahead(memory, begun(filmed.views, {0, 4}))
    monkeypatch.setattr(reader, "frames_at", lambda *_, **__: pytest.fail("decoded once more"))
    assert read(memory) == usual
    assert taken_ahead(memory, made_of(filmed.views[0], 1.0), range(LENGTH), Album(frozenset(), 1.0)) is None
