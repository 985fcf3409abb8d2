"""Which start leads to the solution: the curve through the key poses, the motion followed from them, limbs looked for.

Gauss-Newton goes down to the nearest solution. Where the images disagree with the one below the curve, others are
tried, and the one that covers the most of what looks like the performers counts.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from itertools import islice, pairwise

import numpy as np

from ...body.motion import Motion
from ...evidence.accumulate import Sampling
from ...evidence.misfit import beyond_known, measured_misfit
from ...evidence.occlusion import LONG, intervals
from ...evidence.view_frames import views_with_foreground
from ...numerics.arrays import Array
from ...runtime.timing import Seconds
from .gauss_newton import NOTICED, REACH, ROUGH_STEP, DescentStage, SegmentNoise, approach, continued, descend
from .limb_search import exchanges, found_limbs, limbs, pairs, shown_areas, untangled_limbs, without_end
from .measurement import Workspace, hidden_parts, keypoint_agreement, poses_by_delay, view_instants
from .problem import AccelerationSearch, SegmentProblem, SegmentSolution
from .sequential_start import blended, excerpt, follow
from .strayed_limbs import strayed_limbs, with_limbs_held

EXPLAINED = 0.8
"""Share of what the key poses explain of their images that a solution should explain of every other frame's."""
SHOWN = 0.5
"""Share of a performer that others must leave in sight for what it explains to raise a doubt."""
IN_SIGHT = 0.9
"""Share of a performer that others must leave in sight on all frames for its motion to be followed: a few frames show
too little of somebody who is passed to be followed by themselves."""
LIMB_SHARE = 0.5
"""Share of the smallest limb that foreground beside a performer must have to be a limb that the solution lost."""
ASTRAY = 0.2
"""Share of a limb that a view must see on the background, beyond what it sees there on the key frames, for the limb to
be lost."""
BRIEF = 0.1
"""For how long that much of a limb may lie on the background, seconds: motion blur makes single frames of it."""
CONFIRMED = 0.9
"""Share of the keypoints' agreement with the first pass that clears a solution of doubt."""
SETTLING = (
    DescentStage(Sampling(1.0, 4.0, 3, REACH), 2, small=ROUGH_STEP),
    DescentStage(Sampling(1.0, 1.0, 3, REACH), 1),
)
"""Of limbs that were looked for, around a trunk that is held."""
SETTLED = (DescentStage(Sampling(1.0, 1.0, 3, REACH), 3),)
"""From there to the solution."""
RESUMED = (DescentStage(Sampling(1.0, 1.0, 2, REACH), 5, small=0.003, small_refused=True, noticed=NOTICED),)
"""From a motion that was found before to the one with the key poses as they are now. All of it may be a little off, and
no other stage follows."""
EQUAL = 0.005
"""Solutions whose covers of the performers differ by less than this share of them are equals: which of them covers the
most is chance."""
NEAR = 0.03
"""A solution that covers less than the best by more than this share has no limbs to lend to it."""
HOPELESS = 0.06
"""Limbs of one of several performers that were exchanged, and cover less by this share once they have settled, do not
come to cover more."""
ALIKE = np.radians(8)
"""Motions of a performer are one once they are solved if their parts' rotations differ by less, root mean square,
radians."""
FINALISTS = 2
"""So many of the likeliest solutions are settled on until they rest, before the likeliest counts."""
FURTHER = 4
"""How often a finalist is settled on, at most."""
RESTING = 10.0
"""A finalist rests when settling makes the pictures likelier by less, in natural units."""
LOOKS = 5
"""How often limbs are looked for, at most."""
VAIN_LOOKS = 2
"""How many of them in turn may find nothing that covers as much as what is there."""
WINDOW = (
    DescentStage(Sampling(2.0, 4.0, 4, 0.10), 2, small=ROUGH_STEP),
    DescentStage(Sampling(1.0, 1.0, 4, REACH), 2),
)
"""Within the window of `sequential_start.follow`."""

LimbSearch = Callable[[SegmentProblem, SegmentProblem, Sequence[Motion], int, Workspace], SegmentSolution]
"""See `look_for_limbs`."""


