"""The probability that a whole body is lost: that the tracker has it turned or placed otherwise than in the footage.

Between key poses far apart, a fast turn may be missed. Limb by limb, the trunk would then pass for found; but the body
as a whole explains less of the images than on the key poses. As with limbs, the states found and lost form a hidden
Markov chain.
"""

from __future__ import annotations

import numpy as np
from scipy.special import betaln

from ...body import Body
from ...body.tip_landmarks import tip_landmarks
from ...numerics.arrays import Array, Bools
from ..solvers.assessment.solution_doubts import MIN_EXPLAINED_RATIO, explained_at_best, explained_share
from ..solvers.equations.problem import SegmentProblem, SegmentSolution
from .lost_limbs import (
    FRAMES_PER_OBSERVATION,
    PRIOR_BACKGROUND_SHARE,
    SHARE_MARGIN,
    SHARE_PRECISION,
    chain_probabilities,
)

CONFIRMED_PARTS = 0.5
"""Share of the parts that keypoints can confirm beyond which these confirm the whole body."""


def lost_body_probabilities(problem: SegmentProblem, solution: SegmentSolution, performer: int, held: Bools) -> Array:
    """Probability that a performer's whole body is lost on each frame, shape (F,).

    It is zero where the solution explains enough on all frames, so that nothing is doubted.

    Parameters
    ----------
    problem : SegmentProblem
    solution : SegmentSolution
    performer : int
    held : ndarray of bool, shape (F, P)
        Where a part is known to be found: a key pose fixes it, or keypoints confirm it.
    """
    nowhere = np.zeros(problem.length)
    if not (explained_share(problem, solution, performer) < MIN_EXPLAINED_RATIO).any():
        return nowhere
    explained = explained_at_best(problem, solution, performer)
    if not (explained < MIN_EXPLAINED_RATIO).any():
        return nowhere
    return chain_probabilities(np.where(_confirmed(problem.bodies[performer], held), -np.inf, _log_odds(explained)))


def _confirmed(body: Body, held: Bools) -> Bools:
    """Return on which frames the whole body is known to be found, (F,)."""
    return np.asarray(held[:, list(tip_landmarks(body))].mean(axis=1) > CONFIRMED_PARTS)


def _log_odds(explained: Array) -> Array:
    """Log likelihood ratio (lost against found) of how much of a body is explained, (F,); 0 where nothing shows it.

    What is not explained of a body that is found varies as does the share of a limb's pixels that look like background;
    of one that is lost, any share is as likely.
    """
    missed = np.clip(1 - explained, SHARE_MARGIN, 1 - SHARE_MARGIN)
    a, b = PRIOR_BACKGROUND_SHARE * SHARE_PRECISION, (1 - PRIOR_BACKGROUND_SHARE) * SHARE_PRECISION
    found = (a - 1) * np.log(missed) + (b - 1) * np.log1p(-missed) - betaln(a, b)
    return np.asarray(np.where(np.isnan(explained), 0.0, -found / FRAMES_PER_OBSERVATION))
