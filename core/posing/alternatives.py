"""Poses that one view cannot tell apart, likeliest first.

Every bone of a limb that is seen from one camera may point towards it or away from it: the sphere of the bone's length
about its upper joint meets the ray of its lower joint twice (Lee and Chen, "Determination of 3D human body postures
from a single view", Computer Vision, Graphics, and Image Processing 30, 1985). Joint limits, the balance of the body
over its feet, and poses that are known nearby say which of these is likely.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ..body import Body, landmark_positions, part_poses
from ..body.joint_limits import LIMIT_DEVIATION
from ..body.motion import Motion
from ..body.soles import Soles
from ..numerics import rotations
from ..numerics.arrays import Array
from .depth import leading_part

LIMBS = tuple((side + a, side + b) for side in "LR" for a, b in (("Elbow", "Wrist"), ("Knee", "Ankle")))
"""Landmarks at the ends of the two bones of each limb."""
TWISTS = 36
"""Turns of an upper bone about itself that are tried: one view hardly shows them, the next joint's limits do."""
EASE = 1.0
"""Usual turn of a joint from its rest orientation, radians."""
UNBALANCED = 0.1
"""Usual distance of the centre of mass from above the feet, metres."""
MOVEMENT, SPEED = 0.05, 0.7
"""Usual distance of a joint from where a pose known at the same time, or a second away, has it: metres, metres/s."""
ALIKE = 0.05
"""Poses whose limbs are nowhere farther apart are one, metres."""


@dataclass(frozen=True, eq=False)
class Neighbour:
    """A pose that is known nearby.

    Attributes
    ----------
    pose : Motion
        One pose.
    seconds : float
        How far away in time it is.
    """

    pose: Motion
    seconds: float


@dataclass(frozen=True, eq=False)
class Alternatives:
    """Poses that look alike from one camera.

    Attributes
    ----------
    poses : Motion
        N of them, likeliest first.
    energy : ndarray, shape (N,)
        How unlikely each is, in variances.
    """

    poses: Motion
    energy: Array


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
        One pose, which meets what the camera shows. It is among the results unless others are likelier.
    centre_world : ndarray, shape (3,)
        The camera's centre.
    neighbours : sequence of Neighbour, optional
        Poses known on other frames.
    held : ndarray of bool, shape (D,), optional
        Degrees of freedom that stay; a limb of which some is held stays as a whole.
    count : int
        At most so many.
    """
    free = np.ones(len(body), bool) if held is None else ~held[3:].reshape(-1, 3).any(axis=1)
    found = [_LimbDepths.of(body, pose, centre_world, names, free) for names in LIMBS]
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
    """Return how unlikely poses are without any picture, in variances, shape (F,).

    Joints beyond their limits or far from rest, a centre of mass that is not above the feet (z is up), and joints far
    from where poses nearby have them.
    """
    turns = rotations.log(poses.rotations[:, 1:])
    energy = _strain(turns, body.limits[1:]) + (_off_balance(body, poses) / UNBALANCED) ** 2
    names = _limb_landmarks(body)
    for near in neighbours:
        apart = landmark_positions(body, poses, names) - landmark_positions(body, near.pose, names)
        energy = energy + np.sum(apart**2, axis=(1, 2)) / (MOVEMENT + SPEED * near.seconds) ** 2
    return np.asarray(energy)


@dataclass(frozen=True, eq=False)
class _LimbDepths:
    """Turns of the two bones of a limb, and of the hand or foot at its end, which stays as it lies in the world.

    Attributes
    ----------
    parts : list of int, length B
        Two or three.
    turns : ndarray, shape (N, B, 3, 3)
        Q of these parts; the first is as it was.
    """

    parts: list[int]
    turns: Array

    @classmethod
    def of(
        cls, body: Body, pose: Motion, centre: Array, names: tuple[str, str], free: NDArray[np.bool_]
    ) -> _LimbDepths | None:
        """Find what the bones that lead to two landmarks may do; None where they are no limb of two free bones."""
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
                if np.linalg.norm(there - joint) + np.linalg.norm(far - tip) > 1e-6:
                    bones = np.stack([there - root, far - there])
                    found.append(_turned(body, R, parts, np.stack([joint - root, tip - joint]), bones))
        return cls(parts, np.stack(found))


def _other_side(root: Array, joint: Array, centre: Array) -> Array:
    """The second point of a joint's ray at the same distance from the joint above it."""
    away = np.linalg.norm(joint - centre)
    ray = (joint - centre) / away
    other = 2 * ray @ (root - centre) - away
    return np.asarray(centre + other * ray if other > 0 else joint)


