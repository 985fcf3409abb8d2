"""By how much limbs must make the images likelier where they are found, and whether they promise to."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ....body.kinematics import scene_poses
from ....body.motion import Motion, with_motion
from ..assessment.solution_ranking import RESTING_GAIN
from ..equations.problem import SegmentProblem
from ..limb_evidence.limb_images import ViewRatios
from ..limb_evidence.limb_likelihood import pixel_gains, with_sides_learned
from ..limb_evidence.limb_model import FINE_POINTS, LimbOfPerformer, limb_of
from ..thinned_frames import ThinnedProblem
from .limbs_elsewhere import frames_elsewhere

LEAST_GAIN = 100.0
"""Smallest gain in log likelihood, in natural units, for which limbs are moved that the images do not contradict, or
those of one of several performers: solving a limb that is right once more from elsewhere gains up to 60 by chance."""


def contradicted(problem: SegmentProblem) -> bool:
    """Whether the images contradicted a solution for a single performer: then anything that is likelier is an
    improvement.
    """
    return bool(problem.doubted) and not problem.among_others


def least_gain(problem: SegmentProblem) -> float:
    """Smallest gain in log likelihood, in natural units, for which a solution is left for another one.

    A single view hardly shows how far a limb of its only performer points towards it, so that no more than a small gain
    is to be had.
    """
    if not (problem.shows_depth or problem.among_others):
        return 0.0
    return RESTING_GAIN if contradicted(problem) else LEAST_GAIN


def is_promising(
    thinned: ThinnedProblem,
    motions: Sequence[Motion],
    limbs: tuple[int, Sequence[list[int]]],
    found: Motion,
    ratios: Sequence[ViewRatios],
    *,
    share: float = 1.0,
) -> bool:
    """Whether limbs of a single performer are worth solving for where a search has found them: unless nothing
    contradicts where they are, and the pixels that led the search there gain less than the images must (`least_gain`),
    in proportion to the frames on which it was made. Each limb of a pair is asked with those before it where they were
    found: it may be where one of them was.

    Parameters
    ----------
    thinned : ThinnedProblem
        Of the performer alone, on the frames on which it was searched for.
    motions : sequence of Motion
        F poses per performer, with the limbs where they are.
    limbs : tuple of int and sequence of list of int
        Index of the performer, and the limbs as chains of its parts.
    found : Motion
        F poses of the performer, with the limbs where they were found.
    ratios : sequence of ViewRatios
        What the views show of the performer on the kept frames.
    share : float
        Share of the least gain that is enough.
    """
    alone, some = thinned.problem, tuple(thinned.of_motions(motions))
    if alone.among_others or contradicted(alone) or not alone.shows_depth:
        return True
    performer, chains = limbs
    there, gain = found[thinned.frames], 0.0
    for chain in chains:
        gain += _gain_elsewhere(alone, some, (performer, chain), there, ratios)
        Q = some[performer].rotations.copy()
        Q[:, chain] = there.rotations[:, chain]
        some = with_motion(some, performer, Motion(there.translations, Q))
    return gain >= share * least_gain(alone) * len(thinned.frames) / thinned.whole.length


def _gain_elsewhere(
    problem: SegmentProblem,
    motions: Sequence[Motion],
    place: LimbOfPerformer,
    found: Motion,
    ratios: Sequence[ViewRatios],
) -> float:
    """Return by how much likelier a limb's pixels and sides are where it was found, on the frames on which it is
    elsewhere there, natural units.
    """
    before, rng = motions[place[0]], np.random.default_rng(problem.settings.search_seed)
    limb, parts = limb_of(problem, motions, place, rng, FINE_POINTS)
    geometry, poses = problem.geometry(), scene_poses(problem.bodies, motions)
    uncovered = [view.uncovered(geometry, poses, parts) for view in ratios]
    uncovered = with_sides_learned(limb, uncovered, problem.whole_keys(place[0]), rng)
    gains = pixel_gains(limb, uncovered, before, found)
    return float(gains[frames_elsewhere(limb.body, limb.chain, before, found)].sum())
