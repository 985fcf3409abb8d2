"""The points without sides of all detections, as rays in the world."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...numerics.arrays import Array, Ints
from ..keypoint_rays import Keypoints
from .tracks import Track, ViewDetections, without_sides


@dataclass(frozen=True, eq=False)
class DetectedPoints:
    """The points without sides of all detections, and the cameras. `points[v]` has the shape (N, K, 2)."""

    empty: Keypoints
    points: tuple[Array, ...]

    @classmethod
    def of(cls, detections: Sequence[ViewDetections], empty: Keypoints) -> DetectedPoints:
        """Return the points of the detections of every view; `empty` is as in `located_people.find_people`."""
        names, _ = without_sides(empty.names, np.zeros((0, len(empty.names), 2)))
        V, F = empty.confidence.shape[:2]
        rays, confidence = np.full((V, F, len(names), 2), np.nan), np.zeros((V, F, len(names)))
        middles = tuple(without_sides(empty.names, found.rays)[1] for found in detections)
        return cls(Keypoints(names, rays, confidence, empty.R_cam_world, empty.t_cam_world), middles)

    def keypoints(self, tracks: Sequence[Track]) -> Keypoints:
        """Return the points of some tracks as one person's keypoints."""
        rays = self.empty.rays.copy()
        for track in tracks:
            rays[track.view, track.frames] = self.points[track.view][track.rows]
        return replace(self.empty, rays=rays, confidence=np.isfinite(rays).all(axis=-1).astype(float))

    def origins(self, view: int, frames: Ints) -> Array:
        """Positions of a camera on n frames, metres, world, shape (n, 3)."""
        R, t = self.empty.R_cam_world[view, frames], self.empty.t_cam_world[view, frames]
        return -np.einsum("fba,fb->fa", R, t)

    def directions(self, track: Track) -> Array:
        """Directions of a track's rays in the world, shape (n, K, 3)."""
        rays = self.points[track.view][track.rows]
        rays = np.concatenate([rays, np.ones((*rays.shape[:2], 1))], axis=-1)
        world = np.einsum("fba,fkb->fka", self.empty.R_cam_world[track.view, track.frames], rays)
        return np.asarray(world / np.linalg.norm(world, axis=-1, keepdims=True))

    def apart(self, view: int, row: int, frame: int, places: Array) -> float:
        """Median distance of a detection's rays from points (K, 3), metres."""
        R, t = self.empty.R_cam_world[view, frame], self.empty.t_cam_world[view, frame]
        x = places @ R.T + t
        away = np.linalg.norm(x[:, :2] - self.points[view][row] * x[:, 2:], axis=1)
        return float(median_known(np.where(x[:, 2] > 0, away, np.nan)))


def median_known(values: Array) -> Array:
    """Median of the known values along the last axis; infinite if there are none."""
    ordered = np.sort(values, axis=-1)  # NaN comes last
    count = np.isfinite(ordered).sum(axis=-1)
    middle = np.take_along_axis(ordered, np.maximum(count - 1, 0)[..., None] // 2, axis=-1)[..., 0]
    return np.where(count > 0, middle, np.inf)
