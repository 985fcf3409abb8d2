"""Reading capture files: an L-frame and a wand, as videos or as points. Paths are relative to the file's folder."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..capture.calibration_objects import LFRAME_BALLS, USUAL_WAND_LENGTH, WAND_BALLS
from ..capture.capture import Capture, CaptureView, Markers, StandingPerformer
from ..capture.capture_videos import CaptureVideos, CaptureVideoView
from ..capture.colours import Colour, parsed
from ..errors import CalibrationError, ShotError
from ..numerics.arrays import Array
from ..numerics.sequences import first_repeated
from .dltdv_points import ORIGINS, from_bottom, is_dltdv_file, read_dltdv_points
from .marker_points import TAKES, read_marker_points
from .reading import NUMBER_LIMIT, reading
from .toml_tables import Table, check_kind, read_toml

_MOST_BESIDE = 0.6
"""How far a ball's centre may be from the middle of the picture, as a share of its size: it may lie beyond the edge."""
_MANY = 0.05  # share of a view's points
_TABLES = ("lframe", "wand", "view", "points", "floor")
_VIEW = ("camera", "lframe", "wand", "offset", "focal", "matrix", "distortions", "size", "fps")


def load_wand(path: Path | str) -> CaptureVideos | Capture:
    """Read a capture file: videos in which markers are to be detected, or the markers' points themselves.

    Raises
    ------
    CalibrationError
        One message that names the file and the field.
    """
    path = Path(path)
    with _as_calibration_error(), reading(path, "a capture file", CalibrationError):
        values = read_toml(path, "the capture file", CalibrationError)
        check_kind(values, path, "capture", CalibrationError)
        document = Table(values, str(path), _TABLES)
        floor, performer = _floor(document, path)
        lframe = Table(document.value("lframe", {}), f"{path} [lframe]", ("colour", "points", "diameter"))
        wand = Table(document.value("wand"), f"{path} [wand]", ("colours", "length", "diameter"))
        without = bool(floor) or performer is not None
        points = np.full((LFRAME_BALLS, 3), np.nan) if without else _vectors(lframe, "points", (LFRAME_BALLS, 3))
        scale_open = performer is not None and "length" not in wand
        length = USUAL_WAND_LENGTH if scale_open else wand.positive("length")
        performer = None if performer is None else replace(performer, gives_scale=scale_open)
        views = _views(document, path)
        if "points" in document:
            table = Table(document.value("points"), f"{path} [points]", ("file", "lframe", "origin"))
            diameter = wand.positive("diameter") if "diameter" in wand else 0.0
            capture = _capture(table, points, length, views, path)
            return replace(capture, floor=floor, floor_height=diameter / 2, performer=performer)
        colours = _colours(wand)
        return CaptureVideos(
            lframe_points=points,
            lframe_colour=colours[0] if without else parsed(lframe.value("colour"), f"{lframe.where} colour"),
            lframe_diameter=lframe.positive("diameter") if "diameter" in lframe else None,
            wand_length=length,
            wand_colours=colours,
            wand_diameter=wand.positive("diameter") if "diameter" in wand else None,
            views=tuple(_capture_view(view, path.parent) for view in views),
            floor=floor,
            performer=performer,
        )


def capture_files(path: Path) -> list[Path]:
    """Return the videos and the files of points that a capture file names, one that `load_wand` can read."""
    document = read_toml(path, "the capture file", CalibrationError)
    points, floor = document.get("points", {}), document.get("floor", {})
    named = [(view, take) for view in document["view"] for take in ("lframe", "wand")]
    named += [(points, "file"), (points, "lframe"), (floor, "points")]
    files = [Table(values, str(path), values).path(key, path.parent, None) for values, key in named]
    return [file for file in files if file is not None]


def _floor(document: Table, path: Path) -> tuple[tuple[tuple[int, int], ...], StandingPerformer | None]:
    """Read what replaces an L-frame: the frames on which the wand lies on the floor, or somebody who stands there."""
    if "floor" not in document:
        return (), None
    floor = Table(document.value("floor"), f"{path} [floor]", ("wand", "performer", "height", "points"))
    if "lframe" in document:
        raise CalibrationError("there are both an L-frame and [floor]", where=str(path), todo="leave one of them out")
    if "performer" not in floor:
        return _frame_ranges(floor, "wand", 2), None
    if "wand" in floor:
        raise floor.error("performer", "there are both a performer and a wand on the floor", "leave one of them out")
    file = floor.path("points", path.parent)
    found = {camera: m for (camera, take), m in read_marker_points(file).items() if take == "performer"}
    if not found:
        raise floor.error("points", f"{file} has no points of the take 'performer'")
    return (), StandingPerformer(floor.positive("height"), _frame_ranges(floor, "performer"), found)


def _frame_ranges(floor: Table, key: str, count: int | None = None) -> tuple[tuple[int, int], ...]:
    """Read `count` ranges of frames in increasing order; at least two if it is None."""
    shape = (count or max(len(floor.value(key)) if isinstance(floor.value(key), list) else 0, 2), 2)
    ends = _vectors(floor, key, shape).ravel()
    if not ((ends == ends.round()).all() and (np.diff(ends) > 0).all()):
        many = "two" if count else "two or more"
        what = f"must be {many} stretches of frames, each with its first and last frame, the earlier one first"
        raise floor.error(key, what, "such as [[10, 40], [80, 110]]")
    return tuple((int(a), int(b)) for a, b in ends.reshape(-1, 2))


@contextmanager
def _as_calibration_error() -> Iterator[None]:
    """Turn errors of tables into CalibrationErrors."""
    try:
        yield
    except ShotError as error:
        raise CalibrationError(error.what, where=error.where, todo=error.todo) from error


