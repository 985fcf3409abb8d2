"""Comparing solutions of a segment: by the foreground that they cover, and by how likely they make the images."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ....body.motion import Motion
from ....evidence.segment_evidence import SegmentEvidence
from ....numerics.frame_ranges import lasting
from ..descent_stages import OUTLINE_REACH, SETTLED
from ..equations.measurement import Workspace, keypoint_agreement
from ..equations.problem import SegmentProblem, SegmentSolution
from ..equations.segment_equations import SegmentNoise
from ..equations.weighted_evidence import outline_variance
from ..gauss_newton import HopelessTest, continued, descend
from ..joint_moves import joint_moves
from .solution_doubts import least_frames

EQUAL_COVER = 0.005
"""Relative difference of cover up to which solutions count as equals: which of them covers more is chance."""
SAME_SOLUTION_ANGLE = np.radians(8)
"""Root mean square difference of the parts' rotations, radians, up to which two motions lead to the same solution."""
FINALISTS = 2
"""Number of the likeliest solutions that are solved further before they are compared."""
MAX_REPEATS = 4
"""Most repetitions of that, for each of them."""
RESTING_GAIN = 10.0
"""A solution is at rest once solving it further raises the log likelihood of the images by less, in natural units."""


def covering_most(problem: SegmentProblem, *solutions: SegmentSolution) -> SegmentSolution:
    """Return the solution with the largest cover; with keypoints, with the largest sum of relative cover and agreement
    of the keypoints.
    """
    merit = [found.cover for found in solutions]
    if problem.keypoints:
        most = max(*(float(found.explained[problem.sought].sum()) for found in solutions), 1.0)
        merit = [m / most + keypoint_agreement(problem, s.motions) for m, s in zip(merit, solutions, strict=True)]
    return solutions[int(np.argmax(merit))]


def nearly_equal(solutions: Sequence[SegmentSolution], share: float = EQUAL_COVER) -> list[SegmentSolution]:
    """Return the solutions whose cover is within a relative difference (`share`) of the largest one."""
    covers = [solution.cover for solution in solutions]
    least = max(covers) - share * max(abs(solution.sought_cover) for solution in solutions)
    return [solution for solution, cover in zip(solutions, covers, strict=True) if cover >= least]


def same_solution(problem: SegmentProblem, motions: Sequence[Motion], others: Sequence[Motion]) -> bool:
    """Whether two motions of all performers are so similar that solving leads to the same one: parts are turned alike
    (`SAME_SOLUTION_ANGLE`), and no joint is farther away than a descent reaches for long. A single arm that is
    elsewhere hardly shows in the mean over all parts.
    """
    turns = [a.difference(b)[:, 3:] for a, b in zip(motions, others, strict=True)]
    if any(np.sqrt(3 * np.mean(turn**2)) >= SAME_SOLUTION_ANGLE for turn in turns):
        return False
    away = joint_moves(problem, motions, others) > OUTLINE_REACH
    return not lasting(away, least_frames(problem.fps)).any()


def cover_at(
    problem: SegmentProblem, solution: SegmentSolution, motions: Sequence[Motion], workspace: Workspace
) -> float:
    """Measure the cover (`SegmentSolution.cover`) of motions, sampling the images as for a solution."""
    assert solution.evidence is not None
    return float(workspace.measure(problem, motions, solution.evidence.sampling).evidence.explained.sum())


def noise_at(problem: SegmentProblem, solution: SegmentSolution, workspace: Workspace) -> SegmentNoise:
    """Estimate the noise of the images at a solution, to compare other solutions for the same performers under it.

    A problem of one performer gets a noise from that performer's pixels alone: with those of all performers, gradients
    would weigh too much.
    """
    evidence = solution.evidence
    assert evidence is not None
    if problem.only is not None:
        evidence = workspace.measure(problem, solution.motions, evidence.sampling).evidence
    return SegmentNoise.of(evidence, problem.settings)


def likelihood(problem: SegmentProblem, noise: SegmentNoise, solution: SegmentSolution) -> float:
    """Log likelihood of the images given a solution that was measured under a noise, up to a constant.

    It is the sum of the log likelihood ratios (performer against background) of all pixels that the performers cover,
    less the costs of gradients and outlines, with correlated pixels counted once. Smoothness has no part in it, as
    every solution estimates its own. For views with a still camera the gradients contribute a log likelihood ratio
    instead of a cost, against the hypothesis that nothing moves in the image: otherwise a solution would gain by
    leaving a limb behind in a place whose pixels are easy to track.
    """
    assert solution.evidence is not None
    return _likelihood_of(problem, noise, solution.evidence)


