"""A capture as files: the capture file, marker points as CSV, and the command that calibrates from them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from kfmocap.benchmarks.studies.wand_captures import FPS, LFRAME, capture, ends, ring, scattered, waved
from kfmocap.cli import command_line
from kfmocap.core.calibration.resync import synchronise
from kfmocap.core.capture.capture import Capture
from kfmocap.core.capture.capture_videos import CaptureVideos
from kfmocap.core.capture.colours import parsed
from kfmocap.core.errors import CalibrationError, CaptureError
from kfmocap.core.formats import load_cameras, save_cameras
from kfmocap.core.formats.marker_points import read_marker_points, write_marker_points
from kfmocap.core.formats.wand_toml import capture_files, load_wand

CAMERAS = ring(3)
HEAD = """
[lframe]
points = [[0,0,0],[0.3,0,0],[0.6,0,0],[0,0.2,0]]
{lframe}
[wand]
length = 0.5
{wand}
"""


def written(folder: Path, given: Capture, more: str = "") -> Path:
    """A capture file with points beside it."""
    write_marker_points(folder / "points.csv", given)
    views = "".join(
        f'[[view]]\ncamera = "{view.camera}"\nsize = [1920, 1080]\nfps = 30\n'
        + ("" if view.offset is None else f"offset = {view.offset}\n")
        + more
        for view in given.views
    )
    path = folder / "wand.toml"
    path.write_text(HEAD.format(lframe="", wand="") + views + '[points]\nfile = "points.csv"\n')
    return path


def assert_same(a: Capture, b: Capture) -> None:
    for one, other in zip(a.views, b.views, strict=True):
        assert (one.camera, one.size, one.fps, one.offset) == (other.camera, other.size, other.fps, other.offset)
        for key in ("lframe", "wand"):
            first, second = getattr(one, key), getattr(other, key)
            seen = first.seen.any(axis=1)
            np.testing.assert_array_equal(first.frames[seen], second.frames)
            np.testing.assert_array_equal(first.points[seen], second.points)
            np.testing.assert_array_equal(first.sigma[seen], second.sigma)


def test_points_go_out_and_come_back(tmp_path: Path) -> None:
    given = capture(CAMERAS, [scattered(40)] * 3)
    back = load_wand(written(tmp_path, given))
    assert isinstance(back, Capture)
    np.testing.assert_array_equal(back.lframe_points, LFRAME)
    assert_same(given, back)


def test_points_of_other_programs_need_no_sigma_and_no_order(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    path.write_text("frame, v, u, marker, take, camera\n7,20.5,10,1,wand,a\n3,2,1,0,wand,a\n7,4,3,0,wand,a\n")
    markers = read_marker_points(path)["a", "wand"]
    assert markers.frames.tolist() == [3, 7]
    np.testing.assert_array_equal(markers.points[1], [[3, 4], [10, 20.5]])
    assert np.isnan(markers.points[0, 1]).all() and markers.sigma[1, 1] > 0


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("a,wand,1,2,0,0", "line 2: there is no marker 2"),
        ("a,stick,1,0,0,0", "line 2: unknown take 'stick'"),
        ("a,wand,1.5,0,0,0", "line 2: frame '1.5' is not a whole number"),
        ("a,wand,-1,0,0,0", "line 2: frame '-1'"),
        ("a,wand,1,0,x,0", "line 2: u 'x' is not a number"),
        ("a,wand,1,0,0,nan", "line 2: v 'nan'"),
        ("a,wand,1,0", "line 2: the row has too few columns"),
        (",wand,1,0,0,0", "line 2: the camera is empty"),
        ("a,wand,1,0,0,0\na,wand,1,0,0,0", "line 3: marker 0 is there twice on frame 1"),
    ],
)
def test_rows_that_make_no_sense_are_named(tmp_path: Path, row: str, message: str) -> None:
    path = tmp_path / "points.csv"
    path.write_text("camera,take,frame,marker,u,v\n" + row + "\n")
    with pytest.raises(CalibrationError, match=message):
        read_marker_points(path)


def test_points_beside_the_picture_say_that_its_size_is_another(tmp_path: Path) -> None:
    wand = written(tmp_path, capture(CAMERAS, [scattered(20)] * 3))
    wand.write_text(wand.read_text().replace("[1920, 1080]", "[1080, 1920]"))
    with pytest.raises(CalibrationError, match=r"size: is 1080 x 1920, but .*points\.csv has points such as"):
        load_wand(wand)


def test_the_files_of_a_capture_are_those_that_are_read(tmp_path: Path) -> None:
    """Paths may be written with backslashes, as on Windows."""
    wand = written(tmp_path, capture(CAMERAS, [scattered(20)] * 3))
    wand.write_text(wand.read_text().replace('"points.csv"', r"'.\points.csv'"))
    load_wand(wand)
    assert capture_files(wand) == [tmp_path / "points.csv"]


def test_points_without_their_columns_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    path.write_text("camera,take,frame,u,v\n")
    with pytest.raises(CalibrationError, match="the column 'marker' is missing"):
        read_marker_points(path)
    with pytest.raises(CalibrationError, match="cannot be read"):
        read_marker_points(tmp_path / "none.csv")


FILMED = '[[view]]\ncamera = "a"\nlframe = "a_l.mp4"\nwand = "a_w.mp4"\n'


def test_videos_and_what_is_known_of_them(tmp_path: Path) -> None:
    path = tmp_path / "wand.toml"
    known = "offset = 1.5\nmatrix = [[9,0,4],[0,9,3],[0,0,1]]\ndistortions = [0.1,0,0,0]\n"
    text = HEAD.format(lframe='colour = "red"\ndiameter = 0.04', wand='colours = ["green", "#0000ff"]')
    path.write_text(text + FILMED + known)
    film = load_wand(path)
    assert isinstance(film, CaptureVideos)
    assert film.lframe_colour == parsed("red", "") and film.lframe_diameter == 0.04
    assert film.wand_colours == (parsed("green", ""), parsed("#0000ff", "")) and film.wand_diameter is None
    [view] = film.views
    assert view.wand == tmp_path / "a_w.mp4" and view.offset == 1.5 and view.focal is None
    assert view.matrix is not None and view.matrix[0, 0] == 9


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("length = 0.5", "", r"\[wand\]: 'length' is missing"),
        ("length = 0.5", "length = -0.5", r"\[wand\] length: must be greater than 0"),
        ("length = 0.5", "lenght = 0.5", "unknown key 'lenght'.*did you mean 'length'"),
        (",[0,0.2,0]]", "]", r"\[lframe\] points: has shape \(3, 3\), not 4 x 3"),
        ('colour = "red"', "", r"\[lframe\]: 'colour' is missing"),
        ('colour = "red"', 'colour = "ruddy"', r"\[lframe\] colour: 'ruddy' is no colour"),
        ('["green"]', "[]", r"\[wand\] colours: must be one colour for both balls or two"),
        ('wand = "a_w.mp4"', "", r"\[\[view\]\] 1: 'wand' is missing"),
        ('wand = "a_w.mp4"', 'wand = "a_w.mp4"\ndistortions = [0,0,0,0]', "the matrix that goes with them is missing"),
        ("[[view]]", "[[views]]", "unknown key 'views'"),
    ],
)
def test_mistakes_in_a_capture_file_are_named(tmp_path: Path, old: str, new: str, message: str) -> None:
    text = HEAD.format(lframe='colour = "red"', wand='colours = ["green"]') + FILMED
    assert old in text
    path = tmp_path / "wand.toml"
    path.write_text(text.replace(old, new))
    with pytest.raises(CalibrationError, match=message):
        load_wand(path)


@pytest.fixture(scope="module")
def take(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A capture file whose second camera began 4.25 frames after the first, and the third 11.5 before."""
    paths = [waved((np.arange(240) - o) / FPS) for o in (0.0, -4.25, 11.5)]
    return written(tmp_path_factory.mktemp("take"), capture(CAMERAS, paths, offsets=[None] * 3))


