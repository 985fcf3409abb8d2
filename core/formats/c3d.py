"""C3D files: landmarks of marker systems, read with ezc3d where that is installed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import LandmarkError
from .trc import METRES, WORLD_OF_Y_UP, Landmarks

UPRIGHT = ("auto", "z", "y")
"""Which axis of a file is up; "auto" as the file says (POINT:Y_SCREEN), z where it does not."""


def read_c3d(path: Path | str, up: str = "auto") -> Landmarks:
    """Read the points of a C3D file.

    Parameters
    ----------
    path : path
    up : str
        One of `UPRIGHT`. A file whose y axis is up has (X, Y, Z) = (y, z, x) of our Z-up world, as TRC files have.

    Raises
    ------
    LandmarkError
        ezc3d is not installed, or the file cannot be read.
    """
    path = Path(path)
    try:
        import ezc3d
    except ImportError as error:
        todo = "install ezc3d into the Python that runs this, or save the landmarks as TRC"
        raise LandmarkError(
            "C3D files are read by the package ezc3d, which is missing", where=str(path), todo=todo
        ) from error
    try:
        document = ezc3d.c3d(str(path))
        return _landmarks(document["parameters"]["POINT"], document["data"]["points"], up, str(path))
    except OSError as error:
        raise LandmarkError(f"is not a C3D file: {error}", where=str(path)) from error
    except (KeyError, IndexError, ValueError) as error:
        raise LandmarkError(f"the file is not whole: {type(error).__name__} {error}", where=str(path)) from error


def _landmarks(head: Any, points: NDArray[np.float64], up: str, where: str) -> Landmarks:
    names = tuple(str(name).strip() for name in head["LABELS"]["value"])[: points.shape[1]]
    unit = str(_first(head, "UNITS", "mm")).strip().lower()
    if unit not in METRES:
        raise LandmarkError(f"unknown unit '{unit}'", where=where, todo=f"use {', '.join(METRES)}")
    if up == "auto":
        up = "y" if "Y" in str(_first(head, "Y_SCREEN", "+Z")).upper() else "z"
    placed = METRES[unit] * np.moveaxis(points[:3], 0, -1).swapaxes(0, 1)
    return Landmarks(names, placed[..., WORLD_OF_Y_UP] if up == "y" else placed, float(_first(head, "RATE", 0.0)))


def _first(head: Any, name: str, otherwise: Any) -> Any:
    values = list(head[name]["value"]) if name in head else []
    return values[0] if values else otherwise
