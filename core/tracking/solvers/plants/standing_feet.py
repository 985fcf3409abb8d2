"""Standing feet: points of the soles that may be standing, by the evidence, are brought to rest.

As the heel rises, a foot rolls over a place of its sole that need not be the ball; it is found first, and held instead
of the ball (`forefoot_rocker`). Candidate plants are found in a motion that was refined without plants. A foot that
creeps slowly is a candidate, too, but must not be held, so each plant is tested as a whole: the increase of the least
cost of the normal equations, if the point stands still throughout, has a chi-squared distribution with three degrees of
freedom per step. It takes the full covariance of the steps into account, in which a drift over many frames weighs more
than jitter. The covariance of the normal equations is first scaled by the ratio of errors to it that the shot shows for
leg and foot: key poses that were predicted without themselves are missed by more where feet are half hidden. The
pictures around the point are asked as well whether it stands or moves as it was tracked: they do not depend on the
shape of the foot, whose errors make it drift. A plant that passes ends before steps on which the evidence and the
pictures together have the point move; one of a ball takes in the frames on which the heel stands, if the evidence or
the pictures of these agree: a flicker of the evidence seems to end it. Smoothness blurs the moments at which a foot
lands and leaves, so plants also take in the frames beside them on which the point may stand, too: the evidence has
nothing against it, or the pictures show the point in its place. Two plants of a point with no time for a step between
them become one if that passes as well. Those that are brief all the same are left out, unless the shot begins or ends
with them, so that they may be longer, and the pictures are for them. Then all are held together, on the same normal
equations; those that are near the floor on which key poses have such points are held at its height, too
(`floor_height`). Where that moves a joint farther than these equations hold, the solution is polished with the plants
held.

A single view hardly contradicts any plant. With one view, candidates are kept still during the refinement already, and
nothing is tested here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ....body.foot_plants import MIN_DURATION
from ....body.motion import Motion
from ....body.soles import Soles
from ....numerics.arrays import Array, Bools
from ....numerics.banded_blocks import BandedBlocks
from ....numerics.robust_kernels import Quadratic
from ..descent_stages import POLISH, UNCONVERGED_MOVE, DescentStage
from ..equations.measurement import Workspace
from ..equations.plant_factor import PlantFactor
from ..equations.problem import SegmentProblem, SegmentSolution
from ..gauss_newton import descend
from ..joint_moves import at_rest
from ..limb_corrections.local_trials import can_be_parted
from ..protocol import SettledMotions, SolvedFrames
from .apparent_plants import ApparentPlants
from .forefoot_rocker import with_forefoot_rockers
from .plant_evidence import PlantEvidence
from .plant_tests import PlantTests

REST_SPEED_SIGMA = 0.005
"""Standard deviation of the velocity of a standing point along each axis, metres per second."""


def with_standing_feet(
    problem: SegmentProblem,
    solution: SegmentSolution,
    equations: Sequence[BandedBlocks],
    before: SolvedFrames,
    ratios: Sequence[Array],
    *,
    workspace: Workspace,
) -> SettledMotions:
    """Correct the motions of a solution so that standing feet are at rest; the `settle` of Gauss-Newton.

    Degrees of freedom that key poses fix do not change, nor do performers whose feet do not stand. Where plants move
    some joint farther than the normal equations hold, the solution is polished with them held, but not in a long
    segment, whose evidence on all frames is large.

    Parameters
    ----------
    problem : SegmentProblem
        The problem that was solved.
    solution : SegmentSolution
    equations : sequence of BandedBlocks
        Normal equations of each performer at the solution, without those of plants and holds.
    before : SolvedFrames
        The motions before refinement. Plants may have their full length there, while they are broken up in the
        solution. What the feet do on the segments beside shows how fast a standing one is at most, and whether a plant
        at an end of the segment goes on.
    ratios : sequence of ndarray, shape (P,)
        Per performer: squared errors of the parts' tips over those that the normal equations predict, see
        `core.tracking.expected_errors.held_out_keys`.
    workspace : Workspace
    """
    if not problem.settings.plants or not problem.shows_depth:
        return SettledMotions(solution.motions, (None,) * len(solution.motions))
    settled, held = _held(problem, equations, solution.motions, before, ratios)
    if can_be_parted(problem) or at_rest(problem, solution.motions, settled.motions, UNCONVERGED_MOVE):
        return settled
    plants = [held.get(i) for i in range(len(settled.motions))]
    polished = descend(problem, settled.motions, workspace, _stages_as_before(solution), plants=plants)
    return replace(settled, motions=polished.motions)


def _stages_as_before(solution: SegmentSolution) -> tuple[DescentStage, ...]:
    """Return the polish with the pixels by which a solution was found: those of a correction are fewer."""
    assert solution.evidence is not None
    return tuple(replace(stage, sampling=solution.evidence.sampling, thinned=False) for stage in POLISH)


def with_plants_at_rest(
    problem: SegmentProblem,
    systems: Sequence[BandedBlocks],
    motions: tuple[Motion, ...],
    before: SolvedFrames,
    *,
    ratios: Sequence[Array],
) -> SettledMotions:
    """Correct motions so that standing feet are at rest.

    Parameters
    ----------
    problem : SegmentProblem
    systems : sequence of BandedBlocks
        Normal equations of each performer at the motions, without those of plants and holds.
    motions, before, ratios
        See `with_standing_feet`.
    """
    settled, _ = _held(problem, systems, motions, before, ratios)
    return settled


def _held(
    problem: SegmentProblem,
    systems: Sequence[BandedBlocks],
    motions: tuple[Motion, ...],
    before: SolvedFrames,
    ratios: Sequence[Array],
) -> tuple[SettledMotions, dict[int, PlantFactor]]:
    """Return the corrected motions, and the plants that are held by performer; see `with_plants_at_rest`."""
    planted: list[Bools | None] = [None] * len(motions)
    held: dict[int, PlantFactor] = {}
    for members in problem.tied(systems, motions).groups:
        evidence = PlantEvidence(problem, members, systems, motions)
        standing = {}
        for i in members:
            apparent, earlier = _apparent_plants(evidence, before, i, ratios[i])
            if apparent is not None:
                keyed, fitting = _plants_that_fit(evidence, i, apparent, earlier, ratios[i])
                planted[i] = keyed.frames | fitting.frames
                if fitting.steps.any():
                    standing[i] = fitting
            elif (soles := Soles.of(problem.bodies[i])) is not None:
                planted[i] = np.zeros((problem.length, len(soles.names)), bool)
        if standing:
            motions = evidence.with_plants_held(standing)
            held |= standing
    return SettledMotions(motions, tuple(planted)), held


def _apparent_plants(
    evidence: PlantEvidence, before: SolvedFrames, performer: int, ratios: Array
) -> tuple[ApparentPlants | None, ApparentPlants | None]:
    """Return a member's apparent plants, with the balls where its feet roll: in its motion, and in the one before."""
    tracked = replace(
        before,
        motions=tuple(m.replaced(before.first, new) for m, new in zip(before.motions, evidence.motions, strict=True)),
    )
    apparent = ApparentPlants.of(evidence.problem, performer, tracked)
    if apparent is None:
        return None, None
    soles = with_forefoot_rockers(evidence, performer, apparent, ratios)
    now, earlier = (ApparentPlants.of(evidence.problem, performer, frames, soles) for frames in (tracked, before))
    return now, earlier


