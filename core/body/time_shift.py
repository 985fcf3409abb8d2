"""Views taken between the frames of the shot: the poses at their instants, and how these depend on the frames' poses.

A camera that is not synchronised shows the performers slightly later, or earlier, than the shot's frames. Between two
frames, joints are assumed to turn and the root to move at a constant rate; before the first and after the last known
pose they are extrapolated at the same rate.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from ..numerics import rotations
from ..numerics.arrays import Array
from ..numerics.banded_blocks import BandedBlocks, with_translation
from .motion import Motion, stacked

_INSTANTS_AT_ONCE = 64


@dataclass(frozen=True, eq=False)
class Delayed:
    """The poses of a motion at F instants, each interpolated between two of N known poses.

    Attributes
    ----------
    motion : Motion
        F poses, at the instants.
    earlier : ndarray of int, shape (F,)
        Index of the first of the two known poses.
    start : int
        Index among the N of the first of the F poses that belong to the instants; those before and after are held.
    jacobians : tuple of ndarray, shape (F, 1 + P, 3, 3)
        Derivatives of the instants' increments by those of the first and of the second pose, see `Motion.moved`. Only
        the blocks of the translation and of every part's rotation by itself are stored; all others are zero.
    """

    motion: Motion
    earlier: NDArray[np.intp]
    start: int
    jacobians: tuple[Array, Array]

    def spread(self, blocks: BandedBlocks) -> BandedBlocks:
        """Map normal equations in the poses at the instants to those in the poses on the frames.

        The given system may couple neighbouring instants only.
        """
        F, D = blocks.gradient.shape
        N = max(self.start + F, int(self.earlier.max()) + 2)
        out = BandedBlocks.zeros(N, D)
        for a, b in product((0, 1), repeat=2):
            left, right = self.jacobians[a], self.jacobians[b]
            for own in _pieces(F):
                add = _between(left[own], blocks.diagonal[own], right[own])
                _add(out, self.earlier[own] + a, self.earlier[own] + b, add)
            for own in _pieces(F - 1):
                across = _between(left[1:][own], blocks.first[own], right[:-1][own])
                later, sooner = self.earlier[1:][own], self.earlier[:-1][own]
                _add(out, later + a, sooner + b, across)
                _add(out, sooner + b, later + a, np.swapaxes(across, 1, 2))
        cut = BandedBlocks(out.diagonal, out.first, out.second, out.gradient, blocks.energy).cut(
            self.start, self.start + F
        )
        return replace(cut, gradient=self.gradients_on_frames(blocks.gradient[..., None])[..., 0])

    def gradients_on_frames(self, gradients: Array) -> Array:
        """Map n gradients in the poses at the instants, shape (F, D, n), to those in the poses on the frames."""
        F, D, n = gradients.shape
        out = np.zeros((max(self.start + F, int(self.earlier.max()) + 2), D, n))
        for a in (0, 1):
            np.add.at(out, self.earlier + a, _through(self.jacobians[a], gradients))
        return out[self.start : self.start + F]


def _pieces(count: int) -> Iterator[slice]:
    """Generate slices of some instants at a time: products of all those of a long segment take much memory."""
    return (slice(k, k + _INSTANTS_AT_ONCE) for k in range(0, count, _INSTANTS_AT_ONCE))


def _through(J: Array, blocks: Array) -> Array:
    """J^T times blocks (F, D, n)."""
    F, D, n = blocks.shape
    return (np.swapaxes(J, -1, -2) @ blocks.reshape(F, -1, 3, n)).reshape(F, D, n)


def _between(left: Array, blocks: Array, right: Array) -> Array:
    """Left^T times blocks (F, D, D) times right."""
    return np.swapaxes(_through(right, np.swapaxes(_through(left, blocks), 1, 2)), 1, 2)


def _add(out: BandedBlocks, row: NDArray[np.intp], column: NDArray[np.intp], blocks: Array) -> None:
    """Add blocks on and below the diagonal to a system; those above it are their transposes, and are skipped."""
    for distance, band in enumerate((out.diagonal, out.first, out.second)):
        at = row - column == distance
        for there, block in zip(column[at], blocks[at], strict=True):  # np.add.at takes several times as long
            band[there] += block


def delayed(
    motion: Motion,
    delay: float,
    before: Motion | None = None,
    after: Motion | None = None,
    steps: Array | None = None,
) -> Delayed:
    """Return the poses at a constant delay after each of F >= 2 frames.

    Parameters
    ----------
    motion : Motion
        F poses.
    delay : float
        The delay in frames, between -1 and 1.
    before, after : Motion, optional
        The poses on the frame before the first and on the frame after the last, if they are known.
    steps : ndarray, optional
        The time from each of all these poses to the next, frames; by default one. None is shorter than the delay.
    """
    known = stacked([m for m in (before, motion, after) if m is not None])
    start = 0 if before is None else 1
    if steps is None:
        instants = start + np.arange(len(motion)) + delay
        earlier = np.clip(np.floor(instants).astype(np.intp), 0, len(known) - 2)
        share = instants - earlier
    else:
        times = np.cumsum([0.0, *steps])
        instants = times[start : start + len(motion)] + delay
        earlier = np.clip(np.searchsorted(times, instants, side="right") - 1, 0, len(known) - 2)
        share = (instants - times[earlier]) / steps[earlier]
    one, other = known[earlier], known[earlier + 1]
    turn = rotations.log(np.swapaxes(one.rotations, -1, -2) @ other.rotations)
    part = share[:, None, None] * turn
    step = np.concatenate([other.translations - one.translations, turn.reshape(len(turn), -1)], axis=1)
    along = share[:, None, None, None] * rotations.right_jacobian(part)
    by_one = rotations.exp(-part) - along @ rotations.left_jacobian_inverse(turn)
    by_other = along @ rotations.right_jacobian_inverse(turn)
    return Delayed(
        one.moved(share[:, None] * step),
        earlier,
        start,
        (with_translation(by_one, 1 - share), with_translation(by_other, share)),
    )


def poses_after(motions: Sequence[Motion], delay: float, frames: NDArray[np.int64] | Sequence[int]) -> list[Motion]:
    """Return the poses of some performers at a delay after some of their frames; see `delayed`."""
    picked = np.asarray(frames, dtype=np.int64)
    return [motion[picked] if delay == 0 else delayed(motion, delay).motion[picked] for motion in motions]
