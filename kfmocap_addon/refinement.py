"""Cameras refined from key poses, as a command: from a shot file to a calibration. Needs no Blender."""

from __future__ import annotations

from pathlib import Path

from ..core.calibration.refine import Refinement, refine_cameras
from ..core.errors import OutputError
from ..core.formats import load_shot, save_cameras
from ..core.formats.shot_toml import load_shot_cameras
from ..core.shot import Progress


def refine_shot(shot_path: Path, out: Path, progress: Progress | None = None) -> Refinement:
    """Refine the cameras of a shot file's views and write them with the others of its calibration.

    Raises
    ------
    KFMocapError
        See `load_shot` and `refine_cameras`; nothing was written then.
    OutputError
        The calibration cannot be written; seen before the work where it can be.
    """
    if out.suffix.lower() != ".toml":
        raise OutputError("a calibration is written as .toml", where=str(out))
    if not out.absolute().parent.is_dir():
        raise OutputError("its folder does not exist", where=str(out))
    cameras = load_shot_cameras(shot_path)
    refinement = refine_cameras(load_shot(shot_path), progress)
    save_cameras(out, cameras | refinement.cameras)
    return refinement


def told(refinement: Refinement) -> list[str]:
    """What became of every camera, a line each."""
    lines = []
    for view in refinement.views:
        if view.lost:
            lines.append(f"{view.camera.name}: left as it was: it does not show the performers where the key poses are")
        else:
            lines.append(
                f"{view.camera.name}: its picture moved by {view.shift:.1f} px, known to {view.deviation:.1f} px"
            )
    return lines
