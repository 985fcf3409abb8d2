"""Cameras refined from key poses, as a command: from a shot file to a calibration. Needs no Blender."""

from __future__ import annotations

from pathlib import Path

from ..core.fitting.camera_refinement import Refinement, refine_cameras
from ..core.formats import load_shot
from ..core.formats.calibration_export import check_kind, export_cameras
from ..core.formats.shot_toml import load_shot_cameras
from ..core.runtime.progress import Progress
from .track_command import check_output


def refine_shot(shot_path: Path, out: Path, progress: Progress | None = None, *, kind: str | None = None) -> Refinement:
    """Refine the cameras of a shot file's views and write them with the others of its calibration.

    Parameters
    ----------
    shot_path, out : Path
    progress : callable, optional
    kind : str, optional
        Of the calibration; by default what its name asks for. See `export_cameras`.

    Raises
    ------
    KFMocapError
        See `load_shot` and `refine_cameras`; nothing was written then.
    OutputError
        The calibration cannot be written; seen before the work where it can be.
    """
    check_kind(out, kind)
    check_output(out.parent)
    cameras = load_shot_cameras(shot_path)
    refinement = refine_cameras(load_shot(shot_path), progress)
    export_cameras(out, cameras | refinement.cameras, kind)
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
