"""Solving from several starts: Gauss-Newton finds only the minimum nearest to its start.

The first start is the curve through the key poses. Where the images contradict its solution, three other kinds of
start are tried: the curve with another turn of the whole body (`whole_turns`), the motion followed frame by frame from
the key poses (`sequential_start`), and motions in which lost limbs were searched for in uncovered foreground
(`search_rounds`). Solutions are compared by how much of the performer-like foreground they cover and how likely they
make the images (`solution_ranking`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ...body.motion import Motion
from ...runtime.timing import Seconds
from .approach import approach
from .assessment.settled_solutions import SettledSolution
from .assessment.solution_doubts import (
    doubted_performers,
    images_contradict,
    is_doubtful,
    limb_contradicted,
    others_hide,
    worst_first,
)
from .assessment.solution_ranking import covering_most, likeliest_at_rest, noise_at, settled_further
from .descent_stages import (
    COARSE_STAGES,
    FINE_STAGES,
    FREE_STAGES,
    OUTLINE_REACH,
    POLISHED_AT_ONCE,
    SETTLED,
    STAGES,
    STAGES_AMONG_OTHERS,
    DescentStage,
)
from .equations.measurement import Workspace, solution_at
from .equations.problem import AccelerationSearch, SegmentProblem, SegmentSolution
from .gauss_newton import continued, descend
from .joint_moves import farthest_joint
from .limb_corrections.limb_exchange import with_limbs_exchanged
from .limb_corrections.limbs_elsewhere import limbs_elsewhere
from .limb_corrections.mirrored_limbs import with_limbs_mirrored
from .limb_corrections.search_rounds import MAX_SEARCH_ROUNDS, TrialRound, searched, searched_among_others
from .limb_corrections.strayed_limbs import with_limbs_returned
from .starts.sequential_start import follow_both_ways
from .starts.whole_turns import with_whole_turn

_FIRST_SHARE = 0.7
"""Share of the progress that is that of the first solution: mostly it is the only one, and else a fifth of the work."""


def best_of_starts(
    problem: SegmentProblem, start: Sequence[Motion], workspace: Workspace, first: SegmentSolution | None = None
) -> SegmentSolution:
    """Solve for the motion of all performers between their key poses, from as many starts as the images call for.

    All performers are solved together from the curve through the key poses (`first_solution`). Where the images
    contradict that, other starts are tried for a single performer (`_best_alone`), or for each of several in doubt
    (`_best_among_others`). Parameters as in `gauss_newton.descend`; `first` is the solution from the curve, if it is
    known.
    """
    begin = 0.0 if first else _FIRST_SHARE
    best = first or first_solution(problem, start, workspace.part(0.0, begin))
    seconds = Seconds(best.seconds)
    if problem.keypoints:
        with seconds.measure("initial solution"):
            best = with_limbs_returned(problem, start, best, workspace.silent())
    if problem.search is not AccelerationSearch.JOINTS:
        problem = problem.with_smoothness(best.variances)
    if problem.settings.limb_search and (doubted := doubted_performers(problem, start, best)):
        part = workspace.part(begin, 1.0)
        if problem.among_others:
            best = _best_among_others(problem, start, best, doubted, part)
        else:
            best = _best_alone(problem, start, best, part)
        seconds.add(best.seconds)
    if problem.keypoints:
        with seconds.measure("initial solution"):
            best = replace(with_limbs_mirrored(problem, best, workspace.silent()), doubted=best.doubted)
    return replace(best, seconds=seconds)


def first_solution(problem: SegmentProblem, start: Sequence[Motion], workspace: Workspace) -> SegmentSolution:
    """Descend from the start: a single performer in several views without plants, unless the images contradict that
    (`_without_plants_first`). Where several performers hide one another in several views, by all pixels in the end, as
    those who are hidden are seen by few views. Performers who are held do not count. Parameters as in
    `gauss_newton.descend`.
    """
    several = len(problem.searched) > 1
    if problem.shows_depth and not several:
        return _without_plants_first(problem, start, workspace)
    if not problem.shows_depth or problem.keypoints:
        return descend(problem, start, workspace, STAGES)
    roughly = STAGES[0].sampling_of(len(problem.views))
    hidden = others_hide(workspace.measure(problem, start, roughly).evidence.unhidden)
    return replace(descend(problem, start, workspace, STAGES_AMONG_OTHERS if hidden else STAGES), polished=hidden)


def _without_plants_first(problem: SegmentProblem, start: Sequence[Motion], workspace: Workspace) -> SegmentSolution:
    """Descend from the start with soles that seem planted left free; where the images contradict the result, with them
    held: a leg may have been lost for the lack of them.
    """
    begun = approach(problem, start, workspace.part(0.0, 0.5), COARSE_STAGES)
    free = descend(problem, begun, workspace.part(0.5, 0.8), FREE_STAGES)
    if not problem.settings.plants or not doubted_performers(problem, start, free):
        return free
    held = descend(problem, begun.counted(), workspace.part(0.8, 1.0), FINE_STAGES)
    seconds = Seconds(free.seconds)
    seconds.add(held.seconds)
    return replace(continued(free, held), seconds=dict(seconds))


def _best_among_others(
    problem: SegmentProblem,
    start: Sequence[Motion],
    first: SegmentSolution,
    doubted: Sequence[int],
    workspace: Workspace,
) -> SegmentSolution:
    """Solve for each performer in doubt, with the motions of the others given; the refinement adapts these.

    Parameters and `seconds` as in `best_of_own_starts`.
    """
    seconds, motions = Seconds(), first.motions
    assert first.evidence is not None
    stages = POLISHED_AT_ONCE if others_hide(first.unhidden) else FINE_STAGES
    for k, i in enumerate(worst_first(problem, first, doubted)):
        own_start = [start[j] if j == i else motion for j, motion in enumerate(motions)]
        part = workspace.part(k / len(doubted), (k + 1) / len(doubted))
        alone = problem.alone(i)
        before = replace(first, only=i)
        if k:  # limbs of another performer, found since, may have been what contradicted this one
            before = descend(alone, motions, workspace.silent(), SETTLED)
            seconds.add(before.seconds)
            if not doubted_performers(alone, own_start, before):
                motions = before.motions
                continue
        own = turned_and_searched(alone, own_start, before, part, stages)
        seconds.add(own.seconds)
        if own.motions is not before.motions:
            motions = own.motions
    if motions is first.motions:
        return replace(first, seconds=seconds, doubted=tuple(doubted))
    with seconds.measure("initial solution"):
        found = solution_at(problem, motions, first.evidence.sampling, workspace.silent())
    return replace(
        continued(first, found),
        variances=first.variances,
        seconds=seconds,
        doubted=tuple(doubted),
        polished=first.polished,
    )


def turned_and_searched(
    problem: SegmentProblem,
    start: Sequence[Motion],
    first: SegmentSolution,
    workspace: Workspace,
    stages: Sequence[DescentStage] = FINE_STAGES,
) -> SegmentSolution:
    """Solve for one of several performers from another turn of the body (`whole_turns`, by these stages), and search it
    for limbs (`_searched_again`). With lost limbs a wrong turn may cover more than none, so where one does, limbs are
    searched for without it, too, and the likelier solution is taken; only once if the images no longer contradict the
    turned solution. Parameters as in `best_of_own_starts`; `seconds` is the time spent here.
    """
    seconds = Seconds()
    if not _can_be_searched(problem):
        best = covering_most(problem, first, _followed(problem, start, workspace, seconds))
        return replace(best, seconds=seconds)
    with seconds.measure("initial solution"):
        _, turned = with_whole_turn(problem, start, first, workspace.part(0.0, 0.05), stages)
        best = _searched_again(problem, start, turned, workspace.part(0.35, 1.0))
        if turned is not first:
            rounds = MAX_SEARCH_ROUNDS if doubted_performers(problem, start, best) else 1
            straight = _searched_again(problem, start, first, workspace.silent(), rounds)
            noise = noise_at(problem, first, workspace)
            both = [descend(problem, one.motions, workspace.silent(), SETTLED, noise) for one in (best, straight)]
            best = likeliest_at_rest(problem, noise, *both, workspace=workspace)
    return replace(best, seconds=seconds)


def _searched_again(
    problem: SegmentProblem,
    start: Sequence[Motion],
    best: SegmentSolution,
    workspace: Workspace,
    rounds: int = MAX_SEARCH_ROUNDS,
) -> SegmentSolution:
    """Search for limbs of one of several performers as long as some are found and the images contradict the result."""
    for k in range(rounds):
        part = workspace.part(k / rounds, (k + 1) / rounds)
        before, best = best, searched_among_others(problem, best, k, part)
        found = limbs_elsewhere(problem, before.motions, best.motions)
        if not found or not doubted_performers(problem, start, best):
            break
    return best


def _best_alone(
    problem: SegmentProblem, start: Sequence[Motion], first: SegmentSolution, workspace: Workspace
) -> SegmentSolution:
    """Solve for a single performer from several starts; if it stays in doubt, left and right limbs are exchanged where
    that is better. Parameters and result as in `best_of_own_starts`.
    """
    best = best_of_own_starts(problem, start, first, workspace.part(0.0, 0.9))
    return with_sides_exchanged(problem, best, workspace.part(0.9, 1.0)) if best.doubted else best


def with_sides_exchanged(problem: SegmentProblem, best: SegmentSolution, workspace: Workspace) -> SegmentSolution:
    """Exchange left and right limbs of a single performer where that is better, unless keypoints show them; the time
    that it takes is that of the initial solution.
    """
    if problem.keypoints:
        return best
    seconds = Seconds(best.seconds)
    with seconds.measure("initial solution"):
        found = with_limbs_exchanged(problem, best, workspace)
    return replace(found, seconds=seconds, doubted=best.doubted)


def best_of_own_starts(
    problem: SegmentProblem, start: Sequence[Motion], first: SegmentSolution, workspace: Workspace
) -> SegmentSolution:
    """Solve for a single performer from several starts and return the best solution.

    The body may have turned the longer way round from one key pose to the next, which is tried first (`whole_turns`).
    Where the first solution explains too little, the motion is followed frame by frame from the key poses: a limb that
    is lost alone would be lost again. Then limbs are searched for around the solutions. If nothing but uncovered
    foreground contradicts the first solution, and no whole turn is added to it, a single round of the search decides
    first whether the performer's limbs can be there at all: the foreground may be a bystander. So it does for the
    solution from the motion that was followed, and where both starts lead to the same motion (`starts_agree`): the
    search goes on only if it finds a likelier one.

    Parameters
    ----------
    problem : SegmentProblem
    start : sequence of Motion
        F poses per performer.
    first : SegmentSolution
        The solution from that start.
    workspace : Workspace

    Returns
    -------
    SegmentSolution
        `seconds` is the time spent here. `doubted` is empty if the doubt was dispelled.
    """
    seconds, doubted = Seconds(), tuple(problem.sought)
    if not _can_be_searched(problem):
        best = covering_most(problem, first, _followed(problem, start, workspace, seconds))
        return replace(best, seconds=seconds, doubted=doubted)
    trial, settled = None, None
    with seconds.measure("initial solution"):
        start, first = with_whole_turn(problem, start, straight := first, workspace.part(0.0, 0.05))
    if first is straight and not images_contradict(problem, first):
        with seconds.measure("initial solution"):
            begin = SettledSolution.after(problem, first, workspace.silent())
            trial = TrialRound.around(problem, begin, workspace.part(0.0, 0.1))
        if not trial.explains(problem):
            return replace(first, seconds=seconds)
    solutions = [first]
    if is_doubtful(problem, first):
        solutions.append(_followed(problem, start, workspace, seconds))
    best = covering_most(problem, *solutions)
    agreed = trial is None and starts_agree(problem, *solutions)
    if agreed or best is not first:
        with seconds.measure("initial solution"):
            settled = SettledSolution.after(problem, best, workspace.silent())
            if agreed:  # at rest, as a search may be likelier for having come nearer to the same motion
                rested = settled_further(problem, settled.noise, settled.solution, workspace.silent())
                settled = replace(settled, solution=rested)
            dispelled = agreed or not images_contradict(problem, settled.solution)
            if dispelled:
                trial = TrialRound.around(problem, settled, workspace.part(0.25, 0.35))
                dispelled = not trial.gains(problem)
        if dispelled:
            return replace(settled.solution, seconds=seconds)
    # Even if the cover raises no doubt an arm may be lost: it is a small part of what is to be covered.
    with seconds.measure("initial solution"):
        best = searched(problem, start, solutions, workspace.part(0.35, 1.0), trial=trial, settled=settled)
    return replace(best, seconds=seconds, doubted=doubted)


def searched_once(problem: SegmentProblem, first: SegmentSolution, workspace: Workspace) -> SegmentSolution | None:
    """Make one round of the search for limbs around a solution for a single performer, and return that or the solution;
    None where more than uncovered foreground contradicts it. `seconds` is the time of both.
    """
    if images_contradict(problem, first):
        return None
    seconds = Seconds(first.seconds)
    with seconds.measure("initial solution"):
        settled = SettledSolution.after(problem, first, workspace.silent())
        trial = TrialRound.around(problem, settled, workspace)
    return replace(trial.found if trial.explains(problem) else first, seconds=dict(seconds))


def _can_be_searched(problem: SegmentProblem) -> bool:
    """Whether the limbs of the one performer that is solved for are worth a search.

    Keypoints show where limbs are. In a single view many poses look alike, unless key poses on both sides decide.
    """
    [performer] = problem.sought
    return len(problem.whole_keys(performer)) >= (1 if problem.shows_depth else 2) and not problem.keypoints


def _followed(
    problem: SegmentProblem, start: Sequence[Motion], workspace: Workspace, seconds: Seconds
) -> SegmentSolution:
    """Solve from the motion followed frame by frame from the key poses; the time is added to `seconds`."""
    with seconds.measure("initial solution"):
        initial = follow_both_ways(problem, start, workspace.part(0.0, 0.15))
    found = descend(problem, initial, workspace.part(0.15, 0.25))
    seconds.add(found.seconds)
    return found


def starts_agree(problem: SegmentProblem, *solutions: SegmentSolution) -> bool:
    """Whether solutions for a single performer from different starts are as near to each other as a descent reaches,
    although they explain too little, and no limb is known to be lost.
    """
    first, *others = solutions
    if not others:
        return False
    near = all(farthest_joint(problem, first.motions, other.motions) < OUTLINE_REACH for other in others)
    return near and not any(limb_contradicted(problem, one) for one in solutions)
