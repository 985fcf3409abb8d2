"""The depths of arms and legs that one view shows: each of their bones points towards the camera or away from it.

A state says this for both bones of a limb, or that its foot stands on the floor; and for both legs together, as people
mostly keep their feet below their hips. A joint is in the mean of its places in all states, by their posterior
probabilities (a hidden Markov model over the frames): where nothing tells which place is right, one between them is
nearest in the mean.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from ...body import Body
from ...numerics import rotations
from ...numerics.arrays import Array, Ints
from ...numerics.likeliest_path import state_probabilities
from .closed_form import LimbChain, limb_orientations
from .limb_postures import posture_rarity
from .person_depth import Rays, floor_depth

LIMIT_SIGMA = 0.2
"""Standard deviation of a joint beyond its limits, radians; it is wide because depths are rough."""
POSTURE_SIGMA = 1.5
"""Standard deviation of a joint from its rest rotation, radians."""
SPEED_SIGMA = 2.0
"""Standard deviation of the velocity of a joint relative to the trunk, metres per second."""
LIFTED_JOINT_SIGMA = 0.06
"""Standard deviation of a lifted joint, metres: for a bone seen at nearly its full length, little noise changes the
depth much."""
MAX_CHANGE_COST = 16.0
"""Upper bound of the cost of a change between two frames, in units of the variance."""
FLOOR_SIGMA = 0.05
"""Standard deviation of feet below the floor, metres."""
STANDING_ANKLE = 0.12
"""Height of an ankle up to which its foot counts as standing, metres."""
RAISED_SIGMA = 0.15
"""Standard deviation of an ankle above that height, metres: people mostly stand on both feet."""
MAX_RAISED_COST = 4.0
"""Upper bound of the cost of a raised foot, in units of the variance: kicks and leaps raise feet by more."""
STANDING_LENGTH_SIGMA = 0.1
"""Standard deviation of a shin's length from that between the knee and an ankle where that of a standing foot would be,
metres: the knee's depth is rough."""
BALANCE_SIGMA = 0.2
"""Standard deviation of the middle of both ankles from that of the hips, horizontally, metres."""
MAX_BALANCE_COST = 9.0
"""Upper bound of its cost, in units of the variance: who leaps or lies has no balance to keep."""
INDEPENDENT_SHARE = 0.5
"""Share of a path's cost that counts for the probability of its states: what makes a place unlikely on one frame mostly
does on the next, too."""


@dataclass(frozen=True, eq=False)
class Limb:
    """A limb of a body, on one side ("L" or "R")."""

    body: Body
    chain: LimbChain
    side: str

    @property
    def parts(self) -> tuple[int, int]:
        """Indices of the upper and the lower part."""
        return self.chain.parts(self.body, self.side)

    @property
    def joints(self) -> list[str]:
        """Landmarks of the limb: shoulder, elbow and wrist, or hip, knee and ankle."""
        return [self.side + joint for joint in self.chain.joints]

    @property
    def is_leg(self) -> bool:
        """Whether it ends in a foot."""
        return self.chain.upper == "thigh"

    def lengths(self) -> list[float]:
        """Lengths of both parts, metres."""
        parts = (self.body.parts[part] for part in self.parts)
        return [float(np.linalg.norm(part.tail_world - part.head_world)) for part in parts]

    def turns(self, trunk: Array, upper: Array, lower: Array) -> list[Array]:
        """Return the rotation vectors of both parts, which point along `upper` and `lower`, relative to a trunk (F, 3,
        3).
        """
        # The arms hang on the chest through collar bones, which rest here.
        carrier = self.body.parts[self.body.index("chest" if self.chain.upper == "upper_arm" else "pelvis")]
        R0_upper = carrier.R_world_rest.T @ self.body.parts[self.parts[0]].R_world_rest
        R0_lower = self.body.R_parent_rest[self.parts[1]]
        rest = np.broadcast_to(trunk @ R0_upper, (*upper.shape, 3))
        first, second = limb_orientations(rest, upper, lower, self.chain, fps=None)
        return [
            rotations.log(np.swapaxes(rest, -1, -2) @ first),
            rotations.log(np.swapaxes(first @ R0_lower, -1, -2) @ second),
        ]


@dataclass(frozen=True, eq=False)
class LimbPlaces:
    """Where a limb may be on F frames, by the direction of both of its bones in depth.

    Attributes
    ----------
    limb : Limb
    start : ndarray, shape (F, 3)
        The first joint, metres, world.
    middles, ends : ndarray, shape (S, F, 3)
        The others, in S states: four by the directions of the bones, and those of a standing foot.
    cost : ndarray, shape (S, F)
        In units of the variance.
    """

    limb: Limb
    start: Array
    middles: Array
    ends: Array
    cost: Array

    def in_states(self, which: Ints) -> LimbPlaces:
        """Return the limb in S states, of which each is one of its own."""
        return replace(self, middles=self.middles[which], ends=self.ends[which], cost=self.cost[which])

    @property
    def relative(self) -> Array:
        """The middle and last joints relative to the first, shape (S, F, 6)."""
        return np.concatenate([self.middles - self.start, self.ends - self.start], axis=-1)


