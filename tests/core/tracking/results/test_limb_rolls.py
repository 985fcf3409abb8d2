"""Limbs of a tracked motion are rolled as elbows and knees bend, and no joint moves by it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from kfmocap.core.body import human, landmark_positions, part_poses
from kfmocap.core.body.body import UNLIMITED, Body
from kfmocap.core.body.motion import Motion
from kfmocap.core.numerics import rotations
from kfmocap.core.numerics.arrays import Array
from kfmocap.core.shot.shot import KeyPoses
from kfmocap.core.tracking.results.limb_rolls import hinges, with_likely_rolls
from synthetic import at_rest, random_motion

BODY = human()
F, FPS, KEYS = 25, 30.0, [0, 12, 24]
MIDDLE = np.setdiff1d(np.arange(F), KEYS)
UPPER, LOWER, END = (BODY.index(name) for name in ("upper_arm.L", "forearm.L", "hand.L"))
THIGH, SHIN, FOOT = (BODY.index(name) for name in ("thigh.R", "shin.R", "foot.R"))
WAVE = np.sin(np.pi * np.arange(F) / 12) ** 2
"""How an error grows and shrinks between key poses, which have none."""


def about(axis: int, angles: Array | float) -> Array:
    return rotations.exp(np.broadcast_to(angles, F)[:, None] * np.eye(3)[axis])


def true_motion(*, plane: float = 0.0, bend: Array | float = 1.2) -> Motion:
    """An arm and a leg that swing, with their elbow and knee bent in a plane turned from the body's."""
    Q = at_rest(BODY, F).rotations.copy()
    swing = 0.4 * np.sin(np.arange(F) / 5)
    Q[:, UPPER], Q[:, THIGH] = about(2, swing), about(0, swing)
    Q[:, LOWER] = about(1, plane) @ about(0, bend) @ about(1, -plane)
    Q[:, SHIN] = about(1, plane) @ about(0, -np.asarray(bend)) @ about(1, -plane)
    return Motion(at_rest(BODY, F).translations, Q)


def rolled(motion: Motion, part: int, child: int, angles: Array) -> Motion:
    """The motion with a part rolled about its length, and the part that hangs on it left as it is."""
    Q, rest = motion.rotations.copy(), BODY.R_parent_rest[child]
    axis = BODY.offsets[child] / np.linalg.norm(BODY.offsets[child])
    turns = angles[:, None] * axis
    Q[:, part] = Q[:, part] @ rotations.exp(turns)
    Q[:, child] = rest.T @ rotations.exp(-turns) @ rest @ Q[:, child]
    return Motion(motion.translations, Q)


def keys_of(motion: Motion, frames: list[int] = KEYS) -> KeyPoses:
    return KeyPoses.whole(frames, motion[frames])


def angle(motion: Motion, other: Motion, part: int, body: Body = BODY) -> Array:
    """Angle between the orientations of a part in two motions, radians, shape (F,)."""
    R, other_R = (part_poses(body, m)[0][:, part] for m in (motion, other))
    return np.asarray(np.linalg.norm(rotations.log(np.swapaxes(R, -1, -2) @ other_R), axis=-1))


def test_the_hinges_of_a_person_are_elbows_and_knees() -> None:
    assert {BODY.names[hinge.lower] for hinge in hinges(BODY)} == {"forearm.L", "forearm.R", "shin.L", "shin.R"}
    assert {hinge.way for hinge in hinges(BODY) if "shin" in BODY.names[hinge.lower]} == {-1.0}


@pytest.mark.parametrize(("part", "child"), [(UPPER, LOWER), (THIGH, SHIN)])
@pytest.mark.parametrize("plane", [0.0, 0.3])
def test_a_wrong_roll_is_led_back_where_the_joint_is_bent(part, child, plane) -> None:
    true = true_motion(plane=plane)
    wrong = rolled(true, part, child, 0.7 * WAVE)
    found = with_likely_rolls(BODY, wrong, keys_of(true), FPS)
    assert angle(found, true, part)[MIDDLE].mean() < 0.25 * angle(wrong, true, part)[MIDDLE].mean()


def test_half_a_turn_is_led_back_as_well() -> None:
    true = true_motion()
    wrong = rolled(true, UPPER, LOWER, 3.3 * WAVE)
    found = with_likely_rolls(BODY, wrong, keys_of(true), FPS)
    assert angle(found, true, UPPER)[MIDDLE].mean() < 0.3 * angle(wrong, true, UPPER)[MIDDLE].mean()


