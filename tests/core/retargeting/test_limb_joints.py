"""Joints of limbs by position, on chains of bones on both sides."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from kfmocap.core.body.skeleton_motion import RestSkeleton
from kfmocap.core.numerics.arrays import Array
from kfmocap.core.retargeting.bone_roles.limb_joints import arm_joints, leg_joints

SHORTEST = 0.1


def on_both_sides(joints: Sequence[Array], tips: Sequence[Array] = ()) -> RestSkeleton:
    """A chain through joints on the left, with bones that begin at tips at its end, and its mirror image; numbered from
    the body, the left ones first.
    """
    parents, heads = [-1], [np.array([0.0, 0.0, 1.0])]
    for side in (1.0, -1.0):
        above = 0
        for joint in joints:
            parents.append(above)
            above = len(heads)
            heads.append(joint * [side, 1.0, 1.0])
        parents += [above] * len(tips)
        heads += [tip * [side, 1.0, 1.0] for tip in tips]
    names = tuple(map(str, range(len(heads))))
    return RestSkeleton(names, tuple(parents), np.array(heads), np.full((len(heads), 3), np.nan))


def test_small_bones_at_the_ankle_below_a_bent_knee_are_no_shin() -> None:
    hip = np.array([0.1, 0.0, 0.9])
    knee, down = hip + [0.0, -0.24, -0.32], np.array([0.0, 0.5, -0.866])
    ankle = [knee + way * down for way in (0.38, 0.39, 0.4)]
    rest = on_both_sides([hip, knee, *ankle, ankle[-1] + [0.0, -0.15, -0.05]])
    found, lengths = leg_joints(rest, 1, 7, SHORTEST)
    assert (found["thigh"], found["shin"], found["foot"]) == (1, 2, 3)
    np.testing.assert_allclose(lengths, [0.4, 0.38], atol=1e-3)


def test_a_short_chain_with_three_ends_is_no_arm() -> None:
    joints = [np.array([0.1 + 0.02 * k, 0.0, 1.4]) for k in range(5)]
    rest = on_both_sides(joints, [np.array([0.22, y, 1.4]) for y in (-0.01, 0.0, 0.01)])
    found, lengths = arm_joints(rest, 1, 9, SHORTEST)
    assert not found
    assert not lengths.any()


@pytest.mark.parametrize("mitten", [False, True])
@pytest.mark.parametrize("droop", [0, 45])
def test_the_elbow_of_an_arm_of_halves_is_found_by_human_proportions_though_the_hand_has_no_fingers(
    mitten: bool, droop: float
) -> None:
    along = np.array([np.cos(np.radians(droop)), 0.0, -np.sin(np.radians(droop))])
    collar, shoulder = np.array([0.03, 0.0, 1.42]), np.array([0.18, 0.02, 1.42])
    ways = [0.0, 0.15, 0.3, 0.43, 0.56, *([0.66] if mitten else [])]
    joints = [collar, *(shoulder + way * along for way in ways)]
    found, lengths = arm_joints(on_both_sides(joints), 1, 1 + len(joints), SHORTEST)
    assert (found["shoulder"], found["upper_arm"], found["forearm"], found["hand"]) == (1, 2, 4, 6)
    np.testing.assert_allclose(lengths, [0.3, 0.26], atol=1e-6)
