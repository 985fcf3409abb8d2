"""Solutions for single performers, solved further: what the results of searches for limbs are compared with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from ....body.motion import Motion
from ..descent_stages import SETTLED
from ..equations.measurement import Workspace, solution_at
from ..equations.problem import SegmentProblem, SegmentSolution
from ..equations.segment_equations import SegmentNoise
from ..gauss_newton import descend
from ..view_subsets import views_in_sight
from .solution_ranking import clearly_likelier, noise_at


@dataclass(frozen=True, eq=False)
class SettledSolution:
    """A solution after as many further iterations as the result of a search has had.

    Attributes
    ----------
    begin : SegmentSolution
        The solution before these.
    noise : SegmentNoise
        The noise at `begin`, under which all are measured.
    solution : SegmentSolution
    """

    begin: SegmentSolution
    noise: SegmentNoise
    solution: SegmentSolution

    @classmethod
    def after(
        cls, problem: SegmentProblem, begin: SegmentSolution, workspace: Workspace, noise: SegmentNoise | None = None
    ) -> SettledSolution:
        """Solve a solution further; in a single view, unless that leads it astray (`_unless_astray`). The noise there
        may be known.
        """
        noise = noise or noise_at(problem, begin, workspace)
        settled = descend(problem, begin.motions, workspace, SETTLED, noise)
        if not problem.shows_depth:
            settled = _unless_astray(problem, noise, begin, settled, workspace)
        return cls(begin, noise, settled.without_equations())


def unsettled(problem: SegmentProblem, motions: Sequence[Motion], workspace: Workspace) -> SegmentSolution:
    """Return motions as a solution that is still to be settled."""
    sampling = SETTLED[-1].sampling_of(views_in_sight(problem, motions))
    return solution_at(problem, motions, sampling, workspace)


def _unless_astray(
    problem: SegmentProblem,
    noise: SegmentNoise,
    begin: SegmentSolution,
    settled: SegmentSolution,
    workspace: Workspace,
) -> SegmentSolution:
    """Return a solution that was solved further, or as it was before if it was clearly likelier then.

    A single view says little, so that smoothness may draw a limb back from where a search has found it: the further
    back, the smoother the motion seems, and the more it is drawn.
    """
    assert settled.evidence is not None
    same = solution_at(problem, begin.motions, settled.evidence.sampling, workspace, noise.sigma)
    return replace(same, variances=begin.variances) if clearly_likelier(problem, noise, same, settled) else settled


class SettledSolutions:
    """Settled solutions of the performers of one problem, and the noise there, each computed once for any number of
    limbs: again only where the solution for a performer has other motions.

    Parameters of the methods are the problem of one performer (`SegmentProblem.alone`), a solution, and a workspace.
    """

    def __init__(self) -> None:
        self._noise: dict[int, tuple[tuple[Motion, ...], SegmentNoise]] = {}
        self._kept: dict[int, SettledSolution] = {}

    def noise(self, alone: SegmentProblem, solution: SegmentSolution, workspace: Workspace) -> SegmentNoise:
        """Return the noise of the images at a solution (`noise_at`)."""
        [performer] = alone.sought
        known = self._noise.get(performer)
        if known is None or known[0] is not solution.motions:
            known = self._noise[performer] = solution.motions, noise_at(alone, solution, workspace)
        return known[1]

    def after(self, alone: SegmentProblem, solution: SegmentSolution, workspace: Workspace) -> SettledSolution:
        """Return a solution, solved further."""
        [performer] = alone.sought
        kept = self._kept.get(performer)
        if kept is None or kept.begin.motions is not solution.motions:
            noise = self.noise(alone, solution, workspace)
            kept = self._kept[performer] = SettledSolution.after(alone, solution, workspace, noise)
        return kept
