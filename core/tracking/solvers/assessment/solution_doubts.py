"""Tests of a solution against the images: whether it may be far from the true motion, and for which performers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ....body.limbs import limbs, numbered_limbs, without_end
from ....body.motion import Motion
from ....evidence.misfit import Misfit, beyond_known, measured_misfit, most_explained
from ....evidence.occlusion import LONG_GAP
from ....evidence.view_frames import views_with_foreground
from ....evidence.view_work import IN_THIS_THREAD, ViewWork
from ....numerics.arrays import Array, Bools, Ints
from ....numerics.frame_ranges import FrameRange, lasting, runs
from ..equations.measurement import hidden_parts, keypoint_agreement, poses_by_delay, view_instants
from ..equations.problem import SegmentProblem, SegmentSolution
from ..limb_evidence.limb_images import shown_areas
from ..limb_evidence.limb_likelihood import MIN_GAIN
from ..limb_evidence.limb_support import support_of_limbs

MIN_EXPLAINED_RATIO = 0.8
"""Smallest ratio between what a solution explains of a frame's image and what the key poses explain of theirs."""
MIN_UNHIDDEN_SHARE = 0.5
"""Share of a performer that must be unhidden by others for this ratio to count on a frame."""
MIN_FOLLOWED_SHARE = 0.9
"""Share of a performer that must be unhidden by others on every frame for its motion to be followed frame by frame: a
window of a few frames shows too little of somebody whom others pass in front of. Where less of any performer is
unhidden, limbs of all may have been led astray, see `limb_signs`."""
LIMB_SHARE = 0.5
"""Area of uncovered foreground beside a performer, relative to the area of its smallest limb, from which on it may be a
lost limb."""
MISPLACED_SHARE = 0.2
"""Share of a limb that lies on the background in some view, beyond what does so on the key frames, from which on the
limb counts as misplaced."""
MIN_DURATION = 0.1
"""Shorter intervals on the background do not count, seconds: motion blur causes them on single frames."""
CONFIRMED_SHARE = 0.9
"""A solution counts as confirmed by keypoints if they agree with it at least by this share of their agreement with the
first pass."""


def doubted_performers(
    problem: SegmentProblem,
    start: Sequence[Motion],
    solution: SegmentSolution,
    searched: Sequence[Motion] | None = None,
) -> list[int]:
    """Return the indices of the performers for whom other starts are worth trying.

    These are the performers whose images contradict the solution while no keypoints confirm it, and those with limbs
    that no view sees for long (`limb_hidden_for_long`); not those who are held.

    Parameters
    ----------
    problem : SegmentProblem
    start : sequence of Motion
        F poses per performer, from which the solution was found.
    solution : SegmentSolution
    searched : sequence of Motion, optional
        As in `performers_uncovered`.
    """
    each = {i: problem.alone(i) for i in problem.searched}
    unsure = {i for i, alone in each.items() if not confirmed_by_keypoints(alone, start, solution)}
    missed = {i for i in unsure if is_doubtful(each[i], solution) or limb_on_background(each[i], solution)}
    if unsure - missed:
        missed |= unsure & set(performers_uncovered(problem, solution.motions, searched, solution.misfit))
    return [i for i, alone in each.items() if i in missed or limb_hidden_for_long(alone, solution)]


def least_frames(fps: float) -> int:
    """Return the number of frames in a row that `MIN_DURATION` takes, two or more."""
    return max(2, round(MIN_DURATION * fps))


def frames_in_doubt(problem: SegmentProblem, solution: SegmentSolution) -> Bools:
    """Return on which frames the images contradict a solution for a single performer without keypoints, shape (F,)."""
    [performer] = problem.sought
    found = _frames_on_background(problem, solution) | _frames_hidden(problem, solution)
    found[frames_unexplained(problem, solution, performer)] = True
    if views_with_foreground(problem.views):
        areas = _areas_beside(problem, solution.misfit or misfit_at(problem, solution.motions))
        found |= _frames_beside_limb(problem, performer, areas[:, performer])
    return found


