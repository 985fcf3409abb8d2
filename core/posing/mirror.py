"""Mirroring poses, as Blender's Paste Pose Flipped does."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..body import Body
from ..body.motion import Motion

_ACROSS = np.diag([1.0, -1.0, -1.0])  # rotations about a bone's y and z axes change sign
_SIDEWAYS = np.diag([-1.0, 1.0, 1.0])  # reflects across the symmetry plane of the rest pose, in the root's frame


def mirrored_poses(body: Body, motion: Motion, partners: Sequence[int], root: bool = True) -> Motion:
    """Return poses with left and right exchanged.

    Parameters
    ----------
    body : Body
    motion : Motion
    partners : sequence of int, length P
        Index of each part's counterpart on the other side; parts in the middle have their own.
    root : bool
        Whether to mirror the root, too: its rotation, and its position across the symmetry plane of the rest pose.
    """
    Q: NDArray[np.float64] = _ACROSS @ motion.rotations[:, list(partners)] @ _ACROSS
    if not root:
        Q[:, 0] = motion.rotations[:, 0]
        return Motion(motion.translations, Q)
    R0 = body.R_parent_rest[0]
    shift = motion.translations - body.offsets[0]
    return Motion(body.offsets[0] + shift @ (R0 @ _SIDEWAYS @ R0.T), Q)
