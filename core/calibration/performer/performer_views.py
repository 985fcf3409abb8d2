"""The main joints of the largest person in the views of a shot whose cameras are not known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...cameras.camera import Camera
from ...keypoints.observations import image_rays
from ...keypoints.seen_landmarks import MIN_CONFIDENCE
from ...numerics.arrays import Array
from ...shot.detections import Detections
from .limb_residuals import JOINTS, JointSightings

MAX_FRAMES = 150
"""Largest number of frames that are used, evenly over the shot; neighbouring frames have the same errors."""
USUAL_CORRELATION = 9.0
"""Number of neighbouring frames on which a detector has the same error: 0.3 s at 30 frames per second."""


@dataclass(frozen=True, eq=False)
class PerformerView:
    """One camera's footage and keypoints of a performer.

    Attributes
    ----------
    camera : str
    size : tuple of int
        Width and height, pixels.
    detections : Detections
        The detector's results; frame f of the shot is frame every * f + offset of the footage, rounded.
    offset : float
    lens : Camera, optional
        A camera with this lens, whose focal length, principal point and distortion are kept.
    every : int
    """

    camera: str
    size: tuple[int, int]
    detections: Detections
    offset: float = 0.0
    lens: Camera | None = None
    every: int = 1

    def matrix(self, focal: float) -> Array:
        """Return the intrinsic matrix of the lens, or if it is not known, of a focal length in pixels, shape (3, 3)."""
        if self.lens is not None:
            return self.lens.matrix
        width, height = self.size
        return np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]])

    def camera_at(self, matrix: Array, R_cam_world: Array, t_cam_world: Array) -> Camera:
        """Return the view's camera with this matrix and pose, and the distortion of its lens, if that is known."""
        distortions = np.zeros(4) if self.lens is None else self.lens.distortions
        fisheye = self.lens is not None and self.lens.fisheye
        return Camera.create(
            self.camera, self.size, matrix, R_cam_world, t_cam_world, distortions=distortions, fisheye=fisheye
        )


def joint_sightings(views: Sequence[PerformerView], frames: tuple[int, int], correlated: float = 1.0) -> JointSightings:
    """Return the main joints of the largest person in every view, on frames on which two views, or the only one, show
    one.
    """
    first, last = frames
    shape = (len(views), last - first + 1, len(JOINTS))
    points, confidence = np.full((*shape, 2), np.nan), np.zeros(shape)
    for v, view in enumerate(views):
        names = [name for name in JOINTS if name in view.detections.names]
        columns, places = [view.detections.names.index(n) for n in names], [JOINTS.index(n) for n in names]
        largest = np.zeros(shape[1])
        found, between = np.divmod(view.detections.frames - round(view.offset), view.every)
        for i, frame in enumerate(np.where(between == 0, found - first, -1)):
            own, sure = view.detections.points[i, columns], view.detections.confidence[i, columns]
            there = np.isfinite(own).all(axis=-1) & (sure >= MIN_CONFIDENCE)
            if not 0 <= frame < shape[1] or there.sum() < 2:
                continue
            size = float(np.linalg.norm(np.ptp(own[there], axis=0))) * sure[there].sum()
            if size > largest[frame]:
                largest[frame] = size
                points[v, frame], confidence[v, frame] = np.nan, 0.0
                points[v, frame, places] = np.where(there[:, None], own, np.nan)
                confidence[v, frame, places] = np.where(there, sure, 0.0)
        if view.lens is not None:
            matrix = view.lens.matrix
            points[v] = image_rays(view.lens, points[v]) * matrix[[0, 1], [0, 1]] + matrix[:2, 2]
    shared = np.flatnonzero((confidence > 0).any(axis=2).sum(axis=0) >= min(2, len(views)))
    some = shared[np.linspace(0, len(shared) - 1, min(len(shared), MAX_FRAMES)).astype(int)] if len(shared) else shared
    return JointSightings(
        tuple(view.camera for view in views),
        np.array([view.size for view in views]),
        first + some,
        points[:, some],
        confidence[:, some],
        max(1.0, correlated * len(some) / max(len(shared), 1)),
    )