def _likelihood_of(problem: SegmentProblem, noise: SegmentNoise, evidence: SegmentEvidence) -> float:
    sampling, gradients = evidence.sampling, evidence.gradients
    shown = noise.share @ evidence.explained.sum(axis=(1, 2))
    outlines = evidence.outlines.energy.sum() / outline_variance(evidence, problem.settings)
    still = np.array([view.camera.stands_still for view in problem.views])[:, None]
    followed = noise.share[:, None] * sampling.stride**2 * gradients.gain
    moved = np.where(still, followed, -0.5 * noise.weight * gradients.cost)
    return float(shown + moved.sum() - 0.5 * outlines)


def never_likelier(problem: SegmentProblem, noise: SegmentNoise, rival: float) -> HopelessTest:
    """Return a test for a descent (`gauss_newton.descend`): whether the images would stay less likely than the rival
    even if each of the steps that are left gained as much as the last.

    The test is of one descent: it remembers the evidence that it was called with.
    """
    reached: list[float] = []

    def hopeless(evidence: SegmentEvidence, left: int) -> bool:
        reached.append(_likelihood_of(problem, noise, evidence))
        return len(reached) > 1 and max(reached) + left * max(reached[-1] - reached[-2], 0.0) <= rival

    return hopeless


def likelihood_decides(problem: SegmentProblem) -> bool:
    """Whether the likelihood singles out the true motion: a single moving camera shows neither depth nor what stands
    still.
    """
    return len(problem.views) != 1 or problem.views[0].camera.stands_still


def likeliest(problem: SegmentProblem, noise: SegmentNoise, *solutions: SegmentSolution) -> SegmentSolution:
    """Return the solution with the largest likelihood, of several that were measured under the same noise.

    Where the likelihood does not tell (`likelihood_decides`), the first solution is returned, unless another one covers
    clearly more.
    """
    if not likelihood_decides(problem):
        return solutions[0] if solutions[0] in nearly_equal(solutions) else covering_most(problem, *solutions)
    return max(solutions, key=lambda solution: likelihood(problem, noise, solution))


def clearly_likelier(
    problem: SegmentProblem, noise: SegmentNoise, solution: SegmentSolution, other: SegmentSolution
) -> bool:
    """Whether a solution is likelier than another by more than solutions still gain that are at rest (`RESTING_GAIN`),
    both measured under the same noise; where the likelihood does not tell, whether it is preferred to it (`likeliest`).
    """
    if not likelihood_decides(problem):
        return likeliest(problem, noise, solution, other) is solution
    return likelihood(problem, noise, solution) > likelihood(problem, noise, other) + RESTING_GAIN


def likeliest_at_rest(
    problem: SegmentProblem, noise: SegmentNoise, *solutions: SegmentSolution, workspace: Workspace
) -> SegmentSolution:
    """Return the likeliest solution after the `FINALISTS` best were solved further, until they are at rest.

    A limb that a search has just brought to its place is still a few centimetres off, which costs more than a misplaced
    limb that has long converged. Parameters as in `likeliest`.
    """
    finalists: list[SegmentSolution] = []
    for solution in sorted(solutions, key=lambda one: -likelihood(problem, noise, one)):
        if len(finalists) < FINALISTS and not any(
            same_solution(problem, solution.motions, other.motions) for other in finalists
        ):
            finalists.append(solution)
    if len(finalists) == 1:
        return likeliest(problem, noise, *solutions)
    rested: list[SegmentSolution] = []
    for solution in finalists:
        decided = rested if likelihood_decides(problem) else []
        rival = max((likelihood(problem, noise, other) for other in decided), default=-np.inf)
        rested.append(settled_further(problem, noise, solution, workspace, rival=rival))
    return likeliest(problem, noise, *rested, *solutions)


def settled_further(
    problem: SegmentProblem,
    noise: SegmentNoise,
    solution: SegmentSolution,
    workspace: Workspace,
    *,
    rival: float = -np.inf,
) -> SegmentSolution:
    """Solve a solution further until it is at rest (`RESTING_GAIN`), at most `MAX_REPEATS` times.

    It ends earlier if the solution would not become likelier than another one although every further repetition gained
    as much as the last: gains become smaller.

    Parameters
    ----------
    problem : SegmentProblem
    noise : SegmentNoise
    solution : SegmentSolution
    workspace : Workspace
    rival : float
        Log likelihood of the images given the other solution; by default there is none.
    """
    for left in reversed(range(MAX_REPEATS)):
        found = descend(problem, solution.motions, workspace.silent(), SETTLED, noise)
        gain = likelihood(problem, noise, found) - likelihood(problem, noise, solution)
        if gain > 0:
            solution = continued(solution, found)
        if gain < RESTING_GAIN or likelihood(problem, noise, solution) + left * gain <= rival:
            break
    return solution
