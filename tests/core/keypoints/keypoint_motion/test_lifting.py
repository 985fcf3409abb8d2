"""A motion from the keypoints of one camera, without key poses: depths by the lengths of the bones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from keypoint_shots import NAMES, cameras, joint_errors, keypoints_of, seen_places, strolling
from kfmocap.core.body import human, landmark_positions, part_poses
from kfmocap.core.body.motion import Motion
from kfmocap.core.errors import KeypointError
from kfmocap.core.keypoints.keypoint_factor import KeypointFactor
from kfmocap.core.keypoints.keypoint_motion import first_pass as first_pass_module
from kfmocap.core.keypoints.keypoint_motion import single_view_turns
from kfmocap.core.keypoints.keypoint_motion.first_pass import first_pass, scaled_first_pass
from kfmocap.core.keypoints.keypoint_motion.keypoint_fit import FitProblem, fit_motion
from kfmocap.core.keypoints.keypoint_motion.lifting import lifted_points, lone_view, with_imagined_view
from kfmocap.core.keypoints.keypoint_motion.person_depth import (
    FLOOR_TOLERANCE,
    Rays,
    depth_on_floor,
    expected_depth,
    likely_height,
)
from kfmocap.core.keypoints.keypoint_rays import Keypoints
from kfmocap.core.keypoints.view_agreement import ViewAgreement
from kfmocap.core.numerics import rotations
from kfmocap.core.shot.acceleration_prior import acceleration_precision
from kfmocap.core.shot.keypose_spline import spline
from kfmocap.core.shot.settings import Settings
from kfmocap.core.shot.shot import KeyPoses

FPS, FRAMES = 30.0, 36
BODY = human(1.8)
TRUTH = strolling(BODY, FRAMES)
PRECISION = acceleration_precision(BODY, FPS, Settings())


def seen_by(view: int, noise: float = 0.01) -> Keypoints:
    return keypoints_of(cameras(4)[view : view + 1], seen_places(BODY, TRUTH), noise=noise, seed=view)


def below_the_hips(body: object, motion: Motion) -> np.ndarray:
    """The main joints against the hips' middle: the pose alone."""
    names = [n for n in NAMES if n[1:] in ("Shoulder", "Elbow", "Wrist", "Hip", "Knee", "Ankle")]
    points = landmark_positions(body, motion, names)
    return points - points[:, [names.index("LHip"), names.index("RHip")]].mean(axis=1, keepdims=True)


def standing_with(turns: dict[str, tuple[float, float, float]]) -> Motion:
    """Somebody who holds a pose, given by rotation vectors of parts, with the lower foot on the floor."""
    vectors = np.zeros((FRAMES, len(BODY), 3))
    for part, vector in turns.items():
        vectors[:, BODY.index(part)] = vector
    raised = Motion(np.tile(BODY.offsets[0], (FRAMES, 1)), rotations.exp(vectors))
    lowest = landmark_positions(BODY, raised, ["LHeel", "RHeel"])[..., 2].min()
    return Motion(raised.translations - [0, 0, lowest], raised.rotations)


@pytest.mark.parametrize("view", range(4))
def test_one_camera_shows_the_pose_and_roughly_the_place(view: int) -> None:
    """From the front, the sides and the back: which way the person looks is found as well."""
    fit = scaled_first_pass(seen_by(view), fps=FPS, precision=PRECISION, correlated=9.0, height=1.8)
    assert joint_errors(fit.body, fit.motion, BODY, TRUTH).mean() < 0.3
    pose = np.linalg.norm(below_the_hips(fit.body, fit.motion) - below_the_hips(BODY, TRUTH), axis=-1)
    assert pose.mean() < 0.12
    assert fit.imagined is not None and fit.agreed is None


def test_a_joint_is_at_one_of_two_depths_beside_its_true_place() -> None:
    rays = Rays.of(seen_by(0, noise=0.0))
    points = dict(zip(NAMES, np.moveaxis(seen_places(BODY, TRUTH), 1, 0), strict=True))
    length = float(np.linalg.norm(points["LKnee"] - points["LHip"], axis=-1).mean())
    near, far = (rays.at("LKnee", depth) for depth in rays.depths_from(points["LHip"], "LKnee", length))
    depth = np.sum((points["LKnee"] - points["LHip"]) * rays.directions["LKnee"], axis=-1)
    assert np.linalg.norm(near - far, axis=-1).max() < 2 * length
    nearest = np.minimum(*(np.linalg.norm(found - points["LKnee"], axis=-1) for found in (near, far)))
    assert nearest.max() < np.maximum(0.15 * length, 0.5 * np.abs(depth)).max()


def test_a_bone_that_is_seen_nearly_whole_is_not_taken_to_be_turned_far_away() -> None:
    share = expected_depth(np.array([0.0, 0.5, 0.95, 1.0, 1.1]))
    assert (np.diff(share[:4]) < 0).all()
    assert share[4] == pytest.approx(share[3])
    assert share[2] < 0.75 * np.sqrt(1 - 0.95**2)  # a little shorter is likelier than turned away by 18 degrees
    assert share[1] > 0.7 * np.sqrt(1 - 0.5**2)  # half of it is turned away for certain


