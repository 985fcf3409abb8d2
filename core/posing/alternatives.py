"""Poses that one view cannot tell apart, likeliest first.

Seen from one camera, every bone of a limb may point towards it or away from it: the ray of the lower joint meets the
sphere around the upper joint, whose radius is the bone's length, twice (Lee and Chen, "Determination of 3D human body
postures from a single view", Computer Vision, Graphics, and Image Processing 30, 1985). Joint limits, the balance of
the body over its feet, and known poses nearby in time decide which of these poses is likely.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ..body import Body, landmark_positions, part_poses
from ..body.joint_limits import LIMIT_SIGMA
from ..body.motion import Motion
from ..body.soles import Soles
from ..numerics import rotations
from ..numerics.arrays import Array
from .depth import leading_part

LIMB_LANDMARKS = tuple((side + a, side + b) for side in "LR" for a, b in (("Elbow", "Wrist"), ("Knee", "Ankle")))
"""Landmarks at the ends of the two bones of each limb."""
TRIED_TWISTS = 36
"""Number of twists of an upper bone that are tried: one view hardly shows them; the next joint's limits decide."""
REST_SIGMA = 1.0
"""Standard deviation of a joint's rotation from rest, radians."""
BALANCE_SIGMA = 0.1
"""Standard deviation of the horizontal distance between the centre of mass and the feet, metres."""
MOVEMENT_SIGMA, SPEED_SIGMA = 0.05, 0.7
"""Standard deviation of a joint's distance from its position in a known pose: at the same time, metres, and growing
with time, metres/s."""
SAME_POSE_DISTANCE = 0.05
"""Poses count as the same if no joint of their limbs differs by more than this, metres."""
CLEAR_MARGIN = 10.0
"""By how much a pose is clearly likelier than another, in squared standard deviations."""
_ROUNDING = 1e-6  # radians or metres by which the same pose may differ, by rounding


@dataclass(frozen=True, eq=False)
class Neighbour:
    """A known pose, and the time between it and the present one."""

    pose: Motion
    seconds: float


@dataclass(frozen=True, eq=False)
class Alternatives:
    """Poses that look alike from one camera.

    Attributes
    ----------
    poses : Motion
        N poses, likeliest first.
    energy : ndarray, shape (N,)
        See `implausibility`.
    """

    poses: Motion
    energy: Array

    def number_of(self, pose: Motion) -> int | None:
        """Return which of them a pose is, None if it is none."""
        turned = pose[[0] * len(self.poses)].difference(self.poses)
        apart = np.abs(turned).max(axis=1)
        nearest = int(np.argmin(apart))
        return nearest if apart[nearest] < _ROUNDING else None

    def first_to_show(self, now: int | None) -> int:
        """Return the number of the pose to show first: the present one, which fits the picture best, unless the
        likeliest is so by more than `CLEAR_MARGIN`.
        """
        return now if now is not None and self.energy[now] - self.energy[0] <= CLEAR_MARGIN else 0


def alternative_poses(
    body: Body,
    pose: Motion,
    centre_world: Array,
    neighbours: Sequence[Neighbour] = (),
    *,
    held: NDArray[np.bool_] | None = None,
    count: int = 8,
) -> Alternatives:
    """Return the poses whose elbows, wrists, knees and ankles lie on the same rays of a camera, likeliest first.

    Parameters
    ----------
    body : Body
    pose : Motion
        One pose, which agrees with the camera's picture. It is among the results unless `count` others are likelier.
    centre_world : ndarray, shape (3,)
        The camera's centre, world frame, metres.
    neighbours : sequence of Neighbour, optional
        Poses known on other frames.
    held : ndarray of bool, shape (D,), optional
        Degrees of freedom that must not change; if one of a limb is held, the whole limb is.
    count : int
        Largest number of poses.
    """
    free = np.ones(len(body), bool) if held is None else ~held[3:].reshape(-1, 3).any(axis=1)
    found = [_LimbDepths.of(body, pose, centre_world, names, free) for names in LIMB_LANDMARKS]
    limbs = [limb for limb in found if limb is not None]
    choices = list(product(*(range(len(limb.turns)) for limb in limbs)))
    Q = np.repeat(pose.rotations, len(choices), axis=0)
    for k, limb in enumerate(limbs):
        Q[:, limb.parts] = limb.turns[[choice[k] for choice in choices]]
    candidates = Motion(np.repeat(pose.translations, len(choices), axis=0), Q)
    energy = implausibility(body, candidates, neighbours)
    kept = _distinct(body, candidates, np.argsort(energy, kind="stable"), count)
    return Alternatives(candidates[kept], energy[kept])


