"""Left and right limbs that are mistaken for each other.

Where the two limbs of a pair meet, silhouettes do not show which is which afterwards. Either the smoothest motion
decides, or the images do, between motions with the limbs exchanged from one meeting to the next.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy  # its parts are loaded when they are used
from numpy.typing import NDArray

from ....body import Body, part_poses
from ....body.limbs import limb_pairs
from ....body.motion import Motion, stacked, with_motion
from ....body.smoothness import second_differences
from ....numerics import rotations
from ....numerics.arrays import Array
from ..equations.problem import SegmentProblem

SMOOTHING_SIGMA = 0.05
"""Standard deviation of the Gaussian that smooths the difference between two limbs over time, seconds."""
MEETING_RATIO = 0.75
"""Two minima of the distance count as meetings if both are smaller than this share of its maximum between them."""
VELOCITY_WINDOW = 0.2
"""Time before and after a meeting over which velocities are compared, seconds."""
ROUGHNESS_RATIO = 2.0
"""Ratio of the sums of squared accelerations with limbs of one of several performers exchanged and as they are, up to
which they may be mistaken for each other: limbs that are, leap where they begin to follow each other's pictures, and so
do limbs that are not once they are exchanged."""
SWITCH_WINDOW = 0.1
"""Time before and after a meeting within which the motion may change from one limb to the other, seconds."""


def untangled_limbs(problem: SegmentProblem, motions: Sequence[Motion]) -> list[Motion]:
    """Undo exchanges of all pairs of limbs of the performers that are solved for; see `untangled`."""
    found = list(motions)
    for i in problem.sought:
        body = problem.bodies[i]
        for pair in limb_pairs(body):
            free = ~problem.fixed_axes(i)[:, pair[0] + pair[1]].any(axis=(1, 2))
            found[i] = untangled(body, found[i], pair, problem.fps, free)
    return found


def untangled(
    body: Body, motion: Motion, pair: tuple[list[int], list[int]], fps: float, free: NDArray[np.bool_] | None = None
) -> Motion:
    """Undo exchanges of a pair of limbs where that makes the motion smoother.

    The limbs may have been exchanged wherever their distance has a minimum. Of all combinations of exchanges there, the
    one with the smallest changes of velocity is taken. On the first and the last frame the limbs stay as they are.

    Parameters
    ----------
    body : Body
    motion : Motion
        F poses.
    pair : tuple of lists of int
        The two limbs as chains of parts, see `limb_pairs`.
    fps : float
    free : ndarray of bool, shape (F,), optional
        Frames on which the limbs may be exchanged; by default all.
    """
    apart, meetings = _meetings(_apart(body, motion, pair), fps)
    frames = np.zeros(len(motion), dtype=bool)
    for (a, b), swapped in zip(
        zip(meetings, [*meetings, len(motion)][1:], strict=True), _exchanges(apart, meetings, fps), strict=True
    ):
        frames[a:b] = swapped
    frames &= True if free is None else free
    return exchanged(body, motion, pair, frames) if frames.any() else motion


@dataclass(frozen=True, eq=False)
class Exchange:
    """A proposal: motions in which one pair of limbs is exchanged on some frames.

    Attributes
    ----------
    motions : tuple of Motion
        F poses per performer.
    places : bool
        Whether the limbs have each other's places (`with_places_exchanged`), not each other's directions.
    """

    motions: tuple[Motion, ...]
    places: bool = False


def exchanges(problem: SegmentProblem, motions: Sequence[Motion]) -> Iterator[Exchange]:
    """Generate motions in which one pair of limbs is exchanged between two of its meetings.

    A solver that mistook the limbs at both meetings has made the motion between them smooth, so only the images can
    show that they were exchanged. Key poses count as meetings, too: limbs may be mistaken right beside them. The limbs
    change over near a meeting where that makes the motion smoothest. They exchange their directions. For a single
    performer in a single view, they also exchange their places: what followed the other limb's pictures is at the right
    place in the picture, and in a wrong one in depth. Limbs of one of several performers in several views exchange
    their places if they reach across each other, and otherwise their directions where that hardly makes the motion
    rougher (`ROUGHNESS_RATIO`).

    Yields
    ------
    Exchange
    """
    for swap in swaps(problem, motions):
        if _is_among_others(problem):
            places = swap.reaches_across(problem, motions)
            there = swap.of_places(problem, motions) if places else swap.of_directions(problem, motions)
            if places or swap.roughness(problem, there) < ROUGHNESS_RATIO * swap.roughness(problem, motions):
                yield Exchange(there, places)
            continue
        if _is_alone_in_one_view(problem):
            yield Exchange(swap.of_places(problem, motions), places=True)
        yield Exchange(swap.of_directions(problem, motions))


@dataclass(frozen=True, eq=False)
class Swap:
    """A pair of limbs, and frames on which they may be mistaken for each other.

    Attributes
    ----------
    performer : int
    pair : tuple of lists of int
        The limbs as chains of parts, see `limb_pairs`.
    frames : ndarray of bool, shape (F,)
    """

    performer: int
    pair: tuple[list[int], list[int]]
    frames: NDArray[np.bool_]

    def of_directions(self, problem: SegmentProblem, motions: Sequence[Motion]) -> tuple[Motion, ...]:
        """Return motions with the limbs' directions exchanged (`exchanged`)."""
        i = self.performer
        new = exchanged(problem.bodies[i], motions[i], self.pair, self.frames)
        return with_motion(motions, i, new)

    def of_places(self, problem: SegmentProblem, motions: Sequence[Motion]) -> tuple[Motion, ...]:
        """Return motions with the limbs' places exchanged (`with_places_exchanged`)."""
        i = self.performer
        new = with_places_exchanged(problem.bodies[i], motions[i], self.pair, self.frames)
        return with_motion(motions, i, new)

    def reaches_across(self, problem: SegmentProblem, motions: Sequence[Motion]) -> bool:
        """Whether each limb is on the other's side, in the mean over the frames and all joints but the first.

        So it is if limbs follow each other's pictures.
        """
        left, right = self.pair
        _, T = part_poses(problem.bodies[self.performer], motions[self.performer][self.frames])
        across = T[:, right[0]] - T[:, left[0]]
        sides = T[:, right[1:]] - T[:, left[1:]]
        return bool(np.einsum("fa,fka->", across, sides) < 0)

    def roughness(self, problem: SegmentProblem, motions: Sequence[Motion]) -> float:
        """Sum of the squared accelerations of the limbs' joints in motions, relative to the first, with the poses that
        are known beside the segment.
        """
        i, (left, right) = self.performer, self.pair
        before, after = problem.around(i)
        known = stacked([motion for motion in (before, motions[i], after) if motion is not None])
        _, T = part_poses(problem.bodies[i], known)
        joints = T[:, left[1:] + right[1:]] - T[:, [left[0]]]
        return float((second_differences(joints, problem.known_steps(i)) ** 2).sum())


