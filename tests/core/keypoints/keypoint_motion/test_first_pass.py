"""What the first pass claims: no worse than what views agree on, whatever the detector's joints, noise and the pace."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from keypoint_shots import NAMES, cameras, joint_errors, keypoints_of, seen_places, strolling
from kfmocap.core.body import Body, human, landmark_positions, part_poses
from kfmocap.core.body.motion import Motion
from kfmocap.core.keypoints.keypoint_factor import KeypointFactor
from kfmocap.core.keypoints.keypoint_motion.closed_form import closed_form_pose
from kfmocap.core.keypoints.keypoint_motion.first_pass import scaled_first_pass
from kfmocap.core.keypoints.keypoint_motion.first_pose import posed_start
from kfmocap.core.keypoints.keypoint_motion.limb_safeguard import repose_lost_limbs
from kfmocap.core.keypoints.keypoint_offsets import KeypointOffsets, offset_precision
from kfmocap.core.keypoints.keypoint_rays import Keypoints
from kfmocap.core.keypoints.left_and_right.left_right import swap_sides
from kfmocap.core.keypoints.triangulation import triangulate
from kfmocap.core.keypoints.view_agreement import ViewAgreement, averaged, view_sigmas, without_midpoints
from kfmocap.core.numerics import rotations
from kfmocap.core.shot.acceleration_prior import acceleration_precision
from kfmocap.core.shot.settings import Settings

FPS = 30.0
JOINTS = [n for n in NAMES if n[1:] in ("Shoulder", "Elbow", "Wrist", "Hip", "Knee", "Ankle")]
COLUMNS = [NAMES.index(n) for n in JOINTS]


def precision(body: Body, fps: float = FPS) -> np.ndarray:
    return acceleration_precision(body, fps, Settings())


def punching(body: Body, frames: int, fps: float = FPS) -> Motion:
    """Standing, and hitting out with both arms in turn, a third of a second a blow."""
    motion, t = strolling(body, frames), np.arange(frames) / fps
    turns = rotations.log(motion.rotations) * (np.array(body.names) == "pelvis")[:, None]
    for side, sign, phase in (("L", 1.0, 0.0), ("R", -1.0, np.pi)):
        out = np.clip(np.sin(2 * np.pi * 1.5 * t + phase), 0, 1)[:, None] ** 2
        guard, blow = np.array([0.2, -0.5 * sign, -1.2 * sign]), np.array([0.1, -1.4 * sign, -0.1 * sign])
        turns[:, body.index(f"upper_arm.{side}")] = guard + (blow - guard) * out
        turns[:, body.index(f"forearm.{side}"), :1] = 2.2 - 2.0 * out
    return Motion(motion.translations, rotations.exp(turns))


def spoiled(seen: Keypoints, share: float = 0.03) -> Keypoints:
    """Some keypoints elsewhere, and unsure of it."""
    rng = np.random.default_rng(5)
    wrong = rng.uniform(size=seen.confidence.shape) < share
    rays = np.where(wrong[..., None], seen.rays + rng.normal(0, 0.03, seen.rays.shape), seen.rays)
    return replace(seen, rays=rays, confidence=np.where(wrong, 0.5, seen.confidence))


def triangulated_error(seen: Keypoints, body: Body, motion: Motion, fps: float = FPS) -> float:
    """Of the joints as triangulated, and averaged over a few frames."""
    points = averaged(ViewAgreement.of(seen, fps).points_world, fps)[:, COLUMNS]
    return float(np.linalg.norm(points - landmark_positions(body, motion, JOINTS), axis=-1).mean())


def test_fast_arms_are_no_worse_than_their_triangulated_keypoints() -> None:
    body = human(1.8)
    motion = punching(body, 40)
    offsets = np.zeros((len(NAMES), 3))
    offsets[[NAMES.index("LHip"), NAMES.index("RHip")], 2] = 0.04
    seen = spoiled(keypoints_of(cameras(3), seen_places(body, motion, offsets), noise=0.012))
    fit = scaled_first_pass(seen, fps=FPS, precision=precision(body), correlated=9.0)
    assert joint_errors(fit.body, fit.motion, body, motion).mean() < triangulated_error(seen, body, motion)


def test_the_frame_rate_that_is_claimed_does_not_matter() -> None:
    """The same keypoints called 30 and 90 frames a second give the same motion."""
    body = human()
    motion = punching(body, 20)
    seen = keypoints_of(cameras(3), seen_places(body, motion), noise=0.006)
    found = [
        landmark_positions(fit.body, fit.motion, JOINTS)
        for fps in (30.0, 90.0)
        for fit in [scaled_first_pass(seen, fps=fps, precision=precision(body, fps), correlated=3.0)]
    ]
    assert np.linalg.norm(found[0] - found[1], axis=-1).mean() < 0.008


def test_midpoints_of_two_joints_do_not_count_twice() -> None:
    body = human()
    seen = keypoints_of(cameras(2), seen_places(body, strolling(body, 5)), noise=0.01)
    neck, left, right = (NAMES.index(n) for n in ("Neck", "LShoulder", "RShoulder"))
    seen.rays[:, :, neck] = 0.5 * (seen.rays[:, :, left] + seen.rays[:, :, right])
    own = without_midpoints(seen)
    assert not own.confidence[:, :, neck].any()
    assert own.confidence[:, :, left].all() and own.confidence[:, :, NAMES.index("Nose")].all()


def test_sides_that_one_view_exchanges_are_corrected_before_any_pose_is_known() -> None:
    body = human()
    motion = punching(body, 24)
    seen = keypoints_of(cameras(4), seen_places(body, motion), noise=0.005)
    group = ("Hip", "Knee", "Ankle", "BigToe", "Heel")
    left, right = (np.array([NAMES.index(side + n) for n in group]) for side in "LR")
    spoilt = seen.rays.copy()
    spoilt[1, 10:14, left], spoilt[1, 10:14, right] = seen.rays[1, 10:14, right], seen.rays[1, 10:14, left]
    found = ViewAgreement.of(replace(seen, rays=spoilt), FPS)
    sided, changed = found.keypoints, found.changed
    legs = np.concatenate([left, right])
    np.testing.assert_allclose(sided.rays[:, :, legs], seen.rays[:, :, legs])
    assert changed[1, 10:14][:, legs].all() and not changed[0][:, legs].any()


def test_frames_with_three_views_decide_which_of_two_views_exchanged_sides() -> None:
    body = human()
    motion = strolling(body, 40)
    sided = [i for i, name in enumerate(NAMES) if name[1:] in ("Hip", "Knee", "Ankle", "Shoulder", "Elbow", "Wrist")]
    made = []
    for seed in range(6):
        seen = keypoints_of(cameras(), seen_places(body, motion), noise=0.02, seed=seed)
        rays, confidence = seen.rays.copy(), seen.confidence.copy()
        confidence[0, 12:24], rays[0, 12:24] = 0, np.nan
        rays[1, 14:22] = swap_sides(seen).rays[1, 14:22]
        agreement = ViewAgreement.of(replace(seen, rays=rays, confidence=confidence), FPS)
        made.append(agreement.changed[..., sided])
    changed = np.array(made)
    assert changed[:, 1, 14:22].mean() > 0.8
    assert changed[:, 1, 14:22].sum() > 0.95 * changed.sum()


@pytest.mark.parametrize(("collar_bones", "carrier"), [(True, "shoulder.L"), (False, "chest")])
def test_shoulders_and_hips_of_a_detector_stay_on_what_the_limbs_hang_on(collar_bones: bool, carrier: str) -> None:
    body = human(collar_bones=collar_bones)
    places = KeypointOffsets.on(body, NAMES)
    carriers = {n: body.names[places.parts[NAMES.index(n)]] for n in ("LShoulder", "RHip", "LElbow")}
    assert carriers == {"LShoulder": carrier, "RHip": "pelvis", "LElbow": "forearm.L"}
    motion = strolling(body, 4)
    found = places.world(part_poses(body, motion))[:, COLUMNS]
    np.testing.assert_allclose(found, landmark_positions(body, motion, JOINTS), atol=1e-12)


def test_a_view_that_errs_more_is_found_to() -> None:
    body = human()
    points = seen_places(body, strolling(body, 60))
    seen = keypoints_of(cameras(4), points, noise=0.008)
    rough = keypoints_of(cameras(4), points, noise=0.024, seed=1)
    seen.rays[2] = rough.rays[2]
    found, inliers = triangulate(seen)
    sigma = np.median(view_sigmas(seen, found, inliers), axis=1)
    assert sigma[2] > 1.4 * np.delete(sigma, 2).max()
    assert (np.delete(sigma, 2) < 0.014).all()


def test_a_stiff_motion_is_not_taken_for_noise() -> None:
    """Deviations come from the views: a fit that starts too smooth does not call the movement the detector's error."""
    body = human()
    motion = punching(body, 36)
    seen = keypoints_of(cameras(3), seen_places(body, motion), noise=0.01)
    fit = scaled_first_pass(seen, fps=FPS, precision=precision(body) * 100, correlated=9.0)
    wrists = [JOINTS.index("LWrist"), JOINTS.index("RWrist")]
    assert fit.sigma[:, [NAMES.index("LWrist"), NAMES.index("RWrist")]].max() < 0.02
    assert joint_errors(fit.body, fit.motion, body, motion)[:, wrists].mean() < 0.04


