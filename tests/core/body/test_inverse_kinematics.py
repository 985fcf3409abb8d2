"""Inverse kinematics: poses and measures come back from the landmarks that they make."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from kfmocap.core.body import Body, human, landmark_positions
from kfmocap.core.body.inverse_kinematics import fit_poses
from kfmocap.core.body.measures.measures_from_landmarks import estimate_height, fit_body, starting_height
from kfmocap.core.body.motion import Motion
from kfmocap.core.errors import LandmarkError
from kfmocap.core.numerics import rotations
from synthetic import at_rest, rigidly_moved

BODY = human(1.78)
HUMAN = human(1.75)
NAMES = list(BODY.landmarks)
# What Pose2Sim's trackers give: no hands.
TRACKED = [name for name in NAMES if name not in ("LHand", "RHand")]


def exercise(body: Body, frames: int, seed: int = 0, share: float = 0.25) -> Motion:
    """Poses within the joint limits of a person who walks about and turns."""
    rng = np.random.default_rng(seed)
    low, high = body.limits[:, :, 0], body.limits[:, :, 1]
    vectors = rng.uniform(share * low, share * high, (frames, len(body), 3))
    vectors[:, 0] = 0.2 * rng.normal(size=(frames, 3))
    vectors[:, 0, 1] = rng.uniform(-np.pi, np.pi, frames)  # the pelvis' y axis points up
    motion = at_rest(body, frames)
    return Motion(motion.translations + rng.normal(0, 0.5, (frames, 3)), rotations.exp(vectors))


def error_mm(body: Body, motion: Motion, names: list[str], targets: np.ndarray) -> np.ndarray:
    return 1000 * np.linalg.norm(landmark_positions(body, motion, names) - targets, axis=-1)


def test_poses_come_back_from_their_landmarks() -> None:
    truth = exercise(BODY, 12)
    targets = landmark_positions(BODY, truth, NAMES)
    assert error_mm(BODY, fit_poses(BODY, NAMES, targets), NAMES, targets).max() < 1


def test_poses_near_the_joint_limits_come_back_from_their_landmarks() -> None:
    """From the rest pose alone three of these forty end with a landmark 90 to 140 mm off."""
    rng = np.random.default_rng(3)
    vectors = rng.uniform(*np.moveaxis(0.8 * HUMAN.limits, 2, 0), size=(40, len(HUMAN), 3))
    targets = landmark_positions(HUMAN, Motion(np.zeros((40, 3)), rotations.exp(vectors)), NAMES)
    assert error_mm(HUMAN, fit_poses(HUMAN, NAMES, targets), NAMES, targets).max() < 30


def test_arms_that_are_nearly_straight_come_back_with_their_elbows_the_right_way_round() -> None:
    """From the rest pose alone each of these ends twisted, its elbow as far back as it goes, 17 to 30 mm off."""
    degrees = {
        "upper_arm.L": [(-34, 14, -43), (-100, 67, 69), (-20, 47, 51), (103, 94, -116), (9, -11, 103)],
        "forearm.L": [(42, 0, 0), (20, 0, 0), (25, 0, 0), (28, 0, 0), (44, 0, 0)],
        "upper_arm.R": [(62, -77, -61), (-44, -25, -1), (-84, -83, 57), (-83, -55, -11), (-72, 86, -72)],
        "forearm.R": [(28, 0, 0), (50, 0, 0), (21, 0, 0), (40, 0, 0), (27, 0, 0)],
    }
    vectors = np.zeros((5, len(HUMAN), 3))
    for part, turns in degrees.items():
        vectors[:, HUMAN.index(part)] = np.radians(turns)
    targets = landmark_positions(HUMAN, Motion(np.zeros((5, 3)), rotations.exp(vectors)), TRACKED)
    assert error_mm(HUMAN, fit_poses(HUMAN, TRACKED, targets), TRACKED, targets).max() < 2


def test_poses_stay_within_the_joint_limits_even_where_landmarks_ask_for_more() -> None:
    targets = landmark_positions(BODY, exercise(BODY, 6, share=1.0), NAMES)
    targets += np.random.default_rng(0).normal(0, 0.1, targets.shape)
    vectors = rotations.log(fit_poses(BODY, NAMES, targets).rotations)[:, 1:]
    limits = BODY.limits[1:]
    assert (vectors >= limits[..., 0] - 1e-6).all() and (vectors <= limits[..., 1] + 1e-6).all()


def test_a_turn_that_landmarks_leave_open_is_shared_by_the_usual_departures() -> None:
    """Shoulders turned against the hips: spine and chest bend alike, and no more than that of it."""
    body = human()
    truth = at_rest(body)
    truth.rotations[:, body.index("chest")] = rotations.exp(np.array([0.0, 0.4, 0.0]))
    names = [name for name in body.landmarks if name not in ("Head", "Nose", "Neck", "Hip")]
    found = fit_poses(body, names, landmark_positions(body, truth, names))
    turns = np.linalg.norm(rotations.log(found.rotations[0]), axis=-1)
    spine, chest = turns[[body.index("spine"), body.index("chest")]]
    assert spine == pytest.approx(chest, rel=0.1) and spine + chest > 0.3


def test_a_larger_usual_departure_takes_more_of_a_turn() -> None:
    body = human()
    parts = tuple(replace(part, departure=2.0) if part.name == "spine" else part for part in body.parts)
    loose = replace(body, parts=parts)
    truth = at_rest(body)
    truth.rotations[:, body.index("chest")] = rotations.exp(np.array([0.0, 0.4, 0.0]))
    names = [name for name in body.landmarks if name not in ("Head", "Nose", "Neck", "Hip")]
    aims = landmark_positions(body, truth, names)
    turns = [np.linalg.norm(rotations.log(fit_poses(b, names, aims).rotations[0]), axis=-1) for b in (body, loose)]
    assert turns[1][body.index("spine")] > 1.5 * turns[0][body.index("spine")]


def test_a_knee_does_not_bend_forward() -> None:
    pose = at_rest(BODY)
    pose.rotations[0, BODY.index("shin.L")] = rotations.exp(np.array([0.5, 0, 0]))
    wrong = landmark_positions(BODY, pose, TRACKED)
    found = fit_poses(BODY, TRACKED, wrong)
    bend = rotations.log(found.rotations[0, BODY.index("shin.L")])[0]
    assert bend <= np.deg2rad(5) + 1e-6
    assert error_mm(BODY, found, TRACKED, wrong).max() > 5


def test_missing_landmarks_do_no_harm() -> None:
    truth = exercise(BODY, 4, seed=2)
    targets = landmark_positions(BODY, truth, NAMES)
    shown = targets.copy()
    for k, names in enumerate((["LElbow"], ["RKnee", "Nose"], ["LWrist", "LHand"], ["Head"])):
        shown[k, [NAMES.index(n) for n in names]] = np.nan
    shown[0, NAMES.index("RHeel"), 2] = np.nan  # one coordinate missing is a landmark missing
    error = error_mm(BODY, fit_poses(BODY, NAMES, shown), NAMES, shown)
    assert np.nanmax(error) < 1.5


def test_landmarks_that_the_body_does_not_have_are_left_out() -> None:
    truth = exercise(BODY, 1)
    targets = landmark_positions(BODY, truth, NAMES)
    named = ["LEar", *NAMES]
    with_ear = np.concatenate([np.full((1, 1, 3), 9.0), targets], axis=1)
    a, b = fit_poses(BODY, named, with_ear), fit_poses(BODY, NAMES, targets)
    np.testing.assert_allclose(a.rotations, b.rotations, atol=1e-9)


@pytest.mark.filterwarnings("error")
def test_arms_alone_which_are_on_a_line_at_rest_leave_the_trunk_upright() -> None:
    """They say nothing of the turn about that line; the upper arms, hanging here, take it all."""
    names = [side + joint for side in "LR" for joint in ("Shoulder", "Elbow", "Wrist")]
    vectors = np.zeros((4, len(BODY), 3))
    vectors[:, 0, 1] = np.radians([0, 60, 120, 170])  # the pelvis' y axis points up
    vectors[:, BODY.index("forearm.L"), 0] = vectors[:, BODY.index("forearm.R"), 0] = 0.5
    truth = Motion(np.zeros((4, 3)), rotations.exp(vectors))
    targets = landmark_positions(BODY, truth, names)
    found = fit_poses(BODY, names, targets)
    assert error_mm(BODY, found, names, targets).max() < 5
    neck, hip = landmark_positions(BODY, found, ["Neck", "Hip"]).swapaxes(0, 1)
    assert ((neck - hip)[:, 2] > 0.9 * np.linalg.norm(neck - hip, axis=1)).all()


@pytest.mark.parametrize("seen", [0, 2])
def test_fewer_than_three_landmarks_are_an_error_that_names_the_pose(seen: int) -> None:
    targets = landmark_positions(BODY, exercise(BODY, 2), NAMES)
    targets[1, seen:] = np.nan
    with pytest.raises(LandmarkError, match="pose 1"):
        fit_poses(BODY, NAMES, targets)


def test_a_name_that_comes_twice_is_refused() -> None:
    names = [*NAMES, NAMES[3]]
    with pytest.raises(LandmarkError, match=f"'{NAMES[3]}' comes twice"):
        fit_poses(BODY, names, landmark_positions(BODY, exercise(BODY, 2), names))


@pytest.mark.parametrize("shape", [(20, 3), (1, 19, 3), (1, 20, 2)])
def test_positions_that_are_not_one_for_each_name_are_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(LandmarkError, match=r"positions of shape .*\(poses, 20, 3\)"):
        fit_poses(BODY, NAMES[:20], np.zeros(shape))


def test_a_landmark_that_the_body_lacks_is_named() -> None:
    with pytest.raises(LandmarkError, match=r"no landmark 'Tail' \(it has .*Hip"):
        landmark_positions(BODY, at_rest(BODY), ["Hip", "Tail"])


def test_no_usable_landmark_is_an_error_too() -> None:
    with pytest.raises(LandmarkError):
        fit_poses(BODY, ["LEar", "REar", "Tail"], np.zeros((1, 3, 3)))


def test_moving_the_world_moves_the_poses() -> None:
    targets = landmark_positions(BODY, exercise(BODY, 3, seed=5), TRACKED)
    targets += np.random.default_rng(1).normal(0, 0.005, targets.shape)
    G, s = rotations.exp(np.array([0.4, -0.8, 2.0])), np.array([3.0, -1.0, 0.5])
    here, there = fit_poses(BODY, TRACKED, targets), fit_poses(BODY, TRACKED, targets @ G.T + s)
    expected = landmark_positions(BODY, rigidly_moved(BODY, here, G, s), TRACKED)
    # The iteration stops at a millionth; where it does depends on the coordinates.
    assert error_mm(BODY, there, TRACKED, expected).max() < 0.5


def test_starting_elsewhere_ends_at_the_same_landmarks() -> None:
    truth = exercise(BODY, 3, seed=6)
    targets = landmark_positions(BODY, truth, NAMES)
    found = fit_poses(BODY, NAMES, targets, start=truth)
    assert error_mm(BODY, found, NAMES, targets).max() < 1


MEASURES = {
    "thigh": 0.46,
    "shin": 0.40,
    "upper_arm": 0.33,
    "forearm": 0.24,
    "hip_width": 0.24,
    "shoulder_width": 0.42,
    "torso": 0.53,
}


def test_measures_come_back_from_landmarks() -> None:
    person = human(1.8, MEASURES)
    targets = landmark_positions(person, exercise(person, 8, seed=3), TRACKED)
    body = fit_body(TRACKED, targets)

    def length(b: Body, ends: tuple[str, str]) -> float:
        return float(np.linalg.norm(np.subtract(*landmark_positions(b, at_rest(b), list(ends))[0])))

    for ends in (
        *((side + a, side + b) for side in "LR" for a, b in (("Hip", "Knee"), ("Knee", "Ankle"))),
        *((side + a, side + b) for side in "LR" for a, b in (("Shoulder", "Elbow"), ("Elbow", "Wrist"))),
        ("LHip", "RHip"),
        ("LShoulder", "RShoulder"),
        ("Hip", "Neck"),
    ):
        assert length(body, ends) == pytest.approx(length(person, ends), rel=0.06), (
            ends
        )  # the prior of 12 % pulls a little
    assert error_mm(body, fit_poses(body, TRACKED, targets), TRACKED, targets).mean() < 3


def test_measures_follow_landmarks_with_gaps() -> None:
    person = human(1.8, MEASURES)
    targets = landmark_positions(person, exercise(person, 8, seed=3), TRACKED)
    targets[2:4, TRACKED.index("LKnee")] = np.nan
    targets[:, TRACKED.index("Head")] = np.nan
    body = fit_body(TRACKED, targets)
    error = error_mm(body, fit_poses(body, TRACKED, targets), TRACKED, targets)
    assert np.nanmean(error) < 4


def test_trunks_of_other_lengths_stand_as_straight_as_the_person() -> None:
    """With the average trunk, they would buckle by 20 to 30 degrees at each of its two joints, forward or backward."""
    joints = ["spine", "chest"]
    for torso in (0.46, 0.50, 0.55):
        person = human(1.8, {"torso": torso})
        truth = at_rest(person, 4)
        for side, turned in (("L", 1.2), ("R", -1.2)):
            truth.rotations[:, person.index(f"upper_arm.{side}")] = rotations.exp(np.array([0.0, 0.0, turned]))
        truth.rotations[2:, person.index("spine")] = rotations.exp(np.array([0.2, 0.0, 0.0]))
        targets = landmark_positions(person, truth, NAMES)
        body = fit_body(NAMES, targets)
        found = fit_poses(body, NAMES, targets)
        bends = rotations.log(found.rotations[:, [body.index(name) for name in joints]]).sum(axis=1)
        true = rotations.log(truth.rotations[:, [body.index(name) for name in joints]]).sum(axis=1)
        assert np.degrees(np.abs(bends - true)).max() < 12, torso


def test_measures_stay_a_persons_where_poses_lie_beyond_joint_limits() -> None:
    """No body bends its knees forward: there, whole steps of the measures lead kilometres away."""
    person = human(1.8, {"torso": 0.46, "thigh": 0.46, "shin": 0.40})
    truth, bent = at_rest(person, 4), np.array([0.0, 0.7, 1.2, 0.0])
    legs = {"thigh.L": -0.9, "thigh.R": -0.7, "shin.L": 1.1, "shin.R": 1.4}
    for part, turned in {"pelvis": 0.5, "spine": 0.35, "chest": 0.25, **legs}.items():
        truth.rotations[:, person.index(part)] = rotations.exp(np.outer(bent, [turned, 0.0, 0.0]))
    for side, turned in (("L", 1.0), ("R", -1.0)):
        raised = np.outer(turned * (1.2 - 0.5 * bent), [0.0, 0.0, 1.0])
        truth.rotations[:, person.index(f"upper_arm.{side}")] = rotations.exp(raised)
    targets = landmark_positions(person, truth, NAMES)
    body = fit_body(NAMES, targets)
    for ends in (("Hip", "Neck"), ("LShoulder", "RShoulder"), ("LHip", "LKnee"), ("RKnee", "RAnkle")):
        lengths = [np.linalg.norm(np.subtract(*landmark_positions(b, at_rest(b), ends)[0])) for b in (body, person)]
        assert lengths[0] == pytest.approx(lengths[1], rel=0.3), ends


def test_height_is_judged_from_the_limbs() -> None:
    targets = landmark_positions(BODY, exercise(BODY, 3), NAMES)
    assert estimate_height(NAMES, targets) == pytest.approx(1.78, rel=1e-6)
    assert estimate_height(["LHip", "LKnee"], targets[:, [NAMES.index("LHip"), NAMES.index("LKnee")]]) == pytest.approx(
        1.78, rel=1e-6
    )
    with pytest.raises(LandmarkError, match="height"):
        estimate_height(["Hip", "Neck"], targets[:, :2])
    assert starting_height(["Hip", "Neck"], targets[:, :2], 0.4) == 0.4
    for given, taken in ((None, 1.78), (1.5, 1.5), (0.356, 1.78), (2.9, 1.78)):
        assert starting_height(NAMES, targets, given) == pytest.approx(taken, rel=1e-6)


def test_a_given_height_is_taken() -> None:
    """It decides what landmarks do not show: how thick the parts are."""
    targets = landmark_positions(BODY, exercise(BODY, 2), TRACKED)
    widths = [np.ptp(fit_body(TRACKED, targets, h, rounds=1).parts[0].vertices[:, 0]) for h in (1.6, 2.0)]
    assert widths[1] / widths[0] == pytest.approx(2.0 / 1.6, rel=1e-6)


def test_feet_without_toes_point_where_the_legs_do() -> None:
    """Their ankles are as at rest, and their turn is the legs', however these are lifted and bent."""
    truth = exercise(BODY, 10, seed=4)
    feet = [BODY.index(f"foot.{side}") for side in "LR"]
    truth.rotations[:, feet] = np.eye(3)
    names = [name for name in TRACKED if not name.endswith(("BigToe", "Heel"))]
    found = fit_poses(BODY, names, landmark_positions(BODY, truth, names))
    np.testing.assert_allclose(found.rotations[:, feet], truth.rotations[:, feet], atol=1e-6)
    for side in "LR":
        ends = [side + "Ankle", side + "BigToe"]
        pointing = [np.diff(landmark_positions(BODY, motion, ends), axis=1)[:, 0] for motion in (found, truth)]
        along = [v / np.linalg.norm(v, axis=1, keepdims=True) for v in pointing]
        assert np.degrees(np.arccos(np.clip(np.sum(along[0] * along[1], axis=1), -1, 1))).max() < 45
