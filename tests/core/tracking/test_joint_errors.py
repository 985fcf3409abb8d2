"""Expected errors: intervals that hold what they say, and limbs that are called lost where they are."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from kfmocap.core.body import part_poses
from kfmocap.core.body.kinematics import tip_positions
from kfmocap.core.body.limbs import numbered_limbs
from kfmocap.core.body.motion import Motion
from kfmocap.core.evidence.misfit import Misfit, measured_misfit
from kfmocap.core.evidence.rendering.part_geometry import Geometry
from kfmocap.core.evidence.view_frames import ViewFrames
from kfmocap.core.numerics.rotations import exp
from kfmocap.core.shot.shot import KeyPoses, Performer
from kfmocap.core.tracking.expected_errors.body_uncertainty import body_covariances
from kfmocap.core.tracking.expected_errors.held_out_keys import USUAL_RATIO, _miss, covariance_ratios
from kfmocap.core.tracking.expected_errors.joint_covariances import (
    LARGEST_GROWTH,
    MOVING_DISPLACEMENT,
    growth_by_speed,
    tip_jacobian,
)
from kfmocap.core.tracking.expected_errors.lost_limbs import PATCH_SIDE, lost_lengths, lost_probabilities
from kfmocap.core.tracking.expected_errors.uncertainty import (
    ERRORS_T_DOF,
    ONE_VIEW_RATIO,
    ONE_VIEW_T_DOF,
    REPORTED_PROBABILITY,
    SegmentUncertainty,
    joint_errors,
    joint_parts,
)
from synthetic import at_rest, figure, look_at, poses_of, silhouette

Array = np.ndarray
BODY = figure()
P = len(BODY)
FRAMES, LOST = 24, slice(8, 18)
ARM = [BODY.index("upper_arm.L"), BODY.index("forearm.L")]
CAMERAS = (look_at("front", (0.3, -2.4, 1.4)), look_at("side", (-2.2, -1.2, 1.5)))


def length_of(parts: list[int]) -> float:
    return sum(float(np.linalg.norm(BODY.parts[part].tail_world - BODY.parts[part].head_world)) for part in parts)


def uncertainty_of(first: int, covariances: Array, misses: Array) -> SegmentUncertainty:
    held = np.zeros(len(covariances), bool)
    held[[0, -1]] = True
    lost = np.zeros(covariances.shape[:2])
    return SegmentUncertainty(first, held, covariances, misses, np.zeros(len(held)), lost, np.zeros(P))


def test_what_a_segment_shows_of_its_errors_is_at_most_the_usual() -> None:
    """Key poses that are missed by far more may be off themselves."""
    covariances = np.tile(1e-6 * np.eye(3), (5, P, 1, 1))
    near, far = (uncertainty_of(0, covariances, np.full((2, P), 3 * error)).ratios(BODY) for error in (0.1, 30.0))
    assert near.max() < 1
    np.testing.assert_array_equal(far, USUAL_RATIO)


def test_errors_larger_than_the_solver_expects_are_covered_as_key_poses_show_them() -> None:
    """Two segments of a linear problem with nine times the variance that its solver assumes, more on some frames."""
    rng, F, keys = np.random.default_rng(0), 400, 24
    A = rng.normal(0, 0.01, (F, P, 3, 3))
    covariances = A @ np.swapaxes(A, -1, -2)
    wrong = 9.0
    misses = wrong * rng.chisquare(3, (keys, P))
    halves = [
        uncertainty_of(0, covariances[: F // 2], misses[: keys // 2]),
        uncertainty_of(F // 2, covariances[F // 2 :], misses[keys // 2 :]),
    ]
    found = joint_errors(BODY, halves, np.zeros((F, P, 3, 3)))
    spread = np.sqrt(wrong / (rng.chisquare(ERRORS_T_DOF, (F, P)) / ERRORS_T_DOF))
    errors = spread * np.linalg.norm((A @ rng.normal(size=(F, P, 3, 1)))[..., 0], axis=-1)
    rows = np.setdiff1d(np.arange(F), [0, F // 2 - 1, F // 2, F - 1])
    assert np.mean(errors[rows] <= found.interval[rows]) == pytest.approx(0.9, abs=0.025)
    assert not found.interval[[0, F - 1]].any() and not found.deviation[[0, F - 1]].any()


def test_in_one_view_most_errors_are_smaller_than_expected_and_some_are_far_larger_whatever_key_poses_show() -> None:
    rng, F = np.random.default_rng(1), 400
    A = rng.normal(0, 0.01, (F, P, 3, 3))
    once, often = (uncertainty_of(0, A @ np.swapaxes(A, -1, -2), np.full((4, P), 3 * miss)) for miss in (0.1, 30.0))
    found, other = (joint_errors(BODY, [one], np.zeros((F, P, 3, 3)), one_view=True) for one in (once, often))
    np.testing.assert_array_equal(found.interval, other.interval)
    spread = np.sqrt(ONE_VIEW_RATIO / (rng.chisquare(ONE_VIEW_T_DOF, (F, P)) / ONE_VIEW_T_DOF))
    errors = spread * np.linalg.norm((A @ rng.normal(size=(F, P, 3, 1)))[..., 0], axis=-1)
    assert np.mean(errors[1:-1] <= found.interval[1:-1]) == pytest.approx(0.9, abs=0.025)
    assert np.median(errors[1:-1] / found.deviation[1:-1]) < 1 < np.quantile(errors[1:-1] / found.deviation[1:-1], 0.8)


@pytest.mark.parametrize("keypoints", [True, False])
def test_in_one_view_depth_is_less_sure_the_farther_a_joint_is_from_its_key_poses(keypoints: bool) -> None:
    """But not what stays where the key poses have it, nor anything across the line of sight."""
    rest = at_rest(BODY, 7)
    raised = rest.rotations.copy()
    raised[:, ARM[0]] = exp(np.outer([0, 0.1, 0.2, 0.5, 0.3, 0.1, 0], [1.0, 0, 0]))
    motion = Motion(rest.translations, raised)
    performer = Performer("man", BODY, KeyPoses.whole([0, 6], motion[[0, 6]]))
    eye = np.tile(CAMERAS[0].centre_world(), (7, 1))
    observed: Any = SimpleNamespace(is_lifted=False) if keypoints else None
    one, several = (body_covariances(performer, motion, 30.0, observed, of) for of in (eye, None))
    more = one - several
    sight = tip_positions(BODY, part_poses(BODY, motion))[:, ARM[1]] - eye
    along = np.einsum("fa,fab,fb->f", sight, more[:, ARM[1]], sight) / (sight**2).sum(axis=1)
    assert (np.diff(along[:4]) > 0).all() and (np.diff(along[3:]) < 0).all()
    np.testing.assert_allclose(np.trace(more[:, ARM[1]], axis1=1, axis2=2), along, atol=1e-12)
    np.testing.assert_allclose(more[:, 0], 0, atol=1e-12)


def test_without_keypoints_depth_is_less_sure_where_limbs_move_not_where_the_whole_body_does() -> None:
    """Pictures show how far away somebody is who walks past, but not whether an arm points towards the camera."""
    rest = at_rest(BODY, 5)
    walked = Motion(rest.translations + np.outer(np.arange(5), [0.2, 0, 0]), rest.rotations)
    eye = np.tile(CAMERAS[0].centre_world(), (5, 1))
    performer = Performer("man", BODY, KeyPoses.whole([0], walked[[0]]))
    one, several = (body_covariances(performer, walked, 30.0, None, of) for of in (eye, None))
    np.testing.assert_allclose(one, several, atol=1e-12)


def test_where_depth_follows_from_the_lengths_of_bones_all_joints_are_less_sure_in_depth_away_from_key_poses() -> None:
    """The more, the farther away the person is; a few frames from a key pose, depth is known better."""
    rest = at_rest(BODY, 40)
    performer = Performer("man", BODY, KeyPoses.whole([0], rest[[0]]))
    observed: Any = SimpleNamespace(is_lifted=True)
    eye = np.tile(CAMERAS[0].centre_world(), (40, 1))
    near, far = (
        body_covariances(performer, rest, 30.0, observed, of) - body_covariances(performer, rest, 30.0, observed)
        for of in (eye, 3 * eye)
    )
    assert not near[0].any()
    depth, farther = (np.trace(more, axis1=2, axis2=3) for more in (near, far))
    assert (depth[5] < depth[30]).all() and (depth[30] > 0.15**2).all()
    assert (farther[30] > depth[30]).all()


def test_a_part_that_misses_key_poses_by_more_than_the_others_has_the_larger_ratio() -> None:
    misses = np.full((6, P), 3.0)
    misses[:, 1] = 60.0
    ratios = covariance_ratios(misses, joint_parts(BODY.parents))
    assert ratios[1] > 2 * np.delete(ratios, 1).max()
    usual = covariance_ratios(np.zeros((0, P)), joint_parts(BODY.parents))
    assert (usual == usual[0]).all() and usual[0] > 1


def test_a_prediction_that_nothing_determines_says_nothing_of_the_ratio() -> None:
    jacobian = tip_jacobian(BODY, at_rest(BODY))[0]
    vague = _miss(jacobian, np.zeros(BODY.dof), 10.0 * np.eye(BODY.dof))
    np.testing.assert_allclose(vague, 3 * USUAL_RATIO)
    exact = _miss(jacobian, np.zeros(BODY.dof), 1e-4 * np.eye(BODY.dof))
    np.testing.assert_allclose(exact, 0)
    usual = covariance_ratios(np.zeros((0, P)), [0, 1])
    np.testing.assert_allclose(covariance_ratios(np.stack([vague] * 5), [0, 1]), usual)


def test_what_moves_is_less_sure_and_misses_a_key_pose_by_more_before_that_counts() -> None:
    still = at_rest(BODY, 5)
    np.testing.assert_allclose(growth_by_speed(BODY, still), 1)
    np.testing.assert_allclose(growth_by_speed(BODY, at_rest(BODY, 1)), 1)
    path = MOVING_DISPLACEMENT * np.outer(np.arange(5), [0.6, 0, 0.8])
    growth, fast = (
        growth_by_speed(BODY, Motion(still.translations + times * path, still.rotations)) for times in (1, 100)
    )
    np.testing.assert_allclose(growth, (1 + LARGEST_GROWTH) / 2)
    np.testing.assert_allclose(fast, LARGEST_GROWTH, rtol=1e-3)
    jacobian, step = tip_jacobian(BODY, still)[0], np.full(BODY.dof, 0.01)
    slow, moving = (_miss(jacobian, step, 1e-4 * np.eye(BODY.dof), by) for by in (1.0, growth[0]))
    np.testing.assert_allclose(moving, slow / growth[0])


def test_what_no_footage_shows_is_in_the_errors_of_all_frames_but_the_key_poses() -> None:
    covariances = np.tile(1e-12 * np.eye(3), (5, P, 1, 1))
    found = joint_errors(
        BODY, [uncertainty_of(0, covariances, np.zeros((0, P)))], np.tile(1e-4 * np.eye(3) / 3, (5, P, 1, 1))
    )
    np.testing.assert_allclose(found.deviation[1:-1], 0.01, rtol=1e-3)


def arm_turned_away() -> Motion:
    motion = at_rest(BODY, FRAMES)
    Q = motion.rotations.copy()
    Q[LOST, ARM[0]] = Q[LOST, ARM[0]] @ exp(np.array([0.0, 0.0, 1.2]))
    return Motion(motion.translations, Q)


def misfit_of(found: Motion, cameras: tuple = CAMERAS) -> Misfit:
    poses = poses_of([BODY], [at_rest(BODY)])
    return misfit_in([np.stack([silhouette([BODY], poses, 0, c, samples=2)] * FRAMES) for c in cameras], found, cameras)


def misfit_in(shown: list[Array], found: Motion, cameras: tuple = CAMERAS, furniture: bool = True) -> Misfit:
    views = [ViewFrames(c, np.zeros_like(s), 0, foreground=s[None]) for c, s in zip(cameras, shown, strict=True)]
    at, limb_of = {0.0: poses_of([BODY], [found])}, numbered_limbs([BODY]) if furniture else None
    return measured_misfit(views, Geometry.of([BODY]), at, first=0, spans=[slice(0, P)], limb_of=limb_of)


def lost_in(
    misfit: Misfit,
    held: Array | None = None,
    support: Array | None = None,
    whole: Array | float = 0.0,
    bare: Array | float = 1.0,
) -> Array:
    held = np.zeros((FRAMES, P), bool) if held is None else held
    held[[0, -1]] = True
    return lost_probabilities(
        BODY,
        misfit,
        slice(0, P),
        held=held,
        keys=np.array([0, FRAMES - 1]),
        bare=np.broadcast_to(bare, misfit.background.shape),
        support=support,
        whole=whole,
    )


def test_an_arm_that_lies_on_background_may_be_lost_on_these_frames_and_no_other_part_ever() -> None:
    """Where it is lost and found again is known to two frames."""
    said = lost_in(misfit_of(arm_turned_away())) >= REPORTED_PROBABILITY
    assert said[LOST, ARM[0]].all() and said[LOST, ARM[1]].all()
    assert not said[: LOST.start - 2].any() and not said[LOST.stop + 2 :].any()
    assert not np.delete(said, ARM, axis=1).any()


def test_a_body_that_explains_too_little_is_lost_only_where_a_limb_lies_on_background() -> None:
    """Elsewhere it may be lit otherwise than on the key poses."""
    whole = np.full(FRAMES, 0.9)
    said = lost_in(misfit_of(arm_turned_away()), whole=whole)[:, 0] >= REPORTED_PROBABILITY
    assert said[LOST].all()
    assert not said[: LOST.start - 2].any() and not said[LOST.stop + 2 :].any()
    assert lost_in(misfit_of(at_rest(BODY, FRAMES)), whole=whole).max() < 0.2


def test_a_lost_arm_is_expected_to_be_off_by_its_length_not_by_millimetres() -> None:
    lost, covariances = lost_in(misfit_of(arm_turned_away())), np.tile(1e-6 * np.eye(3), (FRAMES, P, 1, 1))
    held = np.zeros(FRAMES, bool)
    held[[0, -1]] = True
    uncertainties = [SegmentUncertainty(0, held, covariances, np.zeros((0, P)), np.zeros(FRAMES), lost, np.zeros(P))]
    found = joint_errors(BODY, uncertainties, np.zeros((FRAMES, P, 3, 3)))
    middle = (LOST.start + LOST.stop) // 2
    assert found.deviation[middle, ARM[1]] > 0.9 * length_of(ARM) > 0.3
    assert np.delete(found.deviation, ARM, axis=1).max() < 0.02 and found.deviation[[0, -1]].max() == 0


def test_a_lost_part_of_an_arm_that_is_found_is_off_by_its_own_length() -> None:
    """The more probable it is that the arm before it is found, the less."""
    lost = np.zeros((3, P))
    lost[0, ARM[1]] = lost[1, ARM] = 0.6
    lost[2, ARM] = 0.3, 0.6
    forearm, both = length_of(ARM[1:]), length_of(ARM)
    np.testing.assert_allclose(lost_lengths(BODY, lost)[:, ARM[1]], [forearm, both, (forearm + both) / 2])
    assert not np.delete(lost_lengths(BODY, lost), ARM, axis=1).any()


def test_a_motion_that_is_right_has_no_lost_part_and_neither_has_one_that_key_poses_hold() -> None:
    assert lost_in(misfit_of(at_rest(BODY, FRAMES))).max() < 0.1
    held = np.zeros((FRAMES, P), bool)
    held[:, ARM] = True
    assert not lost_in(misfit_of(arm_turned_away()), held)[:, ARM].any()


def test_limbs_that_pass_behind_a_post_are_hidden_and_not_lost() -> None:
    """It looks like background, whoever passes; nothing else shows where they are in these views."""
    found = at_rest(BODY, FRAMES)
    found.translations[:, 0] += np.linspace(-0.3, 0.3, FRAMES)
    shown = []
    for camera in CAMERAS:
        seen = np.concatenate(
            [silhouette([BODY], poses_of([BODY], [found[[f]]]), 0, camera, samples=2)[None] for f in range(FRAMES)]
        )
        middle = camera.size[0] // 2
        seen[:, :, middle - 20 : middle + 20] = seen.min()
        shown.append(seen)
    assert lost_in(misfit_in(shown, found, furniture=False)).max() > 0.2
    assert lost_in(misfit_in(shown, found)).max() < 0.05


@pytest.mark.parametrize("front_bare", [True, False])
def test_an_arm_that_one_view_shows_as_background_is_hidden_if_another_shows_it_beside_the_body(
    front_bare: bool,
) -> None:
    """There a bystander stands in front of it; before the body, the other view would not show that it is elsewhere."""
    misfit, bare = arm_on_background(CAMERAS, view=1), np.ones((len(CAMERAS), FRAMES, P))
    bare[0][:, ARM] = float(front_bare)
    said = lost_in(misfit, bare=bare)[LOST, ARM]
    assert (said < 0.1).all() if front_bare else (said >= REPORTED_PROBABILITY).all()


def test_in_a_single_view_an_arm_that_lies_on_background_is_lost_and_not_hidden() -> None:
    assert (lost_in(arm_on_background(CAMERAS[:1], view=0))[LOST, ARM] > 0.8).all()


def arm_on_background(cameras: tuple, view: int, share: float = 1.0, pixels: int = 400) -> Misfit:
    """A misfit in which every part covers 40 pieces, and a share of those of the arm are background in one view."""
    misfit = misfit_of(at_rest(BODY, FRAMES), cameras)
    background = np.zeros_like(misfit.background)
    background[view, LOST, ARM[0]] = background[view, LOST, ARM[1]] = share
    area = np.full_like(background, 40 * PATCH_SIDE**2)
    return replace(misfit, background=background, visible=area, pixels=np.full_like(background, pixels))


def test_a_part_of_a_few_pixels_is_not_lost_because_of_one_of_them() -> None:
    """Somebody far away may cover more pieces of a size than pixels: their share of background then tells little."""
    few, many = (lost_in(arm_on_background(CAMERAS[:1], view=0, share=0.25, pixels=pixels)) for pixels in (4, 400))
    assert few.max() < REPORTED_PROBABILITY < many[LOST, ARM].min()


def test_without_foreground_images_nothing_is_called_lost() -> None:
    assert lost_in(misfit_of(arm_turned_away(), cameras=())).max() < REPORTED_PROBABILITY


def test_a_forearm_that_the_images_speak_against_may_be_lost_even_in_front_of_the_body() -> None:
    """Not the upper arm that they speak for by more, nor one that is hidden, of which they say nothing."""
    misfit, support = misfit_of(at_rest(BODY, FRAMES)), np.full((FRAMES, P), 20.0)
    support[LOST, ARM[1]] = -10.0
    assert (lost_in(misfit, support=support)[LOST, ARM] >= REPORTED_PROBABILITY).all(axis=0).tolist() == [False, True]
    support[LOST, ARM] = 0.0
    assert lost_in(misfit, support=support).max() < 0.1
    support[LOST, ARM] = 5.0, -10.0
    assert (lost_in(misfit, support=support)[LOST, ARM] >= REPORTED_PROBABILITY).all()
