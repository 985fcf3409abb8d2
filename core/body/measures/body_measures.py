"""Height and measures of a default body, and how they change."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...numerics.arrays import Array
from ...numerics.repeatable import on_grid
from ..body import Body
from ..human import SHIFTS, default_measures, human


@dataclass(frozen=True)
class BodyMeasures:
    """Height and measures of a default body.

    Attributes
    ----------
    stature : float
        Metres.
    values : mapping of str to float
        See `core.body.human.default_measures`.
    """

    stature: float
    values: Mapping[str, float]

    @classmethod
    def average(cls, stature: float) -> BodyMeasures:
        """Return the measures of the average person of a height."""
        return cls(stature, default_measures(stature))

    def body(self, *, solid: bool = True) -> Body:
        """Return the body with these measures. If not `solid`, its parts have no surfaces, which is faster."""
        return human(self.stature, self.values, solid=solid)

    def changed(self, change: Array) -> BodyMeasures:
        """Return the measures after a step (1 + M,): all are scaled by exp(change[0]), then change[1:], metres, is
        added.
        """
        growth = float(np.exp(np.clip(change[0], -0.1, 0.1)))
        before, after = default_measures(self.stature), default_measures(self.stature * growth)
        grown = {
            name: value + after[name] - before[name] + float(extra)
            for (name, value), extra in zip(self.values.items(), change[1:], strict=True)
        }
        least = {name: value if name in SHIFTS else max(value, 0.2 * after[name]) for name, value in grown.items()}
        return BodyMeasures(self.stature * growth, least)

    def on_grid(self) -> BodyMeasures:
        """Return the measures where they are the same on every processor."""
        stature, *values = on_grid(np.array([self.stature, *self.values.values()])).tolist()
        return BodyMeasures(stature, dict(zip(self.values, values, strict=True)))