def best_of_starts(problem: SegmentProblem, start: Sequence[Motion], workspace: Workspace) -> SegmentSolution:
    """Fit the motion of all performers between their key poses.

    The curve through the key poses is one start. Each performer of whom it leaves a doubt is then solved by itself from
    other starts, among the others as they were found; see `best_of_own_starts`. At last all settle together, and like
    limbs are exchanged where that is better.
    Parameters as of `gauss_newton.descend`.
    """
    best = descend(problem, start, workspace.part(0.0, 0.2))
    seconds = Seconds(best.seconds)
    if problem.keypoints:
        with seconds.measure("initial solution"):
            best = with_limbs_returned(problem, start, best, workspace.silent())
    if problem.search is not AccelerationSearch.JOINTS:
        problem = problem.with_smoothness(best.variances)
    doubted = doubted_performers(problem, start, best) if problem.settings.limb_search else []
    motions = best.motions
    for k, i in enumerate(worst_first(problem, best, doubted)):
        own_start = [start[j] if j == i else motion for j, motion in enumerate(motions)]
        part = workspace.part(0.2 + 0.7 * k / len(doubted), 0.2 + 0.7 * (k + 1) / len(doubted))
        alone = problem.alone(i)
        before = replace(best, only=alone.only)
        if k:  # limbs of somebody else that were found may be what spoke against this performer
            before = descend(alone, motions, workspace.silent(), SETTLED)
            seconds.add(before.seconds)
            motions = before.motions
            if not doubted_performers(alone, own_start, before):
                continue
        own = best_of_own_starts(alone, own_start, before, part)
        seconds.add(own.seconds)
        motions = own.motions
        best = own if len(problem.bodies) == 1 else best
    if motions is not best.motions:
        settled = descend(problem, motions, workspace.silent(), SETTLED)
        seconds.add(settled.seconds)
        best = continued(best, settled)
    if doubted and not problem.keypoints:  # keypoints show where limbs are
        # Of all performers: who stands before the one that is doubted may have had limbs exchanged for its.
        with seconds.measure("initial solution"):
            best = with_limbs_exchanged(problem, best, workspace.part(0.9, 1.0))
    return replace(best, seconds=seconds)


def resumed(problem: SegmentProblem, start: Sequence[Motion], workspace: Workspace) -> SegmentSolution | None:
    """The solution from a motion that was found before key poses changed; None where it leaves a doubt.

    Parameters as of `gauss_newton.descend`.
    """
    found = descend(problem, start, workspace, RESUMED)
    return None if doubted_performers(problem, start, found) else found


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


def with_limbs_returned(
    problem: SegmentProblem, start: Sequence[Motion], solution: SegmentSolution, workspace: Workspace
) -> SegmentSolution:
    """A solution, or with the limbs that have left the first pass brought back there, where the evidence is for it.

    A limb is brought back and its performer solved from there. If that leads it away again, it is also held there while
    all else of the performer is solved.

    Parameters
    ----------
    problem : SegmentProblem
        With keypoints.
    start : sequence of Motion
        The first pass.
    solution : SegmentSolution
    workspace : Workspace
    """
    for i in problem.sought:
        strayed = strayed_limbs(problem, i, start[i], solution.motions[i])
        if not strayed:
            continue
        alone = problem.alone(i)
        back = solution.motions[i].with_parts([part for chain in strayed for part in chain], start[i])
        motions = (*solution.motions[:i], back, *solution.motions[i + 1 :])
        found = [descend(alone, motions, workspace, SETTLED)]
        if strayed_limbs(problem, i, start[i], found[0].motions[i]):
            found.append(descend(with_limbs_held(alone, i, strayed), motions, workspace, SETTLED))
        best = better(alone, solution, *found)
        solution = solution if best is solution else replace(continued(solution, best), only=problem.only)
    return solution


