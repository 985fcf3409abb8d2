"""Heads, hands and feet that a solution has turned farther than their joints allow: they are turned evenly from key
pose to key pose instead.

About its own axis a head is nearly round, and from behind little shows which way it faces. Pictures that follow each
other may lead it round by more than a right angle, and neither outlines nor brightness lead it back. So it is with a
foot whose sole faces the camera, and the search for limbs turns no feet.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ....body import Body
from ....body.limbs import limbs, without_end
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
"""How far joints turn beyond their limits, or beyond the key poses, as nothing unusual: people differ."""
FRAME_SIGMA = 0.1
"""Standard deviation, on each frame, of how far a joint turns beyond that margin, radians."""


def with_ends_unwound(problem: SegmentProblem, solution: SegmentSolution, workspace: Workspace) -> SegmentSolution:
    """Turn heads, hands and feet that are wound up evenly between the key poses, solve from there, and keep that where
    it is likelier: by the images and by how far their joints turn. Those that keypoints show stay as they are.

    All of a performer are led at once; if that is not likelier, one after the other.

    Parameters
    ----------
    problem : SegmentProblem
    solution : SegmentSolution
    workspace : Workspace
    """
    for i in problem.sought:
        wound = [end for end in _turned_freely(problem, i) if _is_wound(problem, i, end, solution.motions[i])]
        led = _likelier_led(problem, i, wound, solution, workspace.silent()) if wound else solution
        if led is solution and len(wound) > 1:
            for end in wound:
                led = _likelier_led(problem, i, [end], led, workspace.silent())
        solution = led
    return solution


def ends(body: Body) -> list[int]:
    """Return the parts at the tips of a body's tree that are turned by no search for limbs, as indices: hands, feet,
    and a head, unless it is on a neck that is a part of its own.
    """
    searched = [part for chain in limbs(body) for part in without_end(chain)]
    return [part for part in range(1, len(body)) if part not in body.parents and part not in searched]


def _turned_freely(problem: SegmentProblem, performer: int) -> list[int]:
    """Return the ends of a performer's body whose turns no keypoints show: those with none away from their joint."""
    body, names = problem.bodies[performer], problem.keypoints[performer].keypoints.names if problem.keypoints else ()
    parts, points = body.landmark_arrays([name for name in names if name in body.landmarks])
    return [end for end in ends(body) if end not in parts[points.any(axis=1)]]


def _is_wound(problem: SegmentProblem, performer: int, end: int, motion: Motion) -> bool:
    away = turned_too_far(problem, performer, end, motion).any(axis=1)
    return bool(lasting(away, least_frames(problem.fps)).any())


def turned_too_far(problem: SegmentProblem, performer: int, end: int, motion: Motion) -> Array:
    """Return how much farther an end is turned about each axis than its joint's limits and key poses allow, radians,
    (F, 3).
    """
    turns, limits = rotations.log(motion.rotations[:, end]), problem.bodies[performer].limits[end]
    keyed = turns[problem.fixed_axes(performer)[:, end].all(axis=1)]
    low = np.minimum(limits[:, 0], keyed.min(axis=0, initial=np.inf)) - MARGIN
    high = np.maximum(limits[:, 1], keyed.max(axis=0, initial=-np.inf)) + MARGIN
    return np.asarray(turns - np.clip(turns, low, high))


def _likelier_led(
    problem: SegmentProblem, performer: int, wound: Sequence[int], before: SegmentSolution, workspace: Workspace
) -> SegmentSolution:
    """Solve with ends that are led, and return the likelier of both solutions."""
    alone = problem.alone(performer)
    begin = before if before.evidence is not None else unsettled(alone, before.motions, workspace)
    first = SettledSolution.after(alone, replace(begin, only=alone.only), workspace)
    led = first.solution.motions[performer]
    for end in wound:
        led = _led(alone, performer, end, led)
    found = solved_from(alone, with_motion(first.solution.motions, performer, led), first.noise, workspace)

    def score(solution: SegmentSolution) -> float:
        motion = solution.motions[performer]
        beyond = np.array([turned_too_far(problem, performer, end, motion) for end in wound]) / FRAME_SIGMA
        return likelihood(alone, first.noise, solution) - 0.5 * float(np.sum(beyond**2))

    if score(found) <= score(first.solution):
        return before
    return continued(before, replace(found, only=problem.only))


def _led(problem: SegmentProblem, performer: int, end: int, motion: Motion) -> Motion:
    """Turn an end evenly from each key pose that holds it to the next. Before the first and after the last of them it
    keeps their turn; where no key pose holds it, it is as at rest.
    """
    fixed = problem.fixed_axes(performer)[:, end]
    if fixed.all(axis=1).any():
        return evenly_led(problem, performer, motion, [end], beyond=True)
    Q = motion.rotations.copy()
    Q[~fixed.any(axis=1), end] = np.eye(3)
    return Motion(motion.translations, Q)