def _plants_that_fit(
    evidence: PlantEvidence, performer: int, apparent: ApparentPlants, earlier: ApparentPlants | None, ratios: Array
) -> tuple[PlantFactor, PlantFactor]:
    """Return the apparent plants of a member that are held: those between key poses on neighbouring frames, which
    nothing moves, and those that pass the tests, with the frames beside them that do, unless they are brief.

    Parameters
    ----------
    evidence : PlantEvidence
    performer : int
    apparent, earlier : ApparentPlants
        As found now, and before the refinement.
    ratios : ndarray, shape (P,)
    """
    problem, plants = evidence.problem, apparent.plants
    held = problem.fixed[performer].all(axis=1)
    movable = ~(held[1:] & held[:-1])
    found, level_precision = np.zeros_like(plants.steps), np.zeros(plants.steps.shape)
    floor = apparent.floor
    for point, part in enumerate(plants.soles.parts):
        ratio = evidence.ratio_of_errors(performer, part, ratios)
        heel = found[:, plants.soles.parts == part].any(axis=1)  # of the same foot; a heel is tested before its ball
        for plant in PlantTests(evidence, ratio, movable).plants_of(apparent, earlier, performer, point, heel):
            lasts = apparent.steps_around(plant) >= MIN_DURATION * problem.fps
            if lasts or (apparent.is_cut_off(plant) and evidence.log_odds(plant) > 0):
                steps = slice(plant.steps[0], plant.steps[1] + 1)
                found[steps, point] = True
                if floor is not None and floor.carries(evidence.path(plant)):
                    level_precision[steps, point] = 1 / (len(plant) * floor.sigma**2)
    keyed = replace(plants, steps=plants.steps & ~movable[:, None])
    sigma, level = REST_SPEED_SIGMA / problem.fps, 0.0 if floor is None else floor.height
    return keyed, PlantFactor(plants.soles, found, sigma, Quadratic(), level, level_precision)
