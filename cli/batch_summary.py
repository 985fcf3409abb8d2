"""The summary table of a batch, as CSV and as HTML."""

from __future__ import annotations

import base64
import csv
from collections.abc import Sequence
from html import escape
from io import StringIO
from pathlib import Path
from urllib.parse import quote

import cv2
import numpy as np

from ..core.formats.html_page import html_page
from ..core.runtime.output_files.files import together
from .batch_outcome import ShotOutcome, ShotState

COLUMNS = ("shot", "state", "expected_error_mm", "seconds", "warnings", "message", "file")
SUMMARY = ("summary.csv", "summary.html")
"""Files of the summary, in the folder of the results."""
_THUMBNAIL = 320


def write_summary(out: Path, outcomes: Sequence[ShotOutcome]) -> list[Path]:
    """Write summary.csv and summary.html into the folder of a batch; returns the files.

    Raises
    ------
    OutputError
        A file cannot be written.
    """
    table = StringIO(newline="")
    writer = csv.writer(table)
    writer.writerow(COLUMNS)
    for outcome in outcomes:
        error, seconds = ("" if n is None else f"{n:.1f}" for n in (outcome.expected_error, outcome.seconds))
        warnings = "; ".join(outcome.warnings)
        writer.writerow([outcome.name, outcome.state, error, seconds, warnings, outcome.message, outcome.file])
    contents = dict(zip(SUMMARY, (table.getvalue(), _page(out, outcomes)), strict=True))
    with together() as outputs:
        for name, content in contents.items():
            outputs.file(out / name).write_text(content, encoding="utf-8", errors="backslashreplace", newline="")
    return [out / name for name in contents]


def _page(out: Path, outcomes: Sequence[ShotOutcome]) -> str:
    done = [outcome for outcome in outcomes if outcome.state == ShotState.DONE]
    head = "".join(f"<th>{name}</th>" for name in ("", "shot", "state", "expected error, mm", "seconds", "remarks"))
    rows = "".join(_row(out, outcome) for outcome in outcomes)
    return html_page(f"{len(done)} of {len(outcomes)} shots", f'<table class="shots"><tr>{head}</tr>{rows}</table>')


def _row(out: Path, outcome: ShotOutcome) -> str:
    name, remarks = escape(outcome.name), "<br>".join(escape(line) for line in outcome.warnings)
    error, seconds = ("" if n is None else f"{n:.1f}" for n in (outcome.expected_error, outcome.seconds))
    if outcome.message:
        remarks = f'<span class="warning">{escape(outcome.message)}</span>'
    return (
        f"<tr><td>{_thumbnail(out, outcome)}</td><td>{name}</td><td>{outcome.state}</td><td>{error}</td>"
        f"<td>{seconds}</td><td>{remarks}</td></tr>"
    )


def _thumbnail(out: Path, outcome: ShotOutcome) -> str:
    """Return a shot's overlay as a thumbnail that links to the full picture."""
    picture = cv2.imdecode(_bytes(out / outcome.name / "overlay.png"), cv2.IMREAD_COLOR)
    if outcome.state != ShotState.DONE or picture is None:
        return ""
    height = max(1, round(picture.shape[0] * _THUMBNAIL / picture.shape[1]))
    small = cv2.resize(picture, (_THUMBNAIL, height), interpolation=cv2.INTER_AREA)
    data = base64.b64encode(cv2.imencode(".jpg", small)[1].tobytes()).decode()
    return (
        f'<a href="{quote(outcome.name)}/overlay.png">'
        f'<img alt="{escape(outcome.name)}" src="data:image/jpeg;base64,{data}"></a>'
    )


def _bytes(file: Path) -> np.ndarray[tuple[int], np.dtype[np.uint8]]:
    """Read a file as bytes; a single zero, which is not a picture, if there is none."""
    try:
        return np.frombuffer(file.read_bytes() or b"\0", np.uint8)
    except OSError:
        return np.zeros(1, np.uint8)
