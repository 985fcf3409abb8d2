"""The solvers by the names that a shot's settings have for them (`core.shot.shot.SOLVERS`)."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from . import leaping_limbs, multi_start, regained_limbs, relaxation, standing_feet
from .protocol import Solver

GAUSS_NEWTON = Solver(
    leaping_limbs.solved,
    regained_limbs.refined,
    multi_start.resumed,
    standing_feet.with_standing_feet,
    uses_keypoints=True,
    uses_foreground=True,
    uses_holds=True,
    refines=True,
)
"""Gauss-Newton over all poses of a segment at once, from several starts where the images leave a doubt."""
RELAXATION = Solver(
    relaxation.relaxed,
    relaxation.relaxed,
    None,
    None,
    uses_keypoints=False,
    uses_foreground=False,
    uses_holds=False,
    refines=False,
)
"""The published relaxation, by gradients between neighbouring frames alone. From a start it takes nothing but the key
poses, nor from motion beside the segment: refining would solve anew."""

REGISTRY: Mapping[str, Solver] = MappingProxyType({"gauss-newton": GAUSS_NEWTON, "relaxation": RELAXATION})


def solver_named(name: str) -> Solver:
    """Return the solver with a name of `core.shot.shot.SOLVERS`."""
    return REGISTRY[name]