def worst_first(problem: SegmentProblem, solution: SegmentSolution, performers: Sequence[int]) -> list[int]:
    """Sort performers by how well a solution explains them on their worst frame, the worst first.

    Misplaced limbs of one performer stand in the way when those of another are searched for.
    """
    return sorted(performers, key=lambda i: float(np.nanmin(explained_share(problem, solution, i), initial=np.inf)))


def confirmed_by_keypoints(problem: SegmentProblem, start: Sequence[Motion], solution: SegmentSolution) -> bool:
    """Whether keypoints agree with a solution nearly as well as with the start, which was fitted to them."""
    if not problem.keypoints:
        return False
    return keypoint_agreement(problem, solution.motions) >= CONFIRMED_SHARE * keypoint_agreement(problem, start)


def is_doubtful(problem: SegmentProblem, solution: SegmentSolution) -> bool:
    """Whether some performer that is solved for explains too little of the images on some frame, though more is there.

    Somebody who bends towards the camera shows less than on the key poses: no search would find more.
    """
    return any(len(frames_unexplained(problem, solution, i)) > 0 for i in problem.sought)


def explains_little(problem: SegmentProblem, solution: SegmentSolution) -> bool:
    """Whether some performer that is solved for explains too little of the images on some frame.

    On the key frames the body covers the foreground as well as its shape allows. On every other frame it should do so
    nearly as well, apart from what other performers hide.
    """
    return any(len(_frames_explained_little(problem, solution, i)) > 0 for i in problem.sought)


def _frames_explained_little(problem: SegmentProblem, solution: SegmentSolution, performer: int) -> Ints:
    keys = problem.whole_keys(performer)
    if len(keys) < 2:  # with a single key pose the start stands still
        return np.arange(problem.length if len(keys) else 0)
    return np.flatnonzero(explained_share(problem, solution, performer) < MIN_EXPLAINED_RATIO)


def frames_unexplained(problem: SegmentProblem, solution: SegmentSolution, performer: int) -> Ints:
    """Return the frames on which a performer explains too little of what there is to explain (`most_explained`)."""
    low = _frames_explained_little(problem, solution, performer)
    if not len(low) or len(problem.whole_keys(performer)) < 2:
        return low
    return low[_share_of_most(problem, solution, performer, low) < MIN_EXPLAINED_RATIO]


def explained_at_best(problem: SegmentProblem, solution: SegmentSolution, performer: int) -> Array:
    """Return how much of a performer a solution explains on each frame, shape (F,): the larger of the ratios to what is
    expected (`explained_share`) and to what there is to explain. NaN where the first is; above 1 only the first counts.
    """
    best = explained_share(problem, solution, performer)
    low = np.flatnonzero(best < 1)
    best[low] = np.maximum(best[low], _share_of_most(problem, solution, performer, low))
    return best


def _share_of_most(problem: SegmentProblem, solution: SegmentSolution, performer: int, frames: Ints) -> Array:
    """Ratio of what a solution explains of a performer on some frames to what there is to explain (`most_explained`),
    relative to the best of the key poses, shape (n,). Zero where that cannot be told: without foreground images, and of
    one of several performers, as the foreground of others may look like it.
    """
    keys, views = problem.whole_keys(performer), views_with_foreground(problem.views)
    if not views or problem.among_others:
        return np.zeros(len(frames))
    explained, asked = solution.explained[performer], [*keys.tolist(), *frames.tolist()]
    poses, geometry = poses_by_delay(problem, view_instants(problem, solution.motions)), problem.geometry()
    each = [
        most_explained(view, geometry, poses[view.delay], performer, first=problem.first, frames=asked)
        for view in views
    ]
    most = np.maximum(np.sum(each, axis=0), 1.0)
    usual = (explained[keys] / most[: len(keys)]).max()
    return np.asarray(explained[frames] / (usual * most[len(keys) :]))


