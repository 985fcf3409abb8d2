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
from kfmocap.core.shot.acceleration_prior import USUAL_JOINT
from kfmocap.core.shot.holds import Hold
from kfmocap.core.shot.shot import KeyPoses, Performer, Shot
from kfmocap.core.tracking.results.limb_rolls import hinges, with_likely_rolls
from kfmocap.core.tracking.results.shot_result import handed_out
from kfmocap.core.tracking.track_state import TrackState
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


def acceleration(motion: Motion, part: int) -> Array:
    """Angular acceleration of a part on all frames but the first and the last, rad/s^2, shape (F - 2,)."""
    R = part_poses(BODY, motion)[0][:, part]
    turns = rotations.log(R[1:] @ np.swapaxes(R[:-1], -1, -2))
    return np.asarray(np.linalg.norm(np.diff(turns, axis=0), axis=-1)) * FPS**2


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


def test_key_poses_with_overstretched_joints_do_not_turn_limbs_around() -> None:
    true = true_motion(bend=1.2 * WAVE - 0.3 * (1 - WAVE))
    found = with_likely_rolls(BODY, true, keys_of(true), FPS)
    assert max(angle(found, true, part).max() for part in (UPPER, THIGH)) < 0.5


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
        found = with_likely_rolls(BODY, wrong, keys_of(true), FPS / 2)  # slow enough not to be smoothed away
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


@pytest.mark.parametrize("part", [UPPER, THIGH, SHIN])
def test_rolls_do_not_change_suddenly_at_a_key_pose(part) -> None:
    motion = true_motion(plane=0.5, bend=0.6 + 0.6 * np.cos(np.pi * np.arange(F) / 12))  # straight on the key frame
    found = with_likely_rolls(BODY, motion, keys_of(motion, [12]), FPS)
    assert angle(found, motion, part).max() > 0.4
    assert acceleration(found, part).max() < acceleration(motion, part).max() + USUAL_JOINT


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


def with_part(name: str, **changes) -> Body:
    """The body with another part of that name."""
    return Body(tuple(replace(part, **changes) if part.name == name else part for part in BODY.parts), BODY.landmarks)


def with_bone(parent: int, place: Array) -> Body:
    """The body with one more bone that hangs on a part, at a place in its frame, before the others that do."""
    one = BODY.parts[parent]
    head = one.head_world + one.R_world_rest @ place
    more = replace(one, name="more", parent=parent, head_world=head, tail_world=head + [0.0, 0.0, 0.1])
    before, after = BODY.parts[: parent + 1], BODY.parts[parent + 1 :]
    after = tuple(replace(part, parent=part.parent + (part.parent > parent)) for part in after)
    return Body((*before, replace(more, limits=np.array(UNLIMITED)), *after), {})


def lower_parts(body: Body) -> set[str]:
    return {body.names[hinge.lower] for hinge in hinges(body)}


def test_a_neck_or_a_tail_that_bends_both_ways_is_no_hinge() -> None:
    both_ways = np.radians([[-60, 70], [-20, 20], [-8, 8]])
    assert lower_parts(with_part("head", limits=both_ways)) == lower_parts(BODY)
    even = np.radians([[-80, 80], [-20, 20], [-8, 8]])
    assert "forearm.L" not in lower_parts(with_part("forearm.L", limits=even))


@pytest.mark.parametrize("name", ["upper_arm.L", "hand.L"])
def test_a_joint_whose_twist_is_locked_is_not_twisted(name) -> None:
    limits = BODY.parts[BODY.index(name)].limits.copy()
    limits[1] = 0.0
    assert lower_parts(BODY) - lower_parts(with_part(name, limits=limits)) == {"forearm.L"}


def test_bones_that_do_not_point_along_their_limb_are_not_rolled() -> None:
    shin = BODY.parts[SHIN]
    bent = shin.R_world_rest @ rotations.exp(np.array([-1.2, 0.0, 0.0]))
    assert "shin.R" not in lower_parts(with_part("shin.R", R_world_rest=bent))


@pytest.mark.parametrize("parent", [UPPER, LOWER])
def test_a_bone_beside_the_line_of_a_limb_keeps_it_from_being_rolled(parent) -> None:
    assert lower_parts(BODY) - lower_parts(with_bone(parent, np.array([0.05, 0.1, 0.0]))) == {"forearm.L"}


