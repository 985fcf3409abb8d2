"""All solvers, by the names that the settings of a shot use (`core.choices.SOLVERS`)."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from . import gauss_newton_solver
from .paper_relaxation import relaxation
from .plants import standing_feet
from .protocol import Solver

GAUSS_NEWTON = Solver(
    gauss_newton_solver.solved,
    refine=gauss_newton_solver.refined,
    resume=gauss_newton_solver.resumed,
    settle=standing_feet.with_standing_feet,
    uses_keypoints=True,
    uses_foreground=True,
    uses_holds=True,
)
"""Gauss-Newton over all poses of a segment at once; where the images cast doubt on the result, from several starts."""
RELAXATION = Solver(
    relaxation.relaxed,
    refine=None,
    resume=None,
    settle=None,
    uses_keypoints=False,
    uses_foreground=False,
    uses_holds=False,
)
"""The relaxation of paper 1, which uses image gradients between neighbouring frames alone.

It takes only the key poses from its start and ignores the motion beside the segment, so refining would repeat the
solve.
"""

REGISTRY: Mapping[str, Solver] = MappingProxyType({"gauss-newton": GAUSS_NEWTON, "relaxation": RELAXATION})


def solver_named(name: str) -> Solver:
    """Return the solver with a name of `core.choices.SOLVERS`."""
    return REGISTRY[name]