def best_of_own_starts(
    problem: SegmentProblem, start: Sequence[Motion], first: SegmentSolution, workspace: Workspace
) -> SegmentSolution:
    """Of solutions from several starts the best: the motion is followed from the key poses, unless others hide the
    performer on the way, and then limbs are looked for around the solutions.

    Where only foreground beside the performer speaks against the first solution, one look tells whether its limbs can
    be there at all: it may be somebody else's.

    Parameters
    ----------
    problem : SegmentProblem
        Of one performer.
    start : sequence of Motion
    first : SegmentSolution
        The solution from there.
    workspace : Workspace

    Returns
    -------
    SegmentSolution
        Its seconds are those spent here.
    """
    seconds, solutions, [performer] = Seconds(), [first], problem.sought
    looks = len(problem.whole_keys(performer)) > 1 and not problem.keypoints  # keypoints show where limbs are
    if looks and not speaks_against(problem, first):
        with seconds.measure("initial solution"):
            explained = limbs_explain(problem, first, workspace.part(0.0, 0.1))
        if not explained:
            return replace(first, seconds=seconds)
    if not looks or first.unhidden[performer].min() > IN_SIGHT:
        with seconds.measure("initial solution"):
            initial = followed(problem, start, workspace.part(0.0, 0.15))
        solutions.append(descend(problem, initial, workspace.part(0.15, 0.25)))
        seconds.add(solutions[1].seconds)
    if looks:
        # Without a doubt an arm may still be lost: it is a small part of what is to be covered.
        with seconds.measure("initial solution"):
            best = searched(problem, start, solutions, workspace.part(0.25, 1.0))
    else:
        best = better(problem, *solutions)
    return replace(best, seconds=seconds)


def confirmed(problem: SegmentProblem, start: Sequence[Motion], solution: SegmentSolution) -> bool:
    """Whether keypoints agree with a solution nearly as well as with the start, which they led to."""
    if not problem.keypoints:
        return False
    return keypoint_agreement(problem, solution.motions) >= CONFIRMED * keypoint_agreement(problem, start)


def better(problem: SegmentProblem, *solutions: SegmentSolution) -> SegmentSolution:
    """The solution that covers the most of what looks like the performers and meets the most keypoints of those that
    are sought, if any.
    """
    merit = [found.cover for found in solutions]
    if problem.keypoints:
        most = max(*(float(found.explained[problem.sought].sum()) for found in solutions), 1.0)
        merit = [m / most + keypoint_agreement(problem, s.motions) for m, s in zip(merit, solutions, strict=True)]
    return solutions[int(np.argmax(merit))]


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


def limbs_explain(problem: SegmentProblem, solution: SegmentSolution, workspace: Workspace) -> bool:
    """Whether one look for limbs makes the pictures likelier than a solution does that has settled as long.

    A bystander's bare arm looks like the performer's, but other views do not show it where the performer's could be.
    """
    noise = noise_of(problem, solution, workspace)
    settled = descend(problem, solution.motions, workspace.silent(), SETTLED, noise)
    found = look_for_limbs(problem, problem, settled.motions, 0, workspace, noise=noise)
    gain = likelihood(problem, noise, found) - likelihood(problem, noise, settled)
    return gain > RESTING and not alike(found.motions, settled.motions)


def searched(
    problem: SegmentProblem,
    start: Sequence[Motion],
    solutions: Sequence[SegmentSolution],
    workspace: Workspace,
    look: LimbSearch | None = None,
) -> SegmentSolution:
    """The solution from looking for limbs around some solutions, and then around the best until that has an equal.

    Of the solutions only equals of the best are looked around, or all where that is doubtful; they settle first, and
    those that lead to one motion are looked around once. While all are doubtful, limbs are also looked for around a
    trunk that moves as at the start, which limbs in wrong places have not led astray. It also ends after `VAIN_LOOKS`
    that cover clearly less than one of these solutions. The likeliest of all counts, see `likeliest_at_rest`, and
    exchanges limbs with the others, see `recombined`.
    `look` is how limbs are looked for, by default `look_for_limbs`.
    """
    held = replace(problem, fixed=tuple(fixed | (np.arange(fixed.shape[1]) < 6) for fixed in problem.fixed))
    first = better(problem, *solutions)
    likely, noise = solutions if doubtful(problem, first) else equals(solutions), noise_of(problem, first, workspace)
    look = look or partial(look_for_limbs, noise=noise)
    settled = [descend(problem, solution.motions, workspace.silent(), SETTLED, noise) for solution in likely]
    begins: list[tuple[Sequence[Motion], SegmentProblem]] = []
    for solution in settled:
        if not any(alike(solution.motions, motions) for motions, _ in begins):
            begins.append((solution.motions, problem))
    found: list[SegmentSolution] = []
    looking, exchanging = workspace.part(0.0, 0.7), workspace.part(0.7, 1.0)
    while begins and len(found) < LOOKS:
        motions, around = begins.pop(0)
        part = looking.part(len(found) / LOOKS, (len(found) + 1) / LOOKS)
        found.append(look(problem, around, motions, len(found), part))
        best = better(problem, *settled, *found)
        if not begins and doubtful(problem, best) and around is not held:
            begins.append((start, held))
        elif not begins and len(equals([*settled, *found])) == 1 and (best in found or len(found) < VAIN_LOOKS):
            begins.append((best.motions, problem))
    best = likeliest_at_rest(problem, noise, better(problem, *settled), *settled, *found, workspace=workspace)
    return recombined(problem, best, [*settled, *found], noise, exchanging)