def explained_share(problem: SegmentProblem, solution: SegmentSolution, performer: int) -> Array:
    """Ratio of what a solution explains of a performer to what is expected on each frame, shape (F,).

    Expected is what is explained on whole key poses, interpolated between them, times the share of the performer that
    others do not hide, and that of the views whose pictures are evidence. NaN where these are too small.
    """
    keys = problem.whole_keys(performer)
    explained, seen = solution.explained[performer], solution.unhidden[performer]
    views = views_with_foreground(problem.views)
    sound = np.mean(
        [view.sound(problem.first, problem.length)[0] for view in views] or [seen > MIN_UNHIDDEN_SHARE], axis=0
    )
    judged, seen = (seen > MIN_UNHIDDEN_SHARE) & (sound > 0), seen * sound
    shown = keys[judged[keys]]
    if not len(shown):
        return np.full(problem.length, np.nan)
    expected = seen * np.interp(np.arange(problem.length), shown, explained[shown] / seen[shown])
    return np.where(judged & (expected > 0), explained / np.where(expected > 0, expected, 1.0), np.nan)


def limb_on_background(problem: SegmentProblem, solution: SegmentSolution) -> bool:
    """Whether a view shows background, for longer than `MIN_DURATION`, where a solution has part of a limb.

    This detects limbs that follow the images of one view but not those of another; they are too small to show in the
    cover of the whole body. What is on the background on key frames as well, such as behind furniture, does not count.
    """
    return bool(_frames_on_background(problem, solution).any())


def _frames_on_background(problem: SegmentProblem, solution: SegmentSolution) -> Bools:
    """Return on which frames that is so, shape (F,)."""
    assert solution.evidence is not None
    found = np.zeros(problem.length, dtype=bool)
    if not views_with_foreground(problem.views):
        return found
    unlike = solution.evidence.share * (1 - solution.evidence.agreeing)
    geometry, spans = problem.geometry(), problem.spans()
    long = least_frames(problem.fps)
    for i in problem.sought:
        keys = problem.whole_keys(i)
        if len(keys) < 2:
            continue  # see `is_doubtful`
        for chain in limbs(problem.bodies[i]):
            parts = [spans[i].start + part for part in chain]
            size = shown_areas(geometry, parts)
            astray = beyond_known(unlike[..., parts] @ (size / size.sum()), [keys] * len(unlike)) > MISPLACED_SHARE
            found |= lasting(astray.any(axis=0), long)
    return found


def performers_uncovered(
    problem: SegmentProblem,
    motions: Sequence[Motion],
    searched: Sequence[Motion] | None = None,
    misfit: Misfit | None = None,
) -> list[int]:
    """Return the performers beside whom some view shows foreground of half a limb or more that nobody covers.

    It must last for `LONG_GAP` frames, longer than prediction bridges. A lost arm is found by this; it is too
    small a part of the performer to show in the cover of the whole body. What is as large beside motions around which
    limbs were searched for already, if there are any, is something else, such as a bystander. `misfit` is that of the
    motions, if it is known.
    """
    held = [i for i in problem.sought if len(problem.whole_keys(i)) > 1]
    if not (held and views_with_foreground(problem.views)):
        return []
    areas = _areas_beside(problem, misfit or misfit_at(problem, motions))
    found = [i for i in held if _frames_beside_limb(problem, i, areas[:, i]).any()]
    if not found or searched is None:
        return found
    areas -= _areas_beside(problem, misfit_at(problem, searched))
    return [i for i in found if _frames_beside_limb(problem, i, areas[:, i]).any()]


def others_hide(unhidden: Array) -> bool:
    """Whether performers hide so much of one another that limbs may be led astray, by the share of each performer that
    others do not hide, (M, F).
    """
    return bool(unhidden.min() <= MIN_FOLLOWED_SHARE)


def misfit_at(problem: SegmentProblem, motions: Sequence[Motion], by: ViewWork = IN_THIS_THREAD) -> Misfit:
    """Compare motions of all performers with the foreground images."""
    poses = poses_by_delay(problem, view_instants(problem, motions))
    return measured_misfit(
        problem.views,
        problem.geometry(),
        poses,
        first=problem.first,
        spans=problem.spans(),
        limb_of=numbered_limbs(problem.bodies),
        by=by,
    )


