"""The unknowns of a wand: its place and direction on every frame."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...numerics.arrays import Array, Ints

WAND_DOF = 5
"""Unknowns of a wand on a frame: its middle (3), and its direction along the two axes of `tangents`."""


@dataclass(frozen=True, eq=False)
class Wand:
    """A wand of known length on n frames.

    Attributes
    ----------
    frames : ndarray of int, shape (n,)
        Frames of the capture, increasing.
    middle : ndarray, shape (n, 3)
        Metres, world.
    direction : ndarray, shape (n, 3)
        Unit vectors from the second end to the first.
    length : float
        Metres.
    """

    frames: Ints
    middle: Array
    direction: Array
    length: float

    def __len__(self) -> int:
        return len(self.frames)

    @property
    def ends_world(self) -> Array:
        """Both ends, shape (n, 2, 3), metres."""
        half = self.length / 2 * self.direction
        return np.stack([self.middle + half, self.middle - half], axis=1)

    def moved(self, step: Array) -> Wand:
        """Return the wand after a step of shape (n, 5)."""
        direction = self.direction + np.einsum("nij,nj->ni", tangents(self.direction), step[:, 3:])
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        return replace(self, middle=self.middle + step[:, :3], direction=direction)

    def in_world(self, R: Array, t: Array) -> Wand:
        """Return the same wand in a world whose points are R x + t, metres, with R (3, 3) and t (3,)."""
        return replace(self, middle=self.middle @ R.T + t, direction=self.direction @ R.T)

    def scaled(self, scale: float) -> Wand:
        """Return the same wand in a world scaled by a factor."""
        return replace(self, middle=scale * self.middle, length=scale * self.length)

    def take(self, chosen: NDArray[Any]) -> Wand:
        """Return the wand on some of its frames."""
        return Wand(self.frames[chosen], self.middle[chosen], self.direction[chosen], self.length)


def tangents(direction: Array) -> Array:
    """Return two unit vectors perpendicular to each direction (n, 3) and to each other, shape (n, 3, 2)."""
    axis = np.eye(3)[np.argmin(np.abs(direction), axis=1)]
    first = np.cross(direction, axis)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(direction, first)], axis=-1)