def test_offsets_that_mirror_each_other_are_likelier() -> None:
    names = ("LHip", "RHip", "Nose")
    known = offset_precision(names)
    both, opposed = np.zeros((2, 3, 3))
    both[:2] = [[0.01, 0.03, 0.04], [-0.01, 0.03, 0.04]]
    opposed[:2] = [[0.01, 0.03, 0.04], [0.01, -0.03, -0.04]]
    cost = [float(x.ravel() @ known @ x.ravel()) for x in (both, opposed)]
    assert cost[1] > 10 * cost[0]
    np.linalg.cholesky(known)


def test_lost_arms_are_posed_again() -> None:
    body = human()
    motion = punching(body, 30)
    points = seen_places(body, motion)
    seen = keypoints_of(cameras(3), points, noise=0.004)
    arm = [body.index("upper_arm.L"), body.index("forearm.L")]
    turns = rotations.log(motion.rotations)
    turns[10:20, arm[0], 1] += 2.0
    lost = Motion(motion.translations, rotations.exp(turns))
    usual = np.full((3, len(NAMES)), 0.01)
    places = KeypointOffsets.on(body, NAMES)

    def reposed(start: Motion) -> Motion | None:
        return repose_lost_limbs(body, start, places, keypoints=seen, points_world=points, sigma=usual, fps=FPS)

    assert reposed(motion) is None
    found = reposed(lost)
    assert found is not None
    assert joint_errors(body, lost, body, motion)[10:20].max() > 0.2
    assert joint_errors(body, found, body, motion).max() < 0.02
    other = np.setdiff1d(np.arange(len(body)), arm)
    np.testing.assert_array_equal(found.rotations[:, other], lost.rotations[:, other])


