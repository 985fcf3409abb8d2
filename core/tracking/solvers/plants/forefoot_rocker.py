"""The forefoot rocker: where feet roll over their soles as the heels rise.

A foot that leaves the ground turns about a place of its sole that stands still until the end (J. Perry, Gait Analysis,
1992). In stiff shoes it lies in front of the ball, which then creeps though the foot stands. Of all places between heel
and toes, the one that the evidence has stand still best is found.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ....body.soles import BALL_SHARE, Soles
from ....numerics.arrays import Array
from ....numerics.frame_ranges import runs
from .apparent_plants import ApparentPlants, Plant
from .plant_evidence import PlantEvidence, most_by_chance

SHARES = np.linspace(0.6, 1.0, 9)
"""Places that are compared, as shares of the way from the heel to the tip of the big toe."""
SHARE_SIGMA = 0.1
"""Standard deviation of the place about the ball, before anything is known of the performer."""


def with_forefoot_rockers(evidence: PlantEvidence, performer: int, apparent: ApparentPlants, ratios: Array) -> Soles:
    """Return the soles with the balls where the feet roll: the likeliest place, the same for both feet.

    It minimises the sum of what keeping it still costs in all apparent plants of the balls, except those that the
    evidence refuses wherever it is: these creep.

    Parameters
    ----------
    evidence : PlantEvidence
    performer : int
    apparent : ApparentPlants
        Apparent plants of the balls, among others.
    ratios : ndarray, shape (P,)
        See `standing_feet.with_standing_feet`.
    """
    soles = apparent.plants.soles
    there = [replace(apparent.plants, soles=soles.with_balls_at(share)) for share in SHARES]
    costs = ((SHARES - BALL_SHARE) / SHARE_SIGMA) ** 2
    for point in (c for c, name in enumerate(soles.names) if name.startswith("ball")):
        ratio = evidence.ratio_of_errors(performer, int(soles.parts[point]), ratios)
        for steps in runs(apparent.plants.steps[:, point]):
            own = [evidence.cost(Plant(plants, performer, point, steps), ratio) for plants in there]
            if min(own) < most_by_chance(3 * (steps[1] + 1 - steps[0])):
                costs += own
    return soles.with_balls_at(_least(costs))


def _least(costs: Array) -> float:
    """Return the share of least cost, by the parabola through the three shares around it."""
    k = int(np.clip(np.argmin(costs), 1, len(SHARES) - 2))
    a, b, _ = np.polyfit(SHARES[k - 1 : k + 2], costs[k - 1 : k + 2], 2)
    return float(np.clip(-b / (2 * a), SHARES[0], SHARES[-1])) if a > 0 else float(SHARES[np.argmin(costs)])
