"""Standing on the floor: how far away a body is that one view shows.

From one camera, a body that is farther away looks like a nearer one whose limbs point more along the view. A foot on a
floor of known height decides: its ray meets the floor in one point.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..body import Body, landmark_positions, part_poses
from ..body.motion import Motion
from ..keypoints.keypoint_rays import Keypoints
from ..numerics.arrays import Array

FLOATING_HEIGHT = 0.15
"""Height of the lowest point of a body above the floor, metres, from which it is taken to float by mistake."""
FLOATING_COST = 30.0
"""By how much a pose on the floor may fit the clicks worse than one that floats, in squared standard deviations."""
_FEET = {"LAnkle": "foot.L", "RAnkle": "foot.R"}
_MIN_SLOPE = 0.05
"""Least slope of a ray that meets the floor."""


def lowest_point(body: Body, poses: Motion) -> Array:
    """Return the height of the lowest point of a body in F poses, world frame (z is up), metres, shape (F,)."""
    R, T = part_poses(body, poses)
    heights = [part.vertices @ R[:, p, 2].T + T[:, p, 2] for p, part in enumerate(body.parts)]
    return np.concatenate(heights).min(axis=0)


def is_from_one_view(clicks: Keypoints) -> bool:
    """Whether all clicks are in the same view, so that nothing but the size of the body shows its distance."""
    return int(clicks.confidence.any(axis=(1, 2)).sum()) == 1


def steps_to_floor(body: Body, clicks: Keypoints, pose: Motion, floor: float) -> Iterator[Array]:
    """Generate for each clicked ankle the displacement, world frame, metres, shape (3,), that brings it to where its
    ray is as high above the floor as it is when the body stands at rest.

    Parameters
    ----------
    body : Body
    clicks : Keypoints
        In one view, on one frame.
    pose : Motion
        One pose.
    floor : float
        Height of the floor in the world frame, z is up, metres.
    """
    [view] = np.flatnonzero(clicks.confidence.any(axis=(1, 2)))
    R, t = clicks.R_cam_world[view, 0], clicks.t_cam_world[view, 0]
    centre = -R.T @ t
    for i, name in enumerate(clicks.names):
        if name not in _FEET or name not in body.landmarks or not clicks.confidence[view, 0, i]:
            continue
        ray = R.T @ np.append(clicks.rays[view, 0, i], 1.0)
        distance = (floor + _height_at_rest(body, name) - centre[2]) / ray[2] if abs(ray[2]) > _MIN_SLOPE else -1.0
        if distance > 0:
            yield centre + distance * ray - landmark_positions(body, pose, [name])[0, 0]


def _height_at_rest(body: Body, ankle: str) -> float:
    """Return the height of an ankle above the sole of its foot in the rest pose, metres."""
    carrier, local = body.landmarks[ankle]
    foot = body.parts[body.index(_FEET[ankle]) if _FEET[ankle] in body.names else carrier]
    up = foot.R_world_rest[2]
    joint = body.parts[carrier]
    height = joint.R_world_rest[2] @ local + joint.head_world[2]
    return float(height - (foot.vertices @ up + foot.head_world[2]).min())
