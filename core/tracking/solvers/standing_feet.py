"""Feet that stand: the points of soles that the evidence lets stand still come to rest.

Which points seem to be planted is found from a motion that was refined without plants. A foot that creeps seems planted
as well, and must not be held. So each plant is tested: what the evidence loses if the point stands still throughout,
beside the least cost that its normal equations allow, is a chi-squared of the plant's steps under their whole
covariance, in which a drift over many frames weighs more than jitter. Plants that fit are then held, all together, on
the same normal equations: pictures do not show the last millimetres, and are not looked at again.

One view alone hardly contradicts a plant. There, what seems planted is kept still in the refinement as well, and
nothing is tested.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtri

from ...body.foot_plants import runs
from ...body.kinematics import part_poses
from ...body.motion import Motion
from ...numerics.arrays import Bools
from ...numerics.banded_blocks import BandedBlocks
from ...numerics.robust_kernels import Quadratic
from .gauss_newton import equations_at, increments_of, moved_by
from .hold_factor import TiedSystems, tied_systems
from .plant_factor import PlantFactor
from .problem import SegmentProblem, SegmentSolution

REFUSED = 0.01
"""Share of true plants that do not fit, were the covariance of their steps right."""
REST = 0.005
"""Metres per second: standard deviation along each axis of the speed of a point that stands."""
STEPS = 4
"""Steps of Gauss-Newton, all on the same normal equations."""


def with_standing_feet(
    problem: SegmentProblem, solution: SegmentSolution, before: Sequence[Motion]
) -> tuple[Motion, ...]:
    """The motions of a solution, moved to where feet that stand are at rest.

    Degrees of freedom that key poses hold stay, and so do performers whose feet do not stand.

    Parameters
    ----------
    problem : SegmentProblem
        As it was solved.
    solution : SegmentSolution
        With its evidence.
    before : sequence of Motion
        Those that led to the solution, in which soles that seemed planted were kept still: plants have their full
        length there, while in the solution they may be broken up.

    Returns
    -------
    tuple of Motion
        F poses per performer.
    """
    if not problem.settings.plants or not problem.shows_depth:
        return solution.motions
    return at_rest(problem, equations_at(problem, solution), solution.motions, before)


def at_rest(
    problem: SegmentProblem,
    systems: Sequence[BandedBlocks],
    motions: tuple[Motion, ...],
    before: Sequence[Motion],
) -> tuple[Motion, ...]:
    """Motions moved to where feet that stand are at rest, by the normal equations of each performer there, which are
    without plants and holds.
    """
    for members in problem.tied(systems, motions).groups:
        evidence = _Evidence(problem, members, systems, motions)
        standing = {i: plants for i in members if (plants := evidence.plants_that_fit(i, before[i])) is not None}
        if standing:
            motions = evidence.with_plants_held(standing)
    return motions


@dataclass(frozen=True, eq=False)
class _Evidence:
    """The normal equations of performers that are tied to each other, the members, at motions of all."""

    problem: SegmentProblem
    members: Sequence[int]
    systems: Sequence[BandedBlocks]
    motions: tuple[Motion, ...]

    def plants_that_fit(self, performer: int, before: Motion) -> PlantFactor | None:
        """The plants of a member that the evidence lets stand still; None where there are none."""
        problem = self.problem
        seeming, earlier = (
            PlantFactor.found(problem.bodies[performer], motion, problem.fps)
            for motion in (self.motions[performer], before)
        )
        if seeming is None:
            return None
        held, least = problem.fixed[performer].all(axis=1), self._least_cost({})
        movable = ~(held[1:] & held[:-1])[:, None]

        def fits(steps: Bools) -> bool:
            plant = replace(seeming, steps=steps, kernel=Quadratic())
            return self._least_cost({performer: plant}) - least < chdtri(3 * np.count_nonzero(steps), REFUSED)

        found = np.zeros_like(seeming.steps)
        for c, column in enumerate((seeming.steps & movable).T):
            longer = [] if earlier is None else runs((earlier.steps & movable)[:, c])
            for run in runs(column):
                for first, last in dict.fromkeys((_joined(run, longer), run)):
                    steps = np.zeros_like(found)
                    steps[first : last + 1, c] = True
                    if fits(steps):
                        found |= steps
                        break
        return PlantFactor(seeming.soles, found, REST / problem.fps, Quadratic()) if found.any() else None

    def with_plants_held(self, plants: Mapping[int, PlantFactor]) -> tuple[Motion, ...]:
        """The motions once planted points of members are at rest."""
        motions = self.motions
        for _ in range(STEPS):
            tied = self._with_plants(plants, motions)
            motions = moved_by(motions, increments_of(tied, [system.solve(0.0) for system in tied.systems]))
        return motions

    def _least_cost(self, plants: Mapping[int, PlantFactor]) -> float:
        """What is left of the cost where the normal equations, with some plants, are solved."""
        [system] = self._with_plants(plants, self.motions).systems
        return system.cost + system.slope(system.solve(0.0)) / 2

    def _with_plants(self, plants: Mapping[int, PlantFactor], there: tuple[Motion, ...]) -> TiedSystems:
        """The normal equations at other motions that are near, with plants."""
        problem, systems = self.problem, list(self.systems)
        for i in self.members:
            increments = self.motions[i].difference(there[i])
            systems[i] = replace(systems[i], gradient=systems[i].gradient_at(increments))
            if i in plants:
                systems[i] += plants[i].blocks(problem.bodies[i], part_poses(problem.bodies[i], there[i]))
        return tied_systems(systems, problem.holds, problem.bodies, there, fixed=problem.fixed, sought=self.members)


def _joined(run: tuple[int, int], others: Sequence[tuple[int, int]]) -> tuple[int, int]:
    """A run with those of others that it overlaps."""
    over = [run, *(other for other in others if other[0] <= run[1] and other[1] >= run[0])]
    return min(first for first, _ in over), max(last for _, last in over)