def test_of_two_depths_of_a_leg_the_one_that_leaves_its_foot_on_the_floor_is_chosen() -> None:
    """Somebody stands with bent knees: turned the other way in depth, the legs would end a hand's breadth higher."""
    bent = {"thigh.L": 0.5, "shin.L": -0.8, "thigh.R": 0.3, "shin.R": -0.5}
    truth = standing_with({part: (angle, 0, 0) for part, angle in bent.items()})
    seen = keypoints_of(cameras(4)[3:], seen_places(BODY, truth), noise=0.01, seed=1)
    found, _ = lifted_points(BODY, seen, FPS)
    legs = [NAMES.index(side + joint) for side in "LR" for joint in ("Hip", "Knee", "Ankle")]
    below = [
        points[:, legs] - points[:, legs[::3]].mean(axis=1, keepdims=True)
        for points in (found, seen_places(BODY, truth))
    ]
    assert np.linalg.norm(below[0] - below[1], axis=-1).mean() < 0.1


@pytest.mark.parametrize("view", [0, 3])
def test_a_trunk_leans_forward_rather_than_backward(view: int) -> None:
    """From the front and from behind it looks the same either way."""
    bowed = standing_with({"thigh.L": (0.3, 0, 0), "thigh.R": (0.3, 0, 0), "spine": (0.3, 0, 0), "chest": (0.2, 0, 0)})
    seen = keypoints_of(cameras(4)[view : view + 1], seen_places(BODY, bowed), noise=0.01, seed=1)
    points = dict(zip(NAMES, np.moveaxis(lifted_points(BODY, seen, FPS)[0], 1, 0), strict=True))
    lean = 0.5 * (points["LShoulder"] + points["RShoulder"] - points["LHip"] - points["RHip"])
    assert lean[:, 1].mean() < -0.08  # the person faces -y


