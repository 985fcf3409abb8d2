"""Whether limbs are elsewhere in one motion than in another: farther away than a descent reaches."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ....body import Body, part_poses
from ....body.limbs import limbs
from ....body.motion import Motion
from ....numerics.arrays import Array, Bools
from ....numerics.frame_ranges import lasting
from ..assessment.solution_doubts import least_frames
from ..descent_stages import OUTLINE_REACH
from ..equations.problem import SegmentProblem


def is_elsewhere(body: Body, chain: Sequence[int], before: Motion, after: Motion, frames: int = 1) -> bool:
    """Whether some joint of a limb, relative to its first, is farther from where it was than a descent reaches, on so
    many frames in a row.
    """
    return bool(frames_elsewhere(body, chain, before, after, frames).any())


def frames_elsewhere(body: Body, chain: Sequence[int], before: Motion, after: Motion, frames: int = 1) -> Bools:
    """Return on which frames that is so, shape (F,)."""
    return lasting(farthest_joints(body, chain, before, after) > OUTLINE_REACH, frames)


def farthest_joints(body: Body, chain: Sequence[int], before: Motion, after: Motion) -> Array:
    """Largest distance of a limb's joint, relative to its first, from where it was before, on each frame, (F,)."""
    joints = [part_poses(body, motion)[1][:, chain] for motion in (before, after)]
    a, b = (each - each[:, :1] for each in joints)
    return np.asarray(np.linalg.norm(b - a, axis=-1).max(axis=1))


def limbs_elsewhere(problem: SegmentProblem, before: Sequence[Motion], after: Sequence[Motion]) -> bool:
    """Whether some limb of the performers that are solved for is elsewhere for `least_frames` in a row."""
    frames = least_frames(problem.fps)
    return any(
        is_elsewhere(problem.bodies[i], chain, before[i], after[i], frames)
        for i in problem.sought
        for chain in limbs(problem.bodies[i])
    )