def _on_ray(start: Array, seen: Array, centre: Array, length: float) -> list[Array]:
    """Points in front of the camera on the ray through `seen` at a distance from a start; the nearest if there is
    none.
    """
    ray = (seen - centre) / np.linalg.norm(seen - centre)
    along = ray @ (start - centre)
    half = np.sqrt(max(length**2 - (start - centre) @ (start - centre) + along**2, 0.0))
    points = [centre + s * ray for s in {along - half, along + half} if s > 0]
    return sorted(points, key=lambda point: float(np.linalg.norm(point - seen)))


def _turned(body: Body, R: Array, parts: list[int], was: Array, bones: Array) -> Array:
    """Q of a limb's parts (B, 3, 3) that point two bones (2, 3) elsewhere, the first turned about itself as the limits
    of all have it.
    """
    upper, lower, *last = parts
    above = R[body.parents[upper]] @ body.R_parent_rest[upper]
    direction = bones[0] / np.linalg.norm(bones[0])
    twists = np.linspace(-np.pi, np.pi, TWISTS, endpoint=False)[:, None] * direction
    R_upper = rotations.exp(twists) @ _aligning(was[0], bones[0]) @ R[upper]
    # The lower bone is where it was in the frame of the upper one, then turns the shortest way.
    carried = R_upper @ R[upper].T
    R_lower = np.stack([_aligning(G @ was[1], bones[1]) @ G @ R[lower] for G in carried])
    Q = np.stack(
        [above.T @ R_upper, np.swapaxes(R_upper @ body.R_parent_rest[lower], -1, -2) @ R_lower]
        + [np.swapaxes(R_lower @ body.R_parent_rest[end], -1, -2) @ R[end] for end in last],
        axis=1,
    )
    return np.asarray(rotations.orthonormal(Q[np.argmin(_strain(rotations.log(Q), body.limits[parts]))]))


def _strain(turns: Array, limits: Array) -> Array:
    """How far joints are beyond their limits (J, 3, 2) and from rest, in variances, by their turns (F, J, 3): (F,)."""
    beyond = turns - np.clip(turns, limits[..., 0], limits[..., 1])
    return np.asarray(np.sum((beyond / LIMIT_DEVIATION) ** 2 + (turns / EASE) ** 2, axis=(1, 2)))


def _limb_landmarks(body: Body) -> list[str]:
    return [name for names in LIMBS for name in names if name in body.landmarks]


def _aligning(a: Array, b: Array) -> Array:
    """The shortest rotation that points a where b points."""
    return np.asarray(Rotation.align_vectors(b, a)[0].as_matrix())


def _off_balance(body: Body, poses: Motion) -> Array:
    """Distance of the centre of mass from above the line between the feet, metres, shape (F,); 0 without feet."""
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
    # A foot that is high carries nothing.
    carries = np.clip(1 - (other[:, 2] - low[:, 2]) / (0.2 * soles.leg), 0.0, 1.0)
    line = carries[:, None] * (other - low)[:, :2]
    share = np.einsum("fa,fa->f", centre - low[:, :2], line) / np.maximum(np.sum(line**2, axis=1), 1e-12)
    nearest = low[:, :2] + np.clip(share, 0, 1)[:, None] * line
    return np.asarray(np.linalg.norm(centre - nearest, axis=1))


def _distinct(body: Body, poses: Motion, order: NDArray[np.intp], count: int) -> list[int]:
    """The first poses of an order without those that are like one before."""
    names = _limb_landmarks(body)
    points = landmark_positions(body, poses, names)
    kept: list[int] = []
    for i in order:
        apart = np.linalg.norm(points[kept] - points[i], axis=-1) if kept else np.empty((0, 1))
        if not kept or (apart.max(axis=1) > ALIKE).all():
            kept.append(int(i))
        if len(kept) == count:
            break
    return kept
