"""How far a person is from the only camera, and how tall: by the lengths of the bones, and by feet on the floor."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy  # its parts are loaded when they are used

from ...body import Body, human, landmark_positions
from ...body.motion import Motion
from ...numerics.arrays import Array
from ...numerics.resampling import gaps_filled
from ..keypoint_rays import Keypoints

MEDIAN_WINDOW = 0.3
"""Window of the running median of the person's distance, seconds."""
MAX_OVERLONG_SHARE = 0.2
"""When the person's distance is estimated, this share of the bones may come out longer than they are."""
AVERAGE_HEIGHT = 1.7
"""Height of a person of whom nothing is known, metres."""
HEIGHTS = (1.4, 2.05)
"""Range of plausible heights, metres; if a height outside follows from the floor, the floor is probably not at z =
0."""
LENGTH_SIGMA = 0.08
"""Standard deviation of a bone's length as seen from that of the body, as a share: proportions differ, and detectors
err.
"""
DEPTH_EXTENT_SIGMA = 0.25
"""Standard deviation of a bone's extent in depth, as a share of its length."""
_DEPTHS = 65  # nodes of an integral
FLOOR_TOLERANCE = 0.15
"""Feet are assumed to be on the floor, z = 0, if the distance that follows from this differs from the one by the
lengths of the bones by less than this share."""
FARTHEST = 1000.0
"""Depth of feet that cannot stand on the floor, metres."""
ANKLE_HEIGHT = 0.08
"""Height of an ankle above the floor, metres."""
_BONES = (
    *((side + a, side + b) for a, b in (("Shoulder", "Elbow"), ("Elbow", "Wrist")) for side in "LR"),
    *((side + a, side + b) for a, b in (("Hip", "Knee"), ("Knee", "Ankle")) for side in "LR"),
)


@dataclass(frozen=True, eq=False)
class Rays:
    """Rays of one view to the keypoints on F frames; missing ones are interpolated.

    Attributes
    ----------
    centre : ndarray, shape (F, 3)
        Centre of the camera, metres, world.
    directions : mapping of str to ndarray, shape (F, 3)
        By keypoint, in the world, scaled to a depth of one: a point is at centre + depth * direction.
    """

    centre: Array
    directions: Mapping[str, Array]

    @classmethod
    def of(cls, keypoints: Keypoints) -> Rays:
        """Return the rays of the first view's keypoints, interpolated linearly between the frames on which they are
        found.
        """
        R, t = keypoints.R_cam_world[0], keypoints.t_cam_world[0]
        directions = {}
        for i, name in enumerate(keypoints.names):
            found = np.where(keypoints.confidence[0, :, i, None] > 0, keypoints.rays[0, :, i], np.nan)
            if np.isfinite(found).any():
                ray = gaps_filled(np.column_stack([found, np.ones(len(found))]))
                directions[name] = np.einsum("fba,fb->fa", R, ray)
        return cls(-np.einsum("fba,fb->fa", R, t), directions)

    def at(self, name: str, depth: Array) -> Array:
        """Return the points at depths (..., F), shape (..., F, 3)."""
        return self.centre + depth[..., None] * self.directions[name]

    def depths_from(self, start: Array, name: str, length: float) -> Array:
        """Return the nearer and the farther depth of a keypoint at a distance of `length` from points (..., F, 3).

        Both have the shape (2, ..., F), metres. The extent in depth is the expected one, see `expected_depth`.
        """
        d = self.directions[name]
        square = np.sum(d * d, axis=-1)
        nearest = np.sum(d * (start - self.centre), axis=-1) / square
        aside = np.linalg.norm(start - self.centre - nearest[..., None] * d, axis=-1)
        beyond = length * expected_depth(aside / length) / np.sqrt(square)
        return np.stack([nearest - beyond, nearest + beyond])


def expected_depth(seen: Array) -> Array:
    """Share of a bone's length along the ray, from the share that is seen across it; the shape is the same.

    If 95 % of a bone's length are seen, it is more likely to be 5 % shorter than assumed than to be turned away by 18
    degrees. The result is therefore the mean over the distributions of turns (`DEPTH_EXTENT_SIGMA`) and of lengths
    (`LENGTH_SIGMA`).
    """
    depths = np.linspace(0.0, 1.0, _DEPTHS)
    off = (np.sqrt(1 - depths**2) - np.minimum(seen, 1.0)[..., None]) / LENGTH_SIGMA
    cost = 0.5 * (off**2 + (depths / DEPTH_EXTENT_SIGMA) ** 2)
    weight = np.exp(cost.min(axis=-1, keepdims=True) - cost)
    return np.asarray((weight * depths).sum(axis=-1) / weight.sum(axis=-1))