@pytest.mark.parametrize("parent", [UPPER, LOWER])
@pytest.mark.parametrize("along", [0.0, 0.1])
def test_a_bone_that_twists_on_the_line_of_a_limb_does_not_move(parent, along) -> None:
    body = with_bone(parent, np.array([0.0, along, 0.0]))
    motion = random_motion(body, F, turn=0.6)
    found = with_likely_rolls(body, motion, keys_of(motion), FPS)
    assert angle(found, motion, UPPER, body).max() > 0.2
    assert np.abs(part_poses(body, found)[1] - part_poses(body, motion)[1]).max() < 1e-9


def test_a_key_of_one_axis_alone_holds_its_frame() -> None:
    motion = random_motion(BODY, F, turn=0.6)
    keys = keys_of(motion)
    fixed = keys.fixed.copy()
    fixed[1] = False
    fixed[1, 3 + 3 * UPPER] = True
    found = with_likely_rolls(BODY, motion, replace(keys, fixed=fixed), FPS)
    assert np.array_equal(found.rotations[12, UPPER], motion.rotations[12, UPPER])


def test_parts_that_hold_a_prop_are_not_rolled() -> None:
    motion = random_motion(BODY, F, turn=0.6)
    tied = np.zeros((F, len(BODY)), bool)
    tied[5:9, LOWER] = True
    found = with_likely_rolls(BODY, motion, keys_of(motion), FPS, tied=tied)
    assert np.array_equal(found.rotations[5:9, LOWER], motion.rotations[5:9, LOWER])
    assert not np.array_equal(found.rotations[5:9, SHIN], motion.rotations[5:9, SHIN])
    hand = np.zeros((F, len(BODY)), bool)
    hand[:, END] = True  # which stays as it is
    whole = with_likely_rolls(BODY, motion, keys_of(motion), FPS)
    assert np.array_equal(with_likely_rolls(BODY, motion, keys_of(motion), FPS, tied=hand).rotations, whole.rotations)


def test_frames_that_join_a_motion_that_stays_are_as_they_were_joined() -> None:
    true = true_motion(plane=0.3)
    wrong = rolled(true, UPPER, LOWER, 0.7 * np.sin(np.pi * np.arange(F) / 24) ** 2)
    found = with_likely_rolls(BODY, wrong, keys_of(true, []), FPS, ends=[0, F - 1])
    assert np.array_equal(found.rotations[[0, -1]], wrong.rotations[[0, -1]])
    assert angle(found, true, UPPER).mean() < 0.25 * angle(wrong, true, UPPER).mean()  # in the plane of these ends


def changed_frames(
    part: int, hold: str = "hand.L", *, first: int = 5, rests: tuple[str, ...] = (), around: bool = False
) -> list[int]:
    """Frames on which a part is rolled in what is handed out of a shot without key poses, with a shield that is held
    from a first frame, by default 5, to frame 8.
    """
    motion = random_motion(BODY, F, turn=0.6)
    known = ((motion[[0]],), (motion[[0]],)) if around else (None, None)
    person = Performer("person", BODY, keys_of(motion, []), unknown=rests)
    shot = Shot("shot", FPS, (0, F - 1), (), (person,), holds=(Hold("shield", "person", hold, (first, 8)),))
    found = handed_out(shot, TrackState((motion,), known), 0)
    return np.flatnonzero(angle(found, motion, part) > 1e-6).tolist()


def test_a_shield_on_a_forearm_stays_on_it() -> None:
    assert changed_frames(LOWER) == list(range(F))
    assert changed_frames(LOWER, "forearm.L") == [f for f in range(F) if not 5 <= f <= 8]
    assert changed_frames(LOWER, "forearm.L", first=-3) == list(range(9, F))


def test_where_poses_beside_the_shot_are_known_its_ends_stay_as_they_join_them() -> None:
    assert changed_frames(UPPER, around=True) == list(range(1, F - 1))


def test_a_part_on_which_another_rests_is_not_rolled_away_from_it() -> None:
    assert changed_frames(LOWER, rests=("hand.L",)) == []
    assert changed_frames(SHIN, rests=("hand.L",)) == list(range(F))
