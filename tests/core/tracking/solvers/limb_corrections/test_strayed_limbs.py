"""Limbs that a solution has led away from the first pass come back where the evidence is for that, and only there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from keypoint_shots import NAMES, cameras, keypoints_of, seen_places, strolling
from kfmocap.core.body import human
from kfmocap.core.body.motion import Motion
from kfmocap.core.evidence.sampling import Sampling
from kfmocap.core.keypoints.keypoint_factor import KeypointFactor
from kfmocap.core.keypoints.keypoint_offsets import KeypointOffsets
from kfmocap.core.numerics import rotations
from kfmocap.core.tracking.solvers.equations.measurement import Workspace, keypoint_agreement
from kfmocap.core.tracking.solvers.equations.problem import SegmentProblem, SegmentSolution
from kfmocap.core.tracking.solvers.limb_corrections.strayed_limbs import (
    strayed_limbs,
    with_limbs_held,
    with_limbs_returned,
)
from synthetic import dark, look_at

BODY, FRAMES, FPS = human(), 8, 30.0
TRUTH = strolling(BODY, FRAMES)
ARM = [BODY.index(name) for name in ("upper_arm.L", "forearm.L", "hand.L")]
FREE = np.zeros((FRAMES, BODY.dof), bool)


def with_arm_elsewhere(motion: Motion, first: int, last: int) -> Motion:
    turned = motion.rotations.copy()
    turned[first : last + 1, ARM[0]] = turned[first : last + 1, ARM[0]] @ rotations.exp(np.array([0.0, 0.0, 1.0]))
    return replace(motion, rotations=turned)


def noisy(motion: Motion) -> Motion:
    """A little off everywhere, as the first pass is."""
    return motion.moved(np.random.default_rng(0).normal(0, 0.01, (FRAMES, BODY.dof)))


@pytest.fixture(scope="module")
def problem() -> SegmentProblem:
    """Keypoints that show the true motion, and pictures that show nothing."""
    seen = keypoints_of(cameras(2), seen_places(BODY, TRUTH))
    factor = KeypointFactor(seen, KeypointOffsets.on(BODY, NAMES), 9.0)
    camera = look_at("front", (0.5, -4.0, 1.3), (0, 0, 0.95), (160, 120), 140)
    return SegmentProblem(dark(camera, FRAMES), (BODY,), 0, FPS, (FREE,), keypoints=(factor,))


def solution(problem: SegmentProblem, motion: Motion) -> SegmentSolution:
    evidence = Workspace().measure(problem, [motion], Sampling(1.0, 1.0, 3, 0.07)).evidence
    return SegmentSolution.of([motion], evidence, iterations=1, energy=[0.0])


@pytest.mark.parametrize(("last", "expected"), [(2, []), (3, [ARM]), (6, [ARM])])
def test_a_limb_has_strayed_that_is_elsewhere_for_more_than_a_moment(
    problem: SegmentProblem, last: int, expected: list[list[int]]
) -> None:
    assert strayed_limbs(problem, 0, noisy(TRUTH), with_arm_elsewhere(TRUTH, 1, last)) == expected


def test_where_all_is_off_alike_nothing_has_strayed(problem: SegmentProblem) -> None:
    beside = replace(TRUTH, translations=TRUTH.translations + [0.2, 0.0, 0.0])
    assert strayed_limbs(problem, 0, beside, TRUTH) == []


def test_a_limb_comes_back_to_where_keypoints_show_it(problem: SegmentProblem) -> None:
    away = with_arm_elsewhere(TRUTH, 1, 6)
    found = with_limbs_returned(problem, [noisy(TRUTH)], solution(problem, away), Workspace())
    before, after = (np.abs(seen_places(BODY, m) - seen_places(BODY, TRUTH)).max() for m in (away, found.motions[0]))
    assert before > 0.3
    assert after < 0.03
    assert keypoint_agreement(problem, found.motions) > keypoint_agreement(problem, [away]) + 0.05


def test_a_limb_that_keypoints_show_where_it_is_stays(problem: SegmentProblem) -> None:
    """It is the first pass that has the arm in the wrong place."""
    right = solution(problem, TRUTH)
    assert with_limbs_returned(problem, [with_arm_elsewhere(TRUTH, 1, 6)], right, Workspace()) is right


def test_limbs_are_held_and_no_more(problem: SegmentProblem) -> None:
    (fixed,) = with_limbs_held(problem, 0, [ARM]).fixed
    held = [3 + 3 * part + axis for part in ARM for axis in range(3)]
    assert fixed[:, held].all() and fixed.sum() == FRAMES * len(held)


def test_each_performer_agrees_with_its_own_keypoints(problem: SegmentProblem) -> None:
    other = replace(TRUTH, translations=TRUTH.translations + [1.5, 0.0, 0.0])
    seen = keypoints_of(cameras(2), seen_places(BODY, other))
    factors = (*problem.keypoints, KeypointFactor(seen, KeypointOffsets.on(BODY, NAMES), 9.0))
    both = replace(problem, bodies=(BODY, BODY), fixed=(FREE, FREE), keypoints=factors)
    motions = [TRUTH, replace(other, translations=other.translations + [0.0, 0.0, 0.3])]
    assert keypoint_agreement(both.alone(0), motions) == pytest.approx(1)
    assert keypoint_agreement(both.alone(1), motions) < 0.2
