"""Without an L-frame, a performer of known height who stands in some places gives floor, origin, axes and scale."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from kfmocap.benchmarks.studies.wand_captures import WAND_LENGTH, Faults, capture, ring, scattered, seen
from kfmocap.core.calibration.performer.performer_floor import on_performers_floor
from kfmocap.core.calibration.solving.camera_rig import rig_of
from kfmocap.core.calibration.wand_calibration import solve_capture
from kfmocap.core.capture.capture import Capture, StandingPerformer
from kfmocap.core.errors import CalibrationError, CaptureError
from kfmocap.core.formats.marker_points import write_marker_points
from kfmocap.core.formats.wand_toml import load_wand

HEIGHT = 1.78
CAMERAS = ring(3, 1)
PLACES = ((0, 9), (20, 29), (40, 49), (60, 69))
STANDS = np.array([[0, 0], [0.9, -0.4], [-0.5, 0.8], [0.3, 1.0]])


def standing(height: float = HEIGHT, sway: float = 0.03) -> dict[str, np.ndarray]:
    """Left foot, right foot and head in all places, seen on a few frames of each by every camera."""
    rng = np.random.default_rng(0)
    points = np.zeros((len(PLACES), 3, 3))
    points[:, :, :2] = STANDS[:, None]
    points[:, 0, 0] += 0.12
    points[:, 1, 0] -= 0.12
    points[:, 2] += [0, 0, height]
    points[1:, 2, :2] += rng.normal(0, sway, (len(PLACES) - 1, 2))
    frames = np.array([first + k for first, _ in PLACES for k in (1, 4, 7)])
    found = {}
    for camera in CAMERAS:
        markers = seen(camera, np.repeat(points, 3, axis=0), Faults(1.5), rng)
        found[camera.name] = replace(markers, frames=frames)
    return found


def taken(*, length: float = WAND_LENGTH, gives_scale: bool = False, height: float = HEIGHT) -> Capture:
    given = capture(CAMERAS, [scattered(120, 1)] * 3, Faults(0.3), 1, length=length)
    performer = StandingPerformer(HEIGHT, PLACES, standing(height), gives_scale)
    return replace(given, lframe_points=np.full((4, 3), np.nan), performer=performer)


@pytest.mark.parametrize("length", [None, WAND_LENGTH])
def test_cameras_stand_in_the_world_of_the_performer(length: float | None):
    given = taken(length=length or 1.3, gives_scale=length is None)  # taken for 1.3 m, which is wrong
    solution = solve_capture(given)
    solved = [solution.cameras[camera.name] for camera in CAMERAS]
    turn = solved[0].R_cam_world[0].T @ CAMERAS[0].R_cam_world[0]
    assert turn[2, 2] > np.cos(np.deg2rad(0.5))
    assert turn[0, 0] > np.cos(np.deg2rad(3.0))  # x is laid down by feet a quarter of a metre apart
    for one, other in zip(solved, CAMERAS, strict=True):
        assert one.centre_world()[2] == pytest.approx(other.centre_world()[2], abs=0.04)
        apart = [
            np.linalg.norm(c.centre_world() - first.centre_world())
            for c, first in ((one, solved[0]), (other, CAMERAS[0]))
        ]
        assert apart[0] == pytest.approx(apart[1], rel=0.01)
    assert solution.capture.wand_length == pytest.approx(WAND_LENGTH, rel=0.01)
    assert solution.wand.length == solution.capture.wand_length
    said = [finding for finding in solution.findings if finding.name == "floor-by-performer"]
    assert len(said) == 1 and ("scale" in said[0].what) == (length is None)
    assert np.isnan(solution.lframe_scale)


def test_the_floor_is_level_by_all_feet_together():
    found = on_performers_floor(taken(), rig_of(CAMERAS))
    measures = found.capture.lframe_points
    assert found.scale == 1
    assert np.abs(measures[[0, 1, 3], 2]).max() < 0.015
    assert measures[2] == pytest.approx([0, 0, HEIGHT], abs=0.02)
    assert measures[0, 0] == pytest.approx(0.12, abs=0.01) and abs(measures[0, 1]) < 0.01


def test_performers_that_give_no_floor_are_refused_by_name():
    wrong = taken()
    assert wrong.performer is not None
    lost = replace(wrong.performer, places=((0, 9), (500, 509)))
    points = dict(wrong.performer.points)
    for name, markers in points.items():
        low = markers.points.copy()
        low[-3:, 2] = markers.points[-3:, 0] + 0.4 * (markers.points[-3:, 2] - markers.points[-3:, 0])
        points[name] = replace(markers, points=low)
    for performer, error in (
        (lost, "performer-not-seen"),
        (replace(wrong.performer, points=points), "performer-not-upright"),
        (replace(wrong.performer, height=2.1), "performer-height-wrong"),
    ):
        with pytest.raises(CaptureError) as raised:
            on_performers_floor(replace(wrong, performer=performer), rig_of(CAMERAS))
        assert raised.value.name == error


def test_the_file_names_who_stands_where(tmp_path: Path):
    given = taken()
    write_marker_points(tmp_path / "points.csv", given)
    views = "".join(f'[[view]]\ncamera = "{view.camera}"\nsize = [1920, 1080]\n' for view in given.views)
    floor = 'height = 1.78\npoints = "points.csv"\nperformer = '
    text = "[points]\nfile = 'points.csv'\n" + views + "[floor]\n" + floor + "{places}\n[wand]\n{length}\n"
    path = tmp_path / "wand.toml"
    for length, scaled in (("length = 0.5", False), ("", True)):
        path.write_text(text.format(places="[[0, 9], [20, 29], [40, 49]]", length=length))
        read = load_wand(path)
        assert isinstance(read, Capture) and read.performer is not None and not read.has_lframe
        assert read.performer.gives_scale is scaled and read.performer.places == PLACES[:3]
        for name, markers in read.performer.points.items():
            assert given.performer is not None
            assert markers.points == pytest.approx(given.performer.points[name].points)
    for wrong in ("[[0, 9]]", "[[0, 9], [5, 29]]", "7"):
        path.write_text(text.format(places=wrong, length=""))
        with pytest.raises(CalibrationError, match="performer"):
            load_wand(path)
