"""Where limbs of a group may be instead of where they are: poses are drawn on some frames, and one path is proposed.

Most limbs that are searched for are right where they are. For a single performer in several views, the first search is
therefore a rough one, on fewer frames, and there are others only if that promises something.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ....body import Body
from ....body.motion import Motion, with_motion
from ....numerics.arrays import Bools
from ..assessment.solution_doubts import least_frames
from ..equations.problem import SegmentProblem
from ..limb_evidence.limb_images import ViewRatios
from ..limb_evidence.limb_model import FINE_POINTS, POINTS_PER_PART
from ..thinned_frames import ThinnedProblem
from .bridges import evenly_led
from .limb_gains import is_promising
from .limb_search import MIN_GAIN_ELSEWHERE, ROUGH_GAIN_SHARE, LimbSearch, freed_limb, views_of
from .limbs_elsewhere import frames_elsewhere

SEARCH_RATE = 12.0
"""Fewest frames per second on which poses of limbs are drawn, of one of several performers or roughly. Most of these
are right where they are, and how far off the others are changes slowly."""


@dataclass(frozen=True)
class LimbGroup:
    """Limbs of a performer that are searched for together.

    Attributes
    ----------
    performer : int
    chains : tuple of list of int
        One limb or two, as chains of parts.
    """

    performer: int
    chains: tuple[list[int], ...]

    def frames_elsewhere(self, body: Body, before: Motion, after: Motion, frames: int) -> Bools:
        """Return on which frames any of the limbs is elsewhere for so many frames in a row (`limbs_elsewhere`)."""
        each = [frames_elsewhere(body, chain, before, after, frames) for chain in self.chains]
        return np.any(each, axis=0)


@dataclass(frozen=True, eq=False)
class LimbProposals:
    """Proposes where the limbs of a group may be.

    Attributes
    ----------
    thinned : ThinnedProblem
        The problem of the limbs' performer alone, and the frames on which poses are drawn.
    group : LimbGroup
    motions : tuple of Motion
        F poses per performer, of which those of the others count: they stay where they are.
    known : sequence of ViewRatios, optional
        What the views show of the performer on the kept frames, if it is known.
    rough : LimbProposals, optional
        What is proposed roughly, on fewer frames, before the first search; without it, that is fine at once.
    roughly : bool
        Whether these are such.
    """

    thinned: ThinnedProblem
    group: LimbGroup
    motions: tuple[Motion, ...]
    known: Sequence[ViewRatios] | None = None
    rough: LimbProposals | None = None
    roughly: bool = False

    @classmethod
    def of(
        cls,
        thinned: ThinnedProblem,
        group: LimbGroup,
        motions: tuple[Motion, ...],
        known: Sequence[ViewRatios] | None = None,
    ) -> LimbProposals:
        """Propose roughly first for a single performer in several views, if that leaves more frames out."""
        alone, rough = thinned.whole, None
        if alone.shows_depth and not alone.among_others:
            few = ThinnedProblem.at_rate(alone, SEARCH_RATE)
            if few is not None and len(few.frames) < len(thinned.frames):
                rough = cls(few, group, motions, roughly=True)
        return cls(thinned, group, motions, known, rough)

    def around(self, motions: Sequence[Motion], turn: int) -> Motion | None:
        """Search for the limbs around motions of F poses per performer, and return that performer's motion.

        Parameters
        ----------
        motions : sequence of Motion
        turn : int
            Number of the search: selects the random poses.

        Returns
        -------
        Motion or None
            None if the limbs are where they were, or what is found roughly before the first search is not promising.
        """
        if self.rough is not None and turn == 0:
            roughly = self.rough.around(motions, turn)
            if roughly is None or not self.rough.are_promising(motions, roughly):
                return None
        return self._found(motions, turn)

    def are_promising(self, motions: Sequence[Motion], found: Motion) -> bool:
        """Whether the limbs are worth solving for where they were found (`limb_gains.is_promising`); if that is rough,
        whether they are worth finding.
        """
        limbs, share = (self.group.performer, self.group.chains), ROUGH_GAIN_SHARE if self.roughly else 1.0
        return is_promising(self.thinned, motions, limbs, found, self._ratios, share=share)

    @cached_property
    def _ratios(self) -> Sequence[ViewRatios]:
        if self.known is not None:
            return self.known
        return views_of(self.thinned.problem, self.thinned.of_motions(self.motions), self.group.performer)

    def _found(self, motions: Sequence[Motion], turn: int) -> Motion | None:
        """Search for the limbs on the kept frames, one after the other, and return the performer's motion on all
        frames; None if they are where they were.

        The first turn is around even paths of all of them, but not with a single view: the likelier of two motions that
        are far apart is not the truer one often enough there. A limb of one of several performers is only elsewhere if
        the images say clearly more for it (`MIN_GAIN_ELSEWHERE`).
        """
        group, thinned = self.group, self.thinned
        alone, i, some = thinned.problem, group.performer, thinned.of_motions(motions)
        before = around = some[i]
        for chain in group.chains if turn == 0 and alone.shows_depth else ():
            around = evenly_led(alone, i, around, chain)
        search = self._search(before)
        found = around
        for chain in group.chains:
            moved = with_motion(some, i, found)
            found = freed_limb(alone, moved, (i, chain), turn, search=search, ratios=self._ratios)
        if found is before or (alone.among_others and found is around):
            return None
        if not elsewhere(alone, group, before, found, 1 if self.roughly else None).any():
            return None
        parts = (found.rotations != before.rotations).any(axis=(0, 2, 3))
        Q, [whole] = motions[i].rotations.copy(), thinned.interpolated([found])
        Q[:, parts] = whole.rotations[:, parts]
        return Motion(motions[i].translations, Q)

    def _search(self, before: Motion) -> LimbSearch:
        share = len(self.thinned.frames) / self.thinned.whole.length
        return LimbSearch(
            points=POINTS_PER_PART if len(self.group.chains) == 1 else FINE_POINTS,
            least_gain=share * MIN_GAIN_ELSEWHERE if self.thinned.problem.among_others else -np.inf,
            before=before,
            roughly=self.roughly,
        )


def frames_searched(alone: SegmentProblem, motions: Sequence[Motion]) -> ThinnedProblem:
    """Return the problem of a performer, and the frames on which poses of its limbs are drawn; `motions` has F poses
    per performer.
    """
    several = alone.among_others
    some = ThinnedProblem.at_rate(alone, SEARCH_RATE) if several else ThinnedProblem.of(alone, motions)
    return some or ThinnedProblem.with_all(alone)


def elsewhere(
    alone: SegmentProblem, group: LimbGroup, before: Motion, after: Motion, frames: int | None = None
) -> Bools:
    """Return on which frames some limb is farther from where it was than a descent reaches, for so many in a row, by
    default for a while, as sampled poses scatter. In depth, which a single view hardly shows, a descent reaches less
    far: there it is on all frames.
    """
    if not alone.shows_depth:
        return np.ones(alone.length, bool)
    frames = least_frames(alone.fps) if frames is None else frames
    return group.frames_elsewhere(alone.bodies[group.performer], before, after, frames)
