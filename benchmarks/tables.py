"""Results as Markdown tables that are readable on a terminal, too."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import zip_longest
from statistics import fmean
from typing import Any

Result = dict[str, Any]
"""A case's values and measurements, as in bench.json."""
Row = tuple[str, ...]
MANY = 16
"""Number of iterations up to which all are shown."""


def markdown(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table with cells padded to their column's width and numbers aligned right."""
    rows = [list(row) for row in rows]
    numbers = [all(re.fullmatch(r"[0-9.]*|-", row[c]) for row in rows) for c in range(len(heads))]
    widths = [max(len(row[c]) for row in [list(heads), *rows]) for c in range(len(heads))]

    def line(cells: Sequence[str]) -> str:
        padded = [c.rjust(w) if n else c.ljust(w) for c, w, n in zip(cells, widths, numbers, strict=True)]
        return f"| {' | '.join(padded)} |"

    rule = [f"{'-' * (w - 1)}:" if n else "-" * w for w, n in zip(widths, numbers, strict=True)]
    return "\n".join([line(heads), f"| {' | '.join(rule)} |", *map(line, rows)])


def errors(results: Sequence[Result]) -> str:
    """Return the table of mean joint errors, millimetres, of both solvers and of curves through the key poses alone."""
    by_row: dict[Row, dict[str, Result]] = {}
    for result in defaults(results):
        by_row.setdefault(_row(result), {})[result["solver"]] = result
    heads = ("shot", "cameras", "key frames", "Gauss-Newton", "relaxation", "Blender's curves", "spline")
    rows = []
    for row, found in by_row.items():
        either = next((r for r in found.values() if "error" not in r), None)
        solved = [_number(found.get(s), lambda r: r["score"]["mean"]) for s in ("gauss-newton", "relaxation")]
        rows.append([*row, *solved, *(_number(either, lambda r, c=c: r[c]) for c in ("blender", "spline"))])
    return markdown(heads, rows)


def judged(results: Sequence[Result], halves: Mapping[str, str]) -> str:
    """Return the table of errors on the set of shots, half by half, with baselines, and a column for changed
    settings.
    """
    plain = [result for result in results if not result["settings"]]
    again = {_row(result): result for result in results if result["settings"]}
    heads = ["half", "shot", "cameras", "fps", "key frames", "mm", "worst joint", "spline", "triangulated"]
    heads += ["90 %", "plants, %"]
    rows = []
    for result in sorted(plain, key=lambda r: halves[r["shot"]]):
        shot, cameras, keys = _row(result)
        kept = result if result["keyframes"] else None
        cells = [halves[shot], shot, cameras, _number(result, lambda r: r["fps"], 0), keys]
        cells += [_number(result, lambda r: r["score"]["mean"]), _worst(result)]
        cells += [_number(kept, lambda r: r["spline"]), _number(result, lambda r: r["triangulated"])]
        cells.append(_number(result, lambda r: 100 * r["cover"], 0))
        cells.append(_number(result, lambda r: r["plants"] and 100 * r["plants"]))
        rows.append(cells + [_number(again.get(_row(result)), lambda r: r["score"]["mean"])] * bool(again))
    if again:
        heads.append(" ".join(f"{k} = {v}" for k, v in next(iter(again.values()))["settings"].items()))
    return markdown(heads, rows)


HARD = 40.0
"""Error of the spline, mm, from which a row is compared with it."""


def halves(results: Sequence[Result], half_of: Mapping[str, str]) -> str:
    """Return the table of both halves of the set: mean errors by kind of input, and their ratios to the baselines."""
    heads = ("half", "given", "settings", "rows", "mm", "of the spline", "of the triangulated", "90 %")
    groups: dict[Row, list[Result]] = {}
    for result in results:
        if "error" not in result:
            given = "key poses" if result["keyframes"] else "keypoints"
            given += ", keypoints" if result["keyframes"] and result["keypoints"] else ""
            groups.setdefault(
                (given, "changed" if result["settings"] else "default", half_of[result["shot"]]), []
            ).append(result)
    rows = []
    for (given, settings, half), found in sorted(groups.items()):
        errors = [r["score"]["mean"] for r in found]
        hard = [r["score"]["mean"] / r["spline"] for r in found if r["keyframes"] and r["spline"] > HARD]
        seen = [r["score"]["mean"] / r["triangulated"] for r in found if r["triangulated"]]
        ratios = [f"{fmean(values):.2f}" if values else "-" for values in (hard, seen)]
        cover = f"{100 * fmean(r['cover'] for r in found):.0f}"
        rows.append([half, given, settings, str(len(found)), f"{fmean(errors):.1f}", *ratios, cover])
    return markdown(heads, rows)


def _worst(result: Result) -> str:
    """Return the joint with the largest error, and this error, mm."""
    if "error" in result:
        return "-"
    name, error = max(result["score"]["per_landmark"].items(), key=lambda item: item[1])
    return f"{name} {error:.0f}"


def times(results: Sequence[Result]) -> str:
    """Return the table of seconds by stage, speed, memory and iterations of every case."""
    stages = list(dict.fromkeys(s for r in defaults(results) for s in r.get("seconds", {}) if s != "total"))
    heads = ("shot", "cameras", "key frames", "solver", *stages, "total", "camera-frames/s", "MB", "iterations")
    rows = []
    for result in defaults(results):
        seconds = [_number(result, lambda r, s=s: r["seconds"].get(s)) for s in (*stages, "total")]
        speed = _number(result, lambda r: r["camera_frames"] / r["seconds"]["total"])
        memory = _number(result, lambda r: r["memory"] and r["memory"] / 1e6, 0)
        iterations = _number(result, lambda r: sum(r["iterations"]) / len(r["iterations"]), 0)
        rows.append([*_row(result), result["solver"], *seconds, speed, memory, iterations])
    return markdown(heads, rows)


def convergence(results: Sequence[Result]) -> str:
    """Return the table of errors after each iteration of Gauss-Newton, and after some sweeps of the relaxation."""
    watched = [result for result in results if result.get("way")]
    newton = [result["way"] for result in watched if result["solver"] == "gauss-newton"]
    left = [(str(i), f"{way[i]:.1f}") for way in newton[:1] for i in _some(len(way))]
    right = _sweeps([result for result in watched if result["solver"] == "relaxation"])
    heads = ("Gauss-Newton iterations", "error, mm", "relaxation sweeps", "error, mm", "seconds")
    return markdown(heads, [[*a, *b] for a, b in _side_by_side(left, right)])


def _some(count: int) -> list[int]:
    """Return which iterations are shown: all of up to `MANY`, else the first ones, every tenth and the last."""
    return [i for i in range(count) if count <= MANY or i < MANY // 4 or i % 10 == 0 or i == count - 1]


def _sweeps(results: Sequence[Result]) -> list[Row]:
    results = sorted(results, key=lambda r: r["iterations"][0])
    lines = [(str(r["iterations"][0]), f"{r['score']['mean']:.1f}", f"{r['seconds']['total']:.1f}") for r in results]
    # The run with the fewest sweeps evaluates the gradients once, around the initial solution.
    return [("0", f"{results[0]['before_last']:.1f}", "-"), *lines] if results else []


def _side_by_side(left: Sequence[Row], right: Sequence[Row]) -> Iterator[tuple[Row, Row]]:
    """Generate the rows of both, the shorter one padded with empty cells."""
    empty = ("",) * 2, ("",) * 3
    return ((a or empty[0], b or empty[1]) for a, b in zip_longest(left, right))


def defaults(results: Sequence[Result]) -> list[Result]:
    """Return the results with the default settings."""
    return [result for result in results if result["sweeps"] is None]


def _row(result: Result) -> Row:
    cameras = result["cameras"]
    named = str(len(cameras)) if len(cameras) > 2 else "+".join(cameras)
    keys = " ".join(map(str, result["keyframes"])) or "none"
    return result["shot"], named, f"{keys}, keypoints" if result["keypoints"] else keys


def _number(result: Result | None, value: Callable[[Result], float | None], digits: int = 1) -> str:
    """Return a measured value as text; a dash if the case failed or has no such value."""
    found = value(result) if result and "error" not in result else None
    return "-" if found is None else f"{found:.{digits}f}"