def test_a_body_is_posed_on_points_of_every_frame() -> None:
    body = human()
    motion = punching(body, 30)
    seen = keypoints_of(cameras(3), seen_places(body, motion))
    start = posed_start(body, seen, seen_places(body, motion), FPS)
    assert joint_errors(body, start, body, motion).mean() < 0.04


def test_a_body_without_ankles_in_the_pictures_is_posed_all_the_same() -> None:
    body = human()
    motion = punching(body, 6)
    points = seen_places(body, motion)
    points[:, [NAMES.index("LAnkle"), NAMES.index("RAnkle")]] = np.nan
    posed = closed_form_pose(body, list(NAMES), points, FPS)
    assert posed is not None
    arms = [i for i, n in enumerate(JOINTS) if n.endswith(("Shoulder", "Elbow", "Wrist"))]
    assert joint_errors(body, posed, body, motion)[:, arms].mean() < 0.05


def test_the_tracker_does_not_take_a_stiff_motion_for_noise_either() -> None:
    """Keypoints that views agree on pull a lost arm as hard as Huber's error does, with deviations that stay."""
    body = human()
    motion = punching(body, 20)
    seen = keypoints_of(cameras(3), seen_places(body, motion), noise=0.004)
    usual, places = np.full((3, len(NAMES)), 0.01), KeypointOffsets.on(body, NAMES)
    turns = rotations.log(motion.rotations)
    turns[:, body.index("upper_arm.L"), 1] += 1.5
    lost = part_poses(body, Motion(motion.translations, rotations.exp(turns)))
    held = KeypointFactor(seen, places, 1.0, usual, seen.confidence)
    alone = KeypointFactor(seen, places, 1.0)
    arm = 3 + 3 * body.index("upper_arm.L")
    pulls = [np.abs(k.blocks(body, lost, 1.0).gradient[:, arm : arm + 3]).mean() for k in (held, alone)]
    assert pulls[0] > 3 * pulls[1]
    assert held[2:5].agreed is not None and held[2:5].agreed.shape[1] == 3
    assert held.of_views([2, 0]).sigma is not None and len(held.of_views([2, 0]).sigma) == 2


