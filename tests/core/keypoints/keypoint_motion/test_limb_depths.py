"""The depths of limbs that one view shows: means over what is possible, and legs that are judged together."""

from __future__ import annotations

import numpy as np
import pytest
from kfmocap.core.body import human
from kfmocap.core.keypoints.keypoint_motion.closed_form import LIMB_CHAINS
from kfmocap.core.keypoints.keypoint_motion.limb_depths import Limb, LimbPlaces, expected_joints

FRAMES, FPS = 12, 30.0
BODY = human(1.8)
ARM, LEG = (next(chain for chain in LIMB_CHAINS if chain.upper == upper) for upper in ("upper_arm", "thigh"))
HIPS = np.tile([0.0, 0.0, 0.9], (FRAMES, 1))


def places(chain: object, side: str, cost: list[float], depth: float = 0.3) -> LimbPlaces:
    """A limb whose both bones go `depth` towards a camera that looks along y, or away from it."""
    y = np.array([[-depth, -2 * depth], [-depth, 0], [depth, 0], [depth, 2 * depth]])
    joints = np.zeros((2, 4, FRAMES, 3))
    joints[..., 1], joints[..., 2] = y.T[:, :, None], np.array([0.5, 0.1])[:, None, None]
    return LimbPlaces(Limb(BODY, chain, side), HIPS, *joints, np.tile(np.array(cost)[:, None], (1, FRAMES)))


def test_a_joint_is_between_places_that_are_as_likely_and_at_the_one_that_is_much_likelier() -> None:
    same, _ = expected_joints([places(ARM, "L", [1, 1, 1, 1])], HIPS, FPS)
    np.testing.assert_allclose(same["LElbow"], np.tile([0, 0, 0.5], (FRAMES, 1)), atol=1e-9)
    np.testing.assert_allclose(same["LWrist"], np.tile([0, 0, 0.1], (FRAMES, 1)), atol=1e-9)
    told, _ = expected_joints([places(ARM, "L", [25, 25, 25, 1])], HIPS, FPS)
    np.testing.assert_allclose(told["LWrist"][:, 1], 0.6, atol=0.01)


def test_legs_that_would_both_reach_towards_the_camera_stay_below_the_hips() -> None:
    cost = [0.0, 2.0, 2.0, 2.0]
    alone, _ = expected_joints([places(LEG, "L", cost)], HIPS, FPS)
    both, _ = expected_joints([places(LEG, side, cost) for side in "LR"], HIPS, FPS)
    assert alone["LAnkle"][:, 1].mean() < -0.4
    assert abs(0.5 * (both["LAnkle"] + both["RAnkle"])[:, 1].mean()) < 0.5 * abs(alone["LAnkle"][:, 1].mean())


def test_a_likelier_lot_costs_less() -> None:
    costs = [expected_joints([places(ARM, "R", [c, c, c, c])], HIPS, FPS)[1] for c in (0.0, 2.0)]
    assert costs[1] - costs[0] == pytest.approx(2.0 * FRAMES)
