"""Motion: the pose of a body on every frame, and its degrees of freedom as the solvers see them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ..numerics import rotations
from ..numerics.arrays import Array, Bools
from ..numerics.repeatable import on_grid


@dataclass(frozen=True, eq=False)
class Motion:
    """Poses of one body.

    Attributes
    ----------
    translations : ndarray, shape (F, 3)
        T_1: the root's joint in the world, metres.
    rotations : ndarray, shape (F, P, 3, 3)
        Q: rotation of each part from its rest orientation, Blender's pose-bone rotation.
    """

    translations: Array
    rotations: Array

    def __len__(self) -> int:
        return len(self.translations)

    def __getitem__(self, frames: slice | NDArray[Any] | list[int]) -> Motion:
        return Motion(self.translations[frames], self.rotations[frames])

    def replaced(self, start: int, part: Motion) -> Motion:
        """Return a copy whose frames from `start` on are those of `part`."""
        T, Q = self.translations.copy(), self.rotations.copy()
        T[start : start + len(part)], Q[start : start + len(part)] = part.translations, part.rotations
        return Motion(T, Q)

    def with_parts(self, parts: Sequence[int], other: Motion) -> Motion:
        """Return a copy in which some parts have the rotations of another motion."""
        Q = self.rotations.copy()
        Q[:, parts] = other.rotations[:, parts]
        return Motion(self.translations, Q)

    def moved(self, delta: Array) -> Motion:
        """Move along the manifold: T + d_T, Q exp(d_Q).

        Parameters
        ----------
        delta : ndarray, shape (F, D)
            Increments in the order of the degrees of freedom: translation in metres, then each part's rotation
            vector in its own frame, radians.
        """
        steps = delta[:, 3:].reshape(len(self), -1, 3)
        return Motion(self.translations + delta[:, :3], rotations.orthonormal(self.rotations @ rotations.exp(steps)))

    def on_grid(self, fixed: Bools) -> Motion:
        """Return the motion rounded so that it is the same on every processor. Joints, and the root's position, stay as
        they are on frames on which any of their degrees of freedom is fixed, bool (F, D).
        """
        free = ~fixed.reshape(len(self), -1, 3).any(axis=2)
        T, turns = (on_grid(values) for values in (self.translations, rotations.log(self.rotations)))
        return Motion(
            np.where(free[:, :1], T, self.translations),
            np.where(free[:, 1:, None, None], rotations.exp(turns), self.rotations),
        )

    def difference(self, other: Motion) -> Array:
        """Return the increments that take this motion to `other`, shape (F, D); inverse of `moved`."""
        steps = rotations.log(np.swapaxes(self.rotations, -1, -2) @ other.rotations)
        return np.concatenate([other.translations - self.translations, steps.reshape(len(self), -1)], axis=1)

    def quaternions(self) -> Array:
        """Blender's (w, x, y, z) of every part, without sign jumps along time, shape (F, P, 4)."""
        F, P = self.rotations.shape[:2]
        q = Rotation.from_matrix(self.rotations.reshape(-1, 3, 3)).as_quat().reshape(F, P, 4)
        return rotations.continuous_signs(q[..., [3, 0, 1, 2]])


def with_motion(motions: Sequence[Motion], performer: int, motion: Motion) -> tuple[Motion, ...]:
    """Return the motions of all performers, with that of one of them replaced."""
    return (*motions[:performer], motion, *motions[performer + 1 :])


def stacked(motions: list[Motion]) -> Motion:
    """Motions concatenated along time."""
    return Motion(np.concatenate([m.translations for m in motions]), np.concatenate([m.rotations for m in motions]))