def test_legs_out_of_sight_do_not_go_on_turning() -> None:
    """Half a second of swinging legs is seen, and a second and more before and after is not."""
    body = human(1.8)
    motion = strolling(body, 60)
    seen = keypoints_of(cameras(2), seen_places(body, motion), noise=0.008)
    legs = [i for i, name in enumerate(NAMES) if name[1:] in ("Knee", "Ankle", "BigToe", "Heel")]
    unseen = np.ix_(range(2), [*range(14), *range(24, 60)], legs)
    seen.confidence[unseen], seen.rays[unseen] = 0.0, np.nan
    fit = scaled_first_pass(seen, fps=FPS, precision=precision(body), correlated=9.0)
    errors = joint_errors(fit.body, fit.motion, body, motion)
    assert errors[14:24].max() < 0.03
    assert errors.mean() < 0.15  # 0.21 where they do go on
    usual = np.linalg.norm(rotations.log(fit.motion.rotations[:, body.index("shin.L")]), axis=-1)
    assert usual.max() < 1.2  # they are bent by 0.1 to 0.7 radians


def test_feet_of_a_detector_without_toes_point_where_the_legs_do() -> None:
    body = human(1.8)
    motion = strolling(body, 30)
    seen = keypoints_of(cameras(3), seen_places(body, motion), noise=0.01)
    seen.confidence[:, :, [i for i, name in enumerate(NAMES) if name[1:] in ("BigToe", "Heel")]] = 0.0
    fit = scaled_first_pass(seen, fps=FPS, precision=precision(body), correlated=9.0)
    for side in "LR":
        names = [side + "Ankle", side + "BigToe"]
        found, true = (
            np.diff(landmark_positions(one, moved, names), axis=1)[:, 0]
            for one, moved in ((fit.body, fit.motion), (body, motion))
        )
        cosine = np.sum(found * true, axis=-1) / np.linalg.norm(found, axis=-1) / np.linalg.norm(true, axis=-1)
        assert np.degrees(np.arccos(cosine)).max() < 20


def test_two_views_that_never_see_most_joints_at_once_are_enough() -> None:
    """Each keypoint is missing on half of the frames, at its own times in each view."""
    body, frames = human(), 30
    points = seen_places(body, strolling(body, frames))
    seen = keypoints_of(cameras(2), points, noise=0.01)
    rng = np.random.default_rng(0)
    begin = rng.integers(0, 10, (1, 1, len(NAMES))) + np.array([0, 3])[:, None, None]
    missing = (np.arange(frames)[:, None] + begin) % 10 < 5
    seen.confidence[missing], seen.rays[missing] = 0.0, np.nan
    fit = scaled_first_pass(seen, fps=FPS, precision=precision(body), correlated=9.0)
    joints = [i for i, name in enumerate(NAMES) if name.endswith(("Elbow", "Knee", "Ankle", "Shoulder"))]
    found = fit.places.world(part_poses(fit.body, fit.motion))
    assert np.linalg.norm(found - points, axis=-1)[:, joints].mean() < 0.04
