"""What a file that somebody hands us is."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from ..errors import KFMocapError
from .tables import read_toml

Kind = Literal["shot", "capture", "calibration"]
_CAPTURE = {"lframe", "wand"}


def file_kind(path: Path | str) -> Kind:
    """Whether a file is a shot, a capture of L-frame and wand, or else may be a calibration.

    Raises
    ------
    KFMocapError
        A TOML file cannot be read.
    """
    path = Path(path)
    if path.suffix.lower() != ".toml":
        return "calibration"
    document = read_toml(path, "the file", KFMocapError)
    if "shot" in document:
        return "shot"
    return "capture" if document.keys() >= _CAPTURE else "calibration"