def test_the_command_calibrates_and_reports(take: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, report, points = tmp_path / "new" / "calibration.toml", tmp_path / "report", tmp_path / "found.csv"
    code = command_line.main(
        ["calibrate", str(take), "--out", str(out), "--report", str(report), "--points", str(points)]
    )
    told = capsys.readouterr()
    assert code == 0, told.err
    assert {str(out), str(report / "report.json"), str(report / "report.html"), str(points)} <= set(told.out.split())
    assert "cam02: offset = -4.2" in told.err
    for camera in CAMERAS:
        found = load_cameras(out)[camera.name]
        assert np.linalg.norm(found.centre_world() - camera.centre_world()) < 0.02
        assert found.matrix[0, 0] == pytest.approx(camera.matrix[0, 0], rel=4e-3)
    numbers = json.loads((report / "report.json").read_text())
    assert [camera["camera"] for camera in numbers["cameras"]] == [camera.name for camera in CAMERAS]
    assert numbers["wand"]["held_out"]["count"] > 10
    assert points.read_text() == (take.parent / "points.csv").read_text()


@pytest.mark.parametrize("name", ["c.qca.txt", "c.yml"])
def test_the_command_writes_the_kind_that_the_name_asks_for(tmp_path: Path, name: str) -> None:
    wand = written(tmp_path, capture(CAMERAS, [scattered(80)] * 3))
    assert command_line.main(["calibrate", str(wand), "--out", str(tmp_path / name)]) == 0
    assert list(load_cameras(tmp_path / name)) == [camera.name for camera in CAMERAS]


def test_a_capture_that_is_refused_leaves_nothing_behind(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    flat = scattered(80)
    flat = ends(flat.mean(axis=1) * [1, 1, 0] + [0, 0, 0.8], (flat[:, 0] - flat[:, 1]) * [1, 1, 0], 0.5)
    folder = tmp_path / "capture"
    folder.mkdir()
    wand = written(folder, capture(CAMERAS, [flat] * 3))
    out = tmp_path / "c.toml"
    assert command_line.main(["calibrate", str(wand), "--out", str(out), "--report", str(tmp_path / "r")]) == 1
    assert "wand-in-a-plane" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["capture"]


def test_a_kind_that_is_unknown_is_refused_before_the_work(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert command_line.main(["calibrate", str(tmp_path / "none.toml"), "--out", str(tmp_path / "c.xcp")]) == 1
    assert "unknown kind of calibration" in capsys.readouterr().err


def test_a_take_of_known_cameras_is_synchronised(
    take: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    save_cameras(tmp_path / "known.toml", CAMERAS)
    assert command_line.main(["synchronise", str(take), "--cameras", str(tmp_path / "known.toml")]) == 0
    lines = dict(line.split(": offset = ") for line in capsys.readouterr().out.splitlines())
    offsets = [float(lines[camera.name].split()[0]) for camera in CAMERAS]
    np.testing.assert_allclose(offsets, [0, -4.25, 11.5], atol=0.02)


def test_a_take_of_other_cameras_is_refused(take: Path) -> None:
    given = load_wand(take)
    assert isinstance(given, Capture)
    with pytest.raises(CalibrationError, match="the calibration does not have it"):
        synchronise(given, {camera.name: camera for camera in CAMERAS[:2]})
    elsewhere = {camera.name: other for camera, other in zip(CAMERAS, ring(3, 9)[::-1], strict=True)}
    with pytest.raises(CaptureError, match="no-solution"):
        synchronise(given, elsewhere)


def digitised(folder: Path, given: Capture, origin: str) -> Path:
    """The same capture as DLTdv writes it: one file of the wand, one of the L-frame, the first pixel 1."""
    names = [f"pt{p + 1}_cam{c + 1}_{axis}" for p in range(4) for c in range(len(given.views)) for axis in "XY"]
    for take in ("lframe", "wand"):
        balls = getattr(given.views[0], take).points.shape[1]
        rows = [",".join(names[: 2 * balls * len(given.views)])]
        for frame in range(max(int(getattr(view, take).frames[-1]) for view in given.views) + 1):
            cells = []
            for ball in range(balls):
                for view in given.views:
                    markers = getattr(view, take)
                    row = np.flatnonzero(markers.frames == frame)
                    u, v = markers.points[row[0], ball] if len(row) else (np.nan, np.nan)
                    cells += [u + 1, v + 1 if origin == "top-left" else view.size[1] - v]
            rows.append(",".join("NaN" if np.isnan(x) else repr(float(x)) for x in cells))
        (folder / f"{take}_xypts.csv").write_text("\n".join(rows) + "\n")
    views = "".join(f'[[view]]\ncamera = "cam{c + 1}"\nsize = [1920, 1080]\n' for c in range(len(given.views)))
    points = f'[points]\nfile = "wand_xypts.csv"\nlframe = "lframe_xypts.csv"\norigin = "{origin}"\n'
    path = folder / "wand.toml"
    path.write_text(HEAD.format(lframe="", wand="") + views + points)
    return path


@pytest.mark.parametrize("origin", ["top-left", "bottom-left"])
def test_points_of_dltdv_and_easywand_are_read(tmp_path: Path, origin: str) -> None:
    """In either of their two ways of counting rows of pixels."""
    given = capture(CAMERAS, [scattered(40)] * 3)
    back = load_wand(digitised(tmp_path, given, origin))
    assert isinstance(back, Capture)
    for one, other in zip(given.views, back.views, strict=True):
        assert other.offset == 0
        for take in ("lframe", "wand"):
            first, second = getattr(one, take), getattr(other, take)
            seen = first.seen.any(axis=1)
            np.testing.assert_array_equal(first.frames[seen], second.frames)
            np.testing.assert_allclose(first.points[seen], second.points, atol=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("pt2_cam2_Y", "pt3_cam2_Y", r"wand_xypts\.csv: the column 'pt2_cam2_Y' is missing"),
        ("NaN", "far", r"wand_xypts\.csv line \d+: 'far' is not a number"),
    ],
)
def test_mistakes_in_dltdv_files_are_named(tmp_path: Path, old: str, new: str, message: str) -> None:
    path = digitised(tmp_path, capture(CAMERAS, [scattered(40)] * 3), "top-left")
    points = tmp_path / "wand_xypts.csv"
    points.write_text((points.read_text() + "NaN\n").replace(old, new, 1))
    with pytest.raises(CalibrationError, match=message):
        load_wand(path)
    path.write_text(path.read_text().replace('"top-left"', '"middle"'))
    points.write_text(points.read_text().replace(new, old, 1))
    with pytest.raises(CalibrationError, match="origin: must be top-left or bottom-left"):
        load_wand(path)


def test_a_view_may_lack_its_video_of_the_lframe(tmp_path: Path) -> None:
    path = tmp_path / "wand.toml"
    head = HEAD.format(lframe='colour = "red"', wand='colours = ["green", "blue"]')
    path.write_text(
        head + '[[view]]\ncamera = "a"\nwand = "a.avi"\n[[view]]\ncamera = "b"\nwand = "b.avi"\nlframe = "l.avi"\n'
    )
    back = load_wand(path)
    assert isinstance(back, CaptureVideos)
    assert back.views[0].lframe is None and back.views[1].lframe == tmp_path / "l.avi"
