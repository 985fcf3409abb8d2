"""The floor: the height at which points of the soles stand on key poses, which are exact."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ....numerics.arrays import Array

EVEN = 0.03
"""Largest distance of standing points from their floor, as they are posed or tracked, metres: what is farther from it
stands on a step, or does not stand."""
USUAL_SIGMA, USUAL_COUNT = 0.003, 2.0
"""Standard deviation of the heights of standing points before any is known, metres: soles give way, and the shapes of
feet are not quite right. It counts as much as this number of heights."""


@dataclass(frozen=True)
class FloorHeight:
    """A level floor.

    Attributes
    ----------
    height : float
        Of points of the soles that stand on it, metres.
    sigma : float
        Standard deviation of the height of another such point, metres.
    """

    height: float
    sigma: float

    @classmethod
    def of(cls, heights: Array) -> FloorHeight | None:
        """Estimate it from the heights (n,) of standing points; None if there are none, or none is near their median.

        How much they vary is estimated as well: where key poses are posed by hand, or the floor is not level, they say
        little of other points.
        """
        on = heights[np.abs(heights - np.median(heights)) < EVEN] if len(heights) else heights
        if not len(on):
            return None
        mean, n = float(on.mean()), len(on)
        variance = (USUAL_COUNT * USUAL_SIGMA**2 + float(np.sum((on - mean) ** 2))) / (USUAL_COUNT + n - 1)
        return cls(mean, float(np.sqrt(variance * (1 + 1 / n))))

    def carries(self, path: Array) -> bool:
        """Whether a point that is tracked along a path (F, 3) while it stands does so on the floor."""
        return bool(abs(path[:, 2].mean() - self.height) < EVEN)
