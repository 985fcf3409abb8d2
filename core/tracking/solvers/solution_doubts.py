"""Whether the images leave a doubt that a solution is near the true one, and about whom."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...body.limbs import limbs, without_end
from ...body.motion import Motion
from ...evidence.misfit import beyond_known, measured_misfit
from ...evidence.occlusion import LONG, intervals
from ...evidence.view_frames import views_with_foreground
from ...numerics.arrays import Array
from .limb_images import shown_areas
from .measurement import hidden_parts, keypoint_agreement, poses_by_delay, view_instants
from .problem import SegmentProblem, SegmentSolution

EXPLAINED = 0.8
"""Share of what the key poses explain of their images that a solution should explain of every other frame's."""
SHOWN = 0.5
"""Share of a performer that others must leave in sight for what it explains to raise a doubt."""
LIMB_SHARE = 0.5
"""Share of the smallest limb that foreground beside a performer must have to be a limb that the solution lost."""
ASTRAY = 0.2
"""Share of a limb that a view must see on the background, beyond what it sees there on the key frames, for the limb to
be lost."""
BRIEF = 0.1
"""For how long that much of a limb may lie on the background, seconds: motion blur makes single frames of it."""
CONFIRMED = 0.9
"""Share of the keypoints' agreement with the first pass that clears a solution of doubt."""


def doubted_performers(problem: SegmentProblem, start: Sequence[Motion], solution: SegmentSolution) -> list[int]:
    """The performers for whom other starts are worth trying: the images disagree with the solution, and no keypoints
    confirm it, or limbs are out of all views' sight for long.
    """
    each = {i: problem.alone(i) for i in problem.sought}
    unsure = {i for i, alone in each.items() if not confirmed(alone, start, solution)}
    missed = {i for i in unsure if doubtful(each[i], solution) or limb_astray(each[i], solution)}
    if unsure - missed:
        missed |= unsure & set(performers_uncovered(problem, solution))
    return [i for i, alone in each.items() if i in missed or concealed(alone, solution)]


def worst_first(problem: SegmentProblem, solution: SegmentSolution, performers: Sequence[int]) -> list[int]:
    """Performers by how little a solution explains of them on the frame where that is least: whose limbs are in wrong
    places stands where others are looked for.
    """
    return sorted(performers, key=lambda i: float(np.nanmin(explained_share(problem, solution, i), initial=np.inf)))


def confirmed(problem: SegmentProblem, start: Sequence[Motion], solution: SegmentSolution) -> bool:
    """Whether keypoints agree with a solution nearly as well as with the start, which they led to."""
    if not problem.keypoints:
        return False
    return keypoint_agreement(problem, solution.motions) >= CONFIRMED * keypoint_agreement(problem, start)


def doubtful(problem: SegmentProblem, solution: SegmentSolution) -> bool:
    """Whether the images leave a doubt that a solution is near the true one for every performer that is sought.

    The body covers what looks like it on the key frames; on every other frame it should do so nearly as well, but for
    what others hide of it.
    """
    return any(_doubted(problem, solution, i) for i in problem.sought)


def _doubted(problem: SegmentProblem, solution: SegmentSolution, performer: int) -> bool:
    keys = problem.whole_keys(performer)
    if len(keys) < 2:
        return len(keys) == 1  # the curve that it began with stands still
    return bool((explained_share(problem, solution, performer) < EXPLAINED).any())


def explained_share(problem: SegmentProblem, solution: SegmentSolution, performer: int) -> Array:
    """What a solution explains of a performer, over what its whole key poses and what others leave in sight of it let
    expect, shape (F,); NaN where they leave too little to tell.
    """
    keys = problem.whole_keys(performer)
    explained, seen = solution.explained[performer], solution.unhidden[performer]
    shown = keys[seen[keys] > SHOWN]
    if not len(shown):
        return np.full(problem.length, np.nan)
    expected = seen * np.interp(np.arange(problem.length), shown, explained[shown] / seen[shown])
    return np.where((seen > SHOWN) & (expected > 0), explained / np.where(expected > 0, expected, 1.0), np.nan)


def limb_astray(problem: SegmentProblem, solution: SegmentSolution) -> bool:
    """Whether a solution has part of a limb where some view shows the background, more than briefly.

    A limb that follows the images of one view and not those of another is found by this; it covers too little for the
    whole body's cover to show it. What furniture hides on the key frames as well does not count.
    """
    assert solution.evidence is not None
    if not views_with_foreground(problem.views):
        return False
    unlike = solution.evidence.share * (1 - solution.evidence.agreeing)
    geometry, spans = problem.geometry(), problem.spans()
    long = max(2, round(BRIEF * problem.fps))
    for i in problem.sought:
        keys = problem.whole_keys(i)
        if len(keys) < 2:
            continue  # see `doubtful`
        for chain in limbs(problem.bodies[i]):
            parts = [spans[i].start + part for part in chain]
            size = shown_areas(geometry, parts)
            astray = beyond_known(unlike[..., parts] @ (size / size.sum()), [keys] * len(unlike)) > ASTRAY
            if any(last + 1 - first >= long for first, last in intervals(astray.any(axis=0))):
                return True
    return False


def performers_uncovered(problem: SegmentProblem, solution: SegmentSolution) -> list[int]:
    """The performers of whom some view shows half a limb, or more, where a solution has nobody, for longer than
    prediction bridges.

    A lost arm is too small a part of the performer to raise a doubt by what all of the body covers.
    """
    held = [i for i in problem.sought if len(problem.whole_keys(i)) > 1]
    if not (held and views_with_foreground(problem.views)):
        return []
    geometry, spans = problem.geometry(), problem.spans()
    poses = poses_by_delay(problem, view_instants(problem, solution.motions))
    misfit = measured_misfit(problem.views, geometry, poses, first=problem.first, spans=spans)
    areas = misfit.areas_beside([problem.whole_keys(i) for i in range(len(problem.bodies))])
    found = []
    for i in held:
        sizes = [
            shown_areas(geometry, [spans[i].start + part for part in chain]).sum() for chain in limbs(problem.bodies[i])
        ]
        beside = areas[:, i] > LIMB_SHARE * min(sizes, default=np.inf)
        if any(last + 1 - first >= LONG for row in beside for first, last in intervals(row)):
            found.append(i)
    return found


def concealed(problem: SegmentProblem, solution: SegmentSolution) -> bool:
    """Whether part of a limb is out of all views' sight, between whole key poses, for longer than prediction bridges.

    It may come into sight elsewhere than the solution has it. Foreground images would show that; keypoints do anyway.
    The end of a limb of three parts and more does not count: a hand is where the forearm ends, and how it is turned is
    not looked for.
    """
    if not views_with_foreground(problem.views) or problem.keypoints:
        return False
    hidden = hidden_parts(problem, solution.share)
    return any(
        last + 1 - first >= LONG
        for i in problem.sought
        if len(problem.whole_keys(i)) > 1
        for chain in limbs(problem.bodies[i])
        for part in without_end(chain)
        for first, last in intervals(hidden[i][:, part])
    )


def speaks_against(problem: SegmentProblem, solution: SegmentSolution) -> bool:
    """Whether more than foreground beside the performers speaks against a solution: they explain too little, have limbs
    on the background, or hide them from all views.
    """
    return doubtful(problem, solution) or limb_astray(problem, solution) or concealed(problem, solution)
