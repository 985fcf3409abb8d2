"""`kfmocap calibrate`: solve for cameras from a waved wand or from a performer, or refine those of a shot."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from ..core.calibration.api import calibrate
from ..core.calibration.calibration_report import REPORT_FILES, write_report
from ..core.calibration.calibration_result import CalibrationResult
from ..core.calibration.performer.performer_cameras import PerformerCalibration, cameras_of_shot
from ..core.calibration.performer.single_camera import SingleViewCalibration
from ..core.cameras.camera import Camera
from ..core.errors import KFMocapError
from ..core.fitting.camera_fits.camera_refinement import Refinement
from ..core.fitting.shot_cameras import refine_shot_cameras
from ..core.formats.calibrations.calibration_files import export_cameras, format_name, load_cameras
from ..core.formats.marker_points import write_marker_points
from ..core.formats.shot_toml import read_shot_spec
from ..core.formats.wand_toml import capture_files, load_wand
from ..core.runtime.interrupts import results_are_written
from ..core.runtime.output_files.files import check_inputs_kept, replacing, together
from ..core.runtime.progress import Progress
from ..core.shot.shot_spec import ShotSpec
from ..core.tracking.prepare import prepare_shot, read_shot_cameras
from .printed import print_outcome
from .progress_bar import progress_bar
from .services import Services


@dataclass(frozen=True)
class CamerasFile:
    """The calibration to write, and the name of its format; by default that of its ending, see `export_cameras`."""

    path: Path
    kind: str | None = None

    def check(self) -> None:
        """Check that the format is known.

        Raises
        ------
        CalibrationError
            It is not.
        """
        format_name(self.path, self.kind)

    def write(self, temporary: Path, cameras: Mapping[str, Camera] | Sequence[Camera]) -> None:
        """Write cameras under a temporary name."""
        export_cameras(temporary, cameras, self.kind)


def run(args: argparse.Namespace, _services: Services) -> int:
    """Run the command; returns the exit code."""
    out = CamerasFile(args.out, args.format)
    if args.lenses is not None and args.performer is None:
        raise KFMocapError("--lenses applies to --performer only", where="kfmocap calibrate", todo="leave it out")
    if args.wand is not None:
        with progress_bar() as progress:
            solution, files = run_calibrate(
                args.wand, out, report=args.report, points=args.points, progress=progress, drift=args.drift
            )
        lines: Sequence[object] = [*solution.clocks.lines, *solution.findings]
    else:
        if args.report is not None or args.points is not None or args.drift:
            what = "--report, --points and --drift apply to a wand capture only"
            raise KFMocapError(what, where="kfmocap calibrate", todo="leave them out")
        with progress_bar() as progress:
            if args.performer is not None:
                found = calibrate_by_performer(args.performer, out, lenses=args.lenses, progress=progress)
                lines = found.summary_lines
            else:
                refinement = refine_shot(args.refine, out, progress)
                lines = [view.summary for view in refinement.views]
        files = [args.out]
    with results_are_written():
        print_outcome(files, lines)
    return 0


def run_calibrate(
    wand: Path,
    out: CamerasFile,
    *,
    report: Path | None,
    points: Path | None,
    progress: Progress | None,
    drift: bool,
) -> tuple[CalibrationResult, list[Path]]:
    """Calibrate; write the cameras and, if asked for, the report and the detected marker positions.

    Parameters
    ----------
    wand : Path
        The capture file.
    out : CamerasFile
    report : Path or None
        Folder for the report; created if it does not exist.
    points : Path or None
        CSV file for the marker positions.
    progress : callable or None
    drift : bool
        Whether the cameras' clocks may run at different speeds.

    Returns
    -------
    CalibrationResult
    list of Path
        The files written.

    Raises
    ------
    KFMocapError
        A file cannot be read or written, or the capture does not determine the cameras.
    """
    out.check()
    with together() as outputs:
        stage = None if report is None else outputs.folder(report, REPORT_FILES)
        points_file = None if points is None else outputs.file(points, parents=True)
        calibration = outputs.file(out.path, parents=True)
        results = [file for file in (out.path, points) if file is not None]
        capture = load_wand(wand)
        check_inputs_kept(results, [wand, *capture_files(wand)])
        solution = calibrate(capture, progress, drift=drift)
        files = [out.path]
        if report is not None and stage is not None:
            files += [report / file.name for file in write_report(stage, solution)]
        if points is not None and points_file is not None:
            write_marker_points(points_file, solution.capture)
            files.append(points)
        out.write(calibration, solution.cameras)
    return solution, files


def calibrate_by_performer(
    shot_path: Path, out: CamerasFile, *, lenses: Path | None, progress: Progress | None
) -> PerformerCalibration | SingleViewCalibration:
    """Find the cameras of a shot file's views from its performer's 2D keypoints and height, and write them.

    Parameters
    ----------
    shot_path : Path
    out : CamerasFile
        It may be the shot's own calibration: that is not read.
    lenses : Path or None
        A calibration of the same cameras, whose intrinsic parameters are kept.
    progress : callable or None

    Raises
    ------
    KFMocapError
        A file cannot be read or written, or the keypoints do not determine the cameras.
    """
    out.check()
    with replacing(out.path) as calibration:
        spec = read_shot_spec(shot_path)
        _check_shot_kept(spec, out)
        found = cameras_of_shot(spec, {} if lenses is None else load_cameras(lenses), progress)
        out.write(calibration, found.cameras)
    return found


def refine_shot(shot_path: Path, out: CamerasFile, progress: Progress | None) -> Refinement:
    """Refine the cameras of a shot file's views; write them with the other cameras of its calibration.

    Parameters
    ----------
    shot_path : Path
    out : CamerasFile
    progress : callable or None

    Raises
    ------
    KFMocapError
        See `prepare_shot` and `refine_shot_cameras`; nothing is written then.
    OutputError
        The calibration cannot be written; raised before the work begins if possible.
    """
    out.check()
    with replacing(out.path) as calibration:
        spec = read_shot_spec(shot_path)
        _check_shot_kept(spec, out)
        cameras = read_shot_cameras(spec)
        refinement = refine_shot_cameras(prepare_shot(spec), progress)
        out.write(calibration, cameras | refinement.cameras)
    return refinement


def _check_shot_kept(spec: ShotSpec, out: CamerasFile) -> None:
    """Check that the cameras overwrite nothing of a shot but its calibration, which they may replace.

    Raises
    ------
    OutputError
        They would.
    """
    check_inputs_kept([out.path], [spec.path, *(file for file in spec.files() if file != spec.calibration)])