def implausibility(body: Body, poses: Motion, neighbours: Sequence[Neighbour] = ()) -> Array:
    """Return how unlikely F poses are regardless of any picture, as sums of squared standard deviations, shape (F,).

    It grows with joints beyond their limits or far from rest, with a centre of mass that is not above the feet (z is
    up), and with the distance of joints from their positions in known poses.
    """
    turns = rotations.log(poses.rotations[:, 1:])
    energy = _strain(turns, body.limits[1:]) + (_off_balance(body, poses) / BALANCE_SIGMA) ** 2
    names = _limb_landmarks(body)
    for near in neighbours:
        apart = landmark_positions(body, poses, names) - landmark_positions(body, near.pose, names)
        energy = energy + np.sum(apart**2, axis=(1, 2)) / (MOVEMENT_SIGMA + SPEED_SIGMA * near.seconds) ** 2
    return np.asarray(energy)


@dataclass(frozen=True, eq=False)
class _LimbDepths:
    """Possible rotations of the two bones of a limb, and of the hand or foot, whose world orientation stays.

    Attributes
    ----------
    parts : list of int, length B
        Two or three.
    turns : ndarray, shape (N, B, 3, 3)
        Rotations of these parts relative to their parents; the first are those of the given pose.
    """

    parts: list[int]
    turns: Array

    @classmethod
    def of(
        cls, body: Body, pose: Motion, centre: Array, names: tuple[str, str], free: NDArray[np.bool_]
    ) -> _LimbDepths | None:
        """Find the rotations of the bones that end at two landmarks; None if these are not a limb of two free bones."""
        middle, end = names
        if middle not in body.landmarks or end not in body.landmarks:
            return None
        upper, lower = leading_part(body, middle), leading_part(body, end)
        if upper < 1 or body.parents[lower] != upper or not free[[upper, lower]].all():
            return None
        last = body.landmarks[end][0]
        parts = [upper, lower, last] if body.parents[last] == lower and free[last] else [upper, lower]
        R, T = (x[0] for x in part_poses(body, pose))
        root, (joint, tip) = T[upper], landmark_positions(body, pose, [middle, end])[0]
        found = [pose.rotations[0, parts]]
        for there in (joint, _other_side(root, joint, centre)):
            for far in _on_ray(there, tip, centre, float(np.linalg.norm(tip - joint))):
                if np.linalg.norm(there - joint) + np.linalg.norm(far - tip) > _ROUNDING:
                    bones = np.stack([there - root, far - there])
                    found.append(_turned(body, R, parts, np.stack([joint - root, tip - joint]), bones))
        return cls(parts, np.stack(found))


def _other_side(root: Array, joint: Array, centre: Array) -> Array:
    """Return the other point on a joint's ray at the same distance from the joint above it."""
    away = np.linalg.norm(joint - centre)
    ray = (joint - centre) / away
    other = 2 * ray @ (root - centre) - away
    return np.asarray(centre + other * ray if other > 0 else joint)


def _on_ray(start: Array, seen: Array, centre: Array, length: float) -> list[Array]:
    """Return the points in front of the camera on the ray through `seen` whose distance from `start` is `length`; the
    nearest point of the ray if there are none.
    """
    ray = (seen - centre) / np.linalg.norm(seen - centre)
    along = ray @ (start - centre)
    half = np.sqrt(max(length**2 - (start - centre) @ (start - centre) + along**2, 0.0))
    points = [centre + s * ray for s in {along - half, along + half} if s > 0]
    return sorted(points, key=lambda point: float(np.linalg.norm(point - seen)))


