"""Heads that a solution has wound up, farther than necks turn: they are led evenly from key pose to key pose.

About its own axis a head is nearly round, and from behind little shows which way it faces. Pictures that follow each
other may lead it round by more than a right angle, and neither outlines nor brightness lead it back.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ....body import Body
from ....body.limbs import limbs
from ....body.motion import Motion, with_motion
from ....numerics import rotations
from ....numerics.arrays import Array
from ....numerics.frame_ranges import lasting
from ..assessment.settled_solutions import SettledSolution, unsettled
from ..assessment.solution_doubts import least_frames
from ..assessment.solution_ranking import likelihood
from ..equations.measurement import Workspace
from ..equations.problem import SegmentProblem, SegmentSolution
from ..gauss_newton import continued
from .bridges import evenly_led
from .limb_groups import solved_from

MARGIN = np.radians(15)
"""How far heads turn beyond the limits of their joints, or beyond the key poses, as nothing unusual: people differ."""
FRAME_SIGMA = 0.1
"""Standard deviation of a head beyond that on a frame, radians."""


def with_heads_unwound(problem: SegmentProblem, solution: SegmentSolution, workspace: Workspace) -> SegmentSolution:
    """Lead heads that are wound up evenly between the key poses, solve from there, and keep that where it is likelier:
    by the images and by how far heads turn.

    Parameters
    ----------
    problem : SegmentProblem
    solution : SegmentSolution
    workspace : Workspace
    """
    for i in problem.sought:
        for head in heads(problem.bodies[i]):
            away = turned_too_far(problem, i, head, solution.motions[i]).any(axis=1)
            if lasting(away, least_frames(problem.fps)).any():
                solution = _likelier_led(problem, i, head, solution, workspace.silent())
    return solution


def heads(body: Body) -> list[int]:
    """Return the parts at the tips of a body's tree that belong to no limb, as indices: a head on a
    neck that is a part of its own is a limb, and not among them.
    """
    of_limbs = [part for chain in limbs(body) for part in chain]
    return [part for part in range(1, len(body)) if part not in body.parents and part not in of_limbs]


def turned_too_far(problem: SegmentProblem, performer: int, head: int, motion: Motion) -> Array:
    """Return by how much a head is turned farther about each axis than necks and key poses allow, radians, (F, 3)."""
    turns, limits = rotations.log(motion.rotations[:, head]), problem.bodies[performer].limits[head]
    keyed = turns[problem.fixed_axes(performer)[:, head].all(axis=1)]
    low = np.minimum(limits[:, 0], keyed.min(axis=0, initial=np.inf)) - MARGIN
    high = np.maximum(limits[:, 1], keyed.max(axis=0, initial=-np.inf)) + MARGIN
    return np.asarray(turns - np.clip(turns, low, high))


def _likelier_led(
    problem: SegmentProblem, performer: int, head: int, before: SegmentSolution, workspace: Workspace
) -> SegmentSolution:
    """Solve with a head that is led evenly, and return the likelier of both solutions."""
    alone = problem.alone(performer)
    if evenly_led(alone, performer, before.motions[performer], [head]) is before.motions[performer]:
        return before  # no key poses on both sides
    begin = before if before.evidence is not None else unsettled(alone, before.motions, workspace)
    first = SettledSolution.after(alone, replace(begin, only=alone.only), workspace)
    led = evenly_led(alone, performer, first.solution.motions[performer], [head])
    found = solved_from(alone, with_motion(first.solution.motions, performer, led), first.noise, workspace)

    def score(solution: SegmentSolution) -> float:
        beyond = turned_too_far(problem, performer, head, solution.motions[performer]) / FRAME_SIGMA
        return likelihood(alone, first.noise, solution) - 0.5 * float(np.sum(beyond**2))

    if score(found) <= score(first.solution):
        return before
    return continued(before, replace(found, only=problem.only))
