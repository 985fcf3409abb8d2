"""Calibrate from a capture file and write what comes of it: all of it, or nothing."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path

from ..core.calibration.api import calibrate
from ..core.calibration.calibration_report import write_report
from ..core.calibration.solution import Solution
from ..core.formats.calibration_export import check_kind, export_cameras
from ..core.formats.marker_points import write_marker_points
from ..core.formats.wand_toml import load_wand
from ..core.runtime.progress import Progress
from .track_command import check_output, staged


def run_calibrate(
    wand: Path,
    out: Path,
    report: Path | None = None,
    points: Path | None = None,
    progress: Progress | None = None,
    *,
    kind: str | None = None,
    drift: bool = False,
) -> tuple[Solution, list[Path]]:
    """Calibrate; write the cameras, and if asked for the report's folder and the markers' points.

    Parameters
    ----------
    wand : Path
        The capture file.
    out : Path
        The calibration.
    report : Path, optional
        A folder: made if it is not there.
    points : Path, optional
        A CSV file.
    kind : str, optional
        Of the calibration; by default what its name asks for. See `export_cameras`.
    drift : bool
        Clocks may run faster or slower.

    Returns
    -------
    Solution
    list of Path
        The files written.

    Raises
    ------
    KFMocapError
        A file cannot be read or written, or the capture does not tell where the cameras are.
    """
    check_kind(out, kind)
    check_output(out.parent)
    if report is not None:
        check_output(report)
    solution = calibrate(load_wand(wand), progress, drift=drift)
    files = []
    with nullcontext() if report is None else staged(report) as stage:
        if report is not None and stage is not None:
            write_report(stage, solution)
            files += [report / file.name for file in sorted(stage.iterdir())]
        if points is not None:
            write_marker_points(points, solution.capture)
            files.append(points)
        out.parent.mkdir(parents=True, exist_ok=True)
        export_cameras(out, solution.cameras, kind)
    return solution, [out, *files]
