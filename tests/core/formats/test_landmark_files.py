"""Landmarks of other programs: C3D files, and their names."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from kfmocap.core.body import human
from kfmocap.core.errors import LandmarkError
from kfmocap.core.formats import c3d
from kfmocap.core.formats.c3d import read_c3d
from kfmocap.core.formats.file_kind import file_kind
from kfmocap.core.formats.landmark_files import landmarks_of, read_landmarks
from kfmocap.core.formats.trc import Landmarks, write_trc

POINTS = np.random.default_rng(0).normal(0, 1, (4, 3, 3))
POINTS[2, 1] = np.nan
NAMES = ["LHip", "RHip", "Neck"]


def c3d_bytes(points: np.ndarray, order: str = "<", step: float = -1.0, **head: object) -> bytes:
    """A C3D file of points in millimetres, as floats or, with a step, as whole numbers of that many millimetres."""
    values = {"LABELS": NAMES, "UNITS": ["mm"], "RATE": 100.0, **head}
    processor = {"<": 84, ">": 86, "vax": 85}[order]
    end = "<" if order == "vax" else order

    def real(array) -> bytes:
        if order != "vax":
            return np.asarray(array, f"{order}f4").tobytes()
        halves = (np.asarray(array, "<f4") * np.float32(4)).view("<u2").reshape(-1, 2)
        return halves[:, ::-1].astype("<u2").tobytes()

    records = b"\x05\xffPOINT" + struct.pack(f"{end}hB", 3, 0)
    for name, value in values.items():
        if isinstance(value, float):
            body = struct.pack("bB", 4, 0) + real([value])
        else:
            body = struct.pack("bBBB", -1, 2, 8, len(value)) + "".join(text.ljust(8) for text in value).encode()
        records += (
            struct.pack("bb", len(name), 1) + name.encode() + struct.pack(f"{end}h", 3 + len(body)) + body + b"\0"
        )
    blocks = -(-(4 + len(records) + 2) // 512)
    parameters = (bytes([0, 0, blocks, processor]) + records).ljust(512 * blocks, b"\0")
    seen = np.isfinite(points).all(axis=-1)
    rows = np.concatenate([np.nan_to_num(1000 * points), np.where(seen, 0, -1)[..., None]], axis=-1)
    data = real(rows) if step < 0 else np.where([1, 1, 1, 0], rows / step, rows).round().astype(f"{end}i2").tobytes()
    header = bytes([2, 0x50]) + struct.pack(f"{end}5H", len(NAMES), 0, 1, len(points), 0) + real([step])
    header += struct.pack(f"{end}HH", 2 + blocks, 0) + real([0.0])
    return header.ljust(512, b"\0") + parameters + data


def written(folder: Path, *args, **head) -> Path:
    (folder / "walk.c3d").write_bytes(c3d_bytes(*args, **head))
    return folder / "walk.c3d"


@pytest.mark.parametrize("order", ["<", ">", "vax"])
@pytest.mark.parametrize("step", [-1.0, 0.5])
def test_a_c3d_file_of_any_processor_gives_metres_names_and_rate(tmp_path: Path, order: str, step: float):
    found = read_landmarks(written(tmp_path, POINTS, order, step))
    np.testing.assert_allclose(found.points_world, POINTS, atol=1e-6 if step < 0 else 1e-3 * step)
    assert found.names == tuple(NAMES) and found.fps == 100


@pytest.mark.parametrize("told", [{}, {"up": "y"}])
def test_a_c3d_file_may_have_its_y_axis_up(tmp_path: Path, told: dict):
    path = written(tmp_path, POINTS[..., [1, 2, 0]], **({} if told else {"Y_SCREEN": ["+Y"]}))
    np.testing.assert_allclose(read_c3d(path, **told).points_world, POINTS, atol=1e-6)


def test_labels_beyond_255_go_on_in_another_parameter() -> None:
    names = [f"M{i}" for i in range(300)]
    assert c3d._names({"LABELS": names[:255], "LABELS2": names[255:]}, 300) == tuple(names)


def test_counts_of_frames_beyond_the_headers_are_in_parameters() -> None:
    """Low and high halves of the numbers of the first and the last frame."""
    header = c3d._Numbers(bytes(6) + struct.pack("<HH", 1, 65535) + bytes(512), "<", vax=False)
    trial = {"ACTUAL_START_FIELD": [5, 0], "ACTUAL_END_FIELD": [10, 2]}
    assert c3d._frame_count(header, {"TRIAL": trial}) == 2 * 65536 + 10 - 5 + 1
    assert c3d._frame_count(header, {"POINT": {"FRAMES": [70000.0]}}) == 70000


def test_a_broken_c3d_file_is_named(tmp_path: Path):
    path = written(tmp_path, POINTS)
    path.write_bytes(path.read_bytes()[:-10])
    with pytest.raises(LandmarkError, match=r"walk\.c3d: is not a C3D file, or not whole: it is cut off"):
        read_c3d(path)
    path.write_text("no such thing")
    with pytest.raises(LandmarkError, match="is not a C3D file"):
        read_c3d(path)
    with pytest.raises(LandmarkError, match="unknown unit 'furlong'"):
        read_c3d(written(tmp_path, POINTS, UNITS=["furlong"]))


def test_a_c3d_file_of_another_program_is_read():
    """Written by ezc3d 1.7.2."""
    found = read_c3d(ROOT / "tests" / "data" / "landmarks" / "three_points.c3d")
    np.testing.assert_allclose(found.points_world, POINTS, atol=1e-6)
    assert found.names == tuple(NAMES) and found.fps == 100


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
        ("cameras.toml", "[cam01]", "calibration"),
        ("wand.toml", "[lframe]\n[wand]", "capture"),
        ("floor.toml", "[floor]\n[wand]\n[[view]]", "capture"),
    ],
)
def test_files_are_recognised_by_their_content(tmp_path: Path, name: str, text: str, kind: str):
    (tmp_path / name).write_text(text)
    assert file_kind(tmp_path / name) == kind
