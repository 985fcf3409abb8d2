"""Points in space from the keypoints of a single view ("lifting"): depths follow from the lengths of the bones.

If the length of a bone is roughly known and its ends are seen on two rays, its second joint is at one of two depths,
nearer or farther than the first. The choice is a shortest path over the frames (Viterbi), first for the trunk, where a
state says which hip and which shoulder is nearer and whether it leans forward, then for each limb, where a state is the
choice for its two bones. What people hardly do has a cost: to exceed joint limits, to lean, to have the nose where the
head does not face, to sink into the floor, to raise a foot from it, and to leap.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np

from ...body import Body
from ...numerics import rotations
from ...numerics.arrays import Array, Ints
from ..keypoint_rays import Keypoints
from ..keypoint_sigmas import LIFTED_SIGMA, USUAL_SIGMA
from ..view_agreement import ViewAgreement, without_midpoints
from .closed_form import LIMB_CHAINS, POSED_PARTS, TRUNK_LANDMARKS, LimbChain, along_and_across, limb_orientations
from .person_depth import Rays, floor_ratio, rest_places, root_depth, torso_length

LEAN_SIGMA = 0.5
"""Standard deviation of the angle between the trunk and the vertical, radians."""
TRUNK_TWIST_SIGMA = 0.4
"""Standard deviation of the rotation of the shoulders relative to the hips, radians."""
NOSE_SIGMA = 0.08
"""Standard deviation of the nose from its position on a head that looks ahead, metres."""
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
FLOOR_TOLERANCE = 0.15
"""Feet are assumed to be on the floor, z = 0, if the distance that follows from this differs from the one by the
lengths of the bones by less than this share."""
MIN_DEPTH = 0.1
"""Points that are nearer to the imagined camera than this are left out, metres."""
_NEVER = 1e6
"""Cost of a side that a second path must not take, far above all others."""
_ASIDE = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
"""Rotation from the camera to one that looks at the person from the side."""


def lone_view(body: Body, keypoints: Keypoints) -> int | None:
    """Return the only view that has keypoints, if it shows the hips and the shoulders of the default body."""
    views = np.flatnonzero(keypoints.confidence.any(axis=(1, 2)))
    found = {name for i, name in enumerate(keypoints.names) if keypoints.confidence[:, :, i].any()}
    return (
        int(views[0]) if len(views) == 1 and set(TRUNK_LANDMARKS) <= found and set(body.names) >= POSED_PARTS else None
    )


def lifted_points(body: Body, keypoints: Keypoints, fps: float, *, mirrored: bool = False) -> tuple[Array, float]:
    """Find points in the world for the keypoints of the first view, by the lengths of the bones.

    Parameters
    ----------
    body : Body
        The default body, of the person's height.
    keypoints : Keypoints
    fps : float
    mirrored : bool
        Whether to turn the trunk to the other side of the image plane than is most likely.

    Returns
    -------
    points_world : ndarray, shape (F, L, 3)
        NaN for keypoints that are not lifted, such as those of the face.
    cost : float
        Cost of the paths, in units of the variance.
    """
    rays = Rays.of(keypoints)
    places = rest_places(body)
    root = root_depth(rays, places, fps)
    ratio = floor_ratio(rays, root)
    standing = abs(np.log(ratio)) < FLOOR_TOLERANCE
    root = root * (ratio if standing else 1.0)
    points, total = _trunk_points(rays, places, root, fps, mirrored=mirrored)
    hips, shoulders = (0.5 * (points["L" + joint] + points["R" + joint]) for joint in ("Hip", "Shoulder"))
    pelvis = along_and_across(shoulders - hips, points["LHip"] - points["RHip"])
    chest = along_and_across(shoulders - hips, points["LShoulder"] - points["RShoulder"])
    for chain in LIMB_CHAINS:
        trunk = chest if chain.upper == "upper_arm" else pelvis
        for side in "LR":
            if all(side + joint in rays.directions for joint in chain.joints):
                limb = Limb(body, chain, side)
                found, cost = _limb_points(rays, limb, trunk, points[limb.joints[0]], fps=fps, standing=standing)
                points, total = points | found, total + cost
    out = np.full((len(keypoints), len(keypoints.names), 3), np.nan)
    for name, place in points.items():
        out[:, keypoints.names.index(name)] = place
    return out, total


def _trunk_points(
    rays: Rays, places: Mapping[str, Array], root: Array, fps: float, *, mirrored: bool
) -> tuple[dict[str, Array], float]:
    """Return the hips and shoulders on the cheapest path, by name, shape (F, 3) each, and the path's cost."""
    middles = {
        joint: Rays(rays.centre, {joint: 0.5 * (rays.directions["L" + joint] + rays.directions["R" + joint])})
        for joint in ("Hip", "Shoulder")
    }
    hips = middles["Hip"].at("Hip", root)
    tops = middles["Shoulder"].at("Shoulder", middles["Shoulder"].depths_from(hips, "Shoulder", torso_length(places)))
    states = list(product(range(2), repeat=3))  # the lean, the sides of the hips and of the shoulders
    found: dict[str, list[Array]] = {name: [] for name in TRUNK_LANDMARKS}
    for lean, turned, twisted in states:
        for joint, middle, side in (("Hip", hips, turned), ("Shoulder", tops[lean], twisted)):
            half = 0.5 * float(np.linalg.norm(places["L" + joint] - places["R" + joint]))
            left, right = (rays.depths_from(middle, s + joint, half) for s in "LR")
            found["L" + joint].append(rays.at("L" + joint, left[side]))
            found["R" + joint].append(rays.at("R" + joint, right[1 - side]))
    points = {name: np.stack(options) for name, options in found.items()}  # (8, F, 3)
    up = 0.5 * (points["LShoulder"] + points["RShoulder"] - points["LHip"] - points["RHip"])
    chest = along_and_across(up, points["LShoulder"] - points["RShoulder"])
    pelvis = along_and_across(up, points["LHip"] - points["RHip"])
    cost = (np.arccos(np.clip(chest[..., 2, 1], -1, 1)) / LEAN_SIGMA) ** 2
    twist = np.linalg.norm(rotations.log(np.swapaxes(pelvis, -1, -2) @ chest), axis=-1)
    cost = cost + (twist / TRUNK_TWIST_SIGMA) ** 2
    if "Nose" in rays.directions:
        top = 0.5 * (places["LShoulder"] + places["RShoulder"])
        ahead = (places["Nose"] - top)[[0, 2, 1]] * [1, 1, -1]  # the rest pose faces -Y
        nose = 0.5 * (points["LShoulder"] + points["RShoulder"]) + chest @ ahead
        cost = cost + np.minimum((_distance(rays, "Nose", nose) / NOSE_SIGMA) ** 2, MAX_CHANGE_COST)
    moving = np.concatenate([points["LShoulder"] - points["RShoulder"], points["LHip"] - points["RHip"], up], axis=-1)
    path, total = _cheapest_path(cost, moving, fps)
    if mirrored:
        sides = np.array([state[2] for state in states])
        path, total = _cheapest_path(np.where(sides[:, None] == sides[path], _NEVER, cost), moving, fps)
    return {name: options[path, np.arange(len(path))] for name, options in points.items()}, total


