"""Shapes of the hand: fingers bend into the palm, on both sides, whatever the fingers' bones are called."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from kfmocap.core.body.skeleton_motion import RestSkeleton
from kfmocap.core.choices import HAND_SHAPES
from kfmocap.core.errors import BodyError
from kfmocap.core.retargeting.bone_roles.roles import FINGERS, BoneMap
from kfmocap.core.retargeting.hands.hand_shapes import finger_turns

ACROSS = {"thumb": -0.035, "index": -0.03, "middle": -0.01, "ring": 0.01, "pinky": 0.03}
"""Y of the fingers of hands that point to the sides, palms down."""


def hand(side: str) -> tuple[RestSkeleton, BoneMap]:
    sign = 1.0 if side == "L" else -1.0
    names, parents, heads, tails, bones = ["h"], [-1], [[0.0, 0.0, 0.0]], [[0.08 * sign, 0.0, 0.0]], {}
    for finger in FINGERS:
        way = np.array([0.02 * sign, -0.02, 0.0] if finger == "thumb" else [0.03 * sign, 0.0, 0.0])
        root = np.array([0.02 * sign if finger == "thumb" else 0.09 * sign, ACROSS[finger], 0.0])
        bones[f"{finger}.{side}"] = tuple(f"{finger}{k}" for k in range(3))
        for k in range(3):
            parents.append(0 if k == 0 else len(names) - 1)
            names.append(f"{finger}{k}")
            heads.append(root + k * way)
            tails.append(root + (k + 1) * way)
    rest = RestSkeleton(tuple(names), tuple(parents), np.array(heads), np.array(tails))
    return rest, BoneMap({f"hand.{side}": ("h",), **bones})


def tips(side: str, shape: str) -> dict[str, np.ndarray]:
    """Where the fingers end, by finger."""
    rest, bones = hand(side)
    turns, found = finger_turns(rest, bones, side, shape), {}
    for finger in FINGERS:
        D, place = np.eye(3), rest.heads[rest.indices([f"{finger}0"])[0]]
        for j in rest.indices(bones.bones[f"{finger}.{side}"]):
            D = D @ turns[rest.names[j]]
            place = place + D @ (rest.tails[j] - rest.heads[j])
        found[finger] = place
    return found


@pytest.mark.parametrize("side", ["L", "R"])
def test_a_fist_brings_the_fingertips_back_below_the_palm(side: str) -> None:
    flat, fist = tips(side, "flat"), tips(side, "fist")
    for finger in ("index", "middle", "ring", "pinky"):
        assert fist[finger][2] < -0.005
        assert abs(fist[finger][0]) < abs(flat[finger][0]) - 0.06
        assert fist[finger][1] == pytest.approx(flat[finger][1], abs=1e-9)
    assert fist["thumb"][2] < -0.005
    assert fist["thumb"][1] > flat["thumb"][1] + 0.005


def test_the_right_hand_mirrors_the_left() -> None:
    for shape in HAND_SHAPES:
        left, right = tips("L", shape), tips("R", shape)
        assert all(np.allclose(left[finger], right[finger] * [-1, 1, 1]) for finger in FINGERS)


def test_pointing_leaves_the_index_finger_stretched() -> None:
    flat, point = tips("L", "flat"), tips("L", "point")
    assert np.linalg.norm(point["index"] - flat["index"]) < 0.02
    assert np.linalg.norm(point["middle"] - flat["middle"]) > 0.08


@pytest.mark.parametrize("missing", [FINGERS, ("index",), ("middle",), ("pinky",)], ids="-".join)
def test_a_hand_without_a_finger_that_defines_the_palm_is_named(missing: tuple[str, ...]) -> None:
    rest, bones = hand("L")
    known = {role: names for role, names in bones.bones.items() if role.partition(".")[0] not in missing}
    with pytest.raises(BodyError, match=r"hand\.L"):
        finger_turns(rest, replace(bones, bones=known), "L", "fist")
