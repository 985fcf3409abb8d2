"""An arm that swings on through the key poses at both ends of a segment, and the same arm led astray between them."""

from __future__ import annotations

import numpy as np
from kfmocap.core.body import human
from kfmocap.core.body.motion import Motion
from kfmocap.core.numerics import rotations
from synthetic import at_rest

BODY, FRAMES, FPS = human(1.75), 12, 30.0
ARM = [BODY.index(f"{name}.R") for name in ("upper_arm", "forearm", "hand")]


def swinging() -> Motion:
    """An arm that swings on at a steady speed through the poses on both ends, and one frame beyond."""
    motion = at_rest(BODY, FRAMES + 2)
    turns = np.zeros((FRAMES + 2, 3))
    turns[:, 2] = 0.09 * np.arange(FRAMES + 2)
    motion.rotations[:, ARM[0]] = rotations.exp(turns)
    return motion


WHOLE = swinging()
TRUTH = WHOLE[1:-1]


def astray() -> Motion:
    """The arm turns back right after the first key pose, and comes back until the last."""
    turns = np.zeros((FRAMES, 3))
    turns[1:, 0] = np.linspace(-0.8, 0.0, FRAMES - 1)
    Q = TRUTH.rotations.copy()
    Q[:, ARM[0]] = Q[:, ARM[0]] @ rotations.exp(turns)
    return Motion(TRUTH.translations, Q)
