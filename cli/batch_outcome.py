"""What became of the shots of a batch, kept in a file each so that the next run knows."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np

from ..core.runtime.output_files.files import write_json

STATUS = "status"
"""The folder, beside those of the results, that contains the outcome of every shot."""


class ShotState(StrEnum):
    """Whether a shot of a batch has results: REFUSED if its input cannot be used, FAILED for other reasons."""

    DONE = "done"
    REFUSED = "bad input"
    FAILED = "failed"


@dataclass(frozen=True)
class ShotOutcome:
    """The outcome of a shot.

    Attributes
    ----------
    name : str
        Name of the shot, and of the folder with its results.
    file : str
        The shot file.
    state : str
        A `ShotState`.
    digest : str
        Checksum of everything that the results depend on; see `shot_digest`.
    expected_error : float or None
        Mean of the joints' expected errors on all frames, millimetres.
    seconds : float or None
        Computing time.
    warnings : tuple of str
        Warnings in the report.
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
        """Write the outcome into the folder of the batch."""
        (out / STATUS).mkdir(parents=True, exist_ok=True)
        write_json(out / STATUS / f"{self.name}.json", asdict(self))


def outcomes(out: Path) -> list[ShotOutcome]:
    """Read the outcomes in the folder of a batch, sorted by name; those that cannot be read are left out."""
    found = []
    for file in sorted((out / STATUS).glob("*.json")):
        try:
            found.append(_outcome_of(json.loads(file.read_text(encoding="utf-8"))))
        except (OSError, ValueError, TypeError, KeyError, RecursionError):
            continue
    return found


def _outcome_of(values: dict[str, Any]) -> ShotOutcome:
    """Return an outcome from the values written.

    Raises
    ------
    ValueError, TypeError, KeyError
        They are not those of an outcome.
    """
    outcome = ShotOutcome(**values | {"warnings": tuple(values["warnings"])})
    texts = (outcome.name, outcome.file, outcome.state, outcome.digest, outcome.message, *outcome.warnings)
    numbers = [number for number in (outcome.expected_error, outcome.seconds) if number is not None]
    if not all(isinstance(text, str) for text in texts) or not np.isfinite(np.array(numbers, float)).all():
        raise ValueError("a field is not what it should be")
    return outcome
