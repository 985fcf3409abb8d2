"""Balls that were found in a picture: where and how large they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...numerics.arrays import Array


class FoundBall(NamedTuple):
    """One ball that was found in a picture: a row of `Balls`.

    Attributes
    ----------
    centre : ndarray, shape (2,)
        Pixels.
    shape : ndarray, shape (2, 2)
        See `Balls.shapes`.
    sigma : float
        Standard deviation of each coordinate of the centre, pixels.
    """

    centre: Array
    shape: Array
    sigma: float


@dataclass(frozen=True, eq=False)
class Balls:
    """Balls that were found in a picture.

    Attributes
    ----------
    centres : ndarray, shape (n, 2)
        Of their outlines' ellipses, or of their colour where they are too small for an outline, pixels.
    shapes : ndarray, shape (n, 2, 2)
        Symmetric; an outline is centre + shape @ (cos, sin), pixels. A ball that moved while the shutter was open is
        longer than wide.
    sigma : ndarray, shape (n,)
        Standard deviation of each coordinate of the centre, pixels.
    """

    centres: Array
    shapes: Array
    sigma: Array

    def __len__(self) -> int:
        return len(self.centres)

    def __getitem__(self, which: NDArray[Any] | slice | list[int]) -> Balls:
        return Balls(self.centres[which], self.shapes[which], self.sigma[which])

    @property
    def semi_axes(self) -> Array:
        """Return the major and minor semi-axes of the outlines, shape (n, 2), pixels."""
        return np.linalg.eigvalsh(self.shapes)[:, ::-1]

    def where(self, which: NDArray[np.bool_], others: Balls) -> Balls:
        """Return these balls where `which`, shape (n,), says so, and as many others elsewhere."""
        pairs = [(getattr(self, item.name), getattr(others, item.name)) for item in fields(Balls)]
        return Balls(*(np.where(which.reshape(-1, *[1] * (own.ndim - 1)), own, other) for own, other in pairs))

    @classmethod
    def of(cls, balls: Sequence[FoundBall]) -> Balls:
        """Return single balls as a set."""
        if not balls:
            return cls.joined([])
        return cls(*(np.array(column, float) for column in zip(*balls, strict=True)))

    @classmethod
    def joined(cls, balls: Sequence[Balls]) -> Balls:
        """Return several sets of balls as one."""
        if not balls:
            return cls(np.empty((0, 2)), np.empty((0, 2, 2)), np.empty(0))
        return cls(*(np.concatenate([getattr(b, item.name) for b in balls]) for item in fields(cls)))
