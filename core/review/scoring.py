"""Scoring: distances of tracked joints from reference landmarks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..body import Body, landmark_positions
from ..body.limbs import MAIN_JOINTS
from ..body.motion import Motion
from ..errors import LandmarkError
from ..formats.trc import Landmarks


@dataclass(frozen=True)
class Score:
    """Joint errors on the frames that are not key frames, millimetres.

    Attributes
    ----------
    frames : int
        Number of frames compared.
    mean, median : float
        Of all joints on these frames.
    per_landmark : dict of str to float
        Mean error of each landmark.
    """

    frames: int
    mean: float
    median: float
    per_landmark: dict[str, float]


def motion_error(body: Body, motion: Motion, reference: Landmarks, keys: Sequence[int]) -> Score:
    """Compare the joints of a motion with a reference, as `joint_error` does."""
    names = list(body.landmarks)
    found = Landmarks(tuple(names), landmark_positions(body, motion, names), reference.fps)
    return joint_error(found, reference, keys)


def joint_error(result: Landmarks, reference: Landmarks, keys: Sequence[int]) -> Score:
    """Compare the joints that both name, row by row, leaving out the key frames.

    Parameters
    ----------
    result, reference : Landmarks
        Positions in metres, row by row for the same frames; `result` has at least as many rows.
    keys : sequence of int
        Rows to leave out: the tracker was given these poses.

    Raises
    ------
    LandmarkError
        Nothing is left to compare.
    """
    names = [n for n in reference.names if n in result.names and n != "Hip" and n.endswith(MAIN_JOINTS)]
    rows = np.setdiff1d(np.arange(min(len(result), len(reference))), keys)
    if not names or not len(rows):
        raise LandmarkError("the two motions share no joint outside the key frames")
    found, truth = (
        motion.points_world[rows][:, [motion.names.index(n) for n in names]] for motion in (result, reference)
    )
    error = 1000 * np.linalg.norm(found - truth, axis=2)
    return Score(
        len(rows),
        float(np.nanmean(error)),
        float(np.nanmedian(error)),
        dict(zip(names, np.nanmean(error, axis=0).tolist(), strict=True)),
    )