def recombined(
    problem: SegmentProblem,
    best: SegmentSolution,
    others: Sequence[SegmentSolution],
    noise: SegmentNoise,
    workspace: Workspace,
) -> SegmentSolution:
    """The best of some solutions, or with like limbs exchanged with others where that is likelier.

    What is drawn by chance may bring the arms to their places in one solution and the legs in another. Limbs do not
    fit a trunk that others have led, so they settle before they are compared. Of equals the
    likeliest counts; all are compared under one noise.
    """
    lenders = equals(others, NEAR)
    tried = [solution.motions for solution in lenders]
    places = [(i, left + right) for i in problem.sought for left, right in pairs(problem.bodies[i])]
    for k, (i, parts) in enumerate(places):
        share = workspace.part(k / len(places), (k + 1) / len(places))
        mixtures = []
        for a, b in [pair for other in lenders for pair in ((best, other), (other, best))]:
            lent = a.motions[i].with_parts(parts, b.motions[i])
            motions = (*a.motions[:i], lent, *a.motions[i + 1 :])
            if not any(alike(motions, before) for before in tried):
                tried.append(motions)
                mixtures.append(motions)
        found = [best]
        for n, motions in enumerate(mixtures):
            part = share.part(n / len(mixtures), (n + 1) / len(mixtures))
            found.append(descend(problem, motions, part, SETTLED, noise))
        best = likeliest_at_rest(problem, noise, *found, workspace=workspace)
    return best


def noise_of(problem: SegmentProblem, solution: SegmentSolution, workspace: Workspace) -> SegmentNoise:
    """The noise of the images at a solution, under which others of the performers that are sought can be compared.

    That of more performers has more pixels: the gradients of the one that is sought would count too much.
    """
    evidence = solution.evidence
    assert evidence is not None
    if problem.only is not None:
        evidence = workspace.measure(problem, solution.motions, evidence.sampling).evidence
    return SegmentNoise.of(evidence, problem.settings)


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


def likelihood(problem: SegmentProblem, noise: SegmentNoise, solution: SegmentSolution) -> float:
    """The logarithm of how likely the pictures are with a solution that was measured under a noise, but for a constant.

    It is what the pixels say that show the performers, those that repeat one another counted once, less the costs of
    gradients and outlines. That of smoothness has no part in it: how smooth the motion is, each solution found itself.
    The gradients of a view that stands still cost what they do less what the same pixels would cost if nothing moved in
    the picture: a limb that is left alone in one place, because pixels are easier to follow elsewhere, moves all the
    same.
    """
    evidence = solution.evidence
    assert evidence is not None
    once = evidence.pixel_share(problem.settings.lengths[0]) / evidence.sampling.stride**2
    shown = once @ evidence.explained.sum(axis=(1, 2))
    outlines = evidence.outlines.energy.sum() / (problem.settings.lengths[1] * evidence.sampling.tolerance**2)
    still = np.array([view.camera.stands_still for view in problem.views])
    gradients = evidence.gradients
    moved = np.where(still[:, None], noise.precision[:, None] * gradients.gain, -noise.weight * gradients.cost)
    return float(shown + moved.sum() - outlines)


def with_limbs_exchanged(problem: SegmentProblem, best: SegmentSolution, workspace: Workspace) -> SegmentSolution:
    """A solution, or with like limbs exchanged between their meetings where that covers more and is likelier.

    Legs that pass each other twice between two key poses look much as if they had turned back both times; looking for
    one limb at a time does not find that, as the other one is in its place. Performers take turns, each among the
    others as they are by then; where limbs of somebody were exchanged, all settle together at last.
    """
    if len(problem.sought) == 1:
        return _with_own_limbs_exchanged(problem, best, workspace)
    motions = best.motions
    for k, i in enumerate(problem.sought):
        part = workspace.part(k / len(problem.sought), (k + 1) / len(problem.sought))
        alone = problem.alone(i)
        own = replace(best, motions=motions, only=alone.only)
        motions = _with_own_limbs_exchanged(alone, own, part).motions
    if motions is best.motions:
        return best
    return continued(best, descend(problem, motions, workspace.silent(), SETTLED))


