"""The report of a calibration says in pictures and on a page what its numbers say."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from kfmocap.core.calibration import calibration_report
from kfmocap.core.calibration.calibration_result import CalibrationResult
from kfmocap.core.calibration.charts import Chart, heat_colour, ticks
from kfmocap.core.calibration.findings import Finding
from kfmocap.core.calibration.quality import quality_numbers
from kfmocap.core.calibration.wand_calibration import solve_capture
from kfmocap.core.capture.capture import Capture, CaptureView, Markers
from kfmocap.core.errors import OutputError
from render.waving import WandTake


@pytest.fixture(scope="module")
def solution() -> CalibrationResult:
    take, rng = WandTake(frames=150, offsets=(0, 0, 0, 0)), np.random.default_rng(0)
    views = []
    for k, camera in enumerate(take.cameras):
        wand = take.truth(k) + rng.normal(0, 0.2, (150, 2, 2))
        lframe = camera.project(take.lframe_points)[None] + rng.normal(0, 0.1, (1, 4, 2))
        seen = Markers(np.arange(150), wand, np.full((150, 2), 0.2))
        still = Markers(np.zeros(1, int), lframe, np.full((1, 4), 0.1))
        views.append(CaptureView(camera.name, camera.size, 30.0, still, seen, offset=0.0))
    solved = solve_capture(Capture(take.lframe_points, take.length, tuple(views)))
    return replace(solved, findings=(Finding("flat", "the wand <moved> in a plane", "tilt it", "cam02"),))


def test_the_report_has_numbers_pictures_and_a_page_of_both(solution, tmp_path: Path):
    paths = calibration_report.write_report(tmp_path / "new" / "report", solution)
    assert [path.name for path in paths] == ["report.json", "report.png", "report.html"]
    numbers = json.loads(paths[0].read_text())
    assert cv2.imread(str(paths[1])).shape[1] == calibration_report._WIDTH
    page = paths[2].read_text()
    assert page.count("<img") == 1 and "http" not in page
    for camera in numbers["cameras"]:
        assert f"<th>{camera['camera']}</th>" in page and f"<td>{camera['focal']:.4g}</td>" in page
    assert "cam02: the wand &lt;moved&gt; in a plane (tilt it)." in page


def test_upright_and_level_pictures_stand_in_one_report(solution):
    """A phone on its end beside other cameras."""
    low = calibration_report.sheet(solution)
    rig = replace(solution.rig, sizes=np.array([(540, 960), *solution.rig.sizes[1:]]))
    high = calibration_report.sheet(replace(solution, rig=rig))
    assert high.shape[1] == low.shape[1] == calibration_report._WIDTH
    assert high.shape[0] > low.shape[0] + 100


def test_a_twentieth_of_the_wands_places_is_nearer_than_near_and_one_farther_than_far(solution):
    for numbers in quality_numbers(solution)["cameras"]:
        camera = solution.cameras[numbers["camera"]]
        depth = (solution.wand.ends_world @ camera.R_cam_world[0].T + camera.t_cam_world[0])[..., 2]
        for name, share in (("near", 0.05), ("middle", 0.5), ("far", 0.95)):
            assert np.mean(depth < numbers["depth"][name]) == pytest.approx(share, abs=0.02)


def test_worse_residuals_are_redder(solution):
    good = calibration_report.sheet(solution)
    bad = calibration_report.sheet(replace(solution, residual=10 * solution.residual))
    red = [np.mean((p[..., 2] > 120) & (p[..., 0] < 60) & (p[..., 1] < 60)) for p in (good, bad)]
    assert red[1] > 2 * red[0]


def test_a_camera_that_sees_nothing_does_not_break_the_report(solution):
    seen = solution.seen.camera != 2
    rest = replace(solution, seen=solution.seen.take(seen), residual=solution.residual[np.append(seen, [True] * 16)])
    assert calibration_report.sheet(rest).shape == calibration_report.sheet(solution).shape


def test_a_folder_that_cannot_be_made_is_said(solution, tmp_path: Path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="file"):
        calibration_report.write_report(tmp_path / "file" / "report", solution)


@pytest.mark.parametrize(("low", "high"), [(0, 2), (-3.7, 3.7), (0, 0.013), (120, 880)])
def test_ticks_are_few_round_and_within(low, high):
    found = ticks(low, high)
    assert 2 <= len(found) <= 8 and found[0] >= low - 1e-9 and found[-1] <= high + 1e-9
    assert "-0" not in [f"{value:g}" for value in found]


def test_a_chart_puts_values_where_its_axes_say():
    chart = Chart(300, 200, (0, 10), (0, 1), "")
    chart.bars([4, 5], [0.5], (0, 0, 255))
    rows, columns = np.nonzero((chart.picture == (0, 0, 255)).all(axis=-1))
    left, right = chart.place([4, 0])[0], chart.place([5, 0])[0]
    assert (columns.min(), columns.max()) == (left, right)
    assert rows.min() == chart.place([0, 0.5])[1]


def test_colours_go_from_blue_to_red():
    blue, red = heat_colour(0.1), heat_colour(0.95)
    assert blue[0] > blue[2] and red[2] > red[0]
