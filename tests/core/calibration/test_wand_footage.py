"""From rendered videos of an L-frame and a wand to cameras: a smaller version of what tools/render_wand.py renders."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from kfmocap.core.calibration import api, video_markers
from kfmocap.core.calibration.lframe.lframe_detection import LFrameUnseenError
from kfmocap.core.calibration.lframe.lframe_markers import SeenBalls, SeenLFrame, find_lframe
from kfmocap.core.calibration.quality import quality_numbers
from kfmocap.core.calibration.video_markers import VideoMarkers, find_all
from kfmocap.core.calibration.wand_calibration import solve_capture
from kfmocap.core.capture.capture import Markers
from kfmocap.core.errors import CalibrationError, CancelledError, CaptureError
from kfmocap.core.formats.wand_toml import load_wand
from kfmocap.core.runtime.processes.worker_pool import WorkerPool
from kfmocap.core.shot.footage_faults.footage_times import FootageRate
from render.waving import CAMERAS, OFFSETS, WandTake
from render_wand import write_take

pytestmark = pytest.mark.long
SMALL = tuple(camera.reduced(1.5) for camera in CAMERAS[:3])
NOTHING = SeenBalls(Markers(np.zeros(0, int), np.zeros((0, 4, 2)), np.zeros((0, 4))), np.zeros((0, 4)))
TAKE = WandTake(SMALL, OFFSETS[:3], frames=75, fps=15.0, lframe_frames=3)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_take(TAKE, tmp_path_factory.mktemp("wand")).parent


@pytest.fixture(scope="module")
def sightings(folder: Path) -> VideoMarkers:
    with WorkerPool(2) as pool:
        return find_all(load_wand(folder / "wand.toml"), None, pool)


def test_balls_are_found_in_compressed_blurred_pictures_among_others(sightings):
    capture = sightings.capture({camera.name: camera for camera in SMALL})
    for k, view in enumerate(capture.views):
        off = np.linalg.norm(view.wand.points - TAKE.truth(k)[view.wand.frames], axis=-1)
        assert len(view.wand) > 0.4 * TAKE.frames
        assert np.median(off) < 0.3 and np.mean(off > 3) < 0.05
        still = np.linalg.norm(view.lframe.points[0] - SMALL[k].project(TAKE.lframe_points), axis=-1)
        assert still.max() < 0.7


def test_cameras_come_out_where_they_stood(sightings):
    solution = solve_capture(sightings.capture())
    numbers = quality_numbers(solution)
    assert max(camera["reprojection"]["median"] for camera in numbers["cameras"]) < 0.4
    assert numbers["wand"]["measured"]["spread"] < 0.006 * TAKE.length
    np.testing.assert_allclose(solution.rig.offset, TAKE.offsets, atol=0.1)
    for camera in SMALL:
        solved = solution.cameras[camera.name]
        assert np.linalg.norm(solved.centre_world() - camera.centre_world()) < 0.04
        assert solved.matrix[0, 0] == pytest.approx(camera.matrix[0, 0], rel=0.01)


def test_the_balls_are_the_same_in_another_process(folder, sightings):
    film = load_wand(folder / "wand.toml")
    seen = sightings.views[-1]
    alone = find_lframe(film.views[-1], film, seen.footage.size).balls
    np.testing.assert_array_equal(alone.markers.points, seen.lframe.markers.points)
    np.testing.assert_array_equal(alone.radii, seen.lframe.radii)


def test_looking_for_balls_can_be_cancelled(folder):
    told = []

    def progress(what: str, fraction: float) -> bool:
        told.append((what, fraction))
        return what != "wand in cam01"

    film = load_wand(folder / "wand.toml")
    with pytest.raises(CancelledError):
        find_all(replace(film, views=film.views[:2]), progress)
    assert told[0] == ("L-frame in cam01", 0.0) and told[-1][0] == "wand in cam01"


def test_a_colour_that_is_not_found_is_reported_with_its_video(folder):
    film = load_wand(folder / "wand.toml")
    seen = find_lframe(film.views[0], replace(film, lframe_colour=film.wand_colours[0]), SMALL[0].size)
    assert not len(seen.balls.markers)
    assert re.search(r"cam01_lframe.*of the L-frame's 4 balls", str(seen.unidentified))


def test_one_view_may_miss_the_lframe_but_not_all_but_one(folder, sightings, monkeypatch):
    film = load_wand(folder / "wand.toml")
    missing = {film.views[1].camera}

    def found(view, *_):
        seen = next(seen for seen in sightings.views if seen.videos.camera == view.camera)
        if view.camera in missing:
            error = LFrameUnseenError("3 of the L-frame's 4 balls were found", where=view.camera)
            return SeenLFrame(NOTHING, seen.candidates[:0], error)
        return SeenLFrame(seen.lframe, seen.candidates)

    monkeypatch.setattr(video_markers, "find_lframe", found)
    monkeypatch.setattr(video_markers, "find_wand", lambda view, *_: next(iter(sightings.views)).wand)
    seen = find_all(film)
    assert [len(view.lframe.markers) for view in seen.views] == [1, 0, 1]
    assert seen.without_lframe() == ("cam02",)
    missing.add(film.views[2].camera)
    with pytest.raises(CalibrationError, match=r"cam02.*3 of the L-frame's 4 balls"):
        find_all(film)


def test_views_that_do_not_tell_the_lframe_alone_tell_it_together(sightings):
    """All of its balls are seen, but not which they are, in two of three views; in one it was told wrongly."""
    truth = [camera.project(TAKE.lframe_points) for camera in SMALL]
    nothing, wrong = [replace(view, lframe=NOTHING) for view in sightings.views], sightings.views[1]
    turned = replace(wrong.lframe, markers=replace(wrong.lframe.markers, points=wrong.lframe.markers.points[:, ::-1]))
    found = replace(sightings, views=(nothing[0], replace(wrong, lframe=turned), nothing[2]))
    solution = solve_capture(found.capture())
    for camera in SMALL:
        assert np.linalg.norm(solution.cameras[camera.name].centre_world() - camera.centre_world()) < 0.05
    again = found.with_lframes_identified(solution)
    assert again.without_lframe() == ()
    for view, true in zip(again.views, truth, strict=True):
        np.testing.assert_allclose(view.lframe.markers.points[0], true, atol=0.7)


def test_where_the_lframe_is_not_seen_the_error_names_a_video(sightings, monkeypatch):
    """Things of its colour are there, but no L-frame."""
    few = [view.candidates[:3] for view in sightings.views]
    views = (replace(view, lframe=NOTHING, candidates=balls) for view, balls in zip(sightings.views, few, strict=True))
    error = LFrameUnseenError("3 of the L-frame's 4 balls were found", where="cam01_lframe.avi")
    found = replace(sightings, views=tuple(views), unidentified=error)
    monkeypatch.setattr(api, "find_all", lambda *_: found)
    with pytest.raises(CalibrationError, match="cam01_lframe"):
        api.calibrate(found.videos)


def test_where_nothing_fits_a_frame_rate_that_varies_is_named(sightings, monkeypatch):
    def refuse(*_, **__):
        raise CaptureError("no set of cameras was found", name="no-solution")

    monkeypatch.setattr(api, "find_all", lambda *_: sightings)
    monkeypatch.setattr(api, "solve_capture", refuse)
    with pytest.raises(CaptureError, match="no set of cameras"):
        api.calibrate(sightings.videos)
    monkeypatch.setattr(api, "video_rate", lambda path, _: FootageRate(29.2, 3.1 if "cam02" in path.name else 0.2, 41))
    with pytest.raises(CaptureError, match=r"cam02.*frame-rate-varies: .*frame 41 .*3\.1 frames.*ffmpeg.*fps=29\.2"):
        api.calibrate(sightings.videos)


def test_where_nothing_fits_interlaced_video_is_named(sightings, monkeypatch):
    def refuse(*_, **__):
        raise CaptureError("no set of cameras was found", name="no-solution")

    first, *others = sightings.views
    interlaced = replace(sightings, views=(replace(first, wand=replace(first.wand, interlaced=True)), *others))
    monkeypatch.setattr(api, "find_all", lambda *_: interlaced)
    monkeypatch.setattr(api, "solve_capture", refuse)
    with pytest.raises(CaptureError, match=r"cam01: interlaced: .*two places.*ffmpeg.*send_field"):
        api.calibrate(sightings.videos)
