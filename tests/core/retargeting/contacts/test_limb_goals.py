"""Limbs are led to goals: their ends arrive where these can be reached, and held ones may lower the hips."""

from __future__ import annotations

import numpy as np
import pytest
from kfmocap.core.body import human
from kfmocap.core.retargeting.contacts.limb_goals import LimbGoal, reach_goals, two_bone_turns
from kfmocap.core.retargeting.control_rig import ControlRig, RigPoses
from kfmocap.core.retargeting.retarget import prepared, retarget
from made_rigs import made_rig, moved_body, wild_motion

BODY = human(1.75)
LEG = np.array([[[0.0, 0.0, 1.0]], [[0.0, 0.0, 0.5]], [[0.0, 0.0, 0.1]]])
"""A straight leg on one frame: hip, knee and ankle."""


def led(goal: list[float], leg: np.ndarray = LEG) -> tuple[np.ndarray, np.ndarray]:
    """Knee and ankle of a leg that is led to a goal."""
    hip, knee, ankle = leg
    upper, lower = two_bone_turns(hip, knee, ankle, np.array([goal]))
    bent = hip[0] + upper[0] @ (knee - hip)[0]
    return bent, bent + lower[0] @ (ankle - knee)[0]


def test_a_straight_limb_bends_forward() -> None:
    knee, ankle = led([0.0, 0.0, 0.4])
    np.testing.assert_allclose(ankle, [0.0, 0.0, 0.4], atol=1e-9)
    assert knee[1] < -0.2 and abs(knee[0]) < 1e-9, "forward is -Y"


def test_a_bent_limb_stays_in_its_plane() -> None:
    leg = LEG + [[[0.0, 0.0, 0.0]], [[0.2, 0.0, 0.0]], [[0.0, 0.0, 0.0]]]
    knee, ankle = led([0.0, 0.0, 0.4], leg)
    np.testing.assert_allclose(ankle, [0.0, 0.0, 0.4], atol=1e-9)
    assert knee[0] > 0.2 and abs(knee[1]) < 1e-9


def test_beyond_its_reach_a_limb_points_at_the_goal() -> None:
    _, ankle = led([0.0, -3.0, -3.0])
    np.testing.assert_allclose(ankle - LEG[0, 0], 0.9 * np.array([0.0, -0.6, -0.8]), atol=1e-6)


@pytest.fixture(scope="module")
def walked() -> tuple[ControlRig, RigPoses]:
    rig = made_rig("kfmocap", BODY, 0.0, 0)
    return rig, retarget(*prepared(moved_body(BODY, wild_motion())), rig).poses


def reached(walked: tuple[ControlRig, RigPoses], shift: float, *, held: bool) -> tuple[np.ndarray, np.ndarray]:
    """How far the hips and the left foot move if the foot is to be lower by `shift` on all frames, (F, 3) each."""
    rig, poses = walked
    thigh, shin, foot = (rig.index(f"{name}.L") for name in ("thigh", "shin", "foot"))
    goal = LimbGoal(thigh, shin, foot, np.tile([0.0, 0.0, -shift], (len(poses), 1)), np.full(len(poses), held))
    hips = rig.index("hips")
    moved = reach_goals(rig, poses, [goal], 30.0)
    return moved.places[:, hips] - poses.places[:, hips], moved.places[:, foot] - poses.places[:, foot]


def test_hips_are_lowered_for_a_foot_that_is_held_out_of_reach(walked: tuple[ControlRig, RigPoses]) -> None:
    hips, foot = reached(walked, 1.0, held=True)
    np.testing.assert_allclose(foot, np.tile([0.0, 0.0, -1.0], (len(foot), 1)), atol=1e-6)
    assert hips[:, 2].max() < 0
    assert hips[:, 2].min() > -1.0, "no more than needed"
    np.testing.assert_allclose(hips[:, :2], 0, atol=1e-9)


def test_hips_stay_for_a_foot_that_is_not_held(walked: tuple[ControlRig, RigPoses]) -> None:
    hips, _ = reached(walked, 1.0, held=False)
    np.testing.assert_allclose(hips, 0, atol=1e-9)
