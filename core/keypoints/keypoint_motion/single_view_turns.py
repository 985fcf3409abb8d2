"""Whole turns of the body between two key poses, which a single view's keypoints show.

The curve through the key poses takes the shorter way from each to the next, so that a pirouette by nearly a turn passes
for standing still, and a fit from there stays turned away from what the keypoints show.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from ...body import Body, part_poses
from ...body.motion import Motion
from ...numerics.arrays import Array
from ...shot.motion_warping import turned
from ..keypoint_sigmas import USUAL_SIGMA, robust_energy
from .keypoint_comparison import Comparison, compared
from .keypoint_fit import FitProblem, KeypointFit, fit_motion

UPRIGHT = np.array([0.0, 1.0, 0.0])
"""The axis along the trunk, in the axes of the root."""
DOUBTFUL_RATIO = 2.0
"""A turn is tried where keypoints between two key poses fit this many times as badly as on the key poses themselves,
which are where the detector's own errors show."""


def with_whole_turns(
    problem: FitProblem, body: Body, curve: Motion, keys: Sequence[int], best: KeypointFit
) -> KeypointFit:
    """Return a fit, or a better one with whole turns of the body about its own upright axis between some key poses.

    Between neighbouring key poses whose keypoints the fit explains badly, the frames there are fitted once more, as
    they are and from the curve with a turn to the left or to the right. If a turn is better, all frames are fitted with
    it.

    Parameters
    ----------
    problem : FitProblem
        With a single view's keypoints.
    body : Body
    curve : Motion
        The curve through the key poses.
    keys : sequence of int
        Frames with a key pose of the whole body, in order.
    best : KeypointFit
        The fit of all frames.
    """
    start, seen = best.motion, compared(problem.agreement, best.places.world(part_poses(best.body, best.motion)))
    usual = _mean_cost(seen, list(keys))
    for first, last in pairwise(keys):
        here = slice(first, last + 1)
        if _mean_cost(seen, here) < DOUBTFUL_RATIO * usual:
            continue
        ways = [start[here], *(turned(curve[here], problem.fixed[here], axis) for axis in (UPRIGHT, -UPRIGHT))]
        fits = [fit_motion(problem.on_frames(here), body, way) for way in ways]
        way = int(np.argmin([fit.energy for fit in fits]))
        start = start.replaced(first, fits[way].motion) if way else start
    return best if start is best.motion else min(best, fit_motion(problem, body, start), key=lambda fit: fit.energy)


def _mean_cost(seen: Comparison, frames: slice | Sequence[int]) -> float:
    """Return the mean robust error of the keypoints on some frames, in units of the usual variance."""
    confidence = seen.keypoints.confidence[:, frames]
    usual: Array = np.full_like(seen.sigma, USUAL_SIGMA)
    return robust_energy(seen.residual[:, frames], confidence, usual) / max(float(confidence.sum()), 1e-9)
