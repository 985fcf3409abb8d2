"""Which of several solutions of a segment counts: by what they cover, and by how likely the pictures are with them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...body.motion import Motion
from .descent_stages import SETTLED
from .gauss_newton import SegmentNoise, continued, descend
from .measurement import Workspace, keypoint_agreement
from .problem import SegmentProblem, SegmentSolution

EQUAL = 0.005
"""Solutions whose covers of the performers differ by less than this share of them are equals: which of them covers the
most is chance."""
ALIKE = np.radians(8)
"""Motions of a performer are one once they are solved if their parts' rotations differ by less, root mean square,
radians."""
FINALISTS = 2
"""So many of the likeliest solutions are settled on until they rest, before the likeliest counts."""
FURTHER = 4
"""How often a finalist is settled on, at most."""
RESTING = 10.0
"""A finalist rests when settling makes the pictures likelier by less, in natural units."""


def better(problem: SegmentProblem, *solutions: SegmentSolution) -> SegmentSolution:
    """The solution that covers the most of what looks like the performers and meets the most keypoints of those that
    are sought, if any.
    """
    merit = [found.cover for found in solutions]
    if problem.keypoints:
        most = max(*(float(found.explained[problem.sought].sum()) for found in solutions), 1.0)
        merit = [m / most + keypoint_agreement(problem, s.motions) for m, s in zip(merit, solutions, strict=True)]
    return solutions[int(np.argmax(merit))]


def equals(solutions: Sequence[SegmentSolution], share: float = EQUAL) -> list[SegmentSolution]:
    """The solutions that cover as much of the performers as the one that covers the most, but for a share."""
    covers = [solution.cover for solution in solutions]
    least = max(covers) - share * max(abs(solution.sought_cover) for solution in solutions)
    return [solution for solution, cover in zip(solutions, covers, strict=True) if cover >= least]


def alike(motions: Sequence[Motion], others: Sequence[Motion]) -> bool:
    """Whether motions of all performers are so near to each other that solving makes them one."""
    turns = [a.difference(b)[:, 3:] for a, b in zip(motions, others, strict=True)]
    return all(np.sqrt(3 * np.mean(turn**2)) < ALIKE for turn in turns)


def cover_at(
    problem: SegmentProblem, solution: SegmentSolution, motions: Sequence[Motion], workspace: Workspace
) -> float:
    """How much of what looks like the performers motions cover, measured as for a solution."""
    assert solution.evidence is not None
    return float(workspace.measure(problem, motions, solution.evidence.sampling).evidence.explained.sum())


def noise_of(problem: SegmentProblem, solution: SegmentSolution, workspace: Workspace) -> SegmentNoise:
    """The noise of the images at a solution, under which others of the performers that are sought can be compared.

    That of more performers has more pixels: the gradients of the one that is sought would count too much.
    """
    evidence = solution.evidence
    assert evidence is not None
    if problem.only is not None:
        evidence = workspace.measure(problem, solution.motions, evidence.sampling).evidence
    return SegmentNoise.of(evidence, problem.settings)


def likelihood(problem: SegmentProblem, noise: SegmentNoise, solution: SegmentSolution) -> float:
    """The logarithm of how likely the pictures are with a solution that was measured under a noise, but for a constant.

    It is what the pixels say that show the performer, those that repeat one another counted once, less the costs of
    gradients and outlines. That of smoothness has no part in it: how smooth the motion is, each solution found itself.
    In a view that stands still the gradients say how much likelier the same pixels are than if nothing moved in the
    picture: a limb that is left alone in one place, because pixels are easier to follow elsewhere, moves all the same.
    """
    evidence = solution.evidence
    assert evidence is not None
    sampling, gradients = evidence.sampling, evidence.gradients
    shown = noise.share @ evidence.explained.sum(axis=(1, 2))
    outlines = evidence.outlines.energy.sum() / (problem.settings.lengths[1] * sampling.tolerance**2)
    still = np.array([view.camera.stands_still for view in problem.views])[:, None]
    followed = noise.share[:, None] * sampling.stride**2 * gradients.gain
    moved = np.where(still, followed, -0.5 * noise.weight * gradients.cost)
    return float(shown + moved.sum() - 0.5 * outlines)


def likeliest(problem: SegmentProblem, noise: SegmentNoise, *solutions: SegmentSolution) -> SegmentSolution:
    """The one of some solutions, measured under one noise, with which the pictures are likeliest.

    A single view that moves shows neither how far away a limb is nor what stands still: the true motion is no likelier
    there than others. The first solution counts, unless another one covers clearly more.
    """
    if len(problem.views) == 1 and not problem.views[0].camera.stands_still:
        return solutions[0] if solutions[0] in equals(solutions) else better(problem, *solutions)
    return max(solutions, key=lambda solution: likelihood(problem, noise, solution))


def likeliest_at_rest(
    problem: SegmentProblem, noise: SegmentNoise, *solutions: SegmentSolution, workspace: Workspace
) -> SegmentSolution:
    """The likeliest of some solutions once the first `FINALISTS` of them have settled until they rest.

    A limb that has just been brought to its place is still a few centimetres off, which costs more than a limb in a
    wrong place that has long settled. Parameters as of `likeliest`.
    """
    finalists: list[SegmentSolution] = []
    for solution in sorted(solutions, key=lambda one: -likelihood(problem, noise, one)):
        if len(finalists) < FINALISTS and not any(alike(solution.motions, other.motions) for other in finalists):
            finalists.append(solution)
    if len(finalists) == 1:
        return likeliest(problem, noise, *solutions)
    rested = [settled_further(problem, noise, solution, workspace) for solution in finalists]
    return likeliest(problem, noise, *rested, *solutions)


def settled_further(
    problem: SegmentProblem, noise: SegmentNoise, solution: SegmentSolution, workspace: Workspace
) -> SegmentSolution:
    """A solution, settled on until it rests, or `FURTHER` times."""
    for _ in range(FURTHER):
        found = descend(problem, solution.motions, workspace.silent(), SETTLED, noise)
        gain = likelihood(problem, noise, found) - likelihood(problem, noise, solution)
        if gain > 0:
            solution = continued(solution, found)
        if gain < RESTING:
            break
    return solution
