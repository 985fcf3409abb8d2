"""Which degrees of freedom of a performer are given, so that nothing solves for them."""

from __future__ import annotations

import numpy as np

from ..body.unknown_parts import resting_parts
from ..numerics.arrays import Bools
from .shot import Performer


def fixed_degrees(performer: Performer, first: int, last: int) -> Bools:
    """Return which degrees of freedom are held on frames first to last, shape (F, D): by key poses, by locked joints,
    or because the part is unknown and rests.
    """
    body = performer.body
    fixed = np.zeros((last + 1 - first, body.dof), dtype=bool)
    keys = performer.key_poses
    inside = (keys.frames >= first) & (keys.frames <= last)
    fixed[keys.frames[inside] - first] = keys.fixed[inside]
    locked = body.limits[..., 0] == body.limits[..., 1]
    locked[resting_parts(body, performer.unknown)] = True
    fixed[:, 3:] |= locked.ravel()
    return fixed