def swaps(problem: SegmentProblem, motions: Sequence[Motion]) -> Iterator[Swap]:
    """Generate the pairs of limbs, and the frames, that may be mistaken for each other; see `exchanges`.

    In a single view, limbs that meet in the picture may be far apart in depth, so for a single performer all minima of
    their distance count.
    """
    ratio = 1.0 if _is_alone_in_one_view(problem) or _is_among_others(problem) else MEETING_RATIO
    for i in problem.sought:
        body, motion = problem.bodies[i], motions[i]
        for pair in limb_pairs(body):
            each = _apart(body, motion, pair)
            apart, meetings = _meetings(each, problem.fps)
            distance = np.linalg.norm(apart, axis=1)
            fixed = problem.fixed_axes(i)[:, pair[0] + pair[1]].any(axis=(1, 2))
            ends = np.flatnonzero(fixed[[0, -1]]) * (len(motion) - 1)
            for a, b in pairwise(sorted({*meetings.tolist(), *ends.tolist()})):
                frames = np.zeros(len(motion), dtype=bool)
                frames[a + fixed[a] : b] = True
                if not (fixed & frames).any() and max(distance[a], distance[b]) < ratio * distance[a:b].max():
                    begin, end = _smoothest(each, (a, b), fixed, problem.fps)
                    yield Swap(i, pair, (np.arange(len(motion)) >= begin) & (np.arange(len(motion)) < end))


def _is_alone_in_one_view(problem: SegmentProblem) -> bool:
    return problem.only is None and len(problem.views) == 1


def _is_among_others(problem: SegmentProblem) -> bool:
    """Whether the problem is of one of several performers in several views: limbs that follow each other's pictures
    then hardly part, as others hide one of them at a time.
    """
    return problem.only is not None and problem.shows_depth


def exchanged(body: Body, motion: Motion, pair: tuple[list[int], list[int]], frames: NDArray[np.bool_]) -> Motion:
    """Exchange the directions of a pair of limbs on the frames of a mask (F,)."""
    R, _ = part_poses(body, motion)
    Q = motion.rotations.copy()
    for chain, other in (pair, pair[::-1]):
        parent = R[:, body.parents[chain[0]]]
        for part, like in zip(chain, other, strict=True):
            turned = np.swapaxes(parent @ body.R_parent_rest[part], -1, -2) @ R[:, like]
            Q[frames, part] = rotations.orthonormal(turned[frames])
            parent = R[:, like]
    return Motion(motion.translations, Q)


