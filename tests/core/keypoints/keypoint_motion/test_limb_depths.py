"""The depths of limbs that one view shows: means over what is possible, and legs that are judged together."""

from __future__ import annotations

import numpy as np
import pytest
from kfmocap.core.body import human
from kfmocap.core.keypoints.keypoint_motion.closed_form import LIMB_CHAINS
from kfmocap.core.keypoints.keypoint_motion.limb_depths import Limb, LimbPlaces, expected_joints, limb_places
from kfmocap.core.keypoints.keypoint_motion.person_depth import ANKLE_HEIGHT, Rays

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


def seen_from_the_front(**joints: tuple[float, float, float]) -> Rays:
    """The rays of a camera 5 m in front of joints, 1.3 m above the floor."""
    eye = np.tile([0.0, -5.0, 1.3], (FRAMES, 1))
    return Rays(eye, {name: (np.array(place) - eye) / (place[1] + 5.0) for name, place in joints.items()})


def placed(chain: object, rays: Rays, start: tuple[float, float, float], standing: bool) -> LimbPlaces:
    """The places of a left limb of somebody who faces the camera, upright."""
    upright = np.tile(np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]]), (FRAMES, 1, 1))
    return limb_places(rays, Limb(BODY, chain, "L"), upright, np.tile(start, (FRAMES, 1)), standing=standing)


def test_a_leg_may_stand_where_the_ray_to_its_ankle_meets_the_floor() -> None:
    hip, knee, ankle = (0.1, 0.0, 0.85), (0.1, -0.2, 0.48), (0.1, -0.1, ANKLE_HEIGHT)
    stands = placed(LEG, seen_from_the_front(LKnee=knee, LAnkle=ankle), hip, True)
    assert stands.ends.shape == (6, FRAMES, 3)
    np.testing.assert_allclose(stands.ends[4:], np.broadcast_to(ankle, (2, FRAMES, 3)), atol=1e-9)
    assert stands.cost[4].max() < stands.cost[:4].min() + 1.0
    raised = placed(LEG, seen_from_the_front(LKnee=knee, LAnkle=(0.1, -0.1, 0.4)), hip, True)
    assert raised.cost[4:].min() > 20.0  # the floor is metres behind it
    assert len(placed(LEG, seen_from_the_front(LKnee=knee, LAnkle=ankle), hip, False).cost) == 4


def test_a_leg_whose_ray_does_not_meet_the_floor_does_not_stand() -> None:
    up = seen_from_the_front(LKnee=(0.1, -0.2, 1.2), LAnkle=(0.1, -0.4, 1.5))
    found = placed(LEG, up, (0.1, 0.0, 0.9), True)
    assert np.isfinite(found.ends).all() and found.cost[4:].min() > 1e4
