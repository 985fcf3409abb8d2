"""Initial solution: the motion followed from a key pose, forward and backward, and both blended (paper 1, section 4.1).

A window of a few frames moves along the segment. The frames behind it are fixed. Those inside are solved together,
starting from an extrapolation of the motion so far; then the window moves on by half of its length. A single key pose
is enough for one direction: where a segment has none at its other end, this is the tracking of paper 2.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ....body.motion import Motion, stacked
from ....evidence.occlusion import unseen
from ..descent_stages import WINDOW_STAGES
from ..equations.measurement import Workspace
from ..equations.problem import SegmentProblem, SegmentSolution
from ..gauss_newton import descend
from ..unseen_parts.prediction import predict_unseen

WINDOW = 10
"""Frames that are solved together."""
WINDOW_STEP = 5
"""Frames by which the window moves on."""
PERSISTENCE = 0.9
"""Share of its velocity that an extrapolated motion keeps from one frame to the next."""

SolveWindow = Callable[[SegmentProblem, Sequence[Motion], Workspace], SegmentSolution]
"""Solves the frames of a window, given its problem, a guess of their poses, and a workspace."""


def follow(
    problem: SegmentProblem,
    start: Sequence[Motion],
    workspace: Workspace,
    solve: SolveWindow,
    *,
    backward: bool = False,
) -> list[Motion]:
    """Follow the motion from the first pose to the last frame, or from the last pose to the first frame.

    Parameters
    ----------
    problem : SegmentProblem
    start : sequence of Motion
        F poses per performer, of which only the first pose (backward: the last) and fixed degrees of freedom are used.
    workspace : Workspace
        Progress is reported before each window.
    solve : callable
        See `SolveWindow`.
    backward : bool

    Returns
    -------
    list of Motion
        F poses per performer.
    """
    F = problem.length
    order = list(range(F - 1, -1, -1) if backward else range(F))
    motions = list(start)
    hidden = [np.zeros((F, len(body)), dtype=bool) for body in problem.bodies]
    known = 1
    while known < F:
        workspace.report(known / F, motions)
        new, held = order[known : known + WINDOW], order[max(known - 2, 0) : known]
        first, stop = min(new + held), max(new + held) + 1
        behind = order[max(known - WINDOW, 0) : known]
        guesses = []
        for motion, keyed, fixed in zip(motions, start, problem.fixed, strict=True):
            guess = _placed(motion, new, _continued(motion[behind], len(new)))
            guesses.append(guess.moved(np.where(fixed, guess.difference(keyed), 0.0)))
        window = _window(problem, first, stop, held)
        solution = solve(window, [guess[first:stop] for guess in guesses], workspace.silent())
        motions = [guess.replaced(first, found) for guess, found in zip(guesses, solution.motions, strict=True)]
        if problem.settings.prediction:
            spans = problem.spans()
            for i in problem.sought:
                span = spans[i]
                hidden[i][new] = unseen(solution.share[:, [f - first for f in new]][..., span])
                so_far = order[: known + len(new)]
                motions[i] = _predicted(motions[i], so_far, hidden[i], problem.fixed[i])
        known += WINDOW_STEP if known + len(new) < F else len(new)
    return motions


def blended(forward: Sequence[Motion], backward: Sequence[Motion]) -> list[Motion]:
    """Blend two motions of each performer linearly along their frames, from the first to the second."""
    share = np.linspace(0, 1, len(forward[0]))[:, None]
    return [a.moved(share * a.difference(b)) for a, b in zip(forward, backward, strict=True)]


def _continued(behind: Motion, count: int) -> Motion:
    """Extrapolate poses at a velocity that decays (`PERSISTENCE`), in the order in which frames are followed."""
    last = behind[-1:]
    if len(behind) < 2:
        return stacked([last] * count)
    step = behind[-2:-1].difference(last)
    distance = np.cumsum(PERSISTENCE ** np.arange(1, count + 1))
    return stacked([last.moved(d * step) for d in distance])


def _placed(motion: Motion, frames: Sequence[int], poses: Motion) -> Motion:
    """Replace the poses of a motion on some frames."""
    T, Q = motion.translations.copy(), motion.rotations.copy()
    T[frames], Q[frames] = poses.translations, poses.rotations
    return Motion(T, Q)


def _window(problem: SegmentProblem, first: int, stop: int, held: Sequence[int]) -> SegmentProblem:
    """Return frames first to stop - 1 of a problem, with some of them fixed."""
    window = excerpt(problem, first, stop)
    fixed = [f.copy() for f in window.fixed]
    for f in fixed:
        f[[frame - first for frame in held]] = True
    return replace(window, fixed=tuple(fixed))


def excerpt(problem: SegmentProblem, first: int, stop: int) -> SegmentProblem:
    """Return frames first to stop - 1 of a problem, as if nothing were known of the motion beside them."""
    if (first, stop) == (0, problem.length):
        return problem
    precision = [problem.precision(i) for i in range(len(problem.bodies))]
    return replace(
        problem,
        first=problem.first + first,
        fixed=tuple(f[first:stop] for f in problem.fixed),
        before=None,
        after=None,
        keypoints=tuple(keypoints[first:stop] for keypoints in problem.keypoints),
        acceleration_precision=tuple(p[first:stop] if p.ndim > 1 else p for p in precision),
        holds=tuple(hold.on_frames(first, stop) for hold in problem.holds),
        steps=None if problem.steps is None else problem.steps[first : stop - 1],
    )


def _predicted(motion: Motion, frames: Sequence[int], hidden: NDArray[np.bool_], fixed: NDArray[np.bool_]) -> Motion:
    """Replace hidden parts by their prediction on the frames followed so far, which may run backward."""
    filled = predict_unseen(motion[list(frames)], hidden[list(frames)], since=len(frames) - WINDOW)
    placed = _placed(motion, frames, filled)
    return placed.moved(np.where(fixed, placed.difference(motion), 0.0))


def follow_both_ways(problem: SegmentProblem, start: Sequence[Motion], workspace: Workspace) -> list[Motion]:
    """Follow the motion frame by frame from each key pose to the next, forward and backward, and blend both.

    Before the first and after the last key pose of the performer that is solved for, there is one direction only.
    """
    keys = problem.whole_keys(problem.sought[0]).tolist()
    if not keys:
        return list(start)
    found, ends = list(start), sorted({0, *keys, problem.length - 1})
    for k, (first, last) in enumerate(pairwise(ends)):
        part = workspace.part(k / (len(ends) - 1), (k + 1) / (len(ends) - 1))
        directions = [backward for backward, end in ((False, first), (True, last)) if end in keys]
        here = [motion[first : last + 1] for motion in found]
        ways = [
            follow(
                excerpt(problem, first, last + 1),
                here,
                part.part(d / len(directions), (d + 1) / len(directions)),
                _solve_window,
                backward=backward,
            )
            for d, backward in enumerate(directions)
        ]
        new = blended(*ways) if len(ways) == 2 else ways[0]
        found = [motion.replaced(first, piece) for motion, piece in zip(found, new, strict=True)]
    return found


def _solve_window(problem: SegmentProblem, start: Sequence[Motion], workspace: Workspace) -> SegmentSolution:
    without_prediction = replace(problem.settings, prediction=False)
    return descend(replace(problem, settings=without_prediction), start, workspace, WINDOW_STAGES)
