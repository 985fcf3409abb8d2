"""Landmarks at the tips of parts, and how far key poses are from them."""

from __future__ import annotations

import numpy as np
import pytest
from kfmocap.core.body import human, landmark_positions
from kfmocap.core.body.tip_landmarks import tip_landmarks, tip_misfits
from synthetic import at_rest

BODY = human(1.8)


@pytest.mark.parametrize(
    ("part", "landmark"),
    [("upper_arm.L", "LElbow"), ("forearm.R", "RWrist"), ("thigh.R", "RKnee"), ("shin.L", "LAnkle")],
)
def test_the_tip_of_a_limbs_part_is_the_next_joint(part: str, landmark: str) -> None:
    assert tip_landmarks(BODY)[BODY.index(part)] == landmark


def test_a_tip_is_off_by_the_root_mean_square_over_the_poses_that_show_its_landmark() -> None:
    names, poses = ["LElbow", "LWrist", "RKnee"], at_rest(BODY, 3)
    points = landmark_positions(BODY, poses, names)
    points[:, 0] += [[0.03, 0, 0], [0, 0.04, 0], [0, 0, 0]]
    points[2, 0] = np.nan
    misfits = dict(zip(BODY.names, tip_misfits(BODY, names, points, poses), strict=True))
    elbow = np.sqrt((0.03**2 + 0.04**2) / 2)
    assert misfits["upper_arm.L"] == pytest.approx(elbow)
    assert misfits["forearm.L"] == pytest.approx(0)
    assert misfits["head"] == pytest.approx(elbow / np.sqrt(3)), "without a landmark: the average of the others"
