"""Marker points as CSV: the balls of an L-frame and a wand, or a standing performer's feet and head, as found by any
detector.

Each row is one point, with columns camera, take (one of `TAKES`), frame, marker, u, v in any order, and optionally
sigma.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from ..capture.calibration_objects import LFRAME_BALLS, PERFORMER_POINTS, WAND_BALLS
from ..capture.capture import Capture, Markers
from ..errors import CalibrationError
from ..runtime.output_files.files import replacing
from .reading import NUMBER_LIMIT, read_text, reading

TAKES = {"lframe": LFRAME_BALLS, "wand": WAND_BALLS, "performer": PERFORMER_POINTS}
"""Number of points of each take."""
_MAX_COLUMNS = 100
COLUMNS = ("camera", "take", "frame", "marker", "u", "v")
USUAL_SIGMA = 0.5
"""Standard deviation of a coordinate if the file states none, pixels."""


def read_marker_points(path: Path | str) -> dict[tuple[str, str], Markers]:
    """Read marker points by camera and take.

    Raises
    ------
    CalibrationError
        The file cannot be read, or a row is invalid; names the file and the line.
    """
    path = Path(path)
    with reading(path, "a table of points", CalibrationError):
        return _read_points(path)


def _read_points(path: Path) -> dict[tuple[str, str], Markers]:
    found: dict[tuple[str, str], dict[tuple[int, int], tuple[float, float, float]]] = {}
    for where, row in _rows(path):
        camera, take = row["camera"].strip(), row["take"].strip()
        if not camera:
            raise CalibrationError("the camera is empty", where=where)
        if take not in TAKES:
            raise CalibrationError(f"unknown take '{take}'", where=where, todo=f"there are {', '.join(TAKES)}")
        frame, marker = _whole(row, "frame", where), _whole(row, "marker", where)
        if marker >= TAKES[take]:
            what = f"there is no marker {marker}: those of the {take} are 0 to {TAKES[take] - 1}"
            raise CalibrationError(what, where=where)
        balls = found.setdefault((camera, take), {})
        if (frame, marker) in balls:
            raise CalibrationError(f"marker {marker} is there twice on frame {frame}", where=where)
        sigma = _number(row, "sigma", where) if (row.get("sigma") or "").strip() else USUAL_SIGMA
        if sigma <= 0:
            raise CalibrationError(f"sigma must be greater than 0, not {sigma}", where=where)
        balls[frame, marker] = (_number(row, "u", where), _number(row, "v", where), sigma)
    return {key: _markers(balls, TAKES[key[1]]) for key, balls in found.items()}


def _rows(path: Path) -> Iterator[tuple[str, Mapping[str, str]]]:
    """Generate the rows, each with its file and line for messages."""
    text = read_text(path, "the points", CalibrationError)
    reader = csv.DictReader(io.StringIO(text, newline=""), skipinitialspace=True)
    header = [name.strip() for name in reader.fieldnames or ()]
    if len(header) > _MAX_COLUMNS:
        raise CalibrationError(f"it has {len(header)} columns", where=str(path))
    for column in COLUMNS:
        if column not in header:
            todo = f"the first line names the columns: {','.join(COLUMNS)}"
            raise CalibrationError(f"the column '{column}' is missing", where=str(path), todo=todo)
    reader.fieldnames = header
    for row in reader:
        where = f"{path} line {reader.line_num}"
        if any(row[column] is None for column in COLUMNS):
            raise CalibrationError("the row has too few columns", where=where)
        yield where, row


def _number(row: Mapping[str, str], column: str, where: str) -> float:
    try:
        value = float(row[column])
    except ValueError as error:
        raise CalibrationError(f"{column} '{row[column]}' is not a number", where=where) from error
    if not np.isfinite(value):
        raise CalibrationError(f"{column} '{row[column]}' is not a finite number", where=where)
    if abs(value) > NUMBER_LIMIT:
        raise CalibrationError(f"{column} '{row[column]}' is too large to be true", where=where)
    return value


def _whole(row: Mapping[str, str], column: str, where: str) -> int:
    value = _number(row, column, where)
    if value != round(value) or value < 0:
        raise CalibrationError(f"{column} '{row[column]}' is not a whole number from 0", where=where)
    return int(value)


def _markers(balls: Mapping[tuple[int, int], tuple[float, float, float]], count: int) -> Markers:
    frames = np.unique([frame for frame, _ in balls])
    row = {int(frame): i for i, frame in enumerate(frames)}
    points, sigma = np.full((len(frames), count, 2), np.nan), np.full((len(frames), count), np.nan)
    for (frame, marker), (u, v, s) in balls.items():
        points[row[frame], marker], sigma[row[frame], marker] = (u, v), s
    return Markers(frames.astype(np.int64), points, sigma)


def write_marker_points(path: Path | str, capture: Capture) -> None:
    """Write all points of a capture; `read_marker_points` reads them back.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    with replacing(Path(path)) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow((*COLUMNS, "sigma"))
        for view in capture.views:
            performer = {} if capture.performer is None else capture.performer.points
            takes = {"lframe": view.lframe, "wand": view.wand, "performer": performer.get(view.camera)}
            for take, markers in ((take, markers) for take, markers in takes.items() if markers is not None):
                for i, m in zip(*np.nonzero(markers.seen), strict=True):
                    u, v = (repr(float(x)) for x in markers.points[i, m])
                    sigma = repr(float(markers.sigma[i, m]))
                    writer.writerow((view.camera, take, int(markers.frames[i]), int(m), u, v, sigma))
