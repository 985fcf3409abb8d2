"""Without an L-frame, a wand that lies on the floor in two places gives floor, origin and axes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from kfmocap.benchmarks.studies.wand_captures import WAND_LENGTH, Faults, capture, ends, ring, scattered
from kfmocap.core.calibration.floor import with_wand_on_floor
from kfmocap.core.calibration.solving.camera_rig import rig_of
from kfmocap.core.calibration.wand_calibration import solve_capture
from kfmocap.core.capture.capture import Capture
from kfmocap.core.errors import CalibrationError, CaptureError
from kfmocap.core.formats.wand_toml import load_wand

HEIGHT = 0.04
FLOOR = ((0, 19), (20, 39))
CAMERAS = ring(3, 1)


def place(x: float, y: float, degrees: float) -> np.ndarray:
    """The wand at rest for 20 frames, its first ball at x, y."""
    along = np.array([np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees)), 0])
    return np.repeat(ends(np.array([[x, y, HEIGHT]]) + WAND_LENGTH / 2 * along, -along[None], WAND_LENGTH), 20, axis=0)


def taken(second: np.ndarray) -> Capture:
    positions = np.concatenate([place(0, 0, 0), second, scattered(120, 1)])
    given = capture(CAMERAS, [positions] * 3, Faults(0.3), 1)
    return replace(given, lframe_points=np.full((4, 3), np.nan), floor=FLOOR, floor_height=HEIGHT)


def test_cameras_stand_in_the_world_of_the_wand_on_the_floor():
    solution = solve_capture(taken(place(0.2, 0.7, 70)))
    for camera in CAMERAS:
        solved = solution.cameras[camera.name]
        assert np.linalg.norm(solved.centre_world() - camera.centre_world()) < 0.025
        turn = solved.R_cam_world[0] @ camera.R_cam_world[0].T
        assert np.arccos(min(1.0, (np.trace(turn) - 1) / 2)) < np.deg2rad(0.4)
    said = [finding for finding in solution.findings if finding.name == "floor-by-wand"]
    assert len(said) == 1 and "mm of one plane" in said[0].what
    assert np.isnan(solution.lframe_scale)


@pytest.mark.parametrize(
    ("second", "floor", "name"),
    [(place(0.8, 0.0, 0), FLOOR, "floor-in-a-line"), (place(0.2, 0.7, 70), ((0, 19), (500, 520)), "floor-not-seen")],
)
def test_places_that_give_no_floor_are_refused_by_name(second, floor, name):
    with pytest.raises(CaptureError) as raised:
        with_wand_on_floor(replace(taken(second), floor=floor), rig_of(CAMERAS))
    assert raised.value.name == name


VIDEOS = """
[wand]
colours = ["green", "blue"]
length = 0.5
diameter = 0.07
{floor}
[[view]]
camera = "cam01"
wand = "one.avi"
"""


def test_the_file_names_the_frames_on_which_the_wand_lies(tmp_path):
    path = tmp_path / "wand.toml"
    path.write_text(VIDEOS.format(floor="[floor]\nwand = [[10, 40], [80, 110]]"))
    videos = load_wand(path)
    assert videos.floor == ((10, 40), (80, 110)) and videos.views[0].lframe is None
    for wrong in ("[floor]\nwand = [[10, 40], [30, 50]]", "[floor]\nwand = [10, 40]", ""):
        path.write_text(VIDEOS.format(floor=wrong))
        with pytest.raises(CalibrationError, match=r"floor|lframe"):
            load_wand(path)
