"""Point files of DLTdv and easyWand (xypts.csv): points digitised by hand or by their trackers.

Columns are pt1_cam1_X, pt1_cam1_Y, pt1_cam2_X ..., a row per frame, NaN or empty where a point was not digitised. The
first pixel is 1. DLTdv8 and easyWand count rows of pixels from the top, DLTdv5 and Argus from the bottom.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ..capture.capture import Markers
from ..errors import CalibrationError
from ..numerics.arrays import Array
from .reading import NUMBER_LIMIT, read_text, reading

DIGITISED_SIGMA = 0.7
"""Standard deviation of a digitised coordinate, pixels."""
ORIGINS = ("top-left", "bottom-left")
"""Corners of the picture from which a file may count."""
_COLUMN = re.compile(r"pt(\d+)_cam(\d+)_([XY])", re.IGNORECASE)


def is_dltdv_file(path: Path) -> bool:
    """Whether a CSV file's first line names points as DLTdv does."""
    try:
        with path.open(encoding="utf-8-sig") as file:
            return _COLUMN.match(file.readline().strip().strip('"')) is not None
    except (OSError, UnicodeDecodeError):
        return False


def read_dltdv_points(path: Path, count: int) -> dict[str, Markers]:
    """Read the first points of a file by camera (cam1, cam2 ...), in pixels counted from the bottom or top as in the
    file.

    Parameters
    ----------
    path : Path
    count : int
        Number of points to read: 2 for a wand, 4 for an L-frame.

    Raises
    ------
    CalibrationError
        The file cannot be read, or lacks a column; names the file, and the line if there is one.
    """
    text = read_text(path, "the points", CalibrationError)
    with reading(path, "a file of digitised points", CalibrationError):
        return _points(text, path, count)


def _points(text: str, path: Path, count: int) -> dict[str, Markers]:
    lines = csv.reader(text.split("\n"), skipinitialspace=True)
    rows = [row for row in lines if any(cell.strip() for cell in row)]
    columns = _columns(rows[0] if rows else [], path)
    if len(rows) * len(columns) > len(text):  # every cell takes at least one character
        what = f"{len(columns)} columns and {len(rows) - 1} rows, nearly all of them empty"
        raise CalibrationError(f"is not a file of digitised points, or not whole: {what}", where=str(path))
    cameras = sorted({camera for _, camera, _ in columns})
    found = {}
    for camera in cameras:
        points: Array = np.full((len(rows) - 1, count, 2), np.nan)
        for point in range(count):
            for axis in range(2):
                column = columns.get((point + 1, camera, axis))
                if column is None:
                    name = f"pt{point + 1}_cam{camera}_{'XY'[axis]}"
                    raise CalibrationError(f"the column '{name}' is missing", where=str(path))
                points[:, point, axis] = [_number(row, column, f"{path} line {i}") for i, row in enumerate(rows[1:], 2)]
        found[f"cam{camera}"] = _markers(np.asarray(points - 1.0))
    return found


def from_bottom(markers: Markers, height: int) -> Markers:
    """Return markers whose rows were counted from the bottom of a picture, with rows counted from its top."""
    points = markers.points.copy()
    points[..., 1] = height - 1 - points[..., 1]
    return Markers(markers.frames, points, markers.sigma)


def _columns(header: list[str], path: Path) -> Mapping[tuple[int, int, int], int]:
    """Return the column of every coordinate by point, camera and axis."""
    found = {}
    for k, name in enumerate(header):
        match = _COLUMN.fullmatch(name.strip())
        if match is not None:
            found[int(match[1]), int(match[2]), "XY".index(match[3].upper())] = k
    if not found:
        raise CalibrationError("no column is called pt1_cam1_X", where=str(path))
    return found


def _number(row: list[str], column: int, where: str) -> float:
    text = row[column].strip() if column < len(row) else ""
    try:
        value = float(text) if text else np.nan
    except ValueError as error:
        raise CalibrationError(f"'{text[:40]}' is not a number", where=where) from error
    if abs(value) > NUMBER_LIMIT:
        raise CalibrationError("a coordinate is too large to be true", where=where)
    return value


def _markers(points: Array) -> Markers:
    """Return the points of the frames that have any; a point with one coordinate missing is missing."""
    points = np.where(np.isfinite(points).all(axis=-1, keepdims=True), points, np.nan)
    frames = np.flatnonzero(np.isfinite(points).any(axis=(1, 2)))
    sigma = np.where(np.isfinite(points[frames, :, 0]), DIGITISED_SIGMA, np.nan)
    return Markers(frames.astype(np.int64), points[frames], sigma)
