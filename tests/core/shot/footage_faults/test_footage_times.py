"""Footage whose frames do not come at a constant rate is found out before anything is decoded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from threading import Event

import cv2
import numpy as np
import pytest
from cut_videos import cut_before
from kfmocap.core.errors import FootageError
from kfmocap.core.shot.footage import Album, pictures, probe
from kfmocap.core.shot.footage_faults.footage_checks import check_rates, check_view
from kfmocap.core.shot.footage_faults.footage_times import (
    footage_rate,
    frame_times,
    frames_missing,
    timed_gaps,
    video_rate,
    whole_pictures,
)
from kfmocap.core.shot.frame_numbers import footage_index
from kfmocap.core.shot.shot import Shot, View
from kfmocap.core.tracking.footage_reading.picture_store import PictureStore
from kfmocap.core.tracking.footage_reading.reader import SegmentReader
from retimed_videos import retimed
from synthetic import figure, look_at, shot_of, swing

FRAMES, FPS = 24, 30.0
BODY = figure()
TRUTH = swing(BODY, FRAMES)
CAMERA = look_at("front", (0.5, -2.8, 1.5))


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("film") / "constant.mp4"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"mp4v"), FPS, CAMERA.size)
    for f in range(FRAMES):
        writer.write(np.full((*CAMERA.size[::-1], 3), 9 * f, np.uint8))
    writer.release()
    return path


def shot(path: Path, first: int = 0) -> Shot:
    made = shot_of([View(CAMERA, path)], [BODY], [TRUTH], (0, FRAMES - 1 - first), fps=FPS)
    return replace(made, frames=(first, FRAMES - 1))


def timed(film: Path, name: str, durations: Sequence[float]) -> Path:
    path = film.with_name(name)
    path.write_bytes(retimed(film.read_bytes(), durations))
    return path


def test_times_are_those_of_the_frames(film: Path) -> None:
    assert frame_times(film, 99) == pytest.approx(np.arange(FRAMES) / FPS, abs=1e-3)
    assert frame_times(film, 5) == pytest.approx(np.arange(5) / FPS, abs=1e-3)
    video = cv2.VideoCapture(str(film))
    decoded = []
    while video.grab():
        decoded.append(video.get(cv2.CAP_PROP_POS_MSEC) / 1000)
    assert frame_times(film, 99) == pytest.approx(np.array(decoded), abs=2e-3)


def test_a_constant_rate_is_found_and_jitter_is_none(film: Path) -> None:
    for name, wobble in (("exact.mp4", 0.0), ("jitter.mp4", 0.2)):
        durations = 1 + wobble * (-1.0) ** np.arange(FRAMES)
        rate = footage_rate(shot(film), View(CAMERA, timed(film, name, durations)))
        assert rate is not None
        assert rate.rate == pytest.approx(FPS, rel=2e-3)
        assert not rate.varies


def test_a_rate_that_varies_is_said(film: Path) -> None:
    """Half of the frames last a half longer than the others, as phones film when it gets dark."""
    path = timed(film, "varies.mp4", [0.8] * 12 + [1.2] * 12)
    rate = footage_rate(shot(path), View(CAMERA, path))
    assert rate is not None
    assert rate.varies
    assert rate.astray == pytest.approx(1.2, abs=0.1)
    assert "convert it, as with: ffmpeg -i FOOTAGE -vf fps=29.97 " in rate.text(30000 / 1001)
    later = footage_rate(shot(path, 13), View(CAMERA, path))
    assert later is not None
    assert not later.varies  # what is not shown does not count
    assert later.rate == pytest.approx(FPS / 1.2, rel=1e-2)
    assert video_rate(path, FRAMES, FPS) == rate
    early = video_rate(path, 12)
    assert early is not None and not early.varies


def test_missing_frames_are_a_rate_that_varies(film: Path) -> None:
    durations = np.full(FRAMES, (FRAMES - 3) / FRAMES)
    durations[10] = 4.0
    rate = footage_rate(shot(film), View(CAMERA, timed(film, "gap.mp4", durations)))
    assert rate is not None
    assert rate.varies
    assert rate.frame in (10, 11)


@pytest.mark.parametrize("lost", [(10,), (1,), (8, 15, 16)])
def test_single_missing_frames_are_told_by_the_times_of_the_others(film: Path, lost: tuple[int, ...]) -> None:
    """A frame too late by half a frame either way is none too late for a constant rate."""
    durations = 1 + 0.1 * (-1.0) ** np.arange(FRAMES)
    durations[list(lost)] += 1.0
    view = View(CAMERA, timed(film, f"lost{len(lost)}{lost[0]}.mp4", durations / durations.mean()))
    rate = footage_rate(shot(view.footage), view)
    assert rate is not None
    assert rate.varies
    assert rate.missing == tuple((k + 1, 1) for k in lost)
    assert rate.rate == pytest.approx(FPS * durations.mean(), rel=5e-3)
    assert f"1 before frame {lost[0] + 1}" in rate.text()
    assert np.flatnonzero(frames_missing(rate, view, range(5, FRAMES))).tolist() == [k - 5 for k in lost if k >= 5]


def test_footage_reaches_as_far_as_the_times_of_its_frames(film: Path) -> None:
    """Six frames of 30 are missing: the file states a lower rate and fewer frames, but is no slower and no shorter."""
    durations = np.ones(FRAMES)
    durations[[7, 9, 11, 15, 19, 20]] = 2.0
    view = View(CAMERA, timed(film, "sparse.mp4", durations / durations.mean()))
    steady = View(replace(CAMERA, name="steady"), timed(film, "steady.mp4", np.full(FRAMES, 1 / durations.mean())))
    footages = [check_view(own, 0, FRAMES) for own in (view, steady)]
    sparse = replace(footages[0], fps=footages[1].fps * FRAMES / (FRAMES + 6))
    check_rates([view, steady], [sparse, footages[1]], footages[1].fps)
    check_view(view, 0, FRAMES + 6)
    for own, length in ((view, FRAMES + 7), (steady, FRAMES + 1)):
        with pytest.raises(FootageError, match=f"the footage has only {FRAMES} frames"):
            check_view(own, 0, length)


def test_frames_whose_rate_varies_are_counted_by_their_times(film: Path) -> None:
    """A phone that films a quarter slower from its twelfth frame on shows every fifth frame of the shot not at all."""
    durations = np.array([1.0] * 12 + [1.25] * 12)
    fps = FPS * durations.mean()
    view = View(CAMERA, timed(film, "phone.mp4", durations / durations.mean()))
    rate = footage_rate(replace(shot(view.footage), fps=fps), view)
    assert rate is not None and rate.varies and not rate.missing
    assert [count for _, count in rate.counted] == [1, 1, 1]
    assert "3 are missing, and 0 too many, by their times" in rate.text(fps)
    counted = replace(view, gaps=timed_gaps(view, rate))
    places = np.r_[0, np.cumsum(durations)[:-1]]
    shown = [places[footage_index(counted, frame)] for frame in range(27)]
    assert np.abs(np.array(shown) - np.arange(27)).max() < 1.1
    check_view(view, 0, FRAMES + 3, fps)
    with pytest.raises(FootageError, match=f"has only {FRAMES} frames"):
        check_view(view, 0, FRAMES + 3)


def test_frames_that_come_too_often_for_the_shot_are_left_out(film: Path) -> None:
    durations = np.array([1.0] * 12 + [0.75] * 12)
    view = View(CAMERA, timed(film, "faster.mp4", durations / durations.mean()))
    gaps = timed_gaps(view, footage_rate(replace(shot(view.footage), fps=FPS * durations.mean()), view))
    assert gaps and {gap.missing for gap in gaps} == {-1}
    places = np.r_[0, np.cumsum(durations)[:-1]]
    shown = [places[footage_index(replace(view, gaps=gaps), frame)] for frame in range(20)]
    assert np.abs(np.array(shown) - np.arange(20)).max() < 0.7


def test_a_view_whose_rate_varies_may_stand_beside_one_at_the_shots(film: Path) -> None:
    varies = View(replace(CAMERA, name="phone"), timed(film, "phone.mp4", [1.0] * 12 + [1.25] * 12))
    steady = View(CAMERA, film)
    footages = [probe(view.footage) for view in (steady, varies)]
    slower = replace(footages[1], fps=FPS / 1.1)
    check_rates([steady, varies], [footages[0], slower], FPS)
    with pytest.raises(FootageError, match=r"it has 30 frames per second, the shot 27 \(write fps = 30 under \[shot\]"):
        check_rates([steady, varies], [footages[0], slower], 27.0)


def test_of_views_with_other_rates_one_that_cannot_be_counted_is_to_be_converted(film: Path) -> None:
    varies = View(replace(CAMERA, name="phone"), timed(film, "half.mp4", np.linspace(1.0, 3.0, FRAMES)))
    steady = View(CAMERA, film)
    footages = [probe(view.footage) for view in (steady, varies)]
    slower = replace(footages[1], fps=FPS / 2)
    with pytest.raises(FootageError, match=rf"half.mp4 \(camera 'phone'\): its frame rate varies.* -vf fps={FPS:.5g} "):
        check_rates([steady, varies], [footages[0], slower], FPS)


def test_frames_that_last_longer_and_longer_are_not_missing(film: Path) -> None:
    path = timed(film, "slower.mp4", np.linspace(0.4, 1.6, FRAMES))
    rate = footage_rate(shot(path), View(CAMERA, path))
    assert rate is not None
    assert rate.varies and not rate.missing


def test_nothing_is_said_where_nothing_is_known(film: Path, tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "0.png"), np.zeros((72, 96, 3), np.uint8))
    broken = tmp_path / "broken.mp4"
    broken.write_bytes(film.read_bytes()[:300])
    for path in (tmp_path / "%d.png", tmp_path / "0.png", tmp_path / "none.mp4", broken, tmp_path):
        assert footage_rate(shot(film), View(CAMERA, path)) is None


def test_pairs_between_which_frames_are_missing_get_no_weight(film: Path) -> None:
    durations = np.ones(FRAMES)
    durations[9] = 2.0
    made = shot(timed(film, "one.mp4", durations / durations.mean()))
    [view] = made.views
    reader = SegmentReader(made, view, Album(frozenset(), 1.0), Event())
    read = reader.read((0, FRAMES - 1), PictureStore(None, "all"))
    assert read.torn is not None
    assert np.flatnonzero(read.torn).tolist() == [9]


def test_of_a_file_that_was_cut_by_its_edit_list_the_frames_that_are_shown_count(tmp_path: Path) -> None:
    whole, cut = tmp_path / "whole.mp4", tmp_path / "cut.mp4"
    writer = cv2.VideoWriter(str(whole), cv2.VideoWriter_fourcc(*"mp4v"), FPS, (160, 120))
    texture = cv2.GaussianBlur(np.random.default_rng(0).integers(0, 255, (120, 160, 3)).astype(np.uint8), (9, 9), 0)
    for f in range(FRAMES):
        writer.write(np.roll(texture, f, axis=1))
    writer.release()
    assert len(whole_pictures(whole, FRAMES)) < FRAMES / 4, "what comes before the cut has to be stored"
    cut.write_bytes(cut_before(whole.read_bytes(), 5, FRAMES))
    shown = len(list(pictures(cut)))
    assert shown == FRAMES - 5
    assert frame_times(cut, FRAMES) == pytest.approx(np.arange(shown) / FPS, abs=1e-3)
    rate = video_rate(cut, FRAMES, FPS)
    assert rate is not None and not rate.varies and rate.rate == pytest.approx(FPS)
