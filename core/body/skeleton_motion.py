"""A skeleton at rest and its motion, in the world: what files and rigs contain, with bones of any names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..numerics.arrays import Array
from .body import Body
from .kinematics import part_poses
from .motion import Motion


@dataclass(frozen=True, eq=False)
class RestSkeleton:
    """Bones at rest, in the world, Z up; any unit of length.

    Attributes
    ----------
    names : tuple of str, length J
    parents : tuple of int
        Index of the bone that each hangs on, -1 for none; parents come first.
    heads, tails : ndarray, shape (J, 3)
        Joints, and the ends of the bones; a tail is NaN where the bone has none.
    ground : float
        Height on which the skeleton stands.
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    heads: Array
    tails: Array
    ground: float = 0.0

    def indices(self, names: Sequence[str]) -> list[int]:
        """Return the indices of bones by their names."""
        where = {name: i for i, name in enumerate(self.names)}
        return [where[name] for name in names]


@dataclass(frozen=True, eq=False)
class SkeletonMotion:
    """A skeleton's motion.

    Attributes
    ----------
    name : str
        What is moved: the name of a performer or a file.
    rest : RestSkeleton
    turns : ndarray, shape (F, J, 3, 3)
        Rotation of every bone from its rest orientation, in the world's axes.
    positions : ndarray, shape (F, J, 3)
        The bones' heads in the world.
    fps : float
        Frames per second; 0 if a file does not state it.
    """

    name: str
    rest: RestSkeleton
    turns: Array
    positions: Array
    fps: float

    def __len__(self) -> int:
        return len(self.turns)

    def rotated(self, R: Array) -> SkeletonMotion:
        """Turn the whole world about its origin by a rotation (3, 3)."""
        rest = RestSkeleton(self.rest.names, self.rest.parents, self.rest.heads @ R.T, self.rest.tails @ R.T)
        return SkeletonMotion(self.name, rest, R @ self.turns @ R.T, self.positions @ R.T, self.fps)


def motion_of_body(body: Body, motion: Motion, name: str, fps: float) -> SkeletonMotion:
    """Return the motion of a tracked body as that of a skeleton, one bone per part.

    Parameters
    ----------
    body : Body
    motion : Motion
        F poses.
    name : str
        Name of the skeleton.
    fps : float
        Frames per second.
    """
    R, T = part_poses(body, motion)
    rest_R = np.stack([part.R_world_rest for part in body.parts])
    return SkeletonMotion(name, rest_of_body(body), R @ np.swapaxes(rest_R, -1, -2), T, fps)


def rest_of_body(body: Body) -> RestSkeleton:
    """Return the parts of a body as bones at rest."""
    return RestSkeleton(
        tuple(body.names),
        tuple(body.parents),
        np.stack([part.head_world for part in body.parts]),
        np.stack([part.tail_world for part in body.parts]),
    )