def _distance(rays: Rays, name: str, points: Array) -> Array:
    """Distance of points (..., F, 3) from the rays of a keypoint, metres."""
    d, gap = rays.directions[name], points - rays.centre
    depth = np.sum(d * gap, axis=-1) / np.sum(d * d, axis=-1)
    return np.asarray(np.linalg.norm(gap - depth[..., None] * d, axis=-1))


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


def _limb_points(
    rays: Rays, limb: Limb, trunk: Array, start: Array, *, fps: float, standing: bool
) -> tuple[dict[str, Array], float]:
    """Return the middle and last joint of a limb that starts at points (F, 3), by name, on the cheapest path; and its
    cost.
    """
    _, middle, last = limb.joints
    lengths = limb.lengths()
    bent = rays.at(middle, rays.depths_from(start, middle, lengths[0]))  # (2, F, 3)
    ends = rays.at(last, rays.depths_from(bent, last, lengths[1]))  # (2, 2, F, 3)
    middles, ends = np.repeat(bent, 2, axis=0), np.swapaxes(ends, 0, 1).reshape(4, *start.shape)
    cost = np.zeros(ends.shape[:2])
    for part, turns in zip(limb.parts, limb.turns(trunk, middles - start, ends - middles), strict=True):
        low, high = limb.body.limits[part].T
        cost += np.sum(((turns - np.clip(turns, low, high)) / LIMIT_SIGMA) ** 2, axis=-1)
        cost += np.sum((turns / POSTURE_SIGMA) ** 2, axis=-1)
    if standing:
        cost += (np.minimum(ends[..., 2], 0.0) / FLOOR_SIGMA) ** 2
        if last.endswith("Ankle"):
            raised = np.maximum(ends[..., 2] - STANDING_ANKLE, 0.0) / RAISED_SIGMA
            cost += np.minimum(raised**2, MAX_RAISED_COST)
    path, total = _cheapest_path(cost, np.concatenate([middles - start, ends - start], axis=-1), fps)
    chosen = path, np.arange(len(path))
    return {middle: middles[chosen], last: ends[chosen]}, total


