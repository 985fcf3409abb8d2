"""Stages of Gauss-Newton's descent for starts of different kinds."""

from __future__ import annotations

from ...evidence.sampling import Sampling
from .gauss_newton import NOTICED, REACH, ROUGH_STEP, DescentStage

SETTLING = (
    DescentStage(Sampling(1.0, 4.0, 3, REACH), 2, small=ROUGH_STEP),
    DescentStage(Sampling(1.0, 1.0, 3, REACH), 1),
)
"""For limbs that were looked for, around a trunk that is held."""
SETTLED = (DescentStage(Sampling(1.0, 1.0, 3, REACH), 3),)
"""From there to the solution."""
RESUMED = (
    DescentStage(Sampling(1.0, 1.0, 2, REACH), 5, small=0.003, small_refused=True, noticed=NOTICED, plants=False),
)
"""From a motion that was found before to the one with the key poses as they are now: all of it may be a little off, and
no other stage follows."""
WINDOW = (
    DescentStage(Sampling(2.0, 4.0, 4, 0.10), 2, small=ROUGH_STEP),
    DescentStage(Sampling(1.0, 1.0, 4, REACH), 2),
)
"""For each window of `sequential_start.follow`."""
