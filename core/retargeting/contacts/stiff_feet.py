"""Feet whose toes have no bone: where the performer rolls over the balls, they stand on the tips of their toes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...numerics.arrays import Array


@dataclass(frozen=True, eq=False)
class StiffFoot:
    """A stiff foot on F frames.

    Attributes
    ----------
    skin : ndarray, shape (V, 3)
        Corners of its skin at rest, from the ankle, in the world's axes, metres.
    turns : ndarray, shape (F, 3, 3)
        Its rotation from the rest pose.
    ground : float
        Height of the ground at rest, from the ankle, metres.
    """

    skin: Array
    turns: Array
    ground: float

    def lift(self, height: Array) -> Array:
        """Return how far the foot must be raised to be out of the floor, metres, (F,), given the height of its ankle
        above the floor, (F,). Skin that is below the ground at rest may be as far below the floor.
        """
        below = max(self.ground - float(self.skin[:, 2].min()), 0.0)
        lowest = height + (self.turns[:, 2] @ self.skin.T).min(axis=1)
        return np.asarray(np.maximum(-below - lowest, 0.0))