def _turned(body: Body, R: Array, parts: list[int], was: Array, bones: Array) -> Array:
    """Return rotations of a limb's parts (B, 3, 3) that point its bones along (2, 3), with the twist of the first that
    suits all joint limits best.
    """
    upper, lower, *last = parts
    above = R[body.parents[upper]] @ body.R_parent_rest[upper]
    direction = bones[0] / np.linalg.norm(bones[0])
    twists = np.linspace(-np.pi, np.pi, TRIED_TWISTS, endpoint=False)[:, None] * direction
    R_upper = rotations.exp(twists) @ _aligning(was[0], bones[0]) @ R[upper]
    # The lower bone keeps its rotation relative to the upper one, then turns the shortest way.
    carried = R_upper @ R[upper].T
    R_lower = np.stack([_aligning(G @ was[1], bones[1]) @ G @ R[lower] for G in carried])
    Q = np.stack(
        [above.T @ R_upper, np.swapaxes(R_upper @ body.R_parent_rest[lower], -1, -2) @ R_lower]
        + [np.swapaxes(R_lower @ body.R_parent_rest[end], -1, -2) @ R[end] for end in last],
        axis=1,
    )
    return np.asarray(rotations.orthonormal(Q[np.argmin(_strain(rotations.log(Q), body.limits[parts]))]))


def _strain(turns: Array, limits: Array) -> Array:
    """Return how far joints with rotation vectors (F, J, 3) are beyond their limits (J, 3, 2) and from rest, as sums of
    squared standard deviations, shape (F,).
    """
    beyond = turns - np.clip(turns, limits[..., 0], limits[..., 1])
    return np.asarray(np.sum((beyond / LIMIT_SIGMA) ** 2 + (turns / REST_SIGMA) ** 2, axis=(1, 2)))


def _limb_landmarks(body: Body) -> list[str]:
    return [name for names in LIMB_LANDMARKS for name in names if name in body.landmarks]


def _aligning(a: Array, b: Array) -> Array:
    """Return the shortest rotation that takes the direction of a to that of b, shape (3, 3)."""
    return np.asarray(Rotation.align_vectors(b, a)[0].as_matrix())


def _off_balance(body: Body, poses: Motion) -> Array:
    """Return the horizontal distance of the centre of mass from the line between the feet, metres, shape (F,); 0 for a
    body without feet.
    """
    soles = Soles.of(body)
    if soles is None:
        return np.zeros(len(poses))
    R, T = part_poses(body, poses)
    mass = np.array([np.prod(np.ptp(part.vertices, axis=0)) for part in body.parts])
    middle = np.stack([part.vertices.mean(axis=0) for part in body.parts])
    centre = np.einsum("p,fpa->fa", mass / mass.sum(), np.einsum("fpab,pb->fpa", R, middle) + T)[:, :2]
    points = soles.world((R, T))
    feet = points.reshape(len(poses), -1, 2, 3).mean(axis=2)
    low, high = feet[np.arange(len(feet)), feet[..., 2].argmin(axis=1)], feet[:, -1]
    other = np.where((low == high).all(axis=1)[:, None], feet[:, 0], high)
    # A raised foot carries no weight.
    carries = np.clip(1 - (other[:, 2] - low[:, 2]) / (0.2 * soles.leg), 0.0, 1.0)
    line = carries[:, None] * (other - low)[:, :2]
    share = np.einsum("fa,fa->f", centre - low[:, :2], line) / np.maximum(np.sum(line**2, axis=1), 1e-12)
    nearest = low[:, :2] + np.clip(share, 0, 1)[:, None] * line
    return np.asarray(np.linalg.norm(centre - nearest, axis=1))


def _distinct(body: Body, poses: Motion, order: NDArray[np.intp], count: int) -> list[int]:
    """Return the first `count` poses in an order, leaving out those that are the same as an earlier one."""
    names = _limb_landmarks(body)
    points = landmark_positions(body, poses, names)
    kept: list[int] = []
    for i in order:
        apart = np.linalg.norm(points[kept] - points[i], axis=-1) if kept else np.empty((0, 1))
        if not kept or (apart.max(axis=1) > SAME_POSE_DISTANCE).all():
            kept.append(int(i))
        if len(kept) == count:
            break
    return kept