def test_the_depth_of_feet_on_the_floor_does_not_change_with_the_pose() -> None:
    """Bones seem to come nearer while somebody bows; the feet stay. Of somebody in the air, bones are all there is."""
    standing = standing_with({})
    seen = keypoints_of(cameras(1), seen_places(BODY, standing))
    rays = Rays.of(seen)
    by_bones = 5.0 * (1 + 0.1 * np.sin(np.arange(FRAMES) / 4))
    found = depth_on_floor(rays, by_bones, FPS)
    np.testing.assert_allclose(found, 5.0, atol=0.3)
    assert np.ptp(found) < 0.01
    away = by_bones * np.where(np.arange(FRAMES) < FRAMES // 2, 1.0, 1.3)
    apart = np.abs(np.log(away / 5.0)) > FLOOR_TOLERANCE
    np.testing.assert_array_equal(depth_on_floor(rays, away, FPS)[apart], away[apart])
    leaping = Rays(rays.centre + [0, 0, 1.0], rays.directions)
    np.testing.assert_array_equal(depth_on_floor(leaping, by_bones, FPS), by_bones)


def test_the_depth_does_not_leap_where_feet_begin_to_stand_on_the_floor() -> None:
    """That of the bones, which grows steadily, comes within the tolerance of the feet's on some frame."""
    rays = Rays.of(keypoints_of(cameras(1), seen_places(BODY, standing_with({}))))
    by_bones = 5.0 * np.exp(np.linspace(-1.5, 0.5, FRAMES) * FLOOR_TOLERANCE)
    found = depth_on_floor(rays, by_bones, FPS)
    assert np.abs(np.diff(found)).max() < 0.2 < 5.0 * FLOOR_TOLERANCE
    np.testing.assert_allclose(found[-FRAMES // 4 :], 5.0, atol=0.05)


def test_feet_on_the_floor_tell_the_height_unless_that_is_nobodys() -> None:
    seen = seen_by(0)
    assert likely_height(seen, FPS) == pytest.approx(1.8, abs=0.12)
    raised = replace(seen, t_cam_world=seen.t_cam_world - seen.R_cam_world @ np.array([0.0, 0.0, 2.0]))
    assert likely_height(raised, FPS) == 1.7  # the floor would be two metres below the feet


def test_a_true_key_pose_corrects_the_proposals_around_it() -> None:
    """The animator keys the middle frame; a proposal stays on each side."""
    seen = seen_by(1)
    fit = scaled_first_pass(seen, fps=FPS, precision=PRECISION, correlated=9.0, height=1.8)
    frames = np.array([4, 32])
    keys = KeyPoses.proposed(frames, fit.motion[frames]).joined(KeyPoses.whole([18], TRUTH[[18]]))
    fixed = np.zeros((FRAMES, BODY.dof), bool)
    fixed[18] = True
    corrected = first_pass(BODY, keys, seen, fixed=fixed, precision=PRECISION, fps=FPS, correlated=9.0)
    before, after = (joint_errors(one.body, one.motion, BODY, TRUTH) for one in (fit, corrected))
    assert after[18].max() < 1e-9
    assert after[14:23].mean() < 0.7 * before[14:23].mean()


def test_legs_that_swing_between_key_poses_are_those_that_one_camera_shows() -> None:
    """The key poses are a whole stride apart. On the curve between them the legs hardly move, and each is taken for the
    other one.
    """
    truth = strolling(BODY, 2 * FRAMES)[::2]
    seen = keypoints_of(cameras(4)[1:2], seen_places(BODY, truth), noise=0.01, seed=1)
    frames = np.array([4, 23])
    fixed = np.zeros((FRAMES, BODY.dof), bool)
    fixed[frames] = True
    keys = KeyPoses.whole(frames, truth[frames])
    found = first_pass(BODY, keys, seen, fixed=fixed, precision=PRECISION, fps=FPS, correlated=9.0)
    error = joint_errors(found.body, found.motion, BODY, truth)
    assert error[frames].max() < 1e-9
    assert error[4:24].max() < 0.2


def test_views_without_keypoints_do_not_count() -> None:
    seen = keypoints_of(cameras(3), seen_places(BODY, TRUTH), noise=0.01)
    seen.confidence[[0, 2]] = 0.0
    assert lone_view(BODY, seen) == 1
    fit = scaled_first_pass(seen, fps=FPS, precision=PRECISION, correlated=9.0, height=1.8)
    assert fit.weights.shape == seen.confidence.shape and not fit.weights[[0, 2]].any()
    seen.confidence[:, :, [NAMES.index("LHip"), NAMES.index("RHip"), NAMES.index("LShoulder")]] = 0.0
    with pytest.raises(KeypointError, match="no two views agree"):
        scaled_first_pass(seen, fps=FPS, precision=PRECISION, correlated=9.0, height=1.8)


def test_the_imagined_view_holds_the_depths() -> None:
    """It pulls back a person that is moved along the camera's axis, which the camera itself hardly does."""
    seen = seen_by(0)
    fit = scaled_first_pass(seen, fps=FPS, precision=PRECISION, correlated=9.0, height=1.8)
    away = cameras(1)[0].pose(0)[0][2]
    moved = Motion(fit.motion.translations + 0.3 * away, fit.motion.rotations)
    factor = KeypointFactor(fit.keypoints, fit.places, 9.0, imagined=fit.imagined)
    pulls = [
        float((one.blocks(fit.body, part_poses(fit.body, moved), 1.0).gradient[:, :3] @ away).mean())
        for one in (factor, replace(factor, imagined=None))
    ]
    assert pulls[0] > 0 and pulls[0] > 2 * abs(pulls[1])
    assert len(factor[3:9].imagined) == 6
    points = seen_places(BODY, TRUTH)
    both = with_imagined_view(seen, points, FPS)
    assert np.nanmax(np.abs(both.keypoints.of_views([1]).residuals(points))) < 1e-9


def turning_by(degrees: float, first: int, last: int) -> Motion:
    """The person strolls, and turns on the way between two frames."""
    share = np.clip((np.arange(FRAMES) - first) / (last - first), 0, 1)
    rotations_of_parts = TRUTH.rotations.copy()
    upright = BODY.parts[0].R_world_rest.T @ [0.0, 0.0, 1.0]
    spin = rotations.exp(np.radians(degrees) * share[:, None] * upright)
    rotations_of_parts[:, 0] = spin @ rotations_of_parts[:, 0]
    return Motion(TRUTH.translations, rotations_of_parts)


@pytest.mark.parametrize("degrees", [330, -330])
def test_the_body_turns_between_key_poses_as_one_camera_shows(degrees: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """The curve through the key poses goes back by 30 degrees instead, and the lifted motion is no better here."""
    truth = turning_by(degrees, 6, 24)
    seen = keypoints_of(cameras(4)[1:2], seen_places(BODY, truth), noise=0.01, seed=1)
    frames = np.array([0, 6, 24, FRAMES - 1])
    fixed = np.zeros((FRAMES, BODY.dof), bool)
    fixed[frames] = True
    keys = KeyPoses.whole(frames, truth[frames])
    monkeypatch.setattr(first_pass_module, "lifted_start", lambda *_, **__: spline(keys, FRAMES))
    found = first_pass(BODY, keys, seen, fixed=fixed, precision=PRECISION, fps=FPS, correlated=9.0)
    assert joint_errors(found.body, found.motion, BODY, truth).mean() < 0.05


def test_no_turn_is_tried_where_keypoints_fit_as_well_as_on_key_poses(monkeypatch: pytest.MonkeyPatch) -> None:
    frames = np.array([0, 6, 24, FRAMES - 1])
    fixed = np.zeros((FRAMES, BODY.dof), bool)
    fixed[frames] = True
    problem = FitProblem(ViewAgreement.of(seen_by(1), FPS), fixed, PRECISION, 9.0)
    curve = spline(KeyPoses.whole(frames, TRUTH[frames]), FRAMES)
    fit = fit_motion(problem, BODY, curve)
    monkeypatch.setattr(single_view_turns, "fit_motion", lambda *_: pytest.fail("it was fitted once more"))
    assert single_view_turns.with_whole_turns(problem, BODY, curve, frames.tolist(), fit) is fit
