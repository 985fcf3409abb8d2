"""The rendered walks: people on the floor and in every picture, whose feet stand where their steps say so."""

from __future__ import annotations

import numpy as np
import pytest
from kfmocap.core.body import human
from kfmocap.core.numerics.frame_ranges import runs
from render.people import true_landmarks
from render.walk_shots import WALK_PLANS, WALKS, WalkPlan
from render.walking_feet import Footfalls

BODY = human(1.75)
PLAIN = Footfalls(1.0, 1.3, 0.6, -15, 30, 0.7)
FAST = 8.0
"""Faster than any ankle, metres per second."""


def test_halves_have_as_many_walks() -> None:
    assert [plan.half for plan in WALKS] == ["deciding", "reporting"] * 6


@pytest.mark.parametrize("plan", WALKS, ids=lambda plan: plan.name)
def test_who_walks_is_in_every_picture_and_on_the_floor(plan: WalkPlan) -> None:
    body = plan.person.body()
    places = true_landmarks(body, plan.movement.motion(body, plan.seconds))
    for camera in plan.cameras:
        uv = camera.project(places.reshape(-1, 3))
        assert (uv >= 0).all() and (uv <= np.array(camera.size) - 1).all(), camera.name
    heels = places[:, [list(body.landmarks).index(f"{side}Heel") for side in "LR"], 2]
    assert 0 < heels.min() < 0.03


@pytest.mark.parametrize("side", ["L", "R"])
def test_a_foot_stands_from_flat_to_heel_off_and_never_jumps(side: str) -> None:
    t = np.arange(0, 3, 0.001)
    ankle, down, _ = PLAIN.foot(BODY, side, t)
    speed = np.linalg.norm(np.diff(ankle, axis=0), axis=1) / 0.001
    share = PLAIN.phase(side, t) % 1 / PLAIN.duty
    stands = (share > PLAIN.flat) & (share < PLAIN.heel_off)
    assert speed[stands[1:] & stands[:-1]].max() < 1e-9 and np.abs(down[stands]).max() < 1e-9
    assert speed.max() < FAST
    assert all(np.degrees(down[first]) < -14 for first, _ in runs(share < 1)[1:])


def test_nothing_moves_in_a_pause() -> None:
    pausing = WALK_PLANS["stop_and_go"].movement.steps
    begin, length = pausing.pause
    inside = pausing.own_time(np.linspace(begin + 0.1, begin + length - 0.1, 9))
    assert np.ptp(inside) < 1e-3
    assert pausing.own_time(begin + length + 1) - inside[-1] == pytest.approx(1, abs=0.1)


def test_backwards_the_ball_strikes_first() -> None:
    back = WALK_PLANS["backwards"].movement.steps
    t = np.linspace(0, 2, 200)
    way, heading = back.way(t)
    assert ((way[1:] - way[:-1]) @ [np.cos(heading[0]), np.sin(heading[0])] < 0).all()
    [down] = [back.foot(BODY, "R", np.array([1e-6]))[1]]
    assert np.degrees(down[0]) == pytest.approx(back.strike, abs=0.1)
