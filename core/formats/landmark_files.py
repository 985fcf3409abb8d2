"""3D landmarks from TRC and C3D files, by the names of a body's landmarks."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from ..body import Body
from ..errors import LandmarkError
from .c3d import read_c3d
from .keypoint_layouts import landmark_of
from .trc import Landmarks, read_trc


def read_landmarks(path: Path | str, up: str = "auto") -> Landmarks:
    """Read a TRC or a C3D file, according to its ending; `up` as in `read_c3d`.

    Raises
    ------
    LandmarkError
        It is neither, or cannot be read.
    """
    ending = Path(path).suffix.lower()
    if ending == ".c3d":
        return read_c3d(path, up)
    if ending == ".trc":
        return read_trc(path)
    raise LandmarkError(f"unknown ending '{ending}'", where=str(path), todo="landmarks are .trc or .c3d files")


def landmarks_of(body: Body, found: Landmarks, where: str) -> Landmarks:
    """Return those landmarks of a file that a body has, under the body's names.

    Names in the file may differ in case, have a prefix such as "subject:", or be spelled out as in "left_shoulder".

    Parameters
    ----------
    body : Body
    found : Landmarks
    where : str
        The file, for error messages.

    Raises
    ------
    LandmarkError
        There are fewer than three.
    """
    own = {name.lower(): name for name in body.landmarks}
    columns: dict[str, int] = {}
    for i, label in enumerate(found.names):
        plain = label.split(":")[-1].strip()
        name = own.get(plain.lower()) or own.get(landmark_of(plain).lower())
        if name is not None:
            columns.setdefault(name, i)
    if len(columns) < 3:
        what = f"only {len(columns)} of its landmarks are the body's; it has {', '.join(found.names[:12])} ..."
        raise LandmarkError(what, where=where, todo=f"name them {', '.join(list(body.landmarks)[:8])} ...")
    return replace(found, names=tuple(columns), points_world=found.points_world[:, list(columns.values())])