def _with_own_limbs_exchanged(problem: SegmentProblem, best: SegmentSolution, workspace: Workspace) -> SegmentSolution:
    """The same for the performer that is sought."""
    noise = noise_of(problem, best, workspace)
    count = len(list(exchanges(problem, best.motions)))
    if count:
        best = continued(best, descend(problem, best.motions, workspace.part(0.0, 1 / (1 + count)), SETTLED, noise))
    for k in range(count):
        part = workspace.part((k + 1) / (1 + count), (k + 2) / (1 + count))
        # Anew of what is best by now: an exchange that was accepted leaves the limbs meeting where they did.
        for motions in islice(exchanges(problem, best.motions), k, k + 1):
            found = _exchange_settled(problem, best, motions, noise, part)
            if found is not None and _exchange_counts(problem, best, found, noise):
                best = continued(best, found)
    return best


def _exchange_counts(
    problem: SegmentProblem, best: SegmentSolution, found: SegmentSolution, noise: SegmentNoise
) -> bool:
    """Whether a solution with limbs exchanged is the better one. Of one of several performers the pictures' likelihood
    decides, which knows what it hides of the others; a limb that is hidden the right way may cover less.
    """
    if problem.only is None:
        return found.cover > best.cover and found.energy[-1] < best.energy[-1]
    return likelihood(problem, noise, found) > likelihood(problem, noise, best) + RESTING


def _exchange_settled(
    problem: SegmentProblem,
    best: SegmentSolution,
    motions: Sequence[Motion],
    noise: SegmentNoise,
    workspace: Workspace,
) -> SegmentSolution | None:
    """The solution from limbs that were exchanged; None for one of several performers if once the limbs have settled it
    covers so much less that the rest cannot make up for it.
    """
    if problem.only is None:
        return descend(problem, motions, workspace, (*SETTLING, *SETTLED), noise)
    settled, *_ = approach(problem, motions, workspace.part(0.0, 0.3), SETTLING)
    if cover_at(problem, best, settled, workspace) < best.cover - HOPELESS * abs(best.sought_cover):
        return None
    return descend(problem, settled, workspace.part(0.3, 1.0), SETTLED, noise)


def cover_at(
    problem: SegmentProblem, solution: SegmentSolution, motions: Sequence[Motion], workspace: Workspace
) -> float:
    """How much of what looks like the performers motions cover, measured as for a solution."""
    assert solution.evidence is not None
    return float(workspace.measure(problem, motions, solution.evidence.sampling).evidence.explained.sum())


def alike(motions: Sequence[Motion], others: Sequence[Motion]) -> bool:
    """Whether motions of all performers are so near to each other that solving makes them one."""
    turns = [a.difference(b)[:, 3:] for a, b in zip(motions, others, strict=True)]
    return all(np.sqrt(3 * np.mean(turn**2)) < ALIKE for turn in turns)


def equals(solutions: Sequence[SegmentSolution], share: float = EQUAL) -> list[SegmentSolution]:
    """Those of some solutions that cover as much of the performers as the one that covers the most, but for a share."""
    covers = [solution.cover for solution in solutions]
    least = max(covers) - share * max(abs(solution.sought_cover) for solution in solutions)
    return [solution for solution, cover in zip(solutions, covers, strict=True) if cover >= least]


def look_for_limbs(
    problem: SegmentProblem,
    around: SegmentProblem,
    motions: Sequence[Motion],
    seed: int,
    workspace: Workspace,
    *,
    noise: SegmentNoise | None = None,
) -> SegmentSolution:
    """The solution from looking for limbs around motions, which settle first with what `around` has fixed."""
    begin = found_limbs(problem, motions, seed, workspace.part(0.0, 0.6))
    settled, *_ = approach(around, begin, workspace.part(0.6, 0.8), SETTLING)
    return descend(problem, untangled_limbs(problem, settled), workspace.part(0.8, 1.0), SETTLED, noise)


def followed(problem: SegmentProblem, start: Sequence[Motion], workspace: Workspace) -> list[Motion]:
    """The motion followed from the key poses of the performer that is sought to the next ones, or to the problem's
    ends.
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
    return descend(replace(problem, settings=without_prediction), start, workspace, WINDOW)
