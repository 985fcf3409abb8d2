"""Feet that roll over a place in front of the ball: it is found, and held instead of the ball."""

from __future__ import annotations

import numpy as np
import pytest
from kfmocap.core.body import part_poses
from kfmocap.core.body.motion import Motion
from kfmocap.core.body.soles import BALL_SHARE, Soles
from kfmocap.core.tracking.solvers.plants import standing_feet
from kfmocap.core.tracking.solvers.plants.forefoot_rocker import with_forefoot_rockers
from kfmocap.core.tracking.solvers.protocol import SettledMotions
from scipy.spatial.transform import Rotation
from standing_bodies import BODY, FPS, FRAMES, SOLES, rested, soles_of, tracked
from synthetic import at_rest as standing

LEFT = 24
"""Last frame on which the feet touch the floor."""


def rolling(share: float) -> Motion:
    """Somebody who stands, tips forward about a place of the soles, ever faster, and is lifted."""
    at = standing(BODY, FRAMES)
    place = SOLES.with_balls_at(share).world(part_poses(BODY, at))[0, 1]
    angle = np.radians(35) * np.clip((np.arange(FRAMES) - 8) / (LEFT - 8), 0, None) ** 2
    turn = Rotation.from_rotvec(angle[:, None] * [1.0, 0.0, 0.0]).as_matrix()
    lifted = np.clip(np.arange(FRAMES) - LEFT, 0, None)[:, None] * [0.0, -0.03, 0.02]
    rotations = at.rotations.copy()
    rotations[:, 0] = turn @ rotations[:, 0]
    return Motion(place + np.einsum("fab,fb->fa", turn, at.translations - place) + lifted, rotations)


def error(motion: Motion, truth: Motion) -> float:
    """Mean distance of the soles from where they were while the feet touched the floor, metres."""
    return float(np.linalg.norm(soles_of(motion) - soles_of(truth), axis=2)[: LEFT + 1].mean())


def reported(found: SettledMotions) -> np.ndarray:
    return SOLES.standing(found.planted[0], part_poses(BODY, found.motions[0]), FPS)


@pytest.mark.parametrize("share", [BALL_SHARE, 0.85])
def test_the_place_over_which_feet_roll_is_found(share: float, monkeypatch: pytest.MonkeyPatch) -> None:
    shares = []

    def noted(*asked) -> Soles:
        soles = with_forefoot_rockers(*asked)
        ways = [np.linalg.norm(np.diff(one.local[:2], axis=0)) for one in (soles, SOLES)]
        shares.append(BALL_SHARE * ways[0] / ways[1])
        return soles

    monkeypatch.setattr(standing_feet, "with_forefoot_rockers", noted)
    for seed in range(6):
        rested(tracked(rolling(share), seed))
    assert np.abs(np.array(shares) - share).max() < 0.06


def test_feet_that_roll_over_a_place_in_front_of_the_ball_are_held_there(monkeypatch: pytest.MonkeyPatch) -> None:
    """Soles are nearer to the truth than with the ball held, and the ball counts as standing until it creeps."""
    truth = rolling(0.85)
    tracks = [tracked(truth, seed) for seed in range(6)]
    rolls = [rested(motion) for motion in tracks]
    with monkeypatch.context() as patch:
        patch.setattr(standing_feet, "with_forefoot_rockers", lambda _evidence, _i, apparent, _: apparent.plants.soles)
        balls = [rested(motion) for motion in tracks]
    mean = [np.mean([error(found.motions[0], truth) for found in each]) for each in (rolls, balls)]
    assert mean[0] < 0.5 * mean[1] and mean[0] < 0.8 * np.mean([error(motion, truth) for motion in tracks])
    true_end = np.flatnonzero(np.linalg.norm(np.diff(soles_of(truth)[:, 1], axis=0), axis=1) * FPS < 0.05)[-1] + 1
    ends = np.array([[np.flatnonzero(reported(found)[:, 1])[-1] for found in each] for each in (rolls, balls)])
    assert np.abs(ends[0] - true_end).mean() < 0.5 * np.abs(ends[1] - true_end).mean()


def test_a_body_that_creeps_as_it_tips_forward_is_not_held() -> None:
    truth = rolling(0.85)
    creep = 0.1 / FPS * np.arange(FRAMES)[:, None] * [0.0, -1.0, 0.0]
    for seed in range(3):
        assert not rested(tracked(Motion(truth.translations + creep, truth.rotations), seed)).planted[0].any()
