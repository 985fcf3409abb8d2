"""One shot of a batch: its inputs, tracking it in a separate process, and its outcome."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import fmean
from typing import Any

from ..core.formats.shot_toml import read_shot_spec
from ..core.review.report_text import report_lines
from ..core.runtime.program_version import program_version
from ..core.runtime.progress import Progress
from ..core.runtime.timing import Seconds
from ..core.shot.fingerprint import checksum, file_bytes
from ..core.tracking.prepare import load_shot
from ..core.tracking.results.journal import journal_beside
from .services import BlenderSession
from .tracked_files import ResultFiles, check_shot_kept, run_track


@dataclass(frozen=True)
class BatchOptions:
    """Options for all shots of a batch.

    Attributes
    ----------
    solver : str, optional
        By default the one in each shot file.
    load_blender : callable, optional
        See `Services`; None leaves out the files that need Blender.
    threads : int
        Number of threads for shots whose file does not state one.
    """

    solver: str | None
    load_blender: Callable[[], BlenderSession] | None
    threads: int


def track_shot(path: Path, out: Path, options: BatchOptions, progress: Progress) -> dict[str, Any]:
    """Track a shot into a folder; returns the report's values for the fields of `ShotOutcome`."""
    check_shot_kept(read_shot_spec(path), out)
    seconds = Seconds()
    with seconds.measure("shot"):
        shot = load_shot(path, solver=options.solver)
    if shot.settings.threads is None:
        shot = replace(shot, settings=replace(shot.settings, threads=options.threads))
    blender = None if options.load_blender is None else options.load_blender()
    with journal_beside(out, resume=True) as journal:
        run_track(shot, out, ResultFiles(blender, seconds=seconds), progress=progress, journal=journal)
    report = json.loads((out / "report.json").read_text(encoding="utf-8"))
    errors = [error for performer in report["performers"] for error in performer["expected_error"] if error is not None]
    return {
        "expected_error": round(fmean(errors), 1) if any(errors) else None,
        "seconds": report["seconds_total"],
        "warnings": tuple(report_lines(report)),
    }


def shot_digest(path: Path, options: BatchOptions) -> str:
    """Return a checksum of everything that a shot's results depend on: its files, the options, the program's version.

    Small files are included completely, footage by its size and samples.

    Raises
    ------
    InputError
        The shot file cannot be read.
    """
    spec = read_shot_spec(path)
    asked = repr((options.solver, options.load_blender is None, program_version())).encode()
    return checksum([asked], *map(file_bytes, (path, *spec.files())))