def _views(document: Table, path: Path) -> list[Table]:
    values = document.value("view")
    if not isinstance(values, list) or not values:
        todo = "write two brackets, [[view]], not [view]" if isinstance(values, Mapping) else None
        raise CalibrationError("there must be at least one [[view]]", where=str(path), todo=todo)
    views = [Table(value, f"{path} [[view]] {i}", _VIEW) for i, value in enumerate(values, 1)]
    if (name := first_repeated(view.text("camera") for view in views)) is not None:
        raise CalibrationError(f"'{name}' is there twice", where=f"{path} [[view]] camera")
    return views


def _capture_view(view: Table, folder: Path) -> CaptureVideoView:
    lframe = view.path("lframe", folder) if "lframe" in view else None
    return CaptureVideoView(view.text("camera"), lframe, view.path("wand", folder), *_known_beforehand(view))


def _known_beforehand(view: Table) -> tuple[float | None, float | None, Array | None, Array | None]:
    """Read offset, focal length, matrix and distortions, each None if it is not given."""
    offset = view.number("offset", None)
    focal = view.positive("focal") if "focal" in view else None
    matrix = _vectors(view, "matrix", (3, 3)) if "matrix" in view else None
    distortions = _vectors(view, "distortions", None) if "distortions" in view else None
    if matrix is not None and not (matrix[0, 0] > 0 and matrix[1, 1] > 0):
        raise view.error("matrix", "must have positive focal lengths")
    if distortions is not None and len(distortions) not in (4, 5, 8, 12, 14):
        raise view.error("distortions", f"{len(distortions)} coefficients, not 4, 5, 8, 12 or 14")
    if distortions is not None and matrix is None:
        raise view.error("distortions", "the matrix that goes with them is missing")
    return None if offset is None else float(offset), focal, matrix, distortions


def _colours(wand: Table) -> tuple[Colour, ...]:
    values = wand.value("colours")
    if not isinstance(values, list) or not 1 <= len(values) <= WAND_BALLS:
        raise wand.error("colours", 'must be one colour for both balls or two, such as ["green", "blue"]')
    return tuple(parsed(value, f"{wand.where} colours") for value in values)


def _capture(table: Table, points: Array, length: float, views: list[Table], path: Path) -> Capture:
    """Read the points of a file for the views that are to be used."""
    file = table.path("file", path.parent)
    digitised = is_dltdv_file(file)
    found = _digitised(table, path.parent) if digitised else read_marker_points(file)
    cameras = sorted({camera for camera, _ in found})
    out = []
    for view in views:
        name = view.text("camera")
        if name not in cameras:
            raise view.error("camera", f"{file} has no points of '{name}'", f"its cameras are {', '.join(cameras)}")
        size = _vectors(view, "size", (2,))
        if not ((size == size.round()) & (size > 0)).all():
            raise view.error("size", "must be two whole numbers of pixels")
        fps = view.positive("fps") if "fps" in view else None
        lframe, wand = (found.get((name, take), _nothing(TAKES[take])) for take in ("lframe", "wand"))
        if digitised and table.value("origin", ORIGINS[0]) == ORIGINS[1]:
            lframe, wand = from_bottom(lframe, int(size[1])), from_bottom(wand, int(size[1]))
        _check_in_picture(view, size, np.concatenate([lframe.points.reshape(-1, 2), wand.points.reshape(-1, 2)]), file)
        known = _known_beforehand(view)
        if digitised and known[0] is None:
            known = (0.0, *known[1:])  # a row of such a file belongs to one instant in all cameras
        out.append(CaptureView(name, (int(size[0]), int(size[1])), fps, lframe, wand, *known))
    return Capture(points, length, tuple(out))


def _check_in_picture(view: Table, size: Array, points: Array, file: Path) -> None:
    """Raise an error if many of the points (n, 2) of a view, not single wrong ones, lie far beyond its picture."""
    far = (np.abs(points - size / 2) > _MOST_BESIDE * size).any(axis=1)
    if far.sum() > _MANY * len(points):
        u, v = points[far][0]
        what = f"is {size[0]:.0f} x {size[1]:.0f}, but {file} has points such as {u:.0f}, {v:.0f}"
        raise view.error("size", what, "give the width and height of the pictures in which they were found")


def _digitised(table: Table, folder: Path) -> dict[tuple[str, str], Markers]:
    """Read the points of DLTdv's files by camera and take."""
    if table.value("origin", ORIGINS[0]) not in ORIGINS:
        raise table.error("origin", f"must be {' or '.join(ORIGINS)}")
    found = {(camera, "wand"): m for camera, m in read_dltdv_points(table.path("file", folder), WAND_BALLS).items()}
    if "lframe" in table:
        lframe = read_dltdv_points(table.path("lframe", folder), LFRAME_BALLS)
        found |= {(camera, "lframe"): markers for camera, markers in lframe.items()}
    return found


def _nothing(balls: int) -> Markers:
    return Markers(np.zeros(0, np.int64), np.zeros((0, balls, 2)), np.zeros((0, balls)))


def _vectors(table: Table, key: str, shape: tuple[int, ...] | None) -> Array:
    """Return the numbers of one field with the given shape; None stands for any list."""
    try:
        values = np.asarray(table.value(key), dtype=float)
    except (TypeError, ValueError, OverflowError) as error:
        raise table.error(key, "must be numbers") from error
    if (values.ndim != 1) if shape is None else (values.shape != shape):
        wanted = "a list" if shape is None else " x ".join(map(str, shape))
        raise table.error(key, f"has shape {values.shape}, not {wanted}")
    if not np.isfinite(values).all():
        raise table.error(key, "holds a value that is not a finite number")
    if (np.abs(values) > NUMBER_LIMIT).any():
        raise table.error(key, "holds a value too large to be true")
    return values