def test_without_key_poses_joints_bend_as_the_bodys_do() -> None:
    true = true_motion()
    wrong = rolled(true, THIGH, SHIN, np.full(F, -0.8))
    found = with_likely_rolls(BODY, wrong, keys_of(true, []), FPS)
    assert angle(found, true, THIGH).max() < 0.1


def test_a_limb_that_is_straight_for_a_moment_keeps_the_roll_of_the_frames_beside() -> None:
    bend = 1.2 * np.abs(np.cos(np.pi * np.arange(F) / 12))  # straight on frames 6 and 18
    true = true_motion(bend=bend)
    wrong = rolled(true, UPPER, LOWER, 0.6 * np.sqrt(WAVE))
    found = with_likely_rolls(BODY, wrong, keys_of(true), FPS)
    assert angle(found, true, UPPER)[[6, 18]].max() < 0.5 * angle(wrong, true, UPPER)[[6, 18]].min()


def test_a_twist_counts_as_far_as_its_joint_can_twist() -> None:
    true = true_motion()
    left = {}
    for part, child in ((LOWER, END), (SHIN, FOOT)):
        wrong = rolled(true, part, child, 0.6 * WAVE)
        found = with_likely_rolls(BODY, wrong, keys_of(true), FPS)
        left[part] = angle(found, true, part)[MIDDLE].mean() / angle(wrong, true, part)[MIDDLE].mean()
    assert left[SHIN] < 0.4
    assert 0.5 < left[LOWER] < 0.9


def test_no_joint_moves_and_hands_and_feet_stay_as_they_are() -> None:
    motion = random_motion(BODY, F, turn=0.6)
    found = with_likely_rolls(BODY, motion, keys_of(motion), FPS)
    assert angle(found, motion, UPPER).max() > 0.2
    names = list(BODY.landmarks)
    places = landmark_positions(BODY, found, names) - landmark_positions(BODY, motion, names)
    assert np.abs(places).max() < 1e-9
    changed = {hinge.upper for hinge in hinges(BODY)} | {hinge.lower for hinge in hinges(BODY)}
    assert max(angle(found, motion, part).max() for part in set(range(len(BODY))) - changed) < 1e-7


def test_key_poses_stay_exactly_as_they_are() -> None:
    motion = random_motion(BODY, F, turn=0.6)
    found = with_likely_rolls(BODY, motion, keys_of(motion), FPS)
    assert np.array_equal(found.rotations[KEYS], motion.rotations[KEYS])


def test_a_key_pose_of_a_hand_alone_holds_its_arm() -> None:
    motion = random_motion(BODY, F, turn=0.6)
    keys = keys_of(motion)
    fixed = keys.fixed.copy()
    fixed[1] = False
    fixed[1, 3 + 3 * END : 6 + 3 * END] = True
    found = with_likely_rolls(BODY, motion, replace(keys, fixed=fixed), FPS)
    assert np.array_equal(found.rotations[12, [UPPER, LOWER, END]], motion.rotations[12, [UPPER, LOWER, END]])
    assert not np.array_equal(found.rotations[12, THIGH], motion.rotations[12, THIGH])


def test_the_frames_between_two_key_poses_do_not_depend_on_others() -> None:
    motion = random_motion(BODY, F, turn=0.6)
    whole = with_likely_rolls(BODY, motion, keys_of(motion), FPS)
    part = with_likely_rolls(BODY, motion[:13], keys_of(motion, [0, 12]), FPS)
    assert np.abs(whole.rotations[:13] - part.rotations).max() < 1e-6


def test_a_body_without_limits_stays_as_it_is() -> None:
    free = Body(tuple(replace(part, limits=np.array(UNLIMITED)) for part in BODY.parts), BODY.landmarks)
    motion = random_motion(free, F, turn=0.6)
    assert np.array_equal(with_likely_rolls(free, motion, keys_of(motion), FPS).rotations, motion.rotations)


@pytest.mark.parametrize("length", [1, 2, 3])
def test_short_motions_are_no_exception(length) -> None:
    motion = random_motion(BODY, length, turn=0.6)
    for frames in ([], [0], [0, length - 1][: min(length, 2)]):
        found = with_likely_rolls(BODY, motion, keys_of(motion, sorted(set(frames))), FPS)
        assert np.isfinite(found.rotations).all()