def _cheapest_path(cost: Array, moving: Array, fps: float) -> tuple[Ints, float]:
    """Return the sequence of states (F,) with the least total cost, and that cost (Viterbi).

    Parameters
    ----------
    cost : ndarray, shape (S, F)
        Cost of each state on each frame.
    moving : ndarray, shape (S, F, K)
        Coordinates that should not leap from one frame to the next, metres.
    fps : float
    """
    variance = (SPEED_SIGMA / fps) ** 2 + LIFTED_JOINT_SIGMA**2
    total, before = cost[:, 0], np.zeros(cost.shape, np.int64)
    for f in range(1, cost.shape[1]):
        leaps = np.sum((moving[:, None, f] - moving[None, :, f - 1]) ** 2, axis=-1) / variance
        ways = total + np.minimum(leaps, MAX_CHANGE_COST)
        before[:, f] = ways.argmin(axis=1)
        total = ways.min(axis=1) + cost[:, f]
    path = np.empty(cost.shape[1], np.int64)
    path[-1] = total.argmin()
    for f in range(cost.shape[1] - 1, 0, -1):
        path[f - 1] = before[path[f], f]
    return path, float(total.min())


def with_imagined_view(keypoints: Keypoints, points_world: Array, fps: float) -> ViewAgreement:
    """Return one view's keypoints together with those of an imagined view of points (F, L, 3) from the side.

    The imagined view holds the depths of the points, weakly. A fit to the real view alone would move the person towards
    the camera, where residuals in metres are smaller, and turn the limbs away.
    """
    R, t = keypoints.R_cam_world[0], keypoints.t_cam_world[0]
    trunk = [i for i, name in enumerate(keypoints.names) if name in TRUNK_LANDMARKS]
    middle = np.einsum("fab,fb->fa", R, points_world[:, trunk].mean(axis=1)) + t
    distance = np.linalg.norm(middle, axis=-1, keepdims=True)
    R_side, t_side = _ASIDE @ R, (t - middle) @ _ASIDE.T + distance * [0.0, 0.0, 1.0]
    x = np.einsum("fab,flb->fla", R_side, points_world) + t_side[:, None]
    with np.errstate(invalid="ignore"):
        known = x[..., 2] > MIN_DEPTH
    both = Keypoints(
        keypoints.names,
        np.stack([keypoints.rays[0], np.where(known[..., None], x[..., :2] / x[..., 2:], np.nan)]),
        np.stack([keypoints.confidence[0], keypoints.confidence[0] * known]),
        np.stack([R, R_side]),
        np.stack([t, t_side]),
    )
    own = without_midpoints(both)
    sigma = np.outer([USUAL_SIGMA, LIFTED_SIGMA], np.ones(len(own.names)))
    return ViewAgreement(own, np.zeros(own.confidence.shape, bool), points_world, own.confidence, sigma, fps)
