"""`kfmocap bench`: measure every case in its own process and print the results as tables."""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import fields, replace
from importlib import metadata
from pathlib import Path
from statistics import median
from typing import Any

from ..cli.example_footage import example_folder
from ..cli.services import BenchmarkRequest
from ..core.errors import FootageError, KFMocapError
from ..core.runtime.output_files.files import check_writable, replacing, staged
from ..core.shot.settings import Settings
from . import tables
from .corrections import measure_corrections
from .rows import CONVERGENCE, ROWS, Case, cases
from .shot_set import JudgedShot, judged_shots
from .speed import measure_speed

_SHOTS = (
    "Mean error of the joints on frames without a key pose, in mm; the worst joint; a spline through the same key "
    "poses; the detector's keypoints triangulated and low-passed; and the share of joints within the 90 % interval "
    "of their expected error:"
)
_HALVES = (
    "Both halves: means over the rows above. One half decides about the tracker's constants, the other only "
    "reports. Ratios are to the spline, where that is off by more than 40 mm, and to the triangulated detector:"
)
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


def run(request: BenchmarkRequest) -> int:
    """Measure the cases and print the tables.

    Returns
    -------
    int
        0 if all cases succeeded, apart from those whose footage cannot be downloaded: these are reported and left out.

    Raises
    ------
    KFMocapError
        There is no such shot or setting, the shots cannot be rendered, or the folder cannot be written.
    """
    if request.repeat < 1:
        raise KFMocapError(f"it is {request.repeat}", where="--repeat", todo="at least 1")
    changed = changed_settings(request.changed)
    if request.out is not None:
        check_writable(request.out)
    if request.speed:
        return _run_speed(request)
    if request.shots:
        judged = judged_shots(request.shot, request.data)
        results = measured(_judging(judged, changed, request.quick), request.repeat)
        text = summary_of_shots(results, {shot.name: shot.half for shot in judged})
    else:
        results = measured(_with_footage(cases(known_example(request.shot), request.quick)), request.repeat)
        text = summary(results)
    print(text)
    if request.out is not None:
        write(request.out, text, results)
    return 0 if results and not any("error" in result for result in results) else 1


def _run_speed(request: BenchmarkRequest) -> int:
    folder = example_folder("beam")
    if request.out is not None:
        request.out.mkdir(parents=True, exist_ok=True)
    measured_rows = measure_speed(
        folder, repeat=request.repeat, quick=request.quick, out=request.out, against=request.against
    )
    corrected = measure_corrections(folder, repeat=request.repeat)
    text = f"Measured with {machine()}.\n\n{measured_rows}\n\nAfter a key pose was corrected:\n\n{corrected}"
    print(text)
    if request.out is not None:
        with replacing(request.out / "speed.md") as file:
            file.write_text(text + "\n", encoding="utf-8")
    return 0


def known_example(shot: str | None) -> str | None:
    """Return the name of an example that is measured, or None for all.

    Raises
    ------
    KFMocapError
        There is no such example.
    """
    if shot is not None and shot not in (known := sorted({row.shot for row in ROWS})):
        raise KFMocapError(f"there is no '{shot}'", where="--shot", todo=f"there are {', '.join(known)}")
    return shot


def changed_settings(texts: Sequence[str]) -> tuple[tuple[str, Any], ...]:
    """Return names and values of settings, from texts "name=value" with the value as in a shot file.

    Raises
    ------
    KFMocapError
        There is no such setting, or its value cannot be read.
    """
    known = [field.name for field in fields(Settings)]
    found = []
    for text in texts:
        name, _, value = (part.strip() for part in text.partition("="))
        if name not in known:
            raise KFMocapError(f"there is no setting '{name}'", where="--set", todo=f"there are {', '.join(known)}")
        try:
            found.append((name, tomllib.loads(f"value = {value}")["value"]))
        except tomllib.TOMLDecodeError as error:
            raise KFMocapError(f"'{value}' is no value of {name}", where="--set", todo="as in a shot file") from error
    return tuple(found)


