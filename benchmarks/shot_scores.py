"""Comparing a tracked shot of the set with a triangulated detector, and with its own expected errors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from ..core.body import Body, landmark_positions
from ..core.body.kinematics import part_poses
from ..core.body.limbs import MAIN_JOINTS
from ..core.body.motion import Motion
from ..core.body.soles import BALL_SHARE, Soles
from ..core.formats import Landmarks
from ..core.formats.keypoint_files import read_shot_keypoints
from ..core.keypoints.observations import performer_keypoints
from ..core.keypoints.triangulation import triangulate
from ..core.numerics.frame_ranges import runs
from ..core.review.scoring import Score, joint_error
from ..core.shot.shot import Shot

Array = NDArray[np.float64]

CUTOFF = 6.0
"""Cutoff frequency of the low-pass filter on triangulated keypoints, Hz, as is usual for whole-body pipelines."""
TIPS = {"Elbow": "upper_arm", "Wrist": "forearm", "Knee": "thigh", "Ankle": "shin"}
"""Joints that are the tips of parts, with these parts."""
SOLE_LANDMARKS = ("LHeel", "LBigToe", "RHeel", "RBigToe")
STANDING = 0.05
"""Largest speed of a true point of the sole that counts as standing, metres per second: shoes give way and roll."""
BRIEF = 0.08
"""Shorter standing does not count, seconds; where the shot begins or ends with it, it is not known how long it is."""


def triangulated_error(shot: Shot, truth: Landmarks) -> Score | None:
    """Return the errors of the keypoints after triangulation, interpolation and filtering; None with fewer than two
    views.
    """
    if sum(view.keypoints is not None for view in shot.views) < 2:
        return None
    keypoints = performer_keypoints(shot, read_shot_keypoints(shot))[0]
    points, _ = triangulate(keypoints)
    names = [name for name in keypoints.names if name.endswith(MAIN_JOINTS) and name != "Hip"]
    columns = points[:, [keypoints.names.index(name) for name in names]]
    return joint_error(Landmarks(tuple(names), low_passed(columns, shot.fps), shot.fps), truth, ())


def low_passed(points: Array, fps: float) -> Array:
    """Interpolate gaps (NaN) of points (F, L, 3) linearly, and apply a Butterworth filter forwards and backwards."""
    frames, out = np.arange(len(points)), points.copy()
    for line in out.reshape(len(points), -1).T:
        known = np.isfinite(line)
        if known.any():
            line[:] = np.interp(frames, frames[known], line[known])
    sections = butter(4, min(CUTOFF, 0.45 * fps), fs=fps, output="sos")
    ends = min(len(points) - 1, max(3, int(fps / 4)))
    return np.asarray(sosfiltfilt(sections, out, axis=0, padlen=ends))


def interval_cover(body: Body, motion: Motion, interval: Array, truth: Landmarks, keys: Sequence[int]) -> float:
    """Return the fraction of joints within the 90 % interval of their expected error, on frames without a key pose.

    Parameters
    ----------
    body : Body
    motion : Motion
    interval : ndarray, shape (F, P)
        See `core.tracking.expected_errors.uncertainty.JointErrors`, metres.
    truth : Landmarks
    keys : sequence of int
        Rows with a key pose.
    """
    rows = np.setdiff1d(np.arange(min(len(motion), len(truth))), keys)
    named = {f"{side}{joint}": f"{part}.{side}" for joint, part in TIPS.items() for side in "LR"}
    names = [name for name in named if name in truth.names]
    found = landmark_positions(body, motion, names)[rows]
    true = truth.points_world[rows][:, [truth.names.index(name) for name in names]]
    said = interval[rows][:, [body.index(named[name]) for name in names]]
    error = np.linalg.norm(found - true, axis=-1)
    return float(np.mean(error[np.isfinite(error)] <= said[np.isfinite(error)]))


def plants_found(body: Body, planted: NDArray[np.bool_] | None, truth: Landmarks) -> float | None:
    """Return the fraction of frames and points of the soles on which found plants agree with the true motion, among
    those on which it is known whether they stand.

    Parameters
    ----------
    body : Body
    planted : ndarray of bool, shape (F, C), optional
        See `core.tracking.results.track_result.TrackResult`.
    truth : Landmarks
        On these frames.

    Returns
    -------
    float, optional
        None where plants were not tested, or the truth has no heels and toes.
    """
    soles = Soles.of(body)
    if soles is None or planted is None or any(name not in truth.names for name in SOLE_LANDMARKS):
        return None
    heels, toes = (
        truth.points_world[: len(planted), [truth.names.index(f"{name[-1]}{tip}") for name in soles.names]]
        for tip in ("Heel", "BigToe")
    )
    along = np.array([BALL_SHARE if name.startswith("ball") else 0.0 for name in soles.names])
    points = heels + along[:, None] * (toes - heels)
    still = np.linalg.norm(np.diff(points, axis=0), axis=2) * truth.fps < STANDING
    stands, known = np.zeros(planted.shape, bool), np.ones(planted.shape, bool)
    for c, steps in enumerate(still.T):
        for first, last in runs(steps):
            frames = slice(first, last + 2)
            stands[frames, c] = (last + 1 - first) / truth.fps >= BRIEF
            known[frames, c] = stands[first, c] or (first > 0 and last < len(steps) - 1)
    return float(np.mean((stands == planted)[known]))


def plants_moved(body: Body, motion: Motion, planted: NDArray[np.bool_] | None) -> tuple[float, float] | None:
    """Return how far planted points of the soles move in a motion, millimetres: at most from one frame to the next, and
    from where they are planted.

    Parameters
    ----------
    body : Body
    motion : Motion
    planted : ndarray of bool, shape (F, C), optional
        See `plants_found`.

    Returns
    -------
    tuple of float, optional
        None where plants were not tested.
    """
    soles = Soles.of(body)
    if soles is None or planted is None:
        return None
    steps, ways = [0.0], [0.0]
    for path, column in zip(np.moveaxis(soles.world(part_poses(body, motion)), 1, 0), planted.T, strict=True):
        for first, last in runs(column):
            stood = path[first : last + 1]
            steps.append(np.linalg.norm(np.diff(stood, axis=0), axis=1).max(initial=0.0))
            ways.append(np.linalg.norm(stood - stood[0], axis=1).max())
    return 1000 * float(max(steps)), 1000 * float(max(ways))
