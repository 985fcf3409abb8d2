"""C3D files: landmarks of marker systems.

A file consists of blocks of 512 bytes: a header, the parameters in groups, and the points, frame by frame, as 16-bit
integers or 32-bit floats. Numbers are stored as on Intel, DEC or MIPS processors. See "The C3D file format user guide",
Motion Lab Systems, 2008 (https://www.c3d.org).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cameras.world_axes import METRES
from ..errors import LandmarkError
from ..numerics.arrays import Array
from .reading import NUMBER_LIMIT, read_bytes, reading
from .trc import WORLD_OF_Y_UP, Landmarks

UPRIGHT = ("auto", "z", "y")
"""Which axis of a file points up; "auto" means as the file states (POINT:Y_SCREEN), or z if it does not."""

_BLOCK = 512
_MAGIC = 0x50
_INTEL, _DEC, _MIPS = 84, 85, 86
_TEXT, _BYTE, _INTEGER, _FLOAT = -1, 1, 2, 4  # codes of the types of parameters
_WIDTHS = {_TEXT: 1, _BYTE: 1, _INTEGER: 2, _FLOAT: 4}
_HEADER_FRAMES = 65535  # larger counts do not fit into the header and are stored as parameters


def read_c3d(path: Path | str, up: str = "auto") -> Landmarks:
    """Read the points of a C3D file.

    Parameters
    ----------
    path : path
    up : str
        One of `UPRIGHT`. In a file whose y axis is up, (X, Y, Z) are (y, z, x) of the world frame (Z up), as in TRC
        files.

    Raises
    ------
    LandmarkError
        The file cannot be read.
    """
    path = Path(path)
    data = read_bytes(path, "landmarks", LandmarkError)
    with reading(path, "a C3D file", LandmarkError):
        return _landmarks(_Numbers.of(data), up, str(path))


@dataclass(frozen=True)
class _Numbers:
    """The bytes of a file, read as numbers in its processor's format."""

    data: bytes
    order: str
    vax: bool

    @classmethod
    def of(cls, data: bytes) -> _Numbers:
        """Find the processor whose number format a file uses."""
        if len(data) < 2 * _BLOCK or data[1] != _MAGIC:
            raise ValueError("its beginning is not that of one")
        place = _BLOCK * (data[0] - 1)
        processor = data[place + 3]
        if processor not in (_INTEL, _DEC, _MIPS):
            raise ValueError(f"unknown processor {processor}")
        return cls(data, ">" if processor == _MIPS else "<", processor == _DEC)

    def integers(self, place: int, count: int, *, signed: bool = True) -> NDArray[np.int64]:
        """Return 16-bit integers, shape (n,)."""
        return self._taken(place, 2 * count).view(f"{self.order}{'i' if signed else 'u'}2").astype(np.int64)

    def floats(self, place: int, count: int) -> Array:
        """Return 32-bit floats; DEC's have their halves exchanged and are four times too large when read as IEEE."""
        raw = self._taken(place, 4 * count)
        if self.vax:
            return raw.view("<u2").reshape(-1, 2)[:, ::-1].copy().view("<f4").ravel().astype(float) / 4
        return raw.view(f"{self.order}f4").astype(float)

    def text(self, place: int, count: int) -> str:
        """Return a string, stripped."""
        return bytes(self._taken(place, count)).decode("latin-1").strip(" \0")

    def _taken(self, place: int, count: int) -> NDArray[np.uint8]:
        if place < 0 or count < 0 or place + count > len(self.data):
            raise ValueError("it is cut off")
        return np.frombuffer(self.data, np.uint8, count, place)


def _landmarks(numbers: _Numbers, up: str, where: str) -> Landmarks:
    parameters = _parameters(numbers)
    point = parameters.get("POINT", {})
    count, per_frame = (int(n) for n in numbers.integers(2, 2, signed=False))
    frames, scale = _frame_count(numbers, parameters), float(numbers.floats(12, 1)[0])
    start = int(_first(point, "DATA_START", 0)) or int(numbers.integers(16, 1, signed=False)[0])
    unit = str(_first(point, "UNITS", "mm")).lower() or "mm"
    if unit not in METRES:
        raise LandmarkError(f"unknown unit '{unit[:20]}'", where=where, todo=f"use {', '.join(METRES)}")
    if up == "auto":
        up = "y" if "Y" in str(_first(point, "Y_SCREEN", "+Z")).upper() else "z"
    points = METRES[unit] * _points(numbers, _BLOCK * (start - 1), (frames, count, per_frame), scale)
    names = _names(point, count)
    rate = float(_first(point, "RATE", numbers.floats(20, 1)[0]))
    if not 0 <= rate <= NUMBER_LIMIT:
        raise ValueError(f"a rate of {rate} frames per second")
    placed = points[:, : len(names)]
    return Landmarks(names, placed[..., WORLD_OF_Y_UP] if up == "y" else placed, rate)


