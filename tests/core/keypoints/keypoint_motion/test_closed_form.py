"""Poses in closed form, from the points of a body."""

from __future__ import annotations

import numpy as np
from keypoint_shots import NAMES, joint_errors, seen_places, strolling
from kfmocap.core.body import human
from kfmocap.core.keypoints.keypoint_motion.closed_form import closed_form_pose
from kfmocap.core.numerics import rotations
from synthetic import figure


def test_the_closed_form_pose_of_a_body_matches_its_own_joints() -> None:
    """All joints within centimetres, without an iteration; missing points are bridged."""
    body = human()
    motion = strolling(body, 20)
    points = seen_places(body, motion)
    points[7:10, NAMES.index("LKnee")] = np.nan
    laid = closed_form_pose(body, NAMES, points)
    assert laid is not None
    assert joint_errors(body, laid, body, motion).max() < 0.04


def test_a_knee_that_seems_to_bend_forward_does_not_turn_the_thigh_round() -> None:
    body = human()
    motion = strolling(body, 3)
    points = seen_places(body, motion)
    hip, knee, ankle = (points[:, NAMES.index("L" + n)] for n in ("Hip", "Knee", "Ankle"))
    points[:, NAMES.index("LKnee")] = hip + ankle - knee  # on the other side of the line between hip and ankle
    laid = closed_form_pose(body, NAMES, points)
    assert laid is not None
    thigh = body.index("thigh.L")
    turn = rotations.log(np.swapaxes(motion.rotations[:, thigh], -1, -2) @ laid.rotations[:, thigh])
    assert np.linalg.norm(turn, axis=-1).max() < np.pi / 2


def test_other_bodies_have_no_closed_form_pose() -> None:
    points = seen_places(human(), strolling(human(), 2))
    assert closed_form_pose(figure(), NAMES, points) is None
    points[:, [NAMES.index("RShoulder"), NAMES.index("LHip")]] = np.nan
    assert closed_form_pose(human(), NAMES, points) is None
