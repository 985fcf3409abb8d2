"""The report of a calibration: its quality in numbers and pictures."""

from __future__ import annotations

import base64
from collections.abc import Callable, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..capture.calibration_objects import LFRAME_ARMS
from ..formats.html_page import html_page
from ..numerics.arrays import Array
from ..runtime.output_files.files import replacing, unwritable, write_json
from .charts import GREY, INK, Chart, Image, blank, heat_colour, joined_pictures, stacked_pictures, text
from .quality import measured_lengths, quality_numbers

if TYPE_CHECKING:
    from .calibration_result import CalibrationResult


REPORT_FILES = ("report.json", "report.png", "report.html")
"""Names of the report's files."""
_WIDTH = 1200
_MAX_RESIDUAL = 1.0
"""Residual that has the last colour of the scale, pixels."""
_AXES = ((40, 40, 220), (40, 160, 40), (200, 90, 30))
_FRUSTUM_DEPTH = 0.35
_SPACE_HEIGHT = 420


def write_report(folder: Path, solution: CalibrationResult) -> list[Path]:
    """Write report.json (the numbers), report.png (the pictures) and report.html (both) into a folder, and name them.

    Raises
    ------
    OutputError
        The folder or a file cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise unwritable(folder, error, "cannot be made") from error
    numbers, picture = quality_numbers(solution), sheet(solution)
    png = cv2.imencode(".png", picture)[1].tobytes()
    files = [folder / name for name in REPORT_FILES]
    write_json(files[0], numbers)
    for file, content in zip(files[1:], (png, page(numbers, png).encode()), strict=True):
        with replacing(file) as temporary:
            temporary.write_bytes(content)
    return files


def page(numbers: Mapping[str, Any], png: bytes) -> str:
    """Return the numbers and a picture as one self-contained HTML page."""
    findings = "".join(f'<p class="warning">{escape(_sentence(f))}</p>' for f in numbers["findings"])
    picture = base64.b64encode(png).decode()
    cameras = {str(camera["camera"]): _flat(camera) for camera in numbers["cameras"]}
    rest = _flat({key: value for key, value in numbers.items() if key not in ("cameras", "findings")})
    return html_page(
        "Calibration",
        f"{findings}{_table(cameras)}{_table({'': rest})}"
        f'<img alt="Residuals, coverage, lengths and cameras" src="data:image/png;base64,{picture}">',
    )


def _sentence(finding: Mapping[str, Any]) -> str:
    place = f"{finding['where']}: " if finding.get("where") else ""
    return f"{place}{finding['what']} ({finding['todo']})."


def _flat(values: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    """Return nested values as a flat mapping, with the keys on the way joined."""
    flat: dict[str, Any] = {}
    for key, value in values.items():
        if isinstance(value, Mapping):
            flat |= _flat(value, f"{before}{key} ")
        elif key != "camera":
            flat[f"{before}{key}"] = value
    return flat


def _table(columns: Mapping[str, Mapping[str, Any]]) -> str:
    """Return an HTML table with a column for each mapping and a row for each key."""
    keys = list(dict.fromkeys(key for column in columns.values() for key in column))
    head = "".join(f"<th>{escape(name)}</th>" for name in columns)
    rows = "".join(
        f"<tr><td>{escape(key.replace('_', ' '))}</td>"
        + "".join(f"<td>{escape(_shown(column.get(key)))}</td>" for column in columns.values())
        + "</tr>"
        for key in keys
    )
    return f"<table><tr><th></th>{head}</tr>{rows}</table>"


def _shown(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, Sequence) and not isinstance(value, str):
        return ", ".join(_shown(item) for item in value)
    return "" if value is None else str(value)


def sheet(solution: CalibrationResult) -> Image:
    """Draw all pictures on one sheet: coverage and residuals of every camera, histograms, the scene from two sides.

    Returns
    -------
    ndarray of uint8, shape (h, w, 3)
        Blue, green, red.
    """
    names = list(solution.cameras)
    pictures = [_coverage(solution, c, name, _WIDTH // min(len(names), 4)) for c, name in enumerate(names)]
    rows = [joined_pictures(pictures[k : k + 4]) for k in range(0, len(pictures), 4)]
    half = _WIDTH // 2
    histograms = joined_pictures([_residuals(solution, names, half), _lengths(solution, half)])
    views = joined_pictures([_space(solution, view, half) for view in (_from_above, _from_aside)])
    return stacked_pictures([*rows, histograms, views])


def _wand_residuals(solution: CalibrationResult) -> Array:
    """Return the lengths of the wand's residuals, pixels."""
    return np.asarray(np.linalg.norm(solution.residual[: len(solution.seen)], axis=1))


def _coverage(solution: CalibrationResult, c: int, name: str, width: int) -> Image:
    """Draw where in its picture a camera saw the wand, coloured by residual."""
    size = np.array(solution.rig.sizes[c], float)
    scale = (width - 12) / size[0]
    picture = blank(width, round(size[1] * scale) + 34)
    own = solution.seen.camera == c
    off = _wand_residuals(solution)[own]
    low = np.array([6, 28])
    cv2.rectangle(picture, low, (low + size * scale).astype(int), GREY, 1)
    for uv, distance in zip(solution.seen.uv[own], off, strict=True):
        cv2.circle(picture, (low + uv * scale).astype(int), 2, heat_colour(distance / _MAX_RESIDUAL), -1, cv2.LINE_AA)
    median = f"{np.median(off):.2f} px" if len(off) else "not used"
    text(picture, f"{name}: {len(off)} balls, {median}", (8, 18))
    return picture