def rest_places(body: Body) -> dict[str, Array]:
    """Return the landmarks of a body at rest by name, metres, shape (3,) each."""
    rest, names = Motion(np.zeros((1, 3)), np.tile(np.eye(3), (1, len(body), 1, 1))), list(body.landmarks)
    return dict(zip(names, landmark_positions(body, rest, names)[0], strict=True))


def root_depth(rays: Rays, places: Mapping[str, Array], fps: float) -> Array:
    """Depth of the middle of the hips, (F,): no bone may come out too long, and some are seen at their full length."""
    bones = [bone for bone in _BONES if set(bone) <= set(rays.directions)]
    seen = [np.linalg.norm(rays.directions[a] - rays.directions[b], axis=-1) for a, b in bones]
    lengths = [float(np.linalg.norm(places[a] - places[b])) for a, b in bones]
    hips, shoulders = (
        0.5 * (rays.directions["L" + joint] + rays.directions["R" + joint]) for joint in ("Hip", "Shoulder")
    )
    seen.append(np.linalg.norm(hips - shoulders, axis=-1))
    lengths.append(torso_length(places))
    farthest = np.array(lengths)[:, None] / np.maximum(seen, 1e-6)
    depth = np.quantile(farthest, MAX_OVERLONG_SHARE, axis=0)
    depth = scipy.ndimage.median_filter(depth, max(1, round(MEDIAN_WINDOW * fps)), mode="nearest")
    return depth


def torso_length(places: Mapping[str, Array]) -> float:
    """Return the distance between the middle of the hips and that of the shoulders, metres."""
    hips, shoulders = (0.5 * (places["L" + joint] + places["R" + joint]) for joint in ("Hip", "Shoulder"))
    return float(np.linalg.norm(hips - shoulders))


def floor_depth(rays: Rays, ankle: str) -> Array:
    """Depth of an ankle if its foot stands on the floor, z = 0, metres, shape (F,); `FARTHEST` where its ray does not
    meet the height of one. A raised foot is nearer.
    """
    falling = -rays.directions[ankle][:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        reached = (rays.centre[:, 2] - ANKLE_HEIGHT) / np.where(falling > 1e-3, falling, 0.0)
    return np.asarray(np.where((reached > 0) & (reached < FARTHEST), reached, FARTHEST))


def standing_depth(rays: Rays) -> Array:
    """Depth of the nearer of both feet if it stands on the floor, as of `floor_depth`."""
    ankles = [floor_depth(rays, name) for name in ("LAnkle", "RAnkle") if name in rays.directions]
    return np.min([np.full(len(rays.centre), FARTHEST), *ankles], axis=0)


def floor_ratio(rays: Rays, depth: Array) -> float:
    """Distance of feet that stand on the floor, as a multiple of depths (F,)."""
    standing = standing_depth(rays)
    reached = standing < FARTHEST
    return float(np.median(standing[reached] / depth[reached])) if reached.any() else np.inf


def depth_on_floor(rays: Rays, depth: Array, fps: float) -> Array:
    """Return depths (F,) of somebody who mostly stands on the floor, from those by the lengths of the bones: the depth
    of the feet, which hardly depends on the pose, wherever both agree to within `FLOOR_TOLERANCE`. Where they begin to
    agree, one passes into the other over `MEDIAN_WINDOW`, as they may be half a metre apart.
    """
    window = max(1, round(MEDIAN_WINDOW * fps))
    standing = scipy.ndimage.median_filter(standing_depth(rays), window, mode="nearest")
    farther = np.log(standing / depth)
    agreed = np.abs(farther) < FLOOR_TOLERANCE
    if agreed.all():
        return standing
    inside = scipy.ndimage.distance_transform_edt(np.pad(agreed, window, mode="edge"))[window:-window]
    return np.asarray(depth * np.exp(np.where(agreed, farther, 0.0) * np.minimum(inside / window, 1.0)))


def likely_height(keypoints: Keypoints, fps: float) -> float:
    """Return the height of a person who stands on the floor, z = 0, in metres; an average one if this is
    implausible.
    """
    body = human(AVERAGE_HEIGHT)
    rays, places = Rays.of(keypoints), rest_places(body)
    height = AVERAGE_HEIGHT * floor_ratio(rays, root_depth(rays, places, fps))
    return height if HEIGHTS[0] < height < HEIGHTS[1] else AVERAGE_HEIGHT
