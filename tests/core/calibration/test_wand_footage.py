"""From rendered videos of an L-frame and a wand to cameras: a smaller version of what tools/render_wand.py renders."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from kfmocap.core.calibration import video_markers
from kfmocap.core.calibration.lframe_detection import LFrameUnseenError
from kfmocap.core.calibration.quality import quality_numbers
from kfmocap.core.calibration.video_markers import VideoMarkers, find_all, find_lframe
from kfmocap.core.calibration.wand_calibration import solve_capture
from kfmocap.core.errors import CalibrationError, CancelledError
from kfmocap.core.formats.wand_toml import load_wand
from render.waving import CAMERAS, OFFSETS, WandTake
from render_wand import write_take

SMALL = tuple(camera.reduced(1.5) for camera in CAMERAS[:3])
TAKE = WandTake(SMALL, OFFSETS[:3], frames=130, fps=15.0, lframe_frames=3)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_take(TAKE, tmp_path_factory.mktemp("wand")).parent


@pytest.fixture(scope="module")
def sightings(folder: Path) -> VideoMarkers:
    return find_all(load_wand(folder / "wand.toml"))


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


def test_looking_for_balls_can_be_cancelled(folder):
    told = []

    def progress(what: str, fraction: float) -> bool:
        told.append((what, fraction))
        return len(told) < 6

    with pytest.raises(CancelledError):
        find_all(load_wand(folder / "wand.toml"), progress)
    assert told[0] == ("cam01: L-frame", 0.0) and told[-1][0] == "cam01: wand"


def test_a_colour_that_is_not_there_is_told_with_its_video(folder):
    film = load_wand(folder / "wand.toml")
    with pytest.raises(CalibrationError, match=r"cam01_lframe.*of the L-frame's 4 balls"):
        find_lframe(film.views[0], replace(film, lframe_colour=film.wand_colours[0]), SMALL[0].size)


def test_one_view_may_miss_the_lframe_but_not_all_but_one(folder, sightings, monkeypatch):
    film = load_wand(folder / "wand.toml")
    missing = {film.views[1].camera}

    def found(view, *_):
        if view.camera in missing:
            raise LFrameUnseenError("3 of the L-frame's 4 balls were found", where=view.camera)
        return next(seen.lframe for seen in sightings.views if seen.videos.camera == view.camera)

    monkeypatch.setattr(video_markers, "find_lframe", found)
    monkeypatch.setattr(video_markers, "find_wand", lambda view, *_: next(iter(sightings.views)).wand)
    seen = find_all(film)
    assert [len(view.lframe.markers) for view in seen.views] == [1, 0, 1]
    assert seen.without_lframe() == ("cam02",)
    missing.add(film.views[2].camera)
    with pytest.raises(CalibrationError, match=r"cam02.*3 of the L-frame's 4 balls"):
        find_all(film)
