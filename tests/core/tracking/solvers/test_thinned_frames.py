"""Solving on some of the frames: key poses stay exact, and the motion between the kept frames survives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from kfmocap.core.body import part_poses
from kfmocap.core.body.motion import Motion, stacked
from kfmocap.core.evidence.view_frames import ViewFrames
from kfmocap.core.shot.acceleration_prior import USUAL_JOINT
from kfmocap.core.shot.settings import Settings
from kfmocap.core.tracking.solvers import gauss_newton_solver
from kfmocap.core.tracking.solvers.equations.measurement import Workspace
from kfmocap.core.tracking.solvers.equations.problem import WIDEST_STEP, SegmentProblem
from kfmocap.core.tracking.solvers.thinned_frames import (
    ThinnedProblem,
    gap_variance,
    interpolated,
    kept_frames,
    widest_step,
)
from synthetic import CAMERAS, at_rest, dark, ends_held, figure, picture, poses_of, swing

BODY = figure()
LENGTH = 23


def problem(fps: float, *, length: int = LENGTH, **more: object) -> SegmentProblem:
    return replace(
        SegmentProblem(dark(CAMERAS[0], length), (BODY,), 0, fps, (ends_held(BODY, length),)),
        **more,  # type: ignore[arg-type]
    )


def rough_motion(length: int, sigma: float, seed: int) -> Motion:
    """A motion whose second differences are independent, of one standard deviation."""
    steps = np.cumsum(np.random.default_rng(seed).normal(0.0, sigma, (length, BODY.dof)), axis=0)
    steps -= steps.mean(axis=0)
    motion = [at_rest(BODY)]
    for step in steps[1:]:
        motion.append(motion[-1].moved(step[None]))
    return stacked(motion)


@pytest.mark.parametrize("every", [2, 3, 4])
def test_frames_with_keys_and_the_ends_are_kept_and_no_step_is_too_long(every: int) -> None:
    fixed = ends_held(BODY, LENGTH)
    fixed[9, 5] = True  # a key of a single degree of freedom
    frames = kept_frames(problem(60.0, fixed=(fixed,)), every)
    assert {0, 9, LENGTH - 1} <= set(frames.tolist())
    assert np.diff(frames).min() >= 1 and np.diff(frames).max() == every


@pytest.mark.parametrize("every", [2, 3, 4])
def test_kept_poses_stay_the_same_to_the_last_bit(every: int) -> None:
    motion, frames = rough_motion(LENGTH, 0.02, 1), kept_frames(problem(60.0), every)
    found = interpolated(motion[frames], frames, LENGTH)
    np.testing.assert_array_equal(found.translations[frames], motion.translations[frames])
    np.testing.assert_array_equal(found.rotations[frames], motion.rotations[frames])


@pytest.mark.parametrize("every", [2, 3, 4])
def test_a_motion_survives_interpolation_to_within_what_its_accelerations_allow(every: int) -> None:
    """Independent accelerations are the roughest motion that the prior expects."""
    sigma, length = 0.004, 24 * every + 1
    frames = np.arange(0, length, every)
    errors = []
    for seed in range(8):
        motion = rough_motion(length, sigma, seed)
        errors.append(interpolated(motion[frames], frames, length).difference(motion))
    inside = np.setdiff1d(np.arange(4 * every, length - 4 * every), frames)
    worst = max(np.sqrt(np.mean(np.array(errors)[:, inside[inside % every == k]] ** 2)) for k in range(1, every))
    assert worst == pytest.approx(sigma * np.sqrt(gap_variance(every)), rel=0.1)


def test_a_steady_motion_is_interpolated_exactly() -> None:
    start = at_rest(BODY)
    steady = stacked([start.moved(np.full((1, BODY.dof), 0.01 * f)) for f in range(LENGTH)])
    frames = kept_frames(problem(60.0), 4)
    assert np.abs(interpolated(steady[frames], frames, LENGTH).difference(steady)).max() < 1e-3


def test_the_step_follows_from_the_frame_rate_and_from_how_fast_joints_are() -> None:
    motion = [swing(BODY, LENGTH, 0.3)]
    steps = [widest_step(problem(fps), motion) for fps in (15.0, 60.0, 90.0, 600.0)]
    assert steps == sorted(steps)
    assert (steps[0], steps[-1]) == (1, WIDEST_STEP)
    fast = replace(problem(600.0), settings=Settings(joint_acceleration=300 * USUAL_JOINT))
    assert widest_step(fast, motion) < WIDEST_STEP


def test_what_was_estimated_can_make_a_step_shorter_but_not_longer() -> None:
    motion = [swing(BODY, LENGTH, 0.3)]
    whole = problem(60.0)
    usual = widest_step(whole, motion)
    assert usual > 1
    steps = [
        widest_step(replace(whole, typical_variances=(factor**2 * whole.variances(0),)), motion)
        for factor in (0.1, 1.0, 30.0)
    ]
    assert steps[0] == steps[1] == usual > steps[2]


def test_where_frames_are_far_apart_in_time_all_are_solved() -> None:
    assert ThinnedProblem.of(problem(15.0), [swing(BODY, LENGTH, 0.3)]) is None


def test_accelerations_mean_the_same_in_seconds() -> None:
    whole = problem(240.0)
    few = ThinnedProblem.at(whole, kept_frames(whole, 4), 4)
    np.testing.assert_allclose(few.problem.variances(0), 4**4 * whole.variances(0))
    given = replace(whole, typical_variances=(whole.variances(0),))
    few = ThinnedProblem.at(given, kept_frames(whole, 4), 4)
    np.testing.assert_allclose(few.problem.variances(0), 4**4 * whole.variances(0))


def test_a_pair_across_a_torn_one_is_torn_and_damaged_frames_stay_damaged() -> None:
    [view] = dark(CAMERAS[0], LENGTH)
    torn, damaged = np.zeros(LENGTH - 1, bool), np.zeros(LENGTH, bool)
    torn[4], damaged[10] = True, True
    whole = problem(60.0, views=(replace(view, torn=torn, damaged=damaged),))
    [few] = ThinnedProblem.at(whole, np.arange(0, LENGTH, 2), 2).problem.views
    assert few.torn is not None and few.damaged is not None
    assert np.flatnonzero(few.torn).tolist() == [2]
    assert np.flatnonzero(few.damaged).tolist() == [5]


def test_known_poses_beside_a_segment_are_as_far_away_as_the_frames_are_from_each_other() -> None:
    """One step would amplify the error of a pose by as much as frames are left out."""
    motion = swing(BODY, LENGTH + 8, 0.3)
    before, after = (motion[:4],), (motion[LENGTH + 4 :],)
    whole = problem(
        240.0, before=(motion[3:4],), after=(motion[LENGTH + 4 : LENGTH + 5],), beyond=(before, (after[0][:2],))
    )
    few = ThinnedProblem.at(whole, kept_frames(whole, 4), 4).problem
    assert few.before is not None and few.after is not None
    np.testing.assert_array_equal(few.before[0].rotations, motion[:1].rotations)
    np.testing.assert_array_equal(few.after[0].rotations, motion[LENGTH + 5 : LENGTH + 6].rotations)
    assert few.beside == (1.0, 0.5)


def filmed(motion: Motion) -> tuple[ViewFrames, ...]:
    poses = poses_of([BODY], [motion])
    return tuple(
        ViewFrames(c, np.stack([picture([BODY], poses, f, c) for f in range(len(motion))]), 0) for c in CAMERAS
    )


def test_few_frames_lead_to_the_motion_of_all_and_keys_stay_exact() -> None:
    length = 25
    motion = swing(BODY, length, 0.3)
    uniform = motion[:1].difference(motion[-1:])[0] / (length - 1)
    start = [stacked([*(motion[:1].moved(j * uniform[None]) for j in range(length - 1)), motion[-1:]])]
    whole = problem(60.0, length=length, views=filmed(motion), fixed=(ends_held(BODY, length),))
    assert ThinnedProblem.of(whole, start) is not None
    reported: list[int] = []
    workspace = Workspace(on_step=lambda _done, motions: reported.append(len(motions[0])))
    found = gauss_newton_solver.solved(whole, start, workspace).motions[0]
    assert set(reported) == {length}
    np.testing.assert_array_equal(found.rotations[[0, -1]], motion.rotations[[0, -1]])
    np.testing.assert_array_equal(found.translations[[0, -1]], motion.translations[[0, -1]])
    truth = part_poses(BODY, motion)[1]
    before, left = (np.linalg.norm(part_poses(BODY, m)[1] - truth, axis=-1).mean() for m in (start[0], found))
    assert left < 0.05 * before
