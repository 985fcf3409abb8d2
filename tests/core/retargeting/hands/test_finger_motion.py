"""Fingers of a rig lie as the performer's do, whatever the rig's fingers measure."""

from __future__ import annotations

import numpy as np
import pytest
from kfmocap.core.body.skeleton_motion import RestSkeleton
from kfmocap.core.numerics import rotations
from kfmocap.core.retargeting.bone_roles.roles import FINGERS, BoneMap
from kfmocap.core.retargeting.hands.finger_motion import finger_motion
from kfmocap.core.retargeting.hands.hand_shapes import finger_turns
from test_hand_shapes import hand

FRAMES, FPS = 60, 60.0
PACE = np.sin(np.linspace(0, 2 * np.pi, FRAMES))


def turned(rest: RestSkeleton, turns: dict[str, np.ndarray]) -> np.ndarray:
    """Rotations of all bones from rest, (F, J, 3, 3)."""
    D = np.repeat(np.eye(3)[None, None], len(rest.names), axis=1).repeat(FRAMES, axis=0)
    for j, (name, parent) in enumerate(zip(rest.names, rest.parents, strict=True)):
        above = D[:, parent] if parent >= 0 else np.eye(3)
        D[:, j] = above @ turns.get(name, np.eye(3))
    return D


def points_of(rest: RestSkeleton, D: np.ndarray, side: str) -> np.ndarray:
    """The 21 points of a hand, (F, 21, 3)."""
    found = [np.repeat(rest.heads[:1], FRAMES, axis=0)]
    for finger in FINGERS:
        place = np.repeat(rest.heads[rest.indices([f"{finger}0"])], FRAMES, axis=0)
        found.append(place)
        for j in rest.indices([f"{finger}{k}" for k in range(3)]):
            place = place + D[:, j] @ (rest.tails[j] - rest.heads[j])
            found.append(place)
    return np.stack(found, axis=1)


def closing(side: str) -> tuple[RestSkeleton, BoneMap, np.ndarray, np.ndarray]:
    """A rig, its fingers' true rotations while the hand closes and opens, and its points, in a world that turns."""
    rest, bones = hand(side)
    amounts = 0.5 + 0.4 * PACE
    each = [finger_turns(rest, bones, side, "fist", amount) for amount in amounts]
    D = turned(rest, {name: np.stack([turns[name] for turns in each]) for name in each[0]})
    world = rotations.exp(np.outer(PACE, [0.4, -0.9, 0.3]))
    points = np.einsum("fab,fkb->fka", world, points_of(rest, D, side)) + np.array([1.0, 2.0, 1.5])
    return rest, bones, D, points


def both(side: str, points: np.ndarray) -> np.ndarray:
    other = np.full_like(points, np.nan)
    return np.stack([points, other] if side == "L" else [other, points], axis=1)


def angle_off(rest: RestSkeleton, D: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Degrees between the bones' true directions and those found, (F, J)."""
    ways = np.nan_to_num(rest.tails - rest.heads)
    a, b = (np.einsum("fjab,jb->fja", each, ways) for each in (D, truth))
    cosine = np.sum(a * b, axis=-1) / np.linalg.norm(ways, axis=-1) ** 2
    return np.degrees(np.arccos(np.clip(cosine, -1, 1)))


@pytest.mark.parametrize("side", ["L", "R"])
def test_fingers_lie_within_three_degrees_of_the_true_ones(side: str) -> None:
    """With 2 mm of noise in every point: a bone of 30 mm is then up to 5 degrees off on a single frame."""
    rest, bones, truth, points = closing(side)
    noisy = points + np.random.default_rng(1).normal(0, 0.002, points.shape)
    for seen, limit in ((points, 1.5), (noisy, 3.0)):
        off = angle_off(rest, turned(rest, finger_motion(rest, bones, both(side, seen), FPS)), truth)
        assert off.mean() < limit


def test_longer_and_bent_fingers_point_the_same_ways() -> None:
    rest, bones, truth, points = closing("L")
    tails = rest.tails.copy()
    longer = RestSkeleton(rest.names, rest.parents, rest.heads.copy(), tails)
    for j in range(1, len(rest.names)):
        way = 1.4 * (rest.tails[j] - rest.heads[j]) + [0.0, 0.0, -0.01]
        if rest.parents[j] > 0:
            longer.heads[j] = tails[rest.parents[j]]
        tails[j] = longer.heads[j] + way
    D = turned(longer, finger_motion(longer, bones, both("L", points), FPS))
    ways = [np.einsum("fjab,jb->fja", d, r.tails - r.heads) for d, r in ((D, longer), (truth, rest))]
    a, b = (way / np.linalg.norm(way, axis=-1, keepdims=True) for way in ways)
    assert np.degrees(np.arccos(np.clip(np.sum(a * b, axis=-1)[:, 1:], -1, 1))).mean() < 1.5


def test_frames_that_are_not_seen_lie_between_those_that_are() -> None:
    rest, bones, truth, points = closing("L")
    gone = points.copy()
    gone[15:22, 5:] = np.nan
    off = angle_off(rest, turned(rest, finger_motion(rest, bones, both("L", gone), FPS)), truth)
    assert np.isfinite(off).all() and off[15:22].max() < 15


def test_a_hand_that_is_seen_on_few_frames_stays_as_it_was_seen() -> None:
    rest, bones, _, points = closing("L")
    gone = np.full_like(points, np.nan)
    gone[20:22] = points[20:22]
    turns = finger_motion(rest, bones, both("L", gone), FPS)
    assert all(np.abs(R - R[20]).max() < 0.2 for R in turns.values())


def test_a_finger_that_is_never_seen_rests() -> None:
    rest, bones, _, points = closing("L")
    points[:, 17 + 2] = np.nan
    found = finger_motion(rest, bones, both("L", points), FPS)
    assert not any(name.startswith("pinky") for name in found)
    assert {name[:-1] for name in found} == set(FINGERS) - {"pinky"}
