"""Points in space from the keypoints of a single view ("lifting"): depths follow from the lengths of the bones.

If the length of a bone is roughly known and its ends are seen on two rays, its second joint is at one of two depths,
nearer or farther than the first. For the trunk, a state says which hip and which shoulder is nearer and whether it
leans forward; a shortest path over the frames (Viterbi) chooses the sides, and the lean is the mean by the states'
probabilities. Limbs follow, see `limb_depths`. What people hardly do has a cost: to exceed joint limits, to lean, above
all backward, to have the nose where the head does not face, to have the feet beside the hips, to sink into the floor,
to raise a foot from it, and to leap.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product

import numpy as np

from ...body import Body
from ...numerics import rotations
from ...numerics.arrays import Array
from ...numerics.likeliest_path import cheapest_path
from ..keypoint_rays import Keypoints
from ..keypoint_sigmas import LIFTED_SIGMA, USUAL_SIGMA
from ..view_agreement import ViewAgreement, without_midpoints
from .closed_form import LIMB_CHAINS, POSED_PARTS, TRUNK_LANDMARKS, along_and_across
from .limb_depths import Limb, believed_states, expected_joints, leap_costs, limb_places
from .person_depth import FLOOR_TOLERANCE, Rays, depth_on_floor, floor_ratio, rest_places, root_depth, torso_length

LEAN_SIGMA = 0.5
"""Standard deviation of the angle between the trunk and the vertical, radians."""
BACKWARD_SIGMA = 0.15
"""The same for a trunk that leans backward, which people hardly do."""
MAX_BACKWARD_COST = 9.0
"""Upper bound of its cost, in units of the variance: who lies on the back does."""
TRUNK_TWIST_SIGMA = 0.4
"""Standard deviation of the rotation of the shoulders relative to the hips, radians."""
NOSE_SIGMA = 0.08
"""Standard deviation of the nose from its position on a head that looks ahead, metres."""
MAX_NOSE_COST = 16.0
"""Upper bound of the cost of a nose elsewhere, in units of the variance: detectors err."""
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
        Of the trunk and the limbs, in units of the variance.
    """
    rays = Rays.of(keypoints)
    places = rest_places(body)
    root = root_depth(rays, places, fps)
    ratio = floor_ratio(rays, root)
    standing = abs(np.log(ratio)) < FLOOR_TOLERANCE
    if standing:
        root = depth_on_floor(rays, root * ratio, fps)
    points, total = _trunk_points(rays, places, root, fps, mirrored=mirrored)
    hips, shoulders = (0.5 * (points["L" + joint] + points["R" + joint]) for joint in ("Hip", "Shoulder"))
    pelvis = along_and_across(shoulders - hips, points["LHip"] - points["RHip"])
    chest = along_and_across(shoulders - hips, points["LShoulder"] - points["RShoulder"])
    for chain in LIMB_CHAINS:
        trunk = chest if chain.upper == "upper_arm" else pelvis
        limbs = [Limb(body, chain, side) for side in "LR"]
        seen = [
            limb_places(rays, limb, trunk, points[limb.joints[0]], standing=standing)
            for limb in limbs
            if set(limb.joints) <= set(rays.directions)
        ]
        together = [seen] if chain.upper == "thigh" and len(seen) == 2 else [[limb] for limb in seen]
        for group in together:
            found, cost = expected_joints(group, hips, fps)
            points, total = points | found, total + cost
    out = np.full((len(keypoints), len(keypoints.names), 3), np.nan)
    for name, place in points.items():
        out[:, keypoints.names.index(name)] = place
    return out, total


def _trunk_points(
    rays: Rays, places: Mapping[str, Array], root: Array, fps: float, *, mirrored: bool
) -> tuple[dict[str, Array], float]:
    """Return the hips and shoulders by name, shape (F, 3) each, and their cost.

    Which hip and which shoulder is nearer is as on the cheapest path; the lean is its mean.
    """
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
    backward = np.maximum(chest[..., 2, 2], 0.0) / BACKWARD_SIGMA  # the z component of what is ahead of the chest
    cost = cost + np.minimum(backward**2, MAX_BACKWARD_COST)
    twist = np.linalg.norm(rotations.log(np.swapaxes(pelvis, -1, -2) @ chest), axis=-1)
    cost = cost + (twist / TRUNK_TWIST_SIGMA) ** 2
    if "Nose" in rays.directions:
        top = 0.5 * (places["LShoulder"] + places["RShoulder"])
        ahead = (places["Nose"] - top)[[0, 2, 1]] * [1, 1, -1]  # the rest pose faces -Y
        nose = 0.5 * (points["LShoulder"] + points["RShoulder"]) + chest @ ahead
        cost = cost + np.minimum((_distance(rays, "Nose", nose) / NOSE_SIGMA) ** 2, MAX_NOSE_COST)
    moving = np.concatenate([points["LShoulder"] - points["RShoulder"], points["LHip"] - points["RHip"], up], axis=-1)
    leaps = leap_costs([moving], fps)
    path = cheapest_path(cost, leaps)
    if mirrored:
        sides = np.array([state[2] for state in states])
        cost = np.where(sides[:, None] == sides[path], _NEVER, cost)
        path = cheapest_path(cost, leaps)
    probability, total = believed_states(cost, leaps)
    sides_seen = path % 4 + np.array([[0], [4]])  # leaning forward and backward
    share = np.take_along_axis(probability, sides_seen, axis=0)
    share /= share.sum(axis=0)
    frames = np.arange(len(path))
    return {
        name: np.einsum("sf,sfk->fk", share, options[sides_seen, frames]) for name, options in points.items()
    }, total


def _distance(rays: Rays, name: str, points: Array) -> Array:
    """Distance of points (..., F, 3) from the rays of a keypoint, metres."""
    d, gap = rays.directions[name], points - rays.centre
    depth = np.sum(d * gap, axis=-1) / np.sum(d * d, axis=-1)
    return np.asarray(np.linalg.norm(gap - depth[..., None] * d, axis=-1))


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
