"""The rows of the benchmark: sets of cameras and key frames of the example shots."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ..core.choices import BEST_SOLVER, SOLVERS

BEAM = ("cam01", "cam02", "cam03", "cam04")
WALK = ("cam01", "cam02", "cam03")


@dataclass(frozen=True)
class Row:
    """A shot with some of its cameras and with key poses at some frames.

    Attributes
    ----------
    keyframes : tuple of int
        Frame numbers of the footage; empty if key poses are proposed from keypoints.
    keypoints : bool
        Whether 2D keypoints are used.
    quick : bool
        Whether the row is among the few of `--quick`.
    """

    shot: str
    cameras: tuple[str, ...]
    keyframes: tuple[int, ...]
    quick: bool = False
    keypoints: bool = False

    @property
    def solvers(self) -> tuple[str, ...]:
        """Solvers that can use everything in the row."""
        return (BEST_SOLVER,) if self.keypoints else tuple(SOLVERS)


CONVERGENCE = Row("beam", BEAM, (0, 33, 66, 99), quick=True)
"""The row on which the convergence of both solvers is measured."""
ROWS = (
    Row("beam", BEAM, (0, 20, 40, 60, 80, 99)),
    CONVERGENCE,
    Row("beam", BEAM, (0, 50, 99)),
    Row("beam", BEAM, (0, 99)),
    Row("beam", BEAM, (0, 99), keypoints=True),
    Row("beam", BEAM, (), keypoints=True),
    Row("beam", ("cam01", "cam03"), (0, 33, 66, 99)),
    Row("beam", ("cam01",), (0, 20, 40, 60, 80, 99)),
    Row("beam", ("cam01",), (0, 33, 66, 99), quick=True),
    Row("beam", ("cam01",), (0, 33, 66, 99), keypoints=True),
    Row("walk", WALK, (0, 20, 39, 59), quick=True),
    Row("walk", ("cam01", "cam02"), (0, 20, 39, 59)),
    Row("walk", ("cam01",), (0, 20, 39, 59), quick=True),
)
SWEEPS = (5, 50, 500)
"""Numbers of sweeps of the relaxation on that row; the last is the default."""


@dataclass(frozen=True)
class Case:
    """A row and how it is solved.

    Attributes
    ----------
    watch : bool
        Whether to measure the error before each iteration, too.
    settings : tuple of (name, value)
        Settings of the tracker that differ from the shot's.
    """

    row: Row
    solver: str
    sweeps: int | None = None
    watch: bool = False
    settings: tuple[tuple[str, Any], ...] = ()

    def as_json(self) -> dict[str, Any]:
        """Plain values."""
        row = self.row
        return {
            "shot": row.shot,
            "cameras": list(row.cameras),
            "keyframes": list(row.keyframes),
            "keypoints": row.keypoints,
            "solver": self.solver,
            "sweeps": self.sweeps,
            "watch": self.watch,
            "settings": dict(self.settings),
        }


def cases(shot: str | None = None, quick: bool = False) -> list[Case]:
    """Return all cases, or those of one shot, or the quick ones."""
    rows = [row for row in ROWS if shot in (None, row.shot) and (row.quick or not quick)]
    found = [Case(row, solver, watch=row == CONVERGENCE) for row in rows for solver in row.solvers]
    if CONVERGENCE in rows and not quick:
        found += [Case(CONVERGENCE, "relaxation", sweeps, watch=True) for sweeps in SWEEPS[:-1]]
    return found
