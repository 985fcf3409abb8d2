"""The initial solution follows the motion from a key pose, forward or backward, a few frames at a time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from kfmocap.core.body import landmark_positions
from kfmocap.core.body.motion import Motion, stacked
from kfmocap.core.errors import CancelledError
from kfmocap.core.evidence.view_frames import ViewFrames
from kfmocap.core.shot.settings import Settings
from kfmocap.core.tracking.solvers import descent_stages, gauss_newton
from kfmocap.core.tracking.solvers.equations.measurement import Workspace
from kfmocap.core.tracking.solvers.equations.problem import SegmentProblem, SegmentSolution
from kfmocap.core.tracking.solvers.starts import sequential_start
from kfmocap.core.tracking.solvers.starts.sequential_start import blended, follow
from synthetic import CAMERAS, figure, picture, poses_of, random_motion, silhouette, swing

Array = np.ndarray
BODY = figure()
D = BODY.dof
LENGTH = 13
TRUTH = swing(BODY, LENGTH)
FPS = 12.0


def error_mm(found: Motion, truth: Motion = TRUTH) -> Array:
    """Mean distance of the landmarks on every frame."""
    a, b = (landmark_positions(BODY, motion, list(BODY.landmarks)) for motion in (found, truth))
    return 1000 * np.linalg.norm(a - b, axis=-1).mean(axis=1)


def held(*frames: int, length: int = LENGTH) -> Array:
    fixed = np.zeros((length, D), bool)
    fixed[list(frames)] = True
    return fixed


def still(frame: int) -> Motion:
    return stacked([TRUTH[[frame]]] * LENGTH)


@pytest.fixture(scope="module")
def views() -> tuple[ViewFrames, ...]:
    poses = poses_of([BODY], [TRUTH])
    frames = range(LENGTH)
    return tuple(
        ViewFrames(
            c,
            np.stack([picture([BODY], poses, f, c) for f in frames]),
            0,
            np.stack([silhouette([BODY], poses, f, c, samples=2) for f in frames])[None],
        )
        for c in CAMERAS
    )


def in_window(problem: SegmentProblem, start: Sequence[Motion], workspace: Workspace) -> SegmentSolution:
    unpredicted = replace(problem, settings=replace(problem.settings, prediction=False))
    return gauss_newton.descend(unpredicted, start, workspace, descent_stages.WINDOW_STAGES)


@pytest.mark.parametrize(("backward", "limit_mm"), [(False, 25), (True, 60)])
def test_from_one_pose_alone_the_motion_is_followed_to_the_other_end(
    views: tuple[ViewFrames, ...], backward: bool, limit_mm: float
) -> None:
    key = LENGTH - 1 if backward else 0
    problem = SegmentProblem(views, (BODY,), 0, FPS, (held(key),))
    [found] = follow(problem, [still(key)], Workspace(), in_window, backward=backward)
    assert error_mm(still(key)).max() > 150
    assert error_mm(found).max() < limit_mm
    np.testing.assert_allclose(found[[key]].difference(TRUTH[[key]]), 0, atol=1e-12)


@pytest.fixture
def short_windows(monkeypatch: pytest.MonkeyPatch) -> None:
    """Several of them in a short motion."""
    monkeypatch.setattr(sequential_start, "WINDOW", 6)
    monkeypatch.setattr(sequential_start, "WINDOW_STEP", 3)


class Halfway:
    """A solver that goes half of the way to the truth, and notes what it was given."""

    def __init__(self, truth: Motion) -> None:
        self.truth = truth
        self.problems: list[SegmentProblem] = []
        self.starts: list[Motion] = []

    def __call__(self, problem: SegmentProblem, start: Sequence[Motion], workspace: Workspace) -> SegmentSolution:
        self.problems.append(problem)
        self.starts.append(start[0])
        frames = slice(problem.first, problem.first + problem.length)
        step = 0.5 * start[0].difference(self.truth[frames]) * ~problem.fixed[0]
        share, none = np.ones((1, problem.length, len(BODY))), np.zeros(problem.length)
        return SegmentSolution((start[0].moved(step),), 1, (0.0,), share, none[None], none[None], none, {})


def followed(truth: Motion, start: Motion, fixed: Array, backward: bool = False) -> tuple[Motion, Halfway]:
    solver = Halfway(truth)
    [found] = follow(SegmentProblem((), (BODY,), 0, FPS, (fixed,)), [start], Workspace(), solver, backward=backward)
    return found, solver


@pytest.mark.parametrize("length", [2, 3, 6, 7, 8, 13])
def test_backward_is_forward_of_reversed_time(length: int) -> None:
    truth = swing(BODY, length)
    start = stacked([truth[[0]]] * length)
    ahead, _ = followed(truth, start, held(0, length=length))
    back, _ = followed(truth[::-1], start[::-1], held(length - 1, length=length), backward=True)
    np.testing.assert_allclose(back[::-1].difference(ahead), 0, atol=1e-12)


@pytest.mark.usefixtures("short_windows")
@pytest.mark.parametrize("backward", [False, True])
def test_a_window_begins_behind_what_is_solved_and_holds_it(backward: bool) -> None:
    key = LENGTH - 1 if backward else 0
    found, solver = followed(TRUTH, still(key), held(key), backward)
    solved = np.zeros(LENGTH, int)
    for problem in solver.problems:
        fixed = problem.fixed[0]
        free = problem.first + np.flatnonzero(~fixed.any(axis=1))
        assert 1 <= len(free) <= sequential_start.WINDOW and problem.length - len(free) in (1, 2)
        assert (fixed.all(axis=1) | ~fixed.any(axis=1)).all()
        assert problem.before is None and problem.after is None
        solved[free] += 1
    assert solved[key] == 0 and (np.delete(solved, key) >= 1).all() and solved.max() == 2
    for one, other in zip(solver.problems, solver.problems[1:], strict=False):
        assert (other.first > one.first) or backward
    assert error_mm(found).max() < error_mm(still(key)).max()


@pytest.mark.usefixtures("short_windows")
def test_a_uniform_motion_is_carried_on_nearly_as_it_is() -> None:
    """The guess for the frames to come goes on from the last two; its speed fades slowly."""
    step = np.zeros((1, D))
    step[0, 0], step[0, 5], step[0, 8] = 0.02, 0.03, -0.05
    poses = stacked([TRUTH[[0]].moved(j * step) for j in range(LENGTH)])
    keys = 7
    start = stacked([poses[:keys], *[poses[[0]]] * (LENGTH - keys)])
    _, solver = followed(poses, start, held(*range(keys)))
    window, guess = solver.problems[2], solver.starts[2]  # of the first that goes on from keyed frames alone
    last = window.first + len(guess) - 1
    assert window.first == keys - 2
    went, missing = (np.abs(m.difference(poses[[last]])).max() for m in (poses[[keys - 1]], guess[-1:]))
    assert missing < 0.35 * went


def test_fixed_degrees_of_freedom_are_kept() -> None:
    start = random_motion(BODY, LENGTH, turn=0.1, shift=0.02)
    fixed = held(0)
    fixed[5, 6:9] = fixed[9, :3] = fixed[:, 12:15] = True
    found, solver = followed(TRUTH, start, fixed)
    np.testing.assert_allclose(start.difference(found)[fixed], 0, atol=1e-9)
    assert np.abs(start.difference(found)[1:, 3:6]).min(axis=1).max() > 1e-3
    for problem, guess in zip(solver.problems, solver.starts, strict=True):
        span = slice(problem.first, problem.first + problem.length)
        own = fixed[span] & problem.fixed[0]
        np.testing.assert_array_equal(own, fixed[span])
        np.testing.assert_allclose(start[span].difference(guess)[own], 0, atol=1e-9)


def test_the_start_is_not_written_to() -> None:
    start = still(0)
    before = start.moved(np.zeros((LENGTH, D)))
    followed(TRUTH, start, held(0))
    np.testing.assert_array_equal(start.translations, before.translations)
    np.testing.assert_allclose(start.rotations, before.rotations, atol=1e-15)


@pytest.mark.usefixtures("short_windows")
def test_progress_is_reported_and_may_end_the_job() -> None:
    reported: list[float] = []

    def on_step(done: float, motions: Sequence[Motion]) -> None:
        assert len(motions) == 1 and len(motions[0]) == LENGTH
        reported.append(done)
        if len(reported) == 3:
            raise CancelledError

    solver, problem = Halfway(TRUTH), SegmentProblem((), (BODY,), 0, FPS, (held(0),))
    with pytest.raises(CancelledError):
        follow(problem, [still(0)], Workspace(on_step=on_step), solver)
    assert len(solver.problems) == 2
    assert reported == sorted(reported) and reported[0] > 0 and reported[-1] < 1


class Blindfolded(Halfway):
    """Sees nothing of a part on some frames."""

    part, hidden = 2, range(9, LENGTH)

    def __call__(self, problem: SegmentProblem, start: Sequence[Motion], workspace: Workspace) -> SegmentSolution:
        solution = super().__call__(problem, start, workspace)
        share = solution.share.copy()
        blind = [f - problem.first for f in self.hidden if 0 <= f - problem.first < problem.length]
        share[:, blind, self.part] = 0
        # Where it is blind, what it finds is nonsense.
        nonsense = np.zeros((problem.length, D))
        nonsense[blind, 3 + 3 * self.part] = 0.7
        [found] = solution.motions
        return replace(solution, motions=(found.moved(nonsense * ~problem.fixed[0]),), share=share)


@pytest.mark.usefixtures("short_windows")
def test_a_part_that_is_hidden_is_predicted() -> None:
    step = np.zeros((1, D))
    step[0, 11] = 0.08
    poses = stacked([TRUTH[[0]].moved(j * step) for j in range(LENGTH)])
    start = stacked([poses[[0]]] * LENGTH)
    problem = SegmentProblem((), (BODY,), 0, FPS, (held(*range(8)),))
    start = start.replaced(0, poses[:8])
    errors = []
    for prediction in (True, False):
        posed = replace(problem, settings=Settings(prediction=prediction))
        [found] = follow(posed, [start], Workspace(), Blindfolded(poses))
        errors.append(np.abs(found.difference(poses)[9:, 9:12]).max())
    assert errors[0] < 0.15 and errors[1] > 0.6


def test_blended_begins_with_the_first_and_ends_with_the_second() -> None:
    a, b = random_motion(BODY, LENGTH, 0, turn=0.3), random_motion(BODY, LENGTH, 1, turn=0.3)
    [found] = blended([a], [b])
    np.testing.assert_allclose(found[[0]].difference(a[[0]]), 0, atol=1e-9)
    np.testing.assert_allclose(found[[-1]].difference(b[[-1]]), 0, atol=1e-9)
    middle = LENGTH // 2
    np.testing.assert_allclose(
        a[[middle]].difference(found[[middle]]), found[[middle]].difference(b[[middle]]), atol=1e-9
    )
    [same] = blended([a], [a])
    np.testing.assert_allclose(same.difference(a), 0, atol=1e-12)
    [back] = blended([b[::-1]], [a[::-1]])
    np.testing.assert_allclose(back[::-1].difference(found), 0, atol=1e-9)
