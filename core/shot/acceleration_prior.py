"""How strongly the joints and the root of a body are usually accelerated."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..body import Body
from .shot import Settings

Array = NDArray[np.float64]

LEAST_MOBILITY = 0.05
"""A joint that can hardly turn about an axis has this share of the usual acceleration there, at least."""


def acceleration_precision(body: Body, fps: float, settings: Settings) -> Array:
    """Inverse variance of the acceleration of each degree of freedom, per frame squared, shape (D,).

    A joint is accelerated the less about an axis the less it can turn about it: knees and elbows are nearly hinges.
    """
    ranges = np.concatenate([np.ptp(part.limits, axis=1) for part in body.parts])
    deviation = np.full(body.dof, settings.root_acceleration)
    deviation[3:] = settings.joint_acceleration * np.clip(ranges / np.pi, LEAST_MOBILITY, 1)
    return (fps * fps / deviation) ** 2