def _judging(shots: Sequence[JudgedShot], changed: tuple[tuple[str, Any], ...], quick: bool) -> list[tuple[Case, Path]]:
    """Return the cases of the shots with their folders; each a second time with the changed settings, if any."""
    plain = [(case, shot.folder) for shot in shots for case in shot.cases(quick)]
    again = [(replace(case, settings=changed), folder) for case, folder in plain]
    return plain if not changed else [pair for both in zip(plain, again, strict=True) for pair in both]


def write(out_dir: Path, text: str, results: Sequence[tables.Result]) -> None:
    """Write bench.md and bench.json, which also describes the machine."""
    versions = {name: metadata.version(name) for name in _LIBRARIES}
    document = {"machine": machine(), "versions": versions, "cases": results}
    with staged(out_dir) as stage:
        (stage / "bench.md").write_text(text + "\n", encoding="utf-8")
        (stage / "bench.json").write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")


def measured(wanted: Iterable[tuple[Case, Path]], repeat: int) -> list[tables.Result]:
    """Measure cases, given with their shots' folders, and print a line on each to standard error."""
    results: list[tables.Result] = []
    for case, folder in wanted:
        _say(f"case {len(results) + 1}: {_title(case)} ...")
        results.append(case.as_json() | _repeated(case, folder, repeat))
        _say(_outcome(results[-1]))
    return results


def _with_footage(wanted: Sequence[Case]) -> Iterator[tuple[Case, Path]]:
    """Generate cases with the folder of their shot; those without footage are left out, with a message."""
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
    """Return the measurements of a case, with medians of time and memory over several runs; or its error."""
    runs = [measured_alone(case, folder) for _ in range(repeat)]
    failed = [run for run in runs if "error" in run]
    if failed:
        return failed[0]
    seconds = {stage: median(run["seconds"][stage] for run in runs) for stage in runs[0]["seconds"]}
    memory = None if runs[0]["memory"] is None else median(run["memory"] for run in runs)
    return runs[0] | {"seconds": seconds, "memory": memory}


def measured_alone(case: Case, folder: Path) -> dict[str, Any]:
    """Measure a case in a separate process, so that its memory and times are its own."""
    command = [sys.executable, "-m", f"{__package__}.measured_case", json.dumps(case.as_json()), str(folder)]
    threads = {f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL")}
    process = subprocess.run(command, env=os.environ | threads, capture_output=True, text=True, check=False)
    if process.returncode:
        return {"error": (process.stderr.strip().splitlines() or ["it ended without a message"])[-1]}
    return json.loads(process.stdout.splitlines()[-1])


def summary(results: Sequence[tables.Result]) -> str:
    """Return all tables, each with a heading line."""
    parts = [f"Measured with {machine()}.", _ERRORS, tables.errors(results), _TIMES, tables.times(results)]
    if any(result["sweeps"] is not None for result in results):
        parts += [_CONVERGENCE, tables.convergence(results)]
    return "\n\n".join(parts) if results else "Nothing could be measured."


def summary_of_shots(results: Sequence[tables.Result], halves: Mapping[str, str]) -> str:
    """Return the tables of the set of shots: every row, then both halves."""
    parts = [
        f"Measured with {machine()}.",
        _SHOTS,
        tables.judged(results, halves),
        _HALVES,
        tables.halves(results, halves),
    ]
    return "\n\n".join(parts) if results else "Nothing could be measured."


def machine() -> str:
    """Return a description of the machine."""
    return f"{os.cpu_count()} cores, {platform.system()} {platform.machine()}, Python {platform.python_version()}"


def _title(case: Case) -> str:
    row = case.row
    sweeps = "" if case.sweeps is None else f", {case.sweeps} sweeps"
    keys = " ".join(map(str, row.keyframes)) or "none"
    given = ", keypoints" if row.keypoints else ""
    changed = "".join(f", {name} = {value}" for name, value in case.settings)
    return f"{row.shot}, {'+'.join(row.cameras)}, key frames {keys}{given}, {case.solver}{sweeps}{changed}"


def _outcome(result: tables.Result) -> str:
    if "error" in result:
        return f"    failed: {result['error']}"
    return f"    {result['score']['mean']:.1f} mm, {result['seconds']['total']:.1f} s"


def _say(text: str) -> None:
    print(f"kfmocap bench: {text}", file=sys.stderr, flush=True)