def with_places_exchanged(
    body: Body, motion: Motion, pair: tuple[list[int], list[int]], frames: NDArray[np.bool_]
) -> Motion:
    """Exchange the places of a pair of limbs on the frames of a mask (F,).

    Limbs that follow each other's pictures reach across the trunk: with each other's directions they would end beside
    these pictures, as far as their first joints are apart. Every bone is turned, from the direction of the other
    limb's, towards the joint where the other's ends.
    """
    R, T = part_poses(body, motion)
    Q = motion.rotations.copy()
    for chain, other in (pair, pair[::-1]):
        parent, joint = R[:, body.parents[chain[0]]], T[:, chain[0]]
        for k, (part, like) in enumerate(zip(chain, other, strict=True)):
            there = R[:, like]
            if k + 1 < len(chain):
                bone = there @ body.offsets[chain[k + 1]]
                there = _turn_between(bone, T[:, other[k + 1]] - joint) @ there
                joint = joint + there @ body.offsets[chain[k + 1]]
            turned = np.swapaxes(parent @ body.R_parent_rest[part], -1, -2) @ there
            Q[frames, part] = rotations.orthonormal(turned[frames])
            parent = there
    return Motion(motion.translations, Q)


def _turn_between(vectors: Array, others: Array) -> Array:
    """Return the smallest rotations (F, 3, 3) that take the directions of vectors (F, 3) to those of others."""
    across = np.cross(vectors, others)
    sine, cosine = np.linalg.norm(across, axis=1), (vectors * others).sum(axis=1)
    return rotations.exp(across * (np.arctan2(sine, cosine) / np.maximum(sine, 1e-12))[:, None])


def _apart(body: Body, motion: Motion, pair: tuple[list[int], list[int]]) -> Array:
    """Differences between the bone directions of two limbs, relative to the trunk, (F, d)."""
    R, _ = part_poses(body, motion)
    trunk = np.flatnonzero(body.ancestry[pair[0][0]] & body.ancestry[pair[1][0]])[-1]
    left, right = (np.swapaxes(R[:, [trunk]], -1, -2) @ R[:, chain] for chain in pair)
    return np.asarray((right - left)[..., 1].reshape(len(motion), -1))


def _meetings(apart: Array, fps: float) -> tuple[Array, NDArray[np.intp]]:
    """Smoothed differences between two limbs, (F, d), and the frames where they are smallest."""
    apart = scipy.ndimage.gaussian_filter1d(apart, SMOOTHING_SIGMA * fps, axis=0, mode="nearest")
    distance = np.linalg.norm(apart, axis=1)
    return apart, 1 + np.flatnonzero((distance[1:-1] < distance[:-2]) & (distance[1:-1] < distance[2:]))


def _smoothest(apart: Array, between: tuple[int, int], fixed: NDArray[np.bool_], fps: float) -> tuple[int, int]:
    """Return the frames from which on, and up to which, two limbs are to be exchanged between two meetings.

    Parameters
    ----------
    apart : ndarray, shape (F, d)
        Differences between the limbs, which change their signs where they are exchanged.
    between : tuple of int
        The meetings' frames.
    fixed : ndarray of bool, shape (F,)
        Frames on which the limbs stay as they are.
    fps : float
    """
    (a, b), reach, F = between, max(1, round(SWITCH_WINDOW * fps)), len(apart)
    bends = np.zeros((2, F + 1))  # squared changes of velocity: with a change of sign there, less those without
    plain = ((apart[2:] - 2 * apart[1:-1] + apart[:-2]) ** 2).sum(axis=1)
    bends[0, 2:F] = ((-apart[2:] - 2 * apart[1:-1] + apart[:-2]) ** 2).sum(axis=1) - plain
    bends[1, 1 : F - 1] = ((apart[2:] - 2 * apart[1:-1] - apart[:-2]) ** 2).sum(axis=1) - plain
    cost = bends.sum(axis=0)
    middle = (a + b) // 2
    before, after = np.flatnonzero(fixed[: middle + 1]), middle + np.flatnonzero(fixed[middle:])
    first = max(a - reach, int(before[-1]) + 1 if len(before) else 1)
    last = min(b + reach, int(after[0]) if len(after) else F - 1)
    begin = first + int(np.argmin(cost[first : min(a + reach, middle) + 1]))
    end = max(b - reach, middle + 1)
    return begin, end + int(np.argmin(cost[end : last + 1]))


def _exchanges(apart: Array, meetings: NDArray[np.intp], fps: float) -> list[bool]:
    """Return after which meetings the limbs are exchanged, from their differences (F, d).

    Dynamic programming over both possible assignments minimises the squared changes of velocity at the meetings.
    """
    reach, last = max(2, round(VELOCITY_WINDOW * fps)), len(apart) - 1
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
