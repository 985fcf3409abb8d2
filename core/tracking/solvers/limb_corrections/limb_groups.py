"""Searching for limbs that may be lost, round after round: one limb, or both of a pair at once.

Both limbs of a pair are one group, as arms that are lost in front of the trunk turn shoulders and trunk with them. If
one of them is put right, the shoulders cannot follow it while the other one holds them, and the images become less
likely. So both are searched for before the body is solved for, which then turns shoulders and trunk as well.

Every round draws poses around a motion, solves from what is found elsewhere, and keeps it if the images are likelier.
The first is around an even path between the key poses, the others around the likeliest motion so far: what a search
finds departs slowly from what it searches around, so that a limb that was lost within a few frames is not found from
where it is now, nor a fast one in a single round.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ....body.motion import Motion, with_motion
from ..assessment.settled_solutions import SettledSolution, SettledSolutions
from ..assessment.solution_ranking import RESTING_GAIN, likelihood, settled_further
from ..descent_stages import SETTLED, UNCONVERGED_MOVE
from ..equations.measurement import Workspace
from ..equations.problem import SegmentProblem, SegmentSolution
from ..equations.segment_equations import SegmentNoise
from ..gauss_newton import VainTest, continued, descend
from ..joint_moves import farthest_joint
from ..limb_evidence.limb_images import ViewRatios
from ..thinned_frames import ThinnedProblem
from .limb_gains import contradicted, least_gain
from .limb_proposals import LimbGroup, LimbProposals, elsewhere, frames_searched
from .local_trials import LocalTrial
from .long_leaps import leaps_farther
from .search_rounds import MAX_SEARCH_ROUNDS, MAX_VAIN_ROUNDS


def with_limbs_found(
    problem: SegmentProblem,
    solution: SegmentSolution,
    group: LimbGroup,
    known: SettledSolutions,
    workspace: Workspace,
    *,
    ratios: Sequence[ViewRatios] | None = None,
) -> SegmentSolution:
    """Search for a group of limbs round after round, and return the likeliest solution, which may be the given one.

    Only that of one performer changes. The search ends with a round that finds the limbs where they were, even around
    an even path far from there, or after `MAX_VAIN_ROUNDS` in a row that find nothing likelier; of one of several
    performers, after one. Limbs that end where they were stay there, however much likelier the rest has become, unless
    the images contradict it: that is chance.

    For a single performer in several views, a rough search comes first, which may end the search (`limb_proposals`).

    Where frames follow each other closely, poses of a single performer's limbs are drawn on some of them
    (`thinned_frames`). What is found is solved for, and judged, on all: on some of them the images say less for it.

    Parameters
    ----------
    problem : SegmentProblem
    solution : SegmentSolution
    group : LimbGroup
    known : SettledSolutions
        Shared by the searches for all groups.
    workspace : Workspace
    ratios : sequence of ViewRatios, optional
        What the views show of one of several performers, if it is known (`views_of`).
    """
    alone = problem.alone(group.performer)
    thinned = frames_searched(alone, solution.motions)
    search = _GroupSearch(thinned, group, workspace, only_elsewhere=alone.among_others)
    settled, best = search.likeliest(solution, known, ratios)
    return solution if settled is None else _if_likelier(problem, solution, group, settled, best)


def likeliest_found(
    problem: SegmentProblem,
    solution: SegmentSolution,
    group: LimbGroup,
    known: SettledSolutions,
    workspace: Workspace,
) -> SegmentSolution | None:
    """Search for a group of limbs as `with_limbs_found` does, and return the likeliest solution, however little it
    gains; None if the limbs are nowhere else in it. A round that leads back to where they were is in vain, and the
    search ends with the first that is. Parameters as there.
    """
    thinned = ThinnedProblem.with_all(problem.alone(group.performer))
    search = _GroupSearch(thinned, group, workspace.silent(), only_elsewhere=True)
    settled, best = search.likeliest(solution, known)
    return None if settled is None or best is settled.solution else best


def with_limbs_moved(
    problem: SegmentProblem,
    solution: SegmentSolution,
    group: LimbGroup,
    motions: Sequence[Motion],
    workspace: Workspace,
) -> SegmentSolution:
    """Solve from motions with limbs elsewhere, and return that if it is likelier, as `with_limbs_found` does."""
    alone = problem.alone(group.performer)
    settled = SettledSolution.after(alone, solution, workspace.silent())
    there = solved_from(alone, motions, settled.noise, workspace.silent())
    rival = likelihood(alone, settled.noise, settled.solution) + least_gain(problem)
    there = settled_further(alone, settled.noise, there, workspace.silent(), rival=rival)
    return _if_likelier(problem, solution, group, settled, there)


@dataclass(frozen=True, eq=False)
class _GroupSearch:
    """The rounds of the search for a group of limbs.

    Attributes
    ----------
    thinned : ThinnedProblem
        The problem of the limbs' performer alone, and the frames on which poses are drawn.
    group : LimbGroup
    workspace : Workspace
        Each round is reported, not the steps in it.
    only_elsewhere : bool
        Whether a round is in vain that leads the limbs back to where they were, as they would stay there, and the
        search ends with the first round in vain.
    """

    thinned: ThinnedProblem
    group: LimbGroup
    workspace: Workspace
    only_elsewhere: bool

    def likeliest(
        self, solution: SegmentSolution, known: SettledSolutions, ratios: Sequence[ViewRatios] | None = None
    ) -> tuple[SettledSolution | None, SegmentSolution]:
        """Search round after round, and return the solution, solved further, and the likeliest one; None for the first
        if nothing was worth solving for, as the limbs were found where they are, or their pixels gain too little
        elsewhere. Parameters as in `with_limbs_found`.
        """
        alone = self.thinned.whole
        best, vain, settled, quiet = solution, 0, None, self.workspace.silent()
        proposals = LimbProposals.of(self.thinned, self.group, tuple(solution.motions), ratios)
        for turn in range(1 + MAX_SEARCH_ROUNDS):
            self.workspace.report(turn / (1 + MAX_SEARCH_ROUNDS))
            found = proposals.around(best.motions, turn)
            if found is None:
                break
            there = None
            if proposals.are_promising(best.motions, found):
                if settled is None and self.only_elsewhere:  # most limbs that are found elsewhere come back
                    there = self._solved(known.noise(alone, solution, quiet), solution, found)
                    if there is None:
                        break
                if settled is None:
                    settled = known.after(alone, solution, quiet)
                    best = settled.solution
                there = there or self._solved(settled.noise, best, found)
            if settled and there and (there := self._likelier(settled.noise, best, there)) is not None:
                best, vain = there, 0
            else:
                vain += 1
            if vain == (1 if self.only_elsewhere else MAX_VAIN_ROUNDS):
                break
        return settled, best

    def _solved(self, noise: SegmentNoise, best: SegmentSolution, found: Motion) -> SegmentSolution | None:
        """Solve with limbs where they were found; None if that is in vain.

        Where they are elsewhere on few frames, it is solved on these and those beside them first, while the motion of
        the others stays.
        """
        alone, group, workspace = self.thinned.whole, self.group, self.workspace.silent()
        i = group.performer
        away = elsewhere(alone, group, best.motions[i], found)
        moved = Motion(
            found.translations, np.where(away[:, None, None, None], found.rotations, best.motions[i].rotations)
        )
        motions = with_motion(best.motions, i, found)
        local = LocalTrial.around(alone, noise, best.motions, with_motion(best.motions, i, moved))
        if local is not None:
            here = solved_from(local.problem, local.of(best.motions), local.noise, workspace)
            there = solved_from(local.problem, local.of(with_motion(best.motions, i, moved)), local.noise, workspace)
            if (
                likelihood(local.problem, local.noise, there)
                <= likelihood(local.problem, local.noise, here) + RESTING_GAIN
            ):
                return None
            motions = local.within(best.motions, there.motions)
        if not self.only_elsewhere:
            return solved_from(alone, motions, noise, workspace)

        def back(motions: Sequence[Motion]) -> bool:
            return not elsewhere(alone, group, best.motions[i], motions[i]).any()

        there = solved_from(alone, motions, noise, workspace, vain=back)
        return None if back(there.motions) else there

    def _likelier(self, noise: SegmentNoise, best: SegmentSolution, there: SegmentSolution) -> SegmentSolution | None:
        """Solve further with limbs elsewhere, until they are at rest; None if that is no likelier."""
        alone = self.thinned.whole
        rival = likelihood(alone, noise, best) + min(RESTING_GAIN, least_gain(alone))
        there = settled_further(alone, noise, there, self.workspace.silent(), rival=rival)
        return there if likelihood(alone, noise, there) > rival else None


def _if_likelier(
    problem: SegmentProblem,
    solution: SegmentSolution,
    group: LimbGroup,
    settled: SettledSolution,
    best: SegmentSolution,
) -> SegmentSolution:
    """Return a solution, continued by the best one if limbs of the group are elsewhere in that and it is likelier than
    the solution, solved further, by the `least_gain`. Limbs of a single performer that the images do not contradict
    must not leap to where they are found, either: hidden ones find something likelier on a few frames.
    """
    if best is settled.solution:
        return solution
    alone, i = problem.alone(group.performer), group.performer
    gain = likelihood(alone, settled.noise, best) - likelihood(alone, settled.noise, settled.solution)
    moved = contradicted(problem) or elsewhere(alone, group, settled.solution.motions[i], best.motions[i]).any()
    if gain <= least_gain(problem) or not moved:
        return solution
    refuted = bool(problem.doubted) or alone.among_others
    if not refuted and leaps_farther(alone, i, settled.solution.motions[i], best.motions[i], group.chains):
        return solution
    return continued(solution, replace(best, only=problem.only))


def continued_where_likelier(
    problem: SegmentProblem,
    solution: SegmentSolution,
    first: SettledSolution,
    found: SegmentSolution,
    workspace: Workspace,
) -> SegmentSolution:
    """Return a solution of a single performer, continued by another one if that is elsewhere and, at rest, likelier by
    the `least_gain`.

    Parameters
    ----------
    problem : SegmentProblem
    solution : SegmentSolution
    first : SettledSolution
        The solution, solved further.
    found : SegmentSolution
        The other one, under the same noise.
    workspace : Workspace
    """
    if farthest_joint(problem, first.solution.motions, found.motions) < UNCONVERGED_MOVE:
        return solution
    rival = likelihood(problem, first.noise, first.solution) + least_gain(problem)
    found = settled_further(problem, first.noise, found, workspace, rival=rival)
    return continued(solution, found) if likelihood(problem, first.noise, found) > rival else solution


def solved_from(
    problem: SegmentProblem,
    motions: Sequence[Motion],
    noise: SegmentNoise,
    workspace: Workspace,
    *,
    vain: VainTest | None = None,
) -> SegmentSolution:
    """Solve from motions, until that is in vain; the result is only to be compared with others."""
    return descend(problem, motions, workspace, SETTLED, noise, vain=vain).without_equations()
