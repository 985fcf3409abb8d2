"""A body that lies otherwise than the images show it is called lost as a whole, on these frames and no others."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from kfmocap.core.body import human
from kfmocap.core.body.limbs import limbs
from kfmocap.core.body.motion import Motion
from kfmocap.core.body.tip_landmarks import tip_landmarks
from kfmocap.core.evidence.sampling import Sampling
from kfmocap.core.evidence.view_frames import ViewFrames
from kfmocap.core.numerics.rotations import exp
from kfmocap.core.tracking.expected_errors.lost_body import lost_body_probabilities
from kfmocap.core.tracking.expected_errors.lost_limbs import lost_lengths
from kfmocap.core.tracking.expected_errors.uncertainty import (
    REPORTED_PROBABILITY,
    JointErrors,
    SegmentUncertainty,
    joint_errors,
)
from kfmocap.core.tracking.solvers.assessment.solution_doubts import MIN_EXPLAINED_RATIO
from kfmocap.core.tracking.solvers.equations.measurement import Workspace
from kfmocap.core.tracking.solvers.equations.problem import SegmentProblem, SegmentSolution
from synthetic import at_rest, coloured, ends_held, look_at

Array = np.ndarray
BODY, FRAMES, LOST = human(1.75), 24, slice(9, 16)
P = len(BODY)
CAMERAS = (look_at("front", (0.3, -2.9, 1.2)), look_at("side", (-2.7, -1.2, 1.3)))
TRUE = at_rest(BODY, FRAMES)
SHOWN = coloured(BODY, TRUE, CAMERAS)
ARM = max(limbs(BODY), key=lambda chain: BODY.names[chain[-1]] == "hand.L")


def turned_over() -> Motion:
    """The body lies on its side for a while instead of standing."""
    Q = TRUE.rotations.copy()
    Q[LOST, 0] = exp(np.array([0.0, 0.0, 1.5])) @ Q[LOST, 0]
    return Motion(TRUE.translations, Q)


def length_of(parts: list[int]) -> float:
    return sum(float(np.linalg.norm(BODY.parts[part].tail_world - BODY.parts[part].head_world)) for part in parts)


def solved(
    found: Motion, fixed: Array | None = None, views: tuple[ViewFrames, ...] = SHOWN
) -> tuple[SegmentProblem, SegmentSolution]:
    keys = ends_held(BODY, FRAMES) if fixed is None else fixed
    problem = SegmentProblem(views, (BODY,), 0, 30.0, (keys,))
    measured = Workspace().measure(problem, [found], Sampling(1.0, 1.0, 2, 0.07)).evidence
    return problem, SegmentSolution.of([found], measured, iterations=1, energy=[0.0])


def lost_in(
    found: Motion, confirmed: slice = slice(0, 0), keys: Array | None = None, views: tuple[ViewFrames, ...] = SHOWN
) -> Array:
    problem, solution = solved(found, keys, views)
    held = np.repeat(problem.fixed[0].all(axis=1)[:, None], P, axis=1)
    held[confirmed, list(tip_landmarks(BODY))] = True
    return lost_body_probabilities(problem, solution, 0, held)


def test_a_body_that_lies_where_the_images_show_it_standing_is_lost_on_these_frames() -> None:
    said = lost_in(turned_over()) >= REPORTED_PROBABILITY
    assert said[LOST].all()
    assert not said[: LOST.start - 2].any() and not said[LOST.stop + 2 :].any()


def test_a_body_that_is_right_is_not_lost() -> None:
    assert not lost_in(TRUE).any()


@pytest.mark.parametrize("key_poses", [0, 1])
def test_nor_is_one_beyond_the_last_key_pose_or_without_any_where_nothing_shows_it(key_poses: int) -> None:
    """With a single key pose a solver doubts every solution, but that says nothing of the images."""
    keys = np.zeros((FRAMES, BODY.dof), bool)
    keys[:key_poses] = True
    assert not lost_in(TRUE, keys=keys).any()


def test_beyond_the_last_key_pose_a_body_may_be_lost_too() -> None:
    keys = np.zeros((FRAMES, BODY.dof), bool)
    keys[0] = True
    assert (lost_in(turned_over(), keys=keys)[LOST] >= REPORTED_PROBABILITY).all()


def test_nor_one_that_shows_less_because_it_points_at_the_camera() -> None:
    """There is no more to explain."""
    bowed = TRUE.rotations.copy()
    bowed[LOST, 0] = exp(np.array([1.4, 0.0, 0.0])) @ bowed[LOST, 0]
    true = Motion(TRUE.translations, bowed)
    views = coloured(BODY, true, [look_at("ahead", (0.0, -3.2, 1.0))])
    explained = solved(true, views=views)[1].explained[0]
    assert explained[LOST].max() < MIN_EXPLAINED_RATIO * explained[0]
    assert lost_in(true, views=views).max() < 0.1


def test_nor_one_that_keypoints_confirm() -> None:
    assert not lost_in(turned_over(), slice(0, FRAMES)).any()


def test_without_foreground_images_no_body_is_called_lost() -> None:
    plain = tuple(replace(view, foreground=None) for view in SHOWN)
    assert not lost_in(turned_over(), views=plain).any()


def test_a_lost_body_may_be_off_by_its_trunk_and_its_limbs_by_more() -> None:
    """So may the shoulders, which would be found if every limb were lost by itself."""
    whole = np.zeros((FRAMES, P))
    whole[LOST] = 1.0
    held = np.zeros(FRAMES, bool)
    held[[0, -1]] = True
    covariances = np.tile(1e-6 * np.eye(3), (FRAMES, P, 1, 1))
    one = SegmentUncertainty(0, held, covariances, np.zeros((0, P)), np.zeros(FRAMES), whole, np.zeros(P))
    errors = joint_errors(BODY, [one], np.zeros((FRAMES, P, 3, 3)))
    head, hand = BODY.parts[BODY.index("head")], BODY.index("hand.L")
    trunk = float(np.linalg.norm(head.tail_world - BODY.parts[0].head_world))
    assert errors.deviation[LOST, BODY.index("shoulder.L")].min() > 0.95 * trunk > 0.6
    assert errors.deviation[LOST, hand].min() > trunk + 0.3
    assert errors.deviation[: LOST.start].max() < 0.01


def test_a_limb_that_may_be_lost_with_the_body_or_alone_is_off_by_what_is_between() -> None:
    both = np.zeros((3, P))
    both[0] = both[2] = 0.5
    both[1, ARM] = 0.5
    both[2, ARM] = 1.0
    whole, alone, mixed = lost_lengths(BODY, both)[:, ARM[-1]]
    assert whole == pytest.approx(
        length_of([*(BODY.index(name) for name in ("pelvis", "spine", "chest", "shoulder.L")), *ARM])
    )
    assert alone == pytest.approx(length_of(ARM))
    assert mixed == pytest.approx((whole + alone) / 2)


def test_the_whole_body_is_named_once_and_its_parts_where_they_are_lost_alone() -> None:
    lost = np.zeros((3, P))
    lost[0], lost[1, ARM] = 0.9, 0.9
    errors = JointErrors(lost, lost, lost)
    assert errors.body_maybe_lost().tolist() == [True, False, False]
    parts = errors.parts_maybe_lost()
    assert np.flatnonzero(parts[1]).tolist() == sorted(ARM)
    assert not parts[[0, 2]].any()
