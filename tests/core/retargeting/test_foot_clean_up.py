"""Cleaning up the feet of a motion: what stands is the ball, not the tip of the toes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from kfmocap.core.body import human, part_poses
from kfmocap.core.body.motion import Motion
from kfmocap.core.body.skeleton_motion import SkeletonMotion, motion_of_body
from kfmocap.core.body.soles import Soles
from kfmocap.core.numerics.arrays import Array
from kfmocap.core.retargeting.contacts.foot_paths import foot_paths
from kfmocap.core.retargeting.foot_clean_up import with_clean_feet
from kfmocap.core.retargeting.retarget import prepared
from kfmocap.core.shot.shot import KeyPoses
from scipy.spatial.transform import Rotation
from synthetic import at_rest

BODY, FPS, FRAMES = human(1.75), 30.0, 31
SOLES = Soles.of(BODY)


def tipping_about(place: Array) -> Motion:
    """Return a motion of the body that stands for a while, and then tips forward about a place."""
    at = at_rest(BODY, FRAMES)
    angle = np.radians(35) * np.clip((np.arange(FRAMES) - 8) / 16, 0, 1) ** 2
    turn = Rotation.from_rotvec(angle[:, None] * [1.0, 0.0, 0.0]).as_matrix()
    rotations = at.rotations.copy()
    rotations[:, 0] = turn @ rotations[:, 0]
    return Motion(place + np.einsum("fab,fb->fa", turn, at.translations - place), rotations)


def with_short_feet(motion: SkeletonMotion, share: float) -> SkeletonMotion:
    """Return a motion whose bones of the feet end at a share of their way."""
    rest, tails = motion.rest, motion.rest.tails.copy()
    feet = rest.indices(["foot.L", "foot.R"])
    tails[feet] = rest.heads[feet] + share * (tails[feet] - rest.heads[feet])
    return replace(motion, rest=replace(rest, tails=tails))


def test_the_ball_of_a_foot_stands_as_its_heel_rises() -> None:
    """Somebody tips forward about the balls of both feet: they stay in place within 8 mm, where tips of the toes that
    stood would shift them by 39.
    """
    points = SOLES.world(part_poses(BODY, at_rest(BODY, FRAMES)))
    tips = tipping_about(points[0, 1])
    planted = {name: np.arange(FRAMES) <= (8 if name.startswith("heel") else FRAMES) for name in SOLES.names}
    cleaned = with_clean_feet(BODY, tips, FPS, KeyPoses.whole([], tips[:0]), planted)
    balls = SOLES.world(part_poses(BODY, cleaned))[:, 1::2]
    assert np.linalg.norm(balls - points[:, 1::2], axis=2).max() < 0.008


@pytest.mark.parametrize("share", [0.6, 0.7])
def test_a_foot_whose_bone_ends_at_the_ball_stands_on_its_end(share: float) -> None:
    """Without bones for toes, a bone as short as from ankle to ball ends there: plants are about its end, which stands,
    where a place at 0.7 of the way from the heel to it would shift by more than 25 mm.
    """
    foot = BODY.parts[BODY.index("foot.L")]
    end = foot.head_world + share * (foot.tail_world - foot.head_world)
    source, bones = prepared(with_short_feet(motion_of_body(BODY, tipping_about(end * [1, 1, 0]), "b", FPS), share))
    for path in foot_paths(source, bones):
        ball = path.heel_and_ball[:, 1]
        assert np.linalg.norm(ball - ball[0], axis=1).max() < 0.002
        assert path.planted[:, 1].all()