def _areas_beside(problem: SegmentProblem, misfit: Misfit) -> Array:
    """Return the areas of foreground beside all performers, see `Misfit.areas_beside`, shape (V, M, F)."""
    return misfit.areas_beside([problem.whole_keys(i) for i in range(len(problem.bodies))])


def _frames_beside_limb(problem: SegmentProblem, performer: int, areas: Array) -> Bools:
    """Return on which frames areas (V, F) beside a performer could be one of its limbs in some view, for `LONG_GAP`
    frames, shape (F,).
    """
    geometry, begin = problem.geometry(), problem.spans()[performer].start
    chains = [[begin + part for part in chain] for chain in limbs(problem.bodies[performer])]
    smallest = min((shown_areas(geometry, parts).sum() for parts in chains), default=np.inf)
    return np.any([lasting(row, LONG_GAP) for row in areas > LIMB_SHARE * smallest], axis=0)


def limb_hidden_for_long(problem: SegmentProblem, solution: SegmentSolution) -> bool:
    """Whether no view sees part of a limb for `LONG_GAP` frames, longer than prediction bridges, between
    whole key poses.

    When it comes into sight again, it may be elsewhere than in the solution, which only a search in foreground images
    can correct; with keypoints it is not needed. Nor is it where the images show the limb clearly, just before and just
    after, where the solution has it. The last part of a limb of three or more does not count: the hand is where the
    forearm ends, and the search does not turn it.
    """
    return bool(_frames_hidden(problem, solution).any())


def _frames_hidden(problem: SegmentProblem, solution: SegmentSolution) -> Bools:
    """Return on which frames that is so, shape (F,)."""
    found = np.zeros(problem.length, dtype=bool)
    if not views_with_foreground(problem.views) or problem.keypoints:
        return found
    hidden = hidden_parts(problem, solution.share)
    gaps = {
        (i, tuple(chain)): own
        for i in problem.sought
        if len(problem.whole_keys(i)) > 1
        for chain in limbs(problem.bodies[i])
        if (own := [gap for part in without_end(chain) for gap in _long_gaps(hidden[i][:, part])])
    }
    support = support_of_limbs(problem, solution.motions) if gaps else ()
    shown = {(i, tuple(chain)): of_limb for i, chain, _, of_limb in support if (i, tuple(chain)) in gaps}
    for limb, own in gaps.items():
        if limb not in shown or not _seen_beside(own, shown[limb]()):
            for first, last in own:
                found[first : last + 1] = True
    return found


def _long_gaps(hidden: Bools) -> list[FrameRange]:
    return [gap for gap in runs(hidden) if gap[1] + 1 - gap[0] >= LONG_GAP]


def _seen_beside(gaps: Sequence[FrameRange], support: Array) -> bool:
    """Whether a limb is clearly seen before and after each of the gaps, by the log likelihood ratio (F,) of the images
    with it against without it: on average at a rate at which `LONG_GAP` frames would have it moved
    (`MIN_GAIN`).
    """
    sides = [side for a, b in gaps for side in (support[max(a - LONG_GAP, 0) : a], support[b + 1 : b + 1 + LONG_GAP])]
    return all(len(side) > 0 and LONG_GAP * side.mean() > MIN_GAIN for side in sides)


def images_contradict(problem: SegmentProblem, solution: SegmentSolution) -> bool:
    """Whether anything but uncovered foreground contradicts a solution: it explains too little of a performer, or
    `limb_contradicted`.
    """
    return is_doubtful(problem, solution) or limb_contradicted(problem, solution)


def limb_contradicted(problem: SegmentProblem, solution: SegmentSolution) -> bool:
    """Whether limbs lie on the background or are hidden from all views."""
    return limb_on_background(problem, solution) or limb_hidden_for_long(problem, solution)