def _parameters(numbers: _Numbers) -> dict[str, dict[str, list[Any]]]:
    """Return the parameters by group name and parameter name."""
    data, place = numbers.data, _BLOCK * (numbers.data[0] - 1) + 4
    groups: dict[int, str] = {}
    found: dict[int, dict[str, list[Any]]] = {}
    while place + 2 <= len(data) and data[place]:
        # A negative length marks a locked name.
        length, number = abs(_signed(data[place])), _signed(data[place + 1])
        name = numbers.text(place + 2, length).upper()
        place += 2 + length
        offset = int(numbers.integers(place, 1, signed=False)[0])
        if number < 0:
            groups[-number] = name
        else:
            found.setdefault(number, {})[name] = _values(numbers, place + 2)
        if offset == 0:
            break
        place += offset
    return {groups.get(number, ""): values for number, values in found.items()}


def _values(numbers: _Numbers, place: int) -> list[Any]:
    """Return the values of a parameter: numbers or strings."""
    kind, depth = _signed(numbers.data[place]), numbers.data[place + 1]
    sizes = list(numbers.data[place + 2 : place + 2 + depth])
    count, place = math.prod(sizes), place + 2 + depth
    if kind not in _WIDTHS or count * _WIDTHS[kind] > len(numbers.data):
        raise ValueError("a parameter is of an unknown type, or too long")
    if kind == _TEXT:
        letters = sizes[0] if sizes else 1
        return [numbers.text(place + k * letters, letters) for k in range(count // max(letters, 1))]
    if kind == _FLOAT:
        return numbers.floats(place, count).tolist()
    if kind == _INTEGER:
        return numbers.integers(place, count, signed=False).tolist()
    return list(numbers.data[place : place + count])


def _signed(byte: int) -> int:
    return byte - 256 if byte > 127 else byte


def _frame_count(numbers: _Numbers, parameters: Mapping[str, Mapping[str, list[Any]]]) -> int:
    """Return the number of frames; counts too large for the header are stored in parameters."""
    first, last = (int(n) for n in numbers.integers(6, 2, signed=False))
    trial = parameters.get("TRIAL", {})
    ends = [trial.get(name, []) for name in ("ACTUAL_START_FIELD", "ACTUAL_END_FIELD")]
    if all(len(end) == 2 for end in ends):
        begin, end = (int(low) + 65536 * int(high) for low, high in ends)
        return end - begin + 1
    frames = float(_first(parameters.get("POINT", {}), "FRAMES", 0))
    if last == _HEADER_FRAMES and frames > 0:
        return int(frames)
    return last - first + 1


def _points(numbers: _Numbers, place: int, counts: tuple[int, int, int], scale: float) -> Array:
    """Return the points (F, L, 3) in the file's unit; NaN where a point was not seen.

    Parameters
    ----------
    counts : tuple of int
        Numbers of frames, of points, and of the analogue values that follow the points of every frame.
    scale : float
        Unit of integers; negative if the points are floats.
    """
    frames, count, analogue = counts
    if frames < 0 or not count:
        raise ValueError(f"it has {frames} frames of {count} points")
    row = 4 * count + analogue
    width = 4 if scale < 0 else 2
    if width * frames * row > len(numbers.data) - place:
        raise ValueError(f"it is cut off: {frames} frames of {count} points do not fit")
    values = numbers.floats(place, frames * row) if scale < 0 else numbers.integers(place, frames * row) * scale
    points = values.reshape(frames, row)[:, : 4 * count].reshape(frames, count, 4)
    # The residual of a point that was not seen is -1; some programs write NaN as its position.
    unseen = (points[..., 3] < 0) | np.isnan(points[..., :3]).any(axis=-1)
    if not (np.abs(points[..., :3][~unseen]) <= NUMBER_LIMIT).all():
        raise ValueError("a coordinate is too large to be true")
    return np.where(unseen[..., None], np.nan, points[..., :3])


def _names(point: Mapping[str, list[Any]], count: int) -> tuple[str, ...]:
    """Return the names of the points; those beyond 255 are in LABELS2, LABELS3, ..."""
    names: list[str] = []
    for key in ("LABELS", *(f"LABELS{k}" for k in range(2, 2 + count // 255))):
        names += [str(name) for name in point.get(key, ())]
    return tuple(names[:count])


def _first(group: Mapping[str, list[Any]], name: str, otherwise: Any) -> Any:
    values = group.get(name)
    return values[0] if values else otherwise
