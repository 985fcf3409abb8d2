"""Finger motion of a character from the tracked points of a performer's hands."""

from __future__ import annotations

import numpy as np
from scipy.linalg import solveh_banded

from ...body.skeleton_motion import RestSkeleton
from ...formats.keypoint_layouts import HAND_POINTS
from ...numerics.arrays import Array
from ..bone_roles.roles import FINGERS, SIDES, BoneMap
from ..rest_poses.palms import palm_axes
from ..rest_poses.rest_alignment import shortest_turn

SMOOTHING_TIME = 0.04
"""Time scale of smoothing, seconds: detected fingers jitter by a few pixels from frame to frame."""
UNSEEN_WEIGHT = 0.01
"""Weight of frames without data, which are interpolated linearly: it keeps the smooth curve from overshooting in
gaps."""
_BONES_PER_FINGER, _SECOND_DIFFERENCE = 3, (1.0, -2.0, 1.0)


def seen_directions(points_world: Array, fps: float) -> dict[str, Array]:
    """Return the directions of the finger bones of one hand in the axes of its palm.

    The palm's axes are those of `rest_poses.palms.palm_axes`: across it, along the middle finger, out of
    it.

    Parameters
    ----------
    points_world : ndarray, shape (F, 21, 3)
        See `core.keypoints.hand_points`, metres; NaN where unknown.
    fps : float

    Returns
    -------
    dict of str to ndarray, shape (F, 3, 3)
        Unit vectors of three bones by finger, smoothed over time and interpolated where a bone is not seen. Fingers
        with a bone that is never seen are absent.
    """
    at = {name: points_world[:, i] for i, name in enumerate(HAND_POINTS)}
    along = at["Middle1"] - at["Wrist"]
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    across = at["Index1"] - at["Pinky1"]
    across = across - along * np.sum(across * along, axis=1, keepdims=True)
    across = across / np.linalg.norm(across, axis=1, keepdims=True)
    palm = np.stack([across, along, np.cross(across, along)], axis=2)
    found = {}
    for finger in FINGERS:
        joints = np.stack([at[f"{finger.capitalize()}{k + 1}"] for k in range(_BONES_PER_FINGER + 1)], axis=1)
        bones = np.einsum("fab,fka->fkb", palm, np.diff(joints, axis=1))
        bones = bones / np.linalg.norm(bones, axis=-1, keepdims=True)
        if np.isfinite(bones).all(axis=-1).any(axis=0).all():
            found[finger] = np.stack([_smooth(bones[:, k], fps) for k in range(_BONES_PER_FINGER)], axis=1)
    return found


def _smooth(directions: Array, fps: float) -> Array:
    """Smooth unit vectors (F, 3) by Whittaker's method: least squares with a penalty on second differences.

    Unlike a moving average it does not flatten a steady rotation, and it bridges frames that are NaN.
    """
    known = np.isfinite(directions).all(axis=1)
    F, at = len(directions), np.flatnonzero(known)
    filled = np.stack([np.interp(np.arange(F), at, directions[at, a]) for a in range(3)], axis=1)
    if F > 2:
        A = np.zeros((3, F))  # upper bands
        A[2] = np.where(known, 1.0, UNSEEN_WEIGHT)
        for i, a in enumerate(_SECOND_DIFFERENCE):
            for j, b in enumerate(_SECOND_DIFFERENCE[i:], start=i):
                A[2 - (j - i), j : F - 2 + j] += (SMOOTHING_TIME * fps) ** 4 * a * b
        filled = solveh_banded(A, np.where(known, 1.0, UNSEEN_WEIGHT)[:, None] * filled)
    return np.asarray(filled / np.maximum(np.linalg.norm(filled, axis=1, keepdims=True), 1e-12))


def finger_motion(rest: RestSkeleton, bones: BoneMap, hands_world: Array, fps: float) -> dict[str, Array]:
    """Return the rotation of each finger bone of a rig relative to its parent, in world axes at rest.

    Every bone points where the performer's does as seen from the palm, by the shortest rotation, so that neither the
    lengths of the rig's fingers nor their rest pose matter.

    Parameters
    ----------
    rest : RestSkeleton
    bones : BoneMap
    hands_world : ndarray, shape (F, 2, 21, 3)
        Points of the left and the right hand.
    fps : float

    Returns
    -------
    dict of str to ndarray, shape (F, 3, 3)
        By the name of the bone; empty if the rig has no fingers, or none are seen.
    """
    found = {}
    for side, points in zip(SIDES, np.swapaxes(hands_world, 0, 1), strict=True):
        palm = palm_axes(rest, bones, side)
        if palm is None:
            continue
        for finger, seen in seen_directions(points, fps).items():
            chain = rest.indices(bones.bones.get(f"{finger}.{side}", ()))
            above = np.broadcast_to(np.eye(3), (len(seen), 3, 3))
            for k, j in enumerate(chain[:_BONES_PER_FINGER]):
                end = rest.heads[chain[k + 1]] if k + 1 < len(chain) else rest.tails[j]
                way = end - rest.heads[j]
                length = np.linalg.norm(way)
                if not (np.isfinite(length) and length > 0):
                    continue
                turn = shortest_turn(above @ (way / length), seen[:, k] @ palm.T) @ above
                found[rest.names[j]] = np.swapaxes(above, 1, 2) @ turn
                above = turn
    return found
