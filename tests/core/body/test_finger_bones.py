"""Fingers of the default body, whose hands have none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from kfmocap.core.body import Body, human
from kfmocap.core.body.finger_bones import finger_bones
from kfmocap.core.errors import BodyError
from kfmocap.core.numerics.rotations import exp

BODY = human(1.8)


def turned_hand(axis: tuple[float, float, float]) -> Body:
    """The body with its left hand turned about the wrist at rest."""
    k = BODY.index("hand.L")
    hand, R = BODY.parts[k], exp(np.array(axis))
    tail = hand.head_world + R @ (hand.tail_world - hand.head_world)
    parts = list(BODY.parts)
    parts[k] = replace(hand, tail_world=tail, R_world_rest=R @ hand.R_world_rest)
    return replace(BODY, parts=tuple(parts))


@pytest.mark.parametrize("body", [BODY, turned_hand((0, 0, 0.4))], ids=["to the side", "forward"])
def test_five_straight_chains_begin_on_each_hand_with_the_thumb_in_front(body: Body) -> None:
    bones = finger_bones(body)
    by_name = {bone.name: bone for bone in bones}
    assert len(bones) == 30
    for bone in bones:
        above = by_name.get(bone.parent)
        if above is None:
            assert bone.parent == f"hand.{bone.name[-1]}"
            continue
        np.testing.assert_allclose(bone.head_world, above.tail_world)
        along, before = bone.tail_world - bone.head_world, above.tail_world - above.head_world
        assert along @ before == pytest.approx(np.linalg.norm(along) * np.linalg.norm(before))
    for side in "LR":
        hand = body.parts[body.index(f"hand.{side}")]
        along = (hand.tail_world - hand.head_world) / np.linalg.norm(hand.tail_world - hand.head_world)
        tips = {bone.name[:-5]: bone.tail_world - hand.head_world for bone in bones if bone.name.endswith(f"03.{side}")}
        forward = {name: float(-tip[1]) for name, tip in tips.items()}
        assert max(forward, key=forward.__getitem__) == "thumb"
        reach = [float(tip @ along) / np.linalg.norm(hand.tail_world - hand.head_world) for tip in tips.values()]
        assert min(reach) > 0.3 and 0.9 < max(reach) < 1.1, "the longest finger ends with the hand"


def test_both_hands_mirror_each_other() -> None:
    places = {bone.name: bone.tail_world for bone in finger_bones(BODY)}
    for name, place in places.items():
        np.testing.assert_allclose(place * [-1, 1, 1], places[name[:-1] + {"L": "R", "R": "L"}[name[-1]]], atol=1e-12)


def test_hands_that_point_forward_are_refused() -> None:
    with pytest.raises(BodyError, match=r"hand\.L"):
        finger_bones(turned_hand((0, 0, -np.pi / 2)))
