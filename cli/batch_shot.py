"""One shot of a batch: what it is made of, tracking it in a process of its own, and what came of it."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from importlib import metadata
from pathlib import Path
from statistics import fmean
from typing import Any

import numpy as np

from ..core.formats.shot_toml import read_shot_spec
from ..core.review.track_report import report_lines
from ..core.runtime.files import write_json
from ..core.runtime.progress import Progress
from ..core.runtime.timing import Seconds
from ..core.shot.fingerprint import checksum, file_bytes
from ..core.tracking.journal import journal_beside
from ..core.tracking.prepare import load_shot
from .services import BlenderSession
from .track_command import check_inputs_kept, run_track

DONE, REFUSED, FAILED = "done", "bad input", "failed"
STATUS = "status"
"""The folder, among those of the results, that holds what came of every shot."""


@dataclass(frozen=True)
class ShotOutcome:
    """What came of a shot.

    Attributes
    ----------
    name : str
        The shot's, and that of the folder of its results.
    file : str
        The shot file.
    state : str
        `DONE`, `REFUSED` (the input cannot be used) or `FAILED`.
    digest : str
        Of all that the results depend on; see `shot_digest`.
    expected_error : float or None
        Mean of the joints' expected errors on all frames, millimetres.
    seconds : float or None
        Computing time.
    warnings : tuple of str
        Lines of the report.
    message : str
        Why there are no results.
    """

    name: str
    file: str
    state: str
    digest: str = ""
    expected_error: float | None = None
    seconds: float | None = None
    warnings: tuple[str, ...] = field(default=())
    message: str = ""

    def write(self, out: Path) -> None:
        """Keep it in the folder of the batch."""
        (out / STATUS).mkdir(parents=True, exist_ok=True)
        write_json(out / STATUS / f"{self.name}.json", asdict(self))


@dataclass(frozen=True)
class BatchOptions:
    """How the shots of a batch are tracked.

    Attributes
    ----------
    solver : str, optional
        By default as each shot file says.
    load_blender : callable, optional
        See `Services`; None leaves out the files that need Blender.
    threads : int
        Worker threads for each shot that does not say itself.
    """

    solver: str | None
    load_blender: Callable[[], BlenderSession] | None
    threads: int


def outcomes(out: Path) -> list[ShotOutcome]:
    """Read what came of every shot in the folder of a batch, by name; what cannot be read is left out."""
    found = []
    for file in sorted((out / STATUS).glob("*.json")):
        try:
            found.append(_outcome_of(json.loads(file.read_text(encoding="utf-8"))))
        except (OSError, ValueError, TypeError, KeyError, RecursionError):
            continue
    return found


def _outcome_of(values: dict[str, Any]) -> ShotOutcome:
    """An outcome as it was written.

    Raises
    ------
    ValueError, TypeError, KeyError
        It is not one.
    """
    outcome = ShotOutcome(**values | {"warnings": tuple(values["warnings"])})
    texts = (outcome.name, outcome.file, outcome.state, outcome.digest, outcome.message, *outcome.warnings)
    numbers = [number for number in (outcome.expected_error, outcome.seconds) if number is not None]
    if not all(isinstance(text, str) for text in texts) or not np.isfinite(np.array(numbers, float)).all():
        raise ValueError("a field is not what it should be")
    return outcome


def track_shot(path: Path, out: Path, options: BatchOptions, progress: Progress) -> dict[str, Any]:
    """Track a shot into a folder; returns what its report says, as fields of `ShotOutcome`."""
    check_inputs_kept(read_shot_spec(path), out)
    seconds = Seconds()
    with seconds.measure("shot"):
        shot = load_shot(path, solver=options.solver)
    if shot.settings.threads is None:
        shot = replace(shot, settings=replace(shot.settings, threads=options.threads))
    blender = None if options.load_blender is None else options.load_blender()
    with journal_beside(out, resume=True) as journal:
        run_track(shot, out, blender=blender, progress=progress, seconds=seconds, journal=journal)
    report = json.loads((out / "report.json").read_text(encoding="utf-8"))
    errors = [error for performer in report["performers"] for error in performer["expected_error"] if error is not None]
    return {
        "expected_error": round(fmean(errors), 1) if any(errors) else None,
        "seconds": report["seconds_total"],
        "warnings": tuple(report_lines(report)),
    }


def shot_digest(path: Path, options: BatchOptions) -> str:
    """A text that changes with what the results of a shot depend on: its files, the options, and the program's version.

    Small files count whole, footage by its size and pieces of it.

    Raises
    ------
    InputError
        The shot file cannot be read.
    """
    spec = read_shot_spec(path)
    asked = repr((options.solver, options.load_blender is None, _version())).encode()
    return checksum([asked], *map(file_bytes, (path, *spec.files())))


def _version() -> str:
    try:
        return metadata.version("kfmocap")
    except metadata.PackageNotFoundError:
        return ""
