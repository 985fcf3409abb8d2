"""Landmarks of other programs: C3D files through ezc3d, and their names."""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from kfmocap.core.body import human
from kfmocap.core.errors import LandmarkError
from kfmocap.core.formats.c3d import read_c3d
from kfmocap.core.formats.file_kind import file_kind
from kfmocap.core.formats.landmark_files import landmarks_of, read_landmarks
from kfmocap.core.formats.trc import Landmarks, write_trc

POINTS = np.random.default_rng(0).normal(0, 1, (4, 3, 3))
POINTS[2, 1] = np.nan
NAMES = ["LHip", "RHip", "Neck"]


def document(points: np.ndarray, **head: list) -> dict:
    """What ezc3d gives of a file in millimetres."""
    values = {"LABELS": NAMES, "UNITS": ["mm"], "RATE": [100.0], **head}
    placed = 1000 * np.moveaxis(points, -1, 0).swapaxes(1, 2)
    return {
        "parameters": {"POINT": {name: {"value": value} for name, value in values.items()}},
        "data": {"points": np.concatenate([placed, np.ones((1, *placed.shape[1:]))])},
    }


@pytest.fixture
def ezc3d(monkeypatch):
    """Stands in for the package."""
    stand_in = SimpleNamespace(found=document(POINTS), c3d=lambda path: stand_in.found)
    monkeypatch.setitem(sys.modules, "ezc3d", stand_in)
    return stand_in


def test_a_c3d_file_gives_metres_names_and_rate(ezc3d):
    found = read_landmarks("walk.c3d")
    np.testing.assert_allclose(found.points_world, POINTS)
    assert found.names == tuple(NAMES) and found.fps == 100


@pytest.mark.parametrize("told", [{}, {"up": "y"}])
def test_a_c3d_file_may_have_its_y_axis_up(ezc3d, told: dict):
    ezc3d.found = document(POINTS[..., [1, 2, 0]], **({} if told else {"Y_SCREEN": ["+Y"]}))
    np.testing.assert_allclose(read_c3d("walk.c3d", **told).points_world, POINTS)


def test_a_broken_c3d_file_is_named(ezc3d):
    ezc3d.found = {"parameters": {"POINT": {}}, "data": {"points": np.zeros((4, 3, 4))}}
    with pytest.raises(LandmarkError, match=r"walk\.c3d: the file is not whole"):
        read_c3d("walk.c3d")
    ezc3d.found = document(POINTS, UNITS=["furlong"])
    with pytest.raises(LandmarkError, match="unknown unit 'furlong'"):
        read_c3d("walk.c3d")


def test_without_ezc3d_the_error_says_what_to_do(monkeypatch):
    monkeypatch.setitem(sys.modules, "ezc3d", None)
    with pytest.raises(LandmarkError, match=r"walk\.c3d: .* ezc3d, which is missing \(install ezc3d"):
        read_landmarks("walk.c3d")


def test_a_file_that_ezc3d_wrote_is_read(tmp_path: Path):
    package = pytest.importorskip("ezc3d")
    file = package.c3d()
    file["parameters"]["POINT"]["RATE"]["value"] = [100]
    file["parameters"]["POINT"]["LABELS"]["value"] = NAMES
    file["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    file["data"]["points"] = document(POINTS)["data"]["points"]
    file.write(str(tmp_path / "walk.c3d"))
    np.testing.assert_allclose(read_c3d(tmp_path / "walk.c3d").points_world, POINTS, atol=1e-6)
    (tmp_path / "walk.c3d").write_text("no such thing")
    with pytest.raises(LandmarkError, match="is not a C3D file"):
        read_c3d(tmp_path / "walk.c3d")


def test_a_trc_file_is_read_by_its_ending(tmp_path: Path):
    write_trc(tmp_path / "walk.TRC", NAMES, POINTS, 30.0)
    np.testing.assert_allclose(read_landmarks(tmp_path / "walk.TRC").points_world, POINTS, atol=1e-6)
    with pytest.raises(LandmarkError, match="unknown ending"):
        read_landmarks(tmp_path / "walk.csv")


def test_landmarks_are_matched_however_they_are_written():
    found = Landmarks(("Anna:LHIP", "right_hip", "C7", "neck"), np.arange(12.0).reshape(1, 4, 3), 30.0)
    own = landmarks_of(human(), found, "walk.trc")
    assert own.names == ("LHip", "RHip", "Neck")
    np.testing.assert_array_equal(own.points_world[0, :, 0], [0, 3, 9])


def test_landmarks_of_something_else_are_refused():
    with pytest.raises(LandmarkError, match=r"walk\.c3d: only 0 of its landmarks are the body's; it has RFHD"):
        landmarks_of(human(), Landmarks(("RFHD", "LFHD"), np.zeros((1, 2, 3)), 30.0), "walk.c3d")


@pytest.mark.parametrize(
    ("name", "text", "kind"),
    [
        ("walk.TRC", "", "landmarks"),
        ("walk.c3d", "", "landmarks"),
        ("pose.json", '{"people": []}', "keypoints"),
        ("cameras.json", '{"camera_matrix": {"rows": 3, "cols": 3, "data": [1]}}', "calibration"),
        ("broken.json", "{", "calibration"),
        ("cameras.yml", "", "calibration"),
        ("shot.toml", "[shot]", "shot"),
    ],
)
def test_files_are_told_by_what_they_hold(tmp_path: Path, name: str, text: str, kind: str):
    (tmp_path / name).write_text(text)
    assert file_kind(tmp_path / name) == kind
