"""The points of a performer's hands in space, from the detections in several views."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..body.kinematics import part_poses
from ..body.motion import Motion
from ..errors import KeypointError
from ..formats.keypoint_layouts import HAND_NAMES, HAND_POINTS
from ..numerics.arrays import Array
from ..shot.detections import Detections
from ..shot.frame_numbers import footage_delay
from ..shot.shot import Shot
from .association.tracks import ViewDetections
from .keypoint_rays import Keypoints
from .observations import on_shot_frames, on_time
from .triangulation import triangulate

MAX_WRIST_DISTANCE = 0.15
"""A detected hand belongs to the performer if its wrist is seen within this of the tracked wrist, metres."""
HAND_INLIER_DISTANCE = 0.03
"""A point of a hand is accepted if at least two views agree on it to within this, metres."""


def hand_points(shot: Shot, detections: Sequence[Detections], wrists_world: Array) -> Array:
    """Triangulate the points of a performer's hands.

    Parameters
    ----------
    shot : Shot
        V views, F frames.
    detections : sequence of Detections
        The detected hands of each view; see `core.formats.keypoint_files.read_keypoints`.
    wrists_world : ndarray, shape (F, 2, 3)
        Positions of the performer's left and right wrist, metres.

    Returns
    -------
    ndarray, shape (F, 2, 21, 3)
        The points of the left and the right hand in the order of `HAND_POINTS`, metres; NaN where no two views agree.

    Raises
    ------
    KeypointError
        Fewer than two views have hands of the performer.
    """
    V, F, L = len(shot.views), shot.length, len(HAND_NAMES)
    poses = [view.camera.poses(0, F) for view in shot.views]
    R, t = np.stack([R for R, _ in poses]), np.stack([t for _, t in poses])
    rays, confidence = np.full((V, F, L, 2), np.nan), np.zeros((V, F, L))
    for v, (view, found) in enumerate(zip(shot.views, detections, strict=True)):
        if len(found):
            seen = on_shot_frames(view, found, HAND_NAMES, shot)
            _fill_in(seen, np.einsum("fab,fsb->fsa", R[v], wrists_world) + t[v][:, None], rays[v], confidence[v])
    views = int((confidence > 0).any(axis=(1, 2)).sum())
    if views < 2:
        raise KeypointError(
            f"{views} of {V} views have keypoints of the performer's hands",
            where="keypoints",
            todo="two views or more are needed: run a detector that finds hands (OpenPose, COCO-WholeBody, MediaPipe "
            "Holistic) on them, and track before",
        )
    keypoints = on_time(Keypoints(HAND_NAMES, rays, confidence, R, t), [footage_delay(view) for view in shot.views])
    points, inliers = triangulate(keypoints)
    distance = np.linalg.norm(keypoints.residuals(points), axis=-1)
    agree = inliers & (np.nan_to_num(distance, nan=np.inf) < HAND_INLIER_DISTANCE)
    sure = replace(keypoints, confidence=np.where(agree, keypoints.confidence, 0.0))
    points, _ = triangulate(sure)
    points[agree.sum(axis=0) < 2] = np.nan
    return np.asarray(points.reshape(F, 2, len(HAND_POINTS), 3))


def tracked_hands(shot: Shot, detections: Sequence[Detections], number: int, motion: Motion) -> Array:
    """Triangulate the points of a tracked performer's hands, see `hand_points`.

    Parameters
    ----------
    shot : Shot
    detections : sequence of Detections
        The detected hands of each view.
    number : int
        Index of the performer in the shot.
    motion : Motion
        F poses.

    Raises
    ------
    KeypointError
        Fewer than two views have hands of the performer.
    BodyError
        The performer has no hands.
    """
    body = shot.performers[number].body
    wrists = part_poses(body, motion)[1][:, [body.index(f"hand.{side}") for side in "LR"]]
    return hand_points(shot, detections, wrists)


def _fill_in(seen: ViewDetections, wrists_cam: Array, rays: Array, confidence: Array) -> None:
    """Fill in the rays (F, 42, 2) and confidence (F, 42) of a view from the hands nearest to the tracked wrists."""
    count = len(HAND_POINTS)
    for side in range(2):
        hand = slice(count * side, count * (side + 1))
        wrist = wrists_cam[seen.frames, side]
        with np.errstate(invalid="ignore"):
            away = np.linalg.norm(seen.rays[:, count * side] - wrist[:, :2] / wrist[:, 2:], axis=-1) * wrist[:, 2]
        away[~(wrist[:, 2] > 0)] = np.nan
        for frame in np.unique(seen.frames):
            rows = np.flatnonzero((seen.frames == frame) & (np.nan_to_num(away, nan=np.inf) < MAX_WRIST_DISTANCE))
            if len(rows):
                row = rows[np.argmin(away[rows])]
                rays[frame, hand], confidence[frame, hand] = seen.rays[row, hand], seen.confidence[row, hand]
