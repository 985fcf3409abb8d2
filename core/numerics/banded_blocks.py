"""Normal equations that couple every frame with the next two, stored as blocks."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .arrays import Array


@dataclass(frozen=True, eq=False)
class BandedBlocks:
    """A symmetric block-banded system over F frames of D degrees of freedom.

    Attributes
    ----------
    diagonal : ndarray, shape (F, D, D)
    first : ndarray, shape (F - 1, D, D)
        Block of frame j + 1 (rows) against frame j (columns).
    second : ndarray, shape (max(F - 2, 0), D, D)
        Block of frame j + 2 against frame j.
    gradient : ndarray, shape (F, D)
        Gradient of half the energy.
    energy : float
        Sum of squared weighted residuals.
    """

    diagonal: Array
    first: Array
    second: Array
    gradient: Array
    energy: float

    @classmethod
    def zeros(cls, frames: int, dof: int) -> BandedBlocks:
        """Return the system without any information, all zeros."""
        return cls(
            np.zeros((frames, dof, dof)),
            np.zeros((max(frames - 1, 0), dof, dof)),
            np.zeros((max(frames - 2, 0), dof, dof)),
            np.zeros((frames, dof)),
            0.0,
        )

    def cut(self, start: int, stop: int) -> BandedBlocks:
        """Return the system of frames start to stop (exclusive) alone, with all others held."""
        return BandedBlocks(
            self.diagonal[start:stop],
            self.first[start : stop - 1],
            self.second[start : max(stop - 2, start)],
            self.gradient[start:stop],
            self.energy,
        )

    def among(self, frames: int, start: int) -> BandedBlocks:
        """Return the system of a run of frames as part of one of more frames, of which it says nothing else; the
        inverse of `cut`.
        """
        return self.zeros(frames, self.gradient.shape[1]).add(self, start)

    def scaled(self, factor: float) -> BandedBlocks:
        """Return the system with its energy multiplied by a factor."""
        return BandedBlocks(
            factor * self.diagonal,
            factor * self.first,
            factor * self.second,
            factor * self.gradient,
            factor * self.energy,
        )

    def near(self, sigma: float) -> BandedBlocks:
        """Return the system whose solution is expected within a deviation of where it is linearised, for every unknown.

        Unknowns of which it says little then stay where they are, instead of going as far as it happens to say.
        """
        frames, dof = self.gradient.shape
        expected = replace(self.zeros(frames, dof), diagonal=np.tile(np.eye(dof) / sigma**2, (frames, 1, 1)))
        return self + expected

    def gradient_at(self, increments: Array) -> Array:
        """Gradient of half the energy after the unknowns have changed by increments (F, D), shape (F, D)."""
        out = self.gradient + (self.diagonal @ increments[..., None])[..., 0]
        for distance, band in ((1, self.first), (2, self.second)):
            out[distance:] += (band @ increments[:-distance, :, None])[..., 0]
            out[:-distance] += (np.swapaxes(band, 1, 2) @ increments[distance:, :, None])[..., 0]
        return out

    def add(self, other: BandedBlocks, start: int = 0) -> BandedBlocks:
        """Return the sum with another system, of a run of the frames from `start` on, in the arrays of this one: those
        of long segments are large.
        """
        for own, more in (
            (self.diagonal, other.diagonal),
            (self.first, other.first),
            (self.second, other.second),
            (self.gradient, other.gradient),
        ):
            own[start : start + len(more)] += more
        return replace(self, energy=self.energy + other.energy)

    def __add__(self, other: BandedBlocks) -> BandedBlocks:
        return BandedBlocks(
            self.diagonal + other.diagonal,
            self.first + other.first,
            self.second + other.second,
            self.gradient + other.gradient,
            self.energy + other.energy,
        )


def with_translation(J: Array, translation: Array | float = 1.0) -> Array:
    """Return the Jacobians of the translation, by a factor (N,), and of all parts' turns (N, P, 3, 3): (N, 1 + P, 3,
    3).
    """
    first = np.reshape(translation, (-1, 1, 1, 1)) * np.eye(3)
    return np.concatenate([np.broadcast_to(first, (len(J), 1, 3, 3)), J], axis=1)


def block_diagonal(J: Array) -> Array:
    """Jacobians of three degrees of freedom each (N, B, 3, 3) as those of all of them, (N, 3 B, 3 B)."""
    N, B = J.shape[:2]
    out, b = np.zeros((N, B, 3, B, 3)), np.arange(B)
    out[:, b, :, b] = np.swapaxes(J, 0, 1)
    return out.reshape(N, 3 * B, 3 * B)


def diagonal_groups(blocks: Array) -> Array:
    """Blocks of each group of three degrees of freedom with itself, (N, D / 3, 3, 3), of blocks (N, D, D)."""
    groups = np.arange(blocks.shape[1] // 3)
    by_group = blocks.reshape(len(blocks), len(groups), 3, len(groups), 3)
    return np.asarray(by_group[:, groups, :, groups].swapaxes(0, 1))