def limb_places(rays: Rays, limb: Limb, trunk: Array, start: Array, *, standing: bool) -> LimbPlaces:
    """Return the places of a limb that starts at points (F, 3) of a trunk with the orientations (F, 3, 3).

    `standing` says whether the floor is known to be at z = 0. A leg then has two more places, with its ankle where that
    of a standing foot would be seen.
    """
    _, middle, last = limb.joints
    lengths = limb.lengths()
    bent = rays.at(middle, rays.depths_from(start, middle, lengths[0]))  # (2, F, 3)
    ends = rays.at(last, rays.depths_from(bent, last, lengths[1]))  # (2, 2, F, 3)
    middles, ends = np.repeat(bent, 2, axis=0), np.swapaxes(ends, 0, 1).reshape(4, *start.shape)
    cost = np.zeros(ends.shape[:2])
    if standing and limb.is_leg:
        placed = np.tile(rays.at(last, floor_depth(rays, last)), (2, 1, 1))
        overlong = np.linalg.norm(placed - bent, axis=-1) - lengths[1]
        middles, ends = np.concatenate([middles, bent]), np.concatenate([ends, placed])
        cost = np.concatenate([cost, (overlong / STANDING_LENGTH_SIGMA) ** 2])
    places = LimbPlaces(limb, start, middles, ends, cost)
    cost = cost + _posture_cost(places, trunk)
    return replace(places, cost=cost + _floor_cost(places) if standing else cost)


def _posture_cost(places: LimbPlaces, trunk: Array) -> Array:
    """Return the cost of bending as people hardly do, with a trunk (F, 3, 3), shape (S, F)."""
    limb, upper, lower = places.limb, places.middles - places.start, places.ends - places.middles
    own_side = np.array([1.0 if limb.side == "L" else -1.0, 1.0, 1.0])  # the trunk's x axis points to its left
    cost = posture_rarity(
        limb.chain.upper, *(np.einsum("fba,sfb->sfa", trunk, bone) * own_side for bone in (upper, lower))
    )
    for part, turns in zip(limb.parts, limb.turns(trunk, upper, lower), strict=True):
        low, high = limb.body.limits[part].T
        cost += np.sum(((turns - np.clip(turns, low, high)) / LIMIT_SIGMA) ** 2, axis=-1)
        cost += np.sum((turns / POSTURE_SIGMA) ** 2, axis=-1)
    return cost


def _floor_cost(places: LimbPlaces) -> Array:
    """Return the cost of a limb that ends below the floor, or of a foot above it, shape (S, F)."""
    cost = (np.minimum(places.ends[..., 2], 0.0) / FLOOR_SIGMA) ** 2
    if places.limb.is_leg:
        raised = np.maximum(places.ends[..., 2] - STANDING_ANKLE, 0.0) / RAISED_SIGMA
        cost += np.minimum(raised**2, MAX_RAISED_COST)
    return cost


def expected_joints(limbs: Sequence[LimbPlaces], hips: Array, fps: float) -> tuple[dict[str, Array], float]:
    """Return the middle and last joints of limbs that are judged together, by name, shape (F, 3) each, and their cost.

    Parameters
    ----------
    limbs : sequence of LimbPlaces
        One limb, or both legs, whose balance then counts.
    hips : ndarray, shape (F, 3)
        Their middle, metres, world.
    fps : float

    Returns
    -------
    joints : dict of str to ndarray, shape (F, 3)
        Mean places, metres, world.
    cost : float
        Of all paths together, in units of the variance.
    """
    states = np.array(list(product(*(range(len(places.cost)) for places in limbs)))).T
    together = [places.in_states(which) for places, which in zip(limbs, states, strict=True)]
    cost = np.sum([places.cost for places in together], axis=0)
    if len(together) == 2:
        left, right = together
        cost = cost + _balance_cost(0.5 * (left.ends + right.ends), hips)
    probability, total = believed_states(cost, leap_costs([places.relative for places in together], fps))
    joints = {}
    for places in together:
        _, middle, last = places.limb.joints
        for name, options in ((middle, places.middles), (last, places.ends)):
            joints[name] = np.einsum("sf,sfk->fk", probability, options)
    return joints, total


def _balance_cost(ankles: Array, hips: Array) -> Array:
    """Return the cost of a middle of the ankles (S, F, 3) that is not below that of the hips (F, 3), shape (S, F)."""
    off = np.sum((ankles - hips)[..., :2] ** 2, axis=-1)
    return np.minimum(off / BALANCE_SIGMA**2, MAX_BALANCE_COST)


def believed_states(cost: Array, leaps: Callable[[int], Array]) -> tuple[Array, float]:
    """Return the probability of every state (S, F) and the cost of all paths together, in units of the variance.

    Parameters
    ----------
    cost : ndarray, shape (S, F)
        Of each state, in units of the variance.
    leaps : callable
        See `leap_costs`.
    """
    scale = 0.5 * INDEPENDENT_SHARE
    probability, total = state_probabilities(scale * cost, lambda f: scale * leaps(f))
    return probability, total / scale


def leap_costs(moving: Sequence[Array], fps: float) -> Callable[[int], Array]:
    """Return the costs of passing from each state on the frame before a given one to each on that frame, (S, S), in
    units of the variance.

    Parameters
    ----------
    moving : sequence of ndarray, shape (S, F, K)
        Coordinates that should not leap together from one frame to the next, metres.
    fps : float
    """
    variance = (SPEED_SIGMA / fps) ** 2 + LIFTED_JOINT_SIGMA**2

    def costs(f: int) -> Array:
        leaps = (np.sum((x[None, :, f] - x[:, None, f - 1]) ** 2, axis=-1) / variance for x in moving)
        return np.asarray(sum(np.minimum(leap, MAX_CHANGE_COST) for leap in leaps))

    return costs
