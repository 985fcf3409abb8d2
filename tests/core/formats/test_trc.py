"""TRC files: nothing is lost on the way, and the axes are those of other programs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from kfmocap.core.errors import LandmarkError, OutputError
from kfmocap.core.formats.trc import read_trc, write_trc

coordinates = st.one_of(st.floats(-100, 100), st.just(np.nan))


@given(
    points=st.tuples(st.integers(1, 4), st.integers(1, 4)).flatmap(
        lambda shape: arrays(float, (*shape, 3), elements=coordinates)
    ),
    fps=st.sampled_from([24.0, 25.0, 29.97, 59.94, 60.0, 120.0]),
)
def test_what_is_written_is_read_back(tmp_path_factory: pytest.TempPathFactory, points, fps) -> None:
    path = tmp_path_factory.mktemp("trc") / "motion.trc"
    names = [f"M{i}" for i in range(points.shape[1])]
    write_trc(path, names, points, fps)
    back = read_trc(path)
    assert back.names == tuple(names)
    assert back.fps == fps
    np.testing.assert_allclose(back.points_world, points, rtol=0, atol=1e-6)


def test_frames_are_counted_from_1_and_times_from_0(tmp_path: Path) -> None:
    write_trc(tmp_path / "motion.trc", ["Hip"], np.zeros((3, 1, 3)), 25.0)
    rows = [line.split("\t")[:2] for line in (tmp_path / "motion.trc").read_text().splitlines()[5:]]
    assert rows == [["1", "0.000000"], ["2", "0.040000"], ["3", "0.080000"]]


def trc(tmp_path: Path, unit: str = "m", rows: str = "1\t0.0\t1\t2\t3\t4\t5\t6\n") -> Path:
    path = tmp_path / "landmarks.trc"
    path.write_text(
        "PathFileType\t4\t(X/Y/Z)\tlandmarks.trc\nDataRate\tNumFrames\tUnits\n"
        f"60\t1\t{unit}\nFrame#\tTime\tRHip\t\t\tLHip\t\t\n\t\tX1\tY1\tZ1\tX2\tY2\tZ2\n{rows}"
    )
    return path


@pytest.mark.parametrize(("unit", "metres"), [("m", 1.0), ("cm", 0.01), ("mm", 0.001)])
def test_the_axes_are_y_z_x_of_the_z_up_world(tmp_path: Path, unit: str, metres: float) -> None:
    points = read_trc(trc(tmp_path, unit)).points_world
    np.testing.assert_allclose(points[0], np.array([[3, 1, 2], [6, 4, 5]]) * metres)


@pytest.mark.parametrize("rate", ["", "0"])
def test_a_frame_rate_that_is_not_stated_is_0(tmp_path: Path, rate: str) -> None:
    path = trc(tmp_path)
    path.write_text(path.read_text().replace("60\t1\t", f"{rate}\t1\t"))
    assert read_trc(path).fps == 0


def test_blanks_nan_and_missing_ends_are_not_seen(tmp_path: Path) -> None:
    rows = "1\t0\t\t\t\t4\t5\t6\n\n2\t0\t1\t2\t3\tnan\tNaN\t6\n3\t0\t1\t2\t3\n"
    points = read_trc(trc(tmp_path, rows=rows)).points_world
    assert np.isnan(points).any(axis=2).tolist() == [[True, False], [False, True], [False, True]]


@pytest.mark.parametrize(
    ("unit", "rows", "message"),
    [("ft", "", "line 3.*unknown unit 'ft'"), ("m", "1\t0\t1\tx\t3\n", "line 6.*not a number.*'x'")],
)
def test_errors_name_file_and_line(tmp_path: Path, unit: str, rows: str, message: str) -> None:
    with pytest.raises(LandmarkError, match=rf"landmarks\.trc {message}"):
        read_trc(trc(tmp_path, unit, rows))


def test_a_file_that_is_not_a_trc_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.trc").write_bytes(b"\xff\xfe\x00binary")
    (tmp_path / "b.trc").write_text("frame,x,y,z\n")
    for name in ("a.trc", "b.trc", "missing.trc"):
        with pytest.raises(LandmarkError, match=name):
            read_trc(tmp_path / name)


@pytest.mark.parametrize("name", ["LHip\tRHip", "Neck\n", "", " "])
def test_a_name_that_would_break_the_file_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(LandmarkError, match=r"a\.trc: .* cannot be a landmark's name"):
        write_trc(tmp_path / "a.trc", ["Hip", name], np.zeros((5, 2, 3)), 30.0)
    assert not list(tmp_path.iterdir())


def test_an_infinite_position_is_refused_with_its_name_and_row(tmp_path: Path) -> None:
    points = np.zeros((5, 2, 3))
    points[3, 1, 0] = np.inf
    with pytest.raises(LandmarkError, match=r"a\.trc: Neck is infinitely far away in row 3"):
        write_trc(tmp_path / "a.trc", ["Hip", "Neck"], points, 30.0)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("shape", "fps"), [((5, 2), 30), ((5, 3, 3), 30), ((5, 2, 2), 30), ((5, 2, 3), 0)])
def test_what_is_not_a_position_for_each_name_is_not_written(
    tmp_path: Path, shape: tuple[int, ...], fps: float
) -> None:
    with pytest.raises(LandmarkError, match=rf"a\.trc: positions of shape .* at {fps} .*\(frames, 2, 3\)"):
        write_trc(tmp_path / "a.trc", ["Hip", "Neck"], np.zeros(shape), fps)
    assert not list(tmp_path.iterdir())


def test_a_file_that_cannot_be_written_leaves_nothing(tmp_path: Path) -> None:
    (tmp_path / "taken.trc").mkdir()
    with pytest.raises(OutputError, match=r"taken\.trc"):
        write_trc(tmp_path / "taken.trc", ["A"], np.zeros((1, 1, 3)), 30)
    assert [p.name for p in tmp_path.iterdir()] == ["taken.trc"]


@pytest.mark.parametrize("between", [",", ";", "  "])
def test_a_file_that_a_spreadsheet_has_saved_otherwise_is_said_to_have_no_tabs(tmp_path: Path, between: str) -> None:
    file = tmp_path / "landmarks.trc"
    write_trc(file, ["LHip", "RHip"], np.zeros((2, 2, 3)), 30.0)
    file.write_text(file.read_text().replace("\t", between))
    with pytest.raises(LandmarkError, match="line 4: its columns are not separated by tabs"):
        read_trc(file)
