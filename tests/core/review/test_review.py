"""Review: how far off joints may be, and where one more key pose would help most."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from kfmocap.core.body import part_poses
from kfmocap.core.body.motion import Motion
from kfmocap.core.evidence.misfit import measured_misfit
from kfmocap.core.evidence.rendering.part_geometry import Geometry
from kfmocap.core.evidence.view_frames import ViewFrames
from kfmocap.core.numerics.rotations import exp
from kfmocap.core.review import suggestions
from kfmocap.core.review.suggestions import MAX_ERROR_SUGGESTIONS, MIN_SPACING, KeySuggestion
from kfmocap.core.shot.shot import KeyPoses
from kfmocap.core.tracking.expected_errors.joint_covariances import tip_covariances, tip_jacobian
from kfmocap.core.tracking.expected_errors.uncertainty import expected_errors
from synthetic import at_rest, figure, look_at, poses_of, random_motion, silhouette

Array = np.ndarray
BODY = figure()
CAMERAS = [look_at("front", (0.3, -2.4, 1.4)), look_at("side", (-2.2, -1.2, 1.5))]
P = len(BODY)
HALF_TURN = exp(np.array([0.0, 0.0, 1.2]))


def tips(motion: Motion) -> Array:
    R, T = part_poses(BODY, motion)
    lengths = [np.linalg.norm(part.tail_world - part.head_world) for part in BODY.parts]
    return R[..., 1] * np.array(lengths)[:, None] + T


def tip_deviations(motion: Motion, covariances: Array) -> Array:
    return np.sqrt(np.trace(tip_covariances(tip_jacobian(BODY, motion), covariances), axis1=2, axis2=3))


def test_the_deviation_of_a_tip_is_that_of_poses_drawn_with_their_covariance() -> None:
    rng = np.random.default_rng(0)
    motion = random_motion(BODY, 2)
    A = rng.normal(0, 0.002, (2, BODY.dof, BODY.dof))
    covariances = A @ np.swapaxes(A, 1, 2)
    expected = []
    for f in range(2):
        drawn = motion[[f] * 8000].moved(rng.normal(size=(8000, BODY.dof)) @ A[f].T)
        apart = tips(drawn) - tips(motion[[f]])
        expected.append(np.sqrt((apart**2).sum(axis=-1).mean(axis=0)))
    np.testing.assert_allclose(tip_deviations(motion, covariances), expected, rtol=0.05)


def test_what_is_held_does_not_deviate() -> None:
    assert not tip_deviations(at_rest(BODY, 3), np.zeros((3, BODY.dof, BODY.dof))).any()


def arm_out_of_place(frames: int, wrong: list[int]) -> tuple[Motion, Motion]:
    """The true motion, and one with an arm turned away on some frames."""
    truth = at_rest(BODY, frames)
    Q = truth.rotations.copy()
    Q[wrong, 1] = Q[wrong, 1] @ HALF_TURN
    return truth, Motion(truth.translations, Q)


def gaps(truth: Motion, found: Motion, known: list[int], cameras: list = CAMERAS) -> Array:
    poses = poses_of([BODY], [truth])
    views = []
    for camera in cameras:
        seen = np.stack([silhouette([BODY], poses, 0, camera, samples=2)] * len(truth))  # the true pose stands still
        views.append(ViewFrames(camera, np.zeros_like(seen), 0, foreground=seen[None]))
    at = {0.0: poses_of([BODY], [found])}
    misfit = measured_misfit(views, Geometry.of([BODY]), at, first=0, spans=[slice(0, P)])
    (row,) = misfit.mean_gaps([np.array(known, int)])
    return row


def test_an_uncovered_limb_leaves_a_gap_on_its_frames_alone() -> None:
    row = gaps(*arm_out_of_place(5, [2, 3]), known=[0, 4])
    assert (row[[2, 3]] > 0.003).all()
    assert (row[[0, 1, 4]] < 1e-3).all()


def test_the_gap_of_a_model_beside_the_performer_is_its_mean_distance_from_the_outline() -> None:
    """Of a shift s the area uncovered is s times the width across it; a closed outline is some pi times as long."""
    truth = at_rest(BODY, 3)
    shift = 0.05
    found = replace(truth, translations=truth.translations + np.array([[0, 0, 0], [0, 0, shift], [0, 0, 0]]))
    row = gaps(truth, found, [0, 2])
    assert 0.15 * shift < row[1] < 0.5 * shift


def test_what_a_model_lacks_on_its_key_frames_does_not_count_as_a_gap() -> None:
    wide = replace(BODY, parts=tuple(replace(part, vertices=1.15 * part.vertices) for part in BODY.parts))
    truth = at_rest(BODY, 4)
    poses = poses_of([wide], [truth])
    views = [
        ViewFrames(
            c, np.zeros((4, 120, 160), np.uint8), 0, np.stack([silhouette([wide], poses, 0, c, samples=2)] * 4)[None]
        )
        for c in CAMERAS
    ]
    at = {0.0: poses_of([BODY], [truth])}
    misfit = measured_misfit(views, Geometry.of([BODY]), at, first=0, spans=[slice(0, P)])
    unknown, known = (misfit.mean_gaps([np.array(keys, int)]) for keys in ([], [0, 3]))
    assert (unknown > 1e-3).all()
    np.testing.assert_allclose(known, 0, atol=1e-9)


def test_a_view_that_sees_nobody_or_has_no_foreground_changes_no_gap() -> None:
    truth, found = arm_out_of_place(4, [2])
    away = look_at("away", (-2.4, -1.4, 1.3), (-5.0, -3.0, 1.3))
    alone = gaps(truth, found, [0, 3])
    np.testing.assert_allclose(gaps(truth, found, [0, 3], [*CAMERAS, away]), alone)
    blind = ViewFrames(CAMERAS[0], np.zeros((4, 120, 160), np.uint8), 0)
    at = {0.0: poses_of([BODY], [found])}
    misfit = measured_misfit([blind], Geometry.of([BODY]), at, first=0, spans=[slice(0, P)])
    assert not misfit.mean_gaps([np.array([0, 3])]).any()


def suggest_keys_by_error(deviation: Array, keys: KeyPoses) -> list[KeySuggestion]:
    return suggestions.suggest_keys_by_error(deviation, keys, BODY.parents)


def keys_at(*frames: int) -> KeyPoses:
    return KeyPoses.whole(list(frames), at_rest(BODY, len(frames)))


def bump(centre: int, length: int = 40, height: float = 0.05, width: float = 4.0) -> Array:
    return height * np.exp(-(((np.arange(length) - centre) / width) ** 2))[:, None] * np.ones(P)


def test_the_first_suggestion_is_where_most_is_wrong() -> None:
    deviation = bump(27) + bump(9, height=0.02)
    first, second, *_ = suggest_keys_by_error(deviation, keys_at(0, 18, 39))
    assert abs(first.frame - 27) <= 2 and abs(second.frame - 9) <= 2
    assert first.deviation == pytest.approx(deviation[first.frame].mean())


def test_the_ends_of_limbs_do_not_count() -> None:
    deviation = bump(27)
    deviation[:, [2, 3]] += bump(9, height=1.0)[:, [2, 3]]  # the forearm's and the right arm's tips are no joints
    first, *_ = suggest_keys_by_error(deviation, keys_at(0, 18, 39))
    assert abs(first.frame - 27) <= 2 and set(first.parts) == {0, 1}
    np.testing.assert_allclose(expected_errors(deviation, BODY.parents), deviation[:, [0, 1]].mean(axis=1))


def test_suggestions_lose_in_gain_and_keep_apart() -> None:
    keys = keys_at(0, 20, 39)
    found = suggest_keys_by_error(bump(10) + bump(30) + 0.01, keys)
    assert 1 < len(found) <= MAX_ERROR_SUGGESTIONS
    assert all(a.gain >= b.gain > 0 for a, b in itertools.pairwise(found))
    frames = [key.frame for key in found]
    assert all(abs(f - k) >= MIN_SPACING for f in frames for k in [0, 20, 39])
    assert all(abs(a - b) >= MIN_SPACING for i, a in enumerate(frames) for b in frames[:i])


def walk_errors(length: int, known: Sequence[int]) -> Array:
    """Return the standard deviation on every frame of a random walk that is zero on some frames, and one shot's length
    before and after the shot.
    """
    at = np.arange(length) + length
    covariance = np.minimum.outer(at, at)
    seen = length + np.array([*known, 2 * length])
    towards = np.minimum.outer(at, seen)
    explained = towards @ np.linalg.solve(np.minimum.outer(seen, seen), towards.T)
    return np.sqrt(np.maximum(np.diagonal(covariance - explained), 0))


@pytest.mark.parametrize("known", [(0, 30), (12,), (20, 30), ()])
def test_the_gain_is_what_a_key_pose_takes_from_errors_that_drift_like_a_random_walk(known: tuple[int, ...]) -> None:
    before = walk_errors(31, known)
    allowed = [f for f in range(31) if all(abs(f - k) >= MIN_SPACING for k in known)]
    after = {f: walk_errors(31, [*known, f]).mean() for f in allowed}
    (best, *_) = suggest_keys_by_error(0.001 * before[:, None] * np.ones(P), keys_at(*known))
    assert best.frame in allowed and after[best.frame] == pytest.approx(min(after.values()))
    assert best.gain == pytest.approx(0.001 * (before.mean() - after[best.frame]))


def test_the_parts_that_are_farthest_off_are_named() -> None:
    deviation = bump(20)
    deviation[:, 0] *= 3
    deviation[:, 1] *= 2.5
    assert suggest_keys_by_error(deviation, keys_at(0, 39))[0].parts == (0, 1)


def test_a_partial_key_pose_does_not_end_the_need_of_a_whole_one() -> None:
    keys = keys_at(0, 20, 39)
    fixed = keys.fixed.copy()
    fixed[1, 6:] = False
    found = suggest_keys_by_error(bump(20), replace(keys, fixed=fixed))
    assert abs(found[0].frame - 20) <= 1


def test_nothing_is_suggested_where_nothing_is_wrong_or_no_frame_is_free() -> None:
    assert suggest_keys_by_error(np.zeros((40, P)), keys_at(0, 39)) == []
    assert suggest_keys_by_error(bump(2, 5), keys_at(0, 4)) == []