def _residuals(solution: CalibrationResult, names: Sequence[str], width: int) -> Image:
    """Draw a histogram of the residuals of every camera."""
    off, most = _wand_residuals(solution), 2 * _MAX_RESIDUAL
    edges = np.linspace(0, most, 41)
    shares = []
    for c in range(len(names)):
        counts = np.histogram(np.minimum(off[solution.seen.camera == c], most), edges)[0]
        shares.append(counts / max(counts.sum(), 1))
    chart = Chart(width, 300, (0, most), (0, float(np.max(shares, initial=0.01))), "Reprojection, px")
    for c, name in enumerate(names):
        colour = heat_colour(c / max(len(names) - 1, 1))
        chart.line((edges[1:] + edges[:-1]) / 2, shares[c], colour)
        text(chart.picture, name, (width - 90, 46 + 18 * c), colour)
    return chart.picture


def _lengths(solution: CalibrationResult, width: int) -> Image:
    """Draw a histogram of the wand's length between its triangulated ends."""
    lengths = measured_lengths(solution.rig, solution.seen, solution.wand.frames)
    off = 1000 * (lengths - solution.wand.length)
    span = max(1.0, float(np.percentile(np.abs(off), 98)) if len(off) else 1.0)
    counts, edges = np.histogram(off, np.linspace(-span, span, 41))
    title = f"Wand's length less {1000 * solution.wand.length:g} mm"
    if len(off):
        title += f": {np.median(off):+.2f}, spread {off.std():.2f}"
    chart = Chart(width, 300, (-span, span), (0, max(1.0, float(counts.max(initial=1)))), title)
    chart.bars(edges, counts, (170, 120, 60))
    return chart.picture


def _from_above(points: Array) -> Array:
    return points[..., :2] * [1, -1]


def _from_aside(points: Array) -> Array:
    """Project points obliquely from above, without perspective."""
    turn, tilt = np.radians(30), np.radians(22)
    x = np.cos(turn) * points[..., 0] + np.sin(turn) * points[..., 1]
    away = -np.sin(turn) * points[..., 0] + np.cos(turn) * points[..., 1]
    return np.stack([x, -np.cos(tilt) * points[..., 2] - np.sin(tilt) * away], axis=-1)


def _space(solution: CalibrationResult, view: Callable[[Array], Array], width: int) -> Image:
    """Draw the cameras, the wand's path and the L-frame in a projection."""
    frusta = {name: _frustum(camera) for name, camera in solution.cameras.items()}
    everything = view(np.concatenate([*frusta.values(), solution.wand.ends_world.reshape(-1, 3), np.zeros((1, 3))]))
    low, high = everything.min(axis=0), everything.max(axis=0)
    scale = float(np.min((np.array([width, _SPACE_HEIGHT]) - [130, 50]) / np.maximum(high - low, 1e-6)))
    picture = blank(width, _SPACE_HEIGHT)

    def at(points: Array) -> NDArray[np.int32]:
        return np.asarray(
            ((view(points) - (low + high) / 2) * scale + [width / 2 - 25, _SPACE_HEIGHT / 2]).round().astype(np.int32)
        )

    for a, b in at(solution.wand.ends_world):
        cv2.line(picture, a, b, (215, 200, 190), 1, cv2.LINE_AA)
    for point in at(solution.wand.ends_world.reshape(-1, 3)):
        cv2.circle(picture, point, 1, (170, 120, 60), -1, cv2.LINE_AA)
    for axis, colour in zip(0.5 * np.eye(3), _AXES, strict=True):
        start, end = at(np.stack([np.zeros(3), axis]))
        cv2.arrowedLine(picture, start, end, colour, 2, cv2.LINE_AA, tipLength=0.15)
    for start, end in at(solution.lframe_world[np.array(LFRAME_ARMS)]):
        cv2.line(picture, start, end, INK, 1, cv2.LINE_AA)
    for name, corners in frusta.items():
        tip, *rest = at(corners)
        cv2.polylines(picture, [np.array(rest)], True, INK, 1, cv2.LINE_AA)
        for corner in rest:
            cv2.line(picture, tip, corner, INK, 1, cv2.LINE_AA)
        text(picture, name, tuple(tip + [6, -6]))
    return picture


def _frustum(camera: Any) -> Array:
    """Return a camera's centre and the corners of its picture at some distance, world frame, metres, shape (5, 3)."""
    width, height = camera.size
    corners = np.array([[0, 0, 1], [width, 0, 1], [width, height, 1], [0, height, 1]], float)
    rays = corners @ np.linalg.inv(camera.matrix).T
    R, _ = camera.pose(0)
    centre = camera.centre_world()
    return np.concatenate([centre[None], centre + _FRUSTUM_DEPTH * rays @ R])
