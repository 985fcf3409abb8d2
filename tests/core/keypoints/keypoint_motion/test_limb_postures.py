"""How common postures of arms and legs are."""

from __future__ import annotations

import numpy as np
import pytest
from kfmocap.core.keypoints.keypoint_motion.limb_postures import SPREAD, UNCOMMON_SHARE, posture_rarity

HANGING, AHEAD, BEHIND, RAISED = np.array([[0.1, -1, 0], [0.1, -0.2, 1], [0.1, -0.2, -1], [0.1, 1, 0.3]], float)


def test_elbows_and_knees_bend_the_way_that_they_do() -> None:
    assert posture_rarity("upper_arm", HANGING, AHEAD) < posture_rarity("upper_arm", HANGING, BEHIND) - 2
    assert posture_rarity("thigh", AHEAD, HANGING) < posture_rarity("thigh", BEHIND, HANGING) - 2
    assert posture_rarity("thigh", HANGING, BEHIND) < posture_rarity("thigh", HANGING, AHEAD) - 2


def test_legs_mostly_stand_and_arms_mostly_hang() -> None:
    for limb in ("upper_arm", "thigh"):
        assert posture_rarity(limb, HANGING, HANGING) < posture_rarity(limb, RAISED, RAISED) - 2


def test_the_lengths_of_the_bones_do_not_matter() -> None:
    bones = np.random.default_rng(0).normal(size=(2, 20, 3))
    np.testing.assert_allclose(posture_rarity("thigh", *(3 * bones)), posture_rarity("thigh", *bones))


@pytest.mark.parametrize("limb", ["upper_arm", "thigh"])
def test_the_density_integrates_to_one(limb: str) -> None:
    bones = np.random.default_rng(0).normal(size=(2, 200_000, 3))
    peak = (2 * np.pi * SPREAD**2) ** 2  # of a density of 1, where both directions are spread by SPREAD
    density = np.exp(-0.5 * posture_rarity(limb, *bones)) / peak
    assert density.mean() * (4 * np.pi) ** 2 == pytest.approx(1.0, abs=0.03)


def test_no_posture_is_impossible() -> None:
    bones = np.random.default_rng(0).normal(size=(2, 1000, 3))
    assert posture_rarity("thigh", *bones).max() < -2 * np.log(UNCOMMON_SHARE * (0.5 * SPREAD**2) ** 2) + 1e-9
