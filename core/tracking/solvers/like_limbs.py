"""Where two like limbs meet, silhouettes do not show which is which afterwards.

The smoothest motion decides; or the pictures, between motions with the limbs exchanged from one meeting to the next.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
import scipy  # its parts are loaded when they are used
from numpy.typing import NDArray

from ...body import Body, part_poses
from ...body.limbs import limb_pairs
from ...body.motion import Motion
from ...numerics import rotations
from ...numerics.arrays import Array
from .problem import SegmentProblem

MEETING = 0.05
"""Duration over which the way between two limbs is smoothed, seconds."""
PARTED = 0.75
"""Limbs meet where they are less far apart than this share of how far they part in between."""
BESIDE = 0.2
"""How long before and after a meeting their velocities are compared, seconds."""


def untangled_limbs(problem: SegmentProblem, motions: Sequence[Motion]) -> list[Motion]:
    """Give all like limbs of every performer their own way, see `untangled`."""
    found = list(motions)
    for i in problem.sought:
        body = problem.bodies[i]
        for pair in limb_pairs(body):
            free = ~problem.fixed[i][:, 3:].reshape(len(found[i]), -1, 3)[:, pair[0] + pair[1]].any(axis=(1, 2))
            found[i] = untangled(body, found[i], pair, problem.fps, free)
    return found


def untangled(
    body: Body, motion: Motion, pair: tuple[list[int], list[int]], fps: float, free: NDArray[np.bool_] | None = None
) -> Motion:
    """Give each of two like limbs its own way again where they were taken for one another.

    They may have been exchanged wherever they are nearest to each other; those exchanges are undone that leave the
    smoothest motion. At the first and last frame they are what they are.

    Parameters
    ----------
    body : Body
    motion : Motion
        F poses.
    pair : tuple of lists of int
        See `limb_pairs`.
    fps : float
    free : ndarray of bool, shape (F,), optional
        The frames on which the limbs may be exchanged.
    """
    apart, meetings = _meetings(body, motion, pair, fps)
    frames = np.zeros(len(motion), dtype=bool)
    for (a, b), swapped in zip(
        zip(meetings, [*meetings, len(motion)][1:], strict=True), _exchanges(apart, meetings, fps), strict=True
    ):
        frames[a:b] = swapped
    frames &= True if free is None else free
    return exchanged(body, motion, pair, frames) if frames.any() else motion


def exchanges(problem: SegmentProblem, motions: Sequence[Motion]) -> Iterator[tuple[Motion, ...]]:
    """The motions with two like limbs exchanged between two of their meetings, one such stretch at a time.

    A solver that took the limbs for one another at both meetings has made its way between them smooth: that they were
    exchanged, only the images show. Key poses are meetings too: limbs may be taken for one another right beside them.
    """
    for i in problem.sought:
        body, motion = problem.bodies[i], motions[i]
        for pair in limb_pairs(body):
            apart, meetings = _meetings(body, motion, pair, problem.fps)
            distance = np.linalg.norm(apart, axis=1)
            fixed = problem.fixed[i][:, 3:].reshape(len(motion), -1, 3)[:, pair[0] + pair[1]].any(axis=(1, 2))
            ends = np.flatnonzero(fixed[[0, -1]]) * (len(motion) - 1)
            for a, b in pairwise(sorted({*meetings.tolist(), *ends.tolist()})):
                frames = np.zeros(len(motion), dtype=bool)
                frames[a + fixed[a] : b] = True
                if not (fixed & frames).any() and max(distance[a], distance[b]) < PARTED * distance[a:b].max():
                    new = exchanged(body, motion, pair, frames)
                    yield (*motions[:i], new, *motions[i + 1 :])


def exchanged(body: Body, motion: Motion, pair: tuple[list[int], list[int]], frames: NDArray[np.bool_]) -> Motion:
    """A motion whose two like limbs point to where the other one did on some frames, a mask (F,)."""
    R, _ = part_poses(body, motion)
    Q = motion.rotations.copy()
    for chain, other in (pair, pair[::-1]):
        parent = R[:, body.parents[chain[0]]]
        for part, like in zip(chain, other, strict=True):
            turned = np.swapaxes(parent @ body.R_parent_rest[part], -1, -2) @ R[:, like]
            Q[frames, part] = rotations.orthonormal(turned[frames])
            parent = R[:, like]
    return Motion(motion.translations, Q)


def _meetings(
    body: Body, motion: Motion, pair: tuple[list[int], list[int]], fps: float
) -> tuple[Array, NDArray[np.intp]]:
    """How far apart two like limbs are in the directions of their bones, (F, d), and where that is least."""
    R, _ = part_poses(body, motion)
    trunk = np.flatnonzero(body.ancestry[pair[0][0]] & body.ancestry[pair[1][0]])[-1]
    left, right = (np.swapaxes(R[:, [trunk]], -1, -2) @ R[:, chain] for chain in pair)
    apart = (right - left)[..., 1].reshape(len(motion), -1)
    apart = scipy.ndimage.gaussian_filter1d(apart, MEETING * fps, axis=0, mode="nearest")
    distance = np.linalg.norm(apart, axis=1)
    return apart, 1 + np.flatnonzero((distance[1:-1] < distance[:-2]) & (distance[1:-1] < distance[2:]))


def _exchanges(apart: Array, meetings: NDArray[np.intp], fps: float) -> list[bool]:
    """After which meetings two limbs, `apart` by (F, d), are to be exchanged so that their velocities go on."""
    reach, last = max(2, round(BESIDE * fps)), len(apart) - 1
    ways: dict[int, tuple[float, list[bool]]] = {1: (0.0, [])}
    for f in meetings:
        p, q = max(f - reach, 0), min(f + reach, last)
        before = (apart[f] - apart[p]) / (f - p)
        jump = {s: float((((s * apart[q] - apart[f]) / (q - f) - before) ** 2).sum()) for s in (1, -1)}
        ways = {
            side: min(
                ((cost + jump[side * was], [*way, side < 0]) for was, (cost, way) in ways.items()), key=lambda w: w[0]
            )
            for side in (1, -1)
        }
    return ways[1][1]
