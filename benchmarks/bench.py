"""`kfmocap bench`: measure every case in a process of its own and print what came out as tables."""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
from collections.abc import Iterator, Sequence
from importlib import metadata
from pathlib import Path
from statistics import median
from typing import Any

from ..cli.example_footage import example_folder
from ..core.errors import FootageError, KFMocapError
from ..core.runtime.files import check_writable, staged
from . import tables
from .rows import CONVERGENCE, ROWS, Case, cases

_LIBRARIES = ("numpy", "scipy", "opencv-python-headless")
_ERRORS = (
    "Mean error of the joints on frames without a key pose, in mm. The last two columns are curves through the same "
    "key poses that do not use the footage:"
)
_TIMES = (
    "Seconds by stage (some stages overlap; the total runs from reading the shot file to the finished motion), frames "
    "of all cameras per second of the total, peak memory, and iterations (or sweeps) per segment between two key poses:"
)
_CONVERGENCE = (
    f"Convergence, {CONVERGENCE.shot} with {len(CONVERGENCE.cameras)} cameras and key poses at "
    f"{' '.join(map(str, CONVERGENCE.keyframes))}; after 0 sweeps the relaxation is at its initial solution:"
)


def run(out: Path | None = None, *, shot: str | None = None, quick: bool = False, repeat: int = 1) -> int:
    """Measure the cases and print the tables.

    Parameters
    ----------
    out : Path, optional
        Folder for bench.md and bench.json; made if it does not exist.
    shot : str, optional
        Measure only this example.
    quick : bool
        Measure only the quick rows.
    repeat : int
        Number of runs of each case; times are their medians.

    Returns
    -------
    int
        0 when every case that could be measured was. Footage that cannot be downloaded is reported and left out.

    Raises
    ------
    KFMocapError
        There is no such example, or the folder cannot be written.
    """
    if repeat < 1:
        raise KFMocapError(f"it is {repeat}", where="--repeat", todo="at least 1")
    if shot is not None and shot not in (known := sorted({row.shot for row in ROWS})):
        raise KFMocapError(f"there is no '{shot}'", where="--shot", todo=f"there are {', '.join(known)}")
    if out is not None:
        check_writable(out)
    results = measured(cases(shot, quick), repeat)
    text = summary(results)
    print(text)
    if out is not None:
        write(out, text, results)
    return 0 if results and not any("error" in result for result in results) else 1


def write(out_dir: Path, text: str, results: Sequence[tables.Result]) -> None:
    """Write bench.md and, with what it was measured on, bench.json."""
    versions = {name: metadata.version(name) for name in _LIBRARIES}
    document = {"machine": machine(), "versions": versions, "cases": results}
    with staged(out_dir) as stage:
        (stage / "bench.md").write_text(text + "\n", encoding="utf-8")
        (stage / "bench.json").write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")


def measured(wanted: Sequence[Case], repeat: int) -> list[tables.Result]:
    """Measure cases one after the other, with a line about each on standard error."""
    results = []
    for case, folder in _with_footage(wanted):
        _say(f"{len(results) + 1} of {len(wanted)}: {_title(case)} ...")
        results.append(case.as_json() | _repeated(case, folder, repeat))
        _say(_outcome(results[-1]))
    return results


def _with_footage(wanted: Sequence[Case]) -> Iterator[tuple[Case, Path]]:
    """Cases with the folder of their shot; those without footage are left out, and that is said."""
    folders: dict[str, Path | None] = {}
    for case in wanted:
        name = case.row.shot
        if name not in folders:
            try:
                folders[name] = example_folder(name)
            except FootageError as error:
                folders[name] = None
                _say(f"{name} is left out, its footage could not be had: {' '.join(str(error).split())}")
        if (folder := folders[name]) is not None:
            yield case, folder


def _repeated(case: Case, folder: Path, repeat: int) -> dict[str, Any]:
    """What a case measured, its times and memory as medians over runs; or its error."""
    runs = [measured_alone(case, folder) for _ in range(repeat)]
    failed = [run for run in runs if "error" in run]
    if failed:
        return failed[0]
    seconds = {stage: median(run["seconds"][stage] for run in runs) for stage in runs[0]["seconds"]}
    memory = None if runs[0]["memory"] is None else median(run["memory"] for run in runs)
    return runs[0] | {"seconds": seconds, "memory": memory}


def measured_alone(case: Case, folder: Path) -> dict[str, Any]:
    """Measure a case in a process of its own, so that its memory and times are nobody else's."""
    command = [sys.executable, "-m", f"{__package__}.case", json.dumps(case.as_json()), str(folder)]
    threads = {f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL")}
    process = subprocess.run(command, env=os.environ | threads, capture_output=True, text=True, check=False)
    if process.returncode:
        return {"error": (process.stderr.strip().splitlines() or ["it ended without a message"])[-1]}
    return json.loads(process.stdout.splitlines()[-1])


def summary(results: Sequence[tables.Result]) -> str:
    """All tables, each under a line that says what it is."""
    parts = [f"Measured with {machine()}.", _ERRORS, tables.errors(results), _TIMES, tables.times(results)]
    if any(result["sweeps"] is not None for result in results):
        parts += [_CONVERGENCE, tables.convergence(results)]
    return "\n\n".join(parts) if results else "Nothing could be measured."


def machine() -> str:
    """What the times depend on."""
    return f"{os.cpu_count()} cores, {platform.system()} {platform.machine()}, Python {platform.python_version()}"


def _title(case: Case) -> str:
    row = case.row
    sweeps = "" if case.sweeps is None else f", {case.sweeps} sweeps"
    keys = " ".join(map(str, row.keyframes)) or "none"
    given = ", keypoints" if row.keypoints else ""
    return f"{row.shot}, {'+'.join(row.cameras)}, key frames {keys}{given}, {case.solver}{sweeps}"


def _outcome(result: tables.Result) -> str:
    if "error" in result:
        return f"    failed: {result['error']}"
    return f"    {result['score']['mean']:.1f} mm, {result['seconds']['total']:.1f} s"


def _say(text: str) -> None:
    print(f"kfmocap bench: {text}", file=sys.stderr, flush=True)
