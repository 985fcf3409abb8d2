"""Where one view lacks a frame, or has it twice, its frames are counted right after it, and nothing else changes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from kfmocap.core.body.kinematics import part_poses, tip_positions
from kfmocap.core.shot.footage_faults.footage_times import FootageRate
from kfmocap.core.shot.footage_faults.frame_pattern import FramePattern
from kfmocap.core.shot.segments import segments
from kfmocap.core.shot.settings import Settings
from kfmocap.core.shot.shot import Gap, Shot, View
from kfmocap.core.tracking import tracker
from kfmocap.core.tracking.footage_corrections.footage_gaps import (
    FoundGap,
    found_gaps,
    with_found_gaps,
    with_timed_gaps,
    without_false_delays,
)
from kfmocap.core.tracking.results.journal import Journal
from kfmocap.core.tracking.results.late_views import LateView
from kfmocap.core.tracking.results.track_result import TrackResult
from kfmocap.core.tracking.retracking import Excerpt, digests, track_excerpts
from kfmocap.core.tracking.scheduling.run_context import RunContext
from kfmocap.core.tracking.tracker import track
from late_footage import BODY, CAMERAS, FRAMES, LENGTH, PLACE, SHIFTS, TRUTH, late_film, pictures
from retimed_videos import retimed
from synthetic import shot_of

SIDE = 1
SETTINGS = Settings(limb_search=False)


@pytest.fixture(scope="module")
def films(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Shot]:
    home = tmp_path_factory.mktemp("film")
    return {name: late_film(home / name, shift, SETTINGS) for name, shift in SHIFTS.items()}


@pytest.fixture(scope="module")
def tracked(films: dict[str, Shot]) -> dict[str, TrackResult]:
    return {name: track(shot) for name, shot in films.items()}


def error(result: TrackResult) -> float:
    """Mean distance of the tips of all parts from their true places behind the gap, mm."""
    found, true = (tip_positions(BODY, part_poses(BODY, motion)) for motion in (result.motions[0], TRUTH[FRAMES]))
    return 1000 * float(np.linalg.norm(found - true, axis=-1)[PLACE:].mean())


def two_views(shot: Shot, *, correct: bool) -> TrackResult:
    return track(replace(shot, views=shot.views[: SIDE + 1], settings=replace(SETTINGS, correct_gaps=correct)))


@pytest.fixture(scope="module")
def whole_error(films: dict[str, Shot]) -> float:
    return error(two_views(films["whole"], correct=True))


@pytest.mark.parametrize("fault", ["missing", "twice"])
def test_what_is_tracked_is_as_good_as_of_whole_footage(films: dict[str, Shot], whole_error: float, fault: str) -> None:
    result = two_views(films[fault], correct=True)
    assert error(two_views(films[fault], correct=False)) > 1.5 * whole_error
    assert error(result) < 1.2 * whole_error
    assert not any(result.late)


@pytest.mark.parametrize("fault", ["missing", "twice"])
def test_the_gap_is_told_and_pairs_across_it_have_no_weight(
    films: dict[str, Shot], tracked: dict[str, TrackResult], fault: str
) -> None:
    gaps, result = found_gaps(films[fault], tracked[fault]), tracked[fault]
    assert not gaps[0] and not gaps[2]
    gap = gaps[SIDE][0]
    assert np.sign(gap.missing) == SHIFTS[fault]
    assert abs(gap.frame - PLACE) <= 1
    assert gap.frame in result.torn[SIDE]


def test_whole_footage_is_tracked_once(films: dict[str, Shot], tracked: dict[str, TrackResult]) -> None:
    without = track(replace(films["whole"], settings=replace(SETTINGS, correct_gaps=False)))
    assert tracked["whole"].motions[0].rotations.tobytes() == without.motions[0].rotations.tobytes()
    assert tracked["whole"].gaps == ((), (), ())
    assert tracked["whole"].camera_frames == without.camera_frames


def test_delays_in_footage_of_another_camera_are_not_believed(
    films: dict[str, Shot], tracked: dict[str, TrackResult]
) -> None:
    shot, late = films["whole"], (LateView(PLACE, 0.5, 12.0), None, None)
    found = replace(tracked["whole"], late=late)
    assert without_false_delays(shot, found) is found
    a, b, c = shot.views
    exchanged = replace(shot, views=(replace(a, footage=b.footage), replace(b, footage=a.footage), c))
    assert not any(without_false_delays(exchanged, found).late)


def test_delays_in_footage_whose_frames_are_repeated_at_regular_intervals_are_not_believed(
    films: dict[str, Shot], tracked: dict[str, TrackResult]
) -> None:
    patterns = (FramePattern(), FramePattern(every=5), FramePattern())
    found = replace(tracked["whole"], late=(LateView(PLACE, 0.5, 12.0), None, None), patterns=patterns)
    assert not any(without_false_delays(films["whole"], found).late)


def test_delays_in_footage_that_shakes_are_not_believed(
    films: dict[str, Shot], tracked: dict[str, TrackResult], tmp_path: Path
) -> None:
    shot, late = films["whole"], (None, LateView(PLACE, 0.5, 12.0), None)
    plaster = cv2.GaussianBlur(np.random.default_rng(3).normal(0, 200, pictures("front")[0].shape), (0, 0), 2.0)
    for frame in range(LENGTH):
        steady = np.clip(pictures("front")[frame] + plaster, 0, 255)
        moved = np.array([[1.0, 0.0, 4 * np.sin(np.pi * frame / 6)], [0.0, 1.0, 0.0]])  # not on key frames
        shaken = cv2.warpAffine(steady, moved, steady.shape[::-1], borderMode=cv2.BORDER_REPLICATE)
        cv2.imwrite(str(tmp_path / f"{frame:03d}.png"), shaken.astype(np.uint8))
    front = replace(shot.views[0], footage=tmp_path / "%03d.png")
    shaking = replace(shot, views=(front, *shot.views[1:]))
    assert not any(without_false_delays(shaking, replace(tracked["whole"], late=late)).late)


@pytest.mark.parametrize("fault", ["missing", "twice"])
def test_the_result_is_that_of_a_shot_whose_gaps_are_known(
    films: dict[str, Shot], tracked: dict[str, TrackResult], fault: str
) -> None:
    known = with_found_gaps(films[fault], tracked[fault].gaps)
    again = track(known)
    assert again.motions[0].rotations.tobytes() == tracked[fault].motions[0].rotations.tobytes()
    assert again.gaps == tracked[fault].gaps


def test_missing_frames_that_the_times_of_a_file_tell_are_counted_from_the_start(films: dict[str, Shot]) -> None:
    shot = films["whole"]
    rates = (FootageRate(30.0, 1.4, 5, ((5, 2), (9, 1))), None, FootageRate(30.0, 0.1, 3))
    found = with_timed_gaps(shot, rates)
    assert [view.gaps for view in found.views] == [(Gap(5, 2, timed=True), Gap(9, 1, timed=True)), (), ()]
    fields = replace(shot, views=tuple(replace(view, fields="top-first") for view in shot.views))
    assert with_timed_gaps(fields, rates).views[0].gaps == (Gap(10, 4, timed=True), Gap(18, 2, timed=True))
    known = replace(shot, views=tuple(replace(view, gaps=(Gap(7, -1),)) for view in shot.views))
    assert with_timed_gaps(known, rates).views[0].gaps == (Gap(7, -1),)
    assert not with_timed_gaps(replace(shot, settings=replace(SETTINGS, correct_gaps=False)), rates).views[0].gaps
    varies = replace(rates[0], missing=(), counted=((5, 2), (9, -1)))
    assert with_timed_gaps(shot, (varies, *rates[1:])).views[0].gaps == (Gap(5, 2, timed=True), Gap(9, -1, timed=True))


def test_one_view_alone_is_counted_by_the_times_of_its_file(tmp_path: Path) -> None:
    path, camera = tmp_path / "side.mp4", CAMERAS["side"]
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"mp4v"), 30.0, camera.size)
    for frame in np.delete(np.arange(LENGTH + 1), PLACE).tolist():
        writer.write(cv2.cvtColor(pictures("side")[frame], cv2.COLOR_GRAY2BGR))
    writer.release()
    path.write_bytes(retimed(path.read_bytes(), [1.0 + (k == PLACE - 1) for k in range(LENGTH)]))
    shot = shot_of([View(camera, path)], [BODY], [TRUTH[FRAMES]], (0, 6, LENGTH - 1), SETTINGS)
    result = track(shot)
    assert result.gaps == ((Gap(PLACE, 1, timed=True),),)
    assert {PLACE, PLACE + 1} <= set(result.torn[0])
    assert error(result) < 0.8 * error(track(replace(shot, settings=replace(SETTINGS, correct_gaps=False))))


def test_gaps_follow_the_views_whatever_their_order(films: dict[str, Shot], tracked: dict[str, TrackResult]) -> None:
    shot = films["missing"]
    turned = track(replace(shot, views=shot.views[::-1]))
    assert turned.gaps == tracked["missing"].gaps[::-1]
    assert turned.motions[0].rotations.tobytes() == tracked["missing"].motions[0].rotations.tobytes()


def test_a_gap_that_one_excerpt_shows_counts_for_those_after_it(films: dict[str, Shot]) -> None:
    shot = films["missing"]
    [result] = track_excerpts(shot, [Excerpt(6, LENGTH - 1, footage_offset=0.0)])
    [gap] = found_gaps(shot, result)[SIDE]
    assert abs(gap.frame - PLACE) <= 1
    known = with_found_gaps(shot, result.gaps)
    before, after = segments(shot)
    now, then = digests(known, segments(shot)), digests(shot, segments(shot))
    assert now[before] == then[before]
    assert now[after] != then[after]


def test_a_run_that_was_ended_goes_on_to_the_same_result(
    films: dict[str, Shot], tracked: dict[str, TrackResult], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shot, true = films["missing"], tracked["missing"]
    with monkeypatch.context() as patched, pytest.raises(InterruptedError):
        patched.setattr(tracker, "with_gaps", _interrupted)
        track(shot, run=RunContext(Journal(tmp_path / "run")))
    journal = Journal(tmp_path / "run", resume=True)
    again = track(shot, run=RunContext(journal))
    assert set(segments(shot)) <= set(journal.taken)
    assert again.motions[0].rotations.tobytes() == true.motions[0].rotations.tobytes()


def _interrupted(*_: object) -> None:
    raise InterruptedError


@pytest.mark.parametrize(
    ("gap", "brief"),
    [
        (FoundGap(57, 1), "frame 57 is missing"),
        (FoundGap(57, 3), "frames 57 to 59 are missing"),
        (FoundGap(57, -1), "frame 56 is there twice"),
        (FoundGap(57, -2), "frame 56 is there 3 times"),
    ],
)
def test_gaps_are_said_in_words(gap: FoundGap, brief: str) -> None:
    assert gap.brief == f"{brief} (corrected)"
    assert gap.text.startswith(brief)
    assert gap.counted_from(10).frame == 67
