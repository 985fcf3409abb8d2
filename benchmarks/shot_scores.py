"""What a tracked shot of the set is compared with: a triangulated detector, and the tracker's own expected errors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from ..core.body import Body, landmark_positions
from ..core.body.motion import Motion
from ..core.formats import Landmarks
from ..core.formats.keypoint_files import read_shot_keypoints
from ..core.keypoints.observations import performer_keypoints
from ..core.keypoints.triangulation import triangulate
from ..core.review.scoring import JOINTS, Score, joint_error
from ..core.shot.shot import Shot

Array = NDArray[np.float64]

CUTOFF = 6.0
"""Of the low-pass filter on triangulated keypoints, Hz: what users of such pipelines choose for the whole body."""
TIPS = {"Elbow": "upper_arm", "Wrist": "forearm", "Knee": "thigh", "Ankle": "shin"}
"""Joints that are the tip of a part."""


def triangulated_error(shot: Shot, truth: Landmarks) -> Score | None:
    """Errors of the shot's keypoints, triangulated, gaps closed, filtered; None with fewer than two views of them."""
    if sum(view.keypoints is not None for view in shot.views) < 2:
        return None
    keypoints = performer_keypoints(shot, read_shot_keypoints(shot))[0]
    points, _ = triangulate(keypoints)
    names = [name for name in keypoints.names if name.endswith(JOINTS) and name != "Hip"]
    columns = points[:, [keypoints.names.index(name) for name in names]]
    return joint_error(Landmarks(tuple(names), low_passed(columns, shot.fps), shot.fps), truth, ())


def low_passed(points: Array, fps: float) -> Array:
    """Points (F, L, 3), gaps (NaN) closed by straight lines, through a Butterworth filter forwards and backwards."""
    frames, out = np.arange(len(points)), points.copy()
    for line in out.reshape(len(points), -1).T:
        known = np.isfinite(line)
        if known.any():
            line[:] = np.interp(frames, frames[known], line[known])
    sections = butter(4, min(CUTOFF, 0.45 * fps), fs=fps, output="sos")
    ends = min(len(points) - 1, max(3, int(fps / 4)))
    return np.asarray(sosfiltfilt(sections, out, axis=0, padlen=ends))


def interval_cover(body: Body, motion: Motion, interval: Array, truth: Landmarks, keys: Sequence[int]) -> float:
    """Share of the joints that lie within the 90 % interval of their expected error, on frames without a key pose.

    Parameters
    ----------
    interval : ndarray, shape (F, P)
        The distance from every part's tip that its true place is said to be within in 90 % of cases, metres.
    """
    rows = np.setdiff1d(np.arange(min(len(motion), len(truth))), keys)
    named = {f"{side}{joint}": f"{part}.{side}" for joint, part in TIPS.items() for side in "LR"}
    names = [name for name in named if name in truth.names]
    found = landmark_positions(body, motion, names)[rows]
    true = truth.points_world[rows][:, [truth.names.index(name) for name in names]]
    said = interval[rows][:, [body.index(named[name]) for name in names]]
    error = np.linalg.norm(found - true, axis=-1)
    return float(np.mean(error[np.isfinite(error)] <= said[np.isfinite(error)]))
