"""Landmarks of a human body whose parts are somebody else's bones: joints, and points of head and feet.

With them, 2D keypoints and clicks have names on it, and feet have heels and balls that can stand still.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..body import Body
from ..keypoints.keypoint_offsets import FACE
from ..numerics.arrays import Array

_JOINTS = {
    "upper_arm": "Shoulder",
    "forearm": "Elbow",
    "hand": "Wrist",
    "thigh": "Hip",
    "shin": "Knee",
    "foot": "Ankle",
}
"""Where a part with a role begins."""
_NOSE_HEIGHT = 0.5
"""Height of the nose on the head, as a share of that of its top."""
_HEEL_SHARE, _TOE_SHARE, _SOLE_CLEARANCE = 0.02, 0.88, 0.06
"""Places of heel and toe along a foot's solid, which is larger than the skin at its corners, and their height above its
sole, in its length: as on the default body.
"""
_MIN_ELONGATION = 1.3
"""Ratio of the spread along a foot to that across from which its own direction is used instead of the body's."""
_MIN_LEG_COSINE = 0.7
"""Least cosine of the angle between the legs of a body that stands and the vertical."""


def human_landmarks(body: Body, parts: Mapping[str, int]) -> dict[str, tuple[int, Array]]:
    """Return the landmarks of a human body that stands upright at rest, with z up; none of one that does not.

    Parameters
    ----------
    body : Body
    parts : mapping of str to int
        Index of the part that has each role of `core.retargeting.bone_roles.roles`; roles may be missing.

    Returns
    -------
    dict of str to (int, ndarray of shape (3,))
        As in `Body.landmarks`; other joints have the names of their parts.
    """
    heads = np.array([part.head_world for part in body.parts])
    if not {"hips", "thigh.L", "thigh.R", "foot.L", "foot.R"} <= set(parts):
        return {}
    thighs, feet = (heads[[parts[f"{role}.L"], parts[f"{role}.R"]]] for role in ("thigh", "foot"))
    leg = thighs.mean(axis=0) - feet.mean(axis=0)
    if not leg[2] > _MIN_LEG_COSINE * np.linalg.norm(leg):
        return {}
    left = (thighs[0] - thighs[1]) * [1, 1, 0]
    if not np.linalg.norm(left) > 0:
        return {}
    left = left / np.linalg.norm(left)
    forward = np.cross(left, [0.0, 0.0, 1.0])
    found = {"Hip": _on(body, parts["hips"], thighs.mean(axis=0))}
    if neck := [parts[role] for role in ("neck", "head") if role in parts]:
        found["Neck"] = neck[0], np.zeros(3)
    if "head" in parts:
        found |= _head(body, parts["head"], left, forward)
    for role, joint in _JOINTS.items():
        for side in "LR":
            if f"{role}.{side}" in parts:
                found[side + joint] = parts[f"{role}.{side}"], np.zeros(3)
    for side in "LR":
        found |= _foot(body, parts[f"foot.{side}"], side, forward)
    named = {part for part, point in found.values() if not point.any()}
    return found | {part.name: (i, np.zeros(3)) for i, part in enumerate(body.parts) if i not in named}


def _on(body: Body, part: int, place_world: Array) -> tuple[int, Array]:
    """Return a landmark of a part by its place at rest, world frame, metres."""
    own = body.parts[part]
    return part, own.R_world_rest.T @ (place_world - own.head_world)


def _corners(body: Body, part: int) -> Array:
    """Return the corners of a part at rest, and of those that hang on it, world frame, metres, shape (V, 3)."""
    hung = np.flatnonzero(body.ancestry[:, part])
    return np.concatenate(
        [body.parts[i].vertices @ body.parts[i].R_world_rest.T + body.parts[i].head_world for i in hung.tolist()]
    )


def _head(body: Body, part: int, left: Array, forward: Array) -> dict[str, tuple[int, Array]]:
    joint, up = body.parts[part].head_world, np.array([0.0, 0.0, 1.0])
    beside = _corners(body, part) - joint
    height, front = float(beside[:, 2].max()), float((beside @ forward).max())
    if not height > 0:
        return {}
    found = {"Head": joint + height * up, "Nose": joint + _NOSE_HEIGHT * height * up + front * forward}
    for name, (aside, above, before) in FACE.items():
        for side, sign in (("L", 1.0), ("R", -1.0)):
            found[side + name] = joint + height * (sign * aside * left + above * up + before * forward)
    return {name: _on(body, part, place) for name, place in found.items()}


def _foot(body: Body, part: int, side: str, forward: Array) -> dict[str, tuple[int, Array]]:
    corners = _corners(body, part)
    middle = corners.mean(axis=0)
    flat = (corners - middle)[:, :2]
    _, spread, ways = np.linalg.svd(flat, full_matrices=False)
    along = forward
    if spread[0] > _MIN_ELONGATION * spread[1]:
        along = np.append(ways[0], 0.0) * np.sign(ways[0] @ forward[:2])
    places = (corners - middle) @ along
    back, front = float(places.min()), float(places.max())
    length = front - back
    found = {}
    for name, share in (("Heel", _HEEL_SHARE), ("BigToe", _TOE_SHARE)):
        place = back + share * length
        near = np.abs(places - place) < 0.5 * length
        sole = float(corners[near, 2].min())
        found[side + name] = _on(body, part, np.append((middle + place * along)[:2], sole + _SOLE_CLEARANCE * length))
    return found
