"""Recognising what a file is, whatever its name."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Literal

from ..errors import KeypointError, KFMocapError
from .keypoint_documents import people
from .reading import read_bytes, reading
from .toml_tables import document_kind, read_toml

Kind = Literal["shot", "capture", "calibration", "keypoints", "landmarks"]
LANDMARKS = (".trc", ".c3d")


def file_kind(path: Path | str) -> Kind:
    """Return whether a file is a shot file, a capture of L-frame and wand, 2D keypoints or 3D landmarks; any other file
    is taken for a calibration.

    Raises
    ------
    KFMocapError
        A TOML file cannot be read.
    """
    path = Path(path)
    ending = path.suffix.lower()
    if ending in LANDMARKS:
        return "landmarks"
    if ending != ".toml":
        return "keypoints" if ending == ".json" and _has_people(path) else "calibration"
    return document_kind(read_toml(path, "the file", KFMocapError)) or "calibration"


def _has_people(path: Path) -> bool:
    try:
        with reading(path, "keypoints", KeypointError):
            return people(json.loads(read_bytes(path, "the file", KeypointError))) is not None
    except KeypointError:
        return False
