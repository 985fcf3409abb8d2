"""TRC files: landmarks over time, as Pose2Sim and OpenSim write them.

The file's axes are Y up: (X, Y, Z) are (y, z, x) of the world frame (Z up). Blanks and "nan" are landmarks that were
not seen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..cameras.world_axes import METRES
from ..errors import LandmarkError
from ..numerics.arrays import Array
from ..numerics.sequences import first_repeated
from ..runtime.output_files.files import replacing
from .reading import NUMBER_LIMIT, read_text, reading

WORLD_OF_Y_UP = [2, 0, 1]
_TRC_OF_WORLD = [1, 2, 0]
_HEADER_LINES = 5
_MIN_VALUES_ALLOWED, _MAX_VALUES_PER_CHARACTER = 1_000_000, 10
"""Number of values for which memory is allocated regardless of the file's length, and beyond that, per character of the
file: most values may be missing."""


@dataclass(frozen=True, eq=False)
class Landmarks:
    """Landmarks over time.

    Attributes
    ----------
    names : tuple of str, length L
    points_world : ndarray, shape (F, L, 3)
        Metres, Z up; NaN where a landmark was not seen.
    fps : float
        Frames per second, 0 if the file does not state it.
    """

    names: tuple[str, ...]
    points_world: Array
    fps: float

    def __len__(self) -> int:
        return len(self.points_world)


def read_trc(path: Path | str) -> Landmarks:
    """Read a TRC file.

    Raises
    ------
    LandmarkError
        The file cannot be read or is not a TRC; names the file and the line.
    """
    path = Path(path)
    lines = read_text(path, "landmarks", LandmarkError).split("\n")
    with reading(path, "a TRC file", LandmarkError):
        return _landmarks(lines, path)


def _landmarks(lines: list[str], path: Path) -> Landmarks:
    if len(lines) < _HEADER_LINES or not lines[0].startswith("PathFileType"):
        raise LandmarkError("is not a TRC file", where=str(path), todo="its first line must begin with PathFileType")
    if "\t" not in lines[3] and lines[3].strip():
        todo = "export it again, or save it as text with tabs: spreadsheets write commas or semicolons"
        raise LandmarkError("its columns are not separated by tabs", where=f"{path} line 4", todo=todo)
    header = dict(zip(lines[1].split("\t"), (v.strip() for v in lines[2].split("\t")), strict=False))
    unit = header.get("Units", "m").lower()
    if unit not in METRES:
        raise LandmarkError(f"unknown unit '{unit}'", where=f"{path} line 3", todo=f"use {', '.join(METRES)}")
    names = tuple(n.strip() for n in lines[3].split("\t")[2:] if n.strip())
    if (twice := first_repeated(names)) is not None:
        raise LandmarkError(f"landmark '{twice}' is named twice", where=f"{path} line 4")
    rows = [(number, line) for number, line in enumerate(lines[_HEADER_LINES:], _HEADER_LINES + 1) if line.strip()]
    cells = 3 * len(names) * len(rows)
    if cells > _MIN_VALUES_ALLOWED + _MAX_VALUES_PER_CHARACTER * sum(map(len, lines)):
        what = f"{len(names)} landmarks on {len(rows)} frames, nearly all of them empty"
        raise LandmarkError(f"is not a TRC file, or not whole: {what}", where=str(path))
    values = np.full((len(rows), 3 * len(names)), np.nan)
    for (number, line), row in zip(rows, values, strict=True):
        found = _row(line, len(names), f"{path} line {number}")
        row[: len(found)] = found
    points = values.reshape(len(rows), len(names), 3)[..., WORLD_OF_Y_UP] * METRES[unit]
    return Landmarks(names, points, _rate(header, path))


def _rate(header: dict[str, str], path: Path) -> float:
    text = header.get("DataRate") or "0"
    try:
        rate = float(text)
    except ValueError:
        rate = np.nan
    if not 0 <= rate <= NUMBER_LIMIT:
        raise LandmarkError(f"DataRate '{text[:40]}' is not a number of frames per second", where=f"{path} line 3")
    return rate


def _row(line: str, count: int, where: str) -> list[float]:
    """Return the coordinates of one frame; those missing at the end of its line were not seen."""
    fields = line.split("\t")[2 : 2 + 3 * count]
    try:
        values = [float(f) if f.strip() else np.nan for f in fields]
    except ValueError as error:
        raise LandmarkError(f"not a number: {str(error)[:80]}", where=where) from error
    if any(abs(value) > NUMBER_LIMIT for value in values):
        raise LandmarkError("a coordinate is too large to be true", where=where)
    return values


def write_trc(path: Path | str, names: Sequence[str], points_world: Array, fps: float) -> None:
    """Write landmarks as a TRC file.

    Parameters
    ----------
    path : Path or str
    names : sequence of str
        Of the L landmarks.
    points_world : ndarray, shape (F, L, 3)
        Metres; NaN where a landmark was not seen.
    fps : float
        Frames per second.

    Raises
    ------
    LandmarkError
        There is not a position for each name, one is infinite, a name holds what separates names in the file, or the
        frame rate is not positive.
    OutputError
        The file cannot be written.
    """
    path = Path(path)
    points = np.asarray(points_world, float)
    F, L = len(points), len(names)
    if points.shape != (F, L, 3) or not (np.isfinite(fps) and fps > 0):
        what = f"positions of shape {points.shape} at {fps} frames per second"
        raise LandmarkError(what, where=str(path), todo=f"give those of each frame, (frames, {L}, 3), and their rate")
    for name in names:
        if not name.strip() or any(ch in name for ch in "\t\r\n"):
            todo = "a name has letters, and neither tabs nor line breaks"
            raise LandmarkError(f"{name!r} cannot be a landmark's name", where=str(path), todo=todo)
    if np.isinf(points).any():
        frame, landmark = np.argwhere(np.isinf(points))[0, :2]
        todo = "give NaN where a landmark was not seen"
        raise LandmarkError(f"{names[landmark]} is infinitely far away in row {frame}", where=str(path), todo=todo)
    rate = f"{fps:.10g}"
    keys = "DataRate CameraRate NumFrames NumMarkers Units OrigDataRate OrigDataStartFrame OrigNumFrames"
    lines = [
        f"PathFileType\t4\t(X/Y/Z)\t{path.name}",
        "\t".join(keys.split()),
        f"{rate}\t{rate}\t{F}\t{L}\tm\t{rate}\t1\t{F}",
        "Frame#\tTime\t" + "\t\t\t".join(names) + "\t\t",
        "\t\t" + "\t".join(f"X{i}\tY{i}\tZ{i}" for i in range(1, L + 1)),
    ]
    for f, values in enumerate(points[..., _TRC_OF_WORLD].reshape(F, 3 * L)):
        cells = ("" if np.isnan(v) else f"{v:.7f}" for v in values)
        lines.append(f"{f + 1}\t{f / fps:.6f}\t" + "\t".join(cells))
    with replacing(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")
