"""The initial solution of the relaxation follows gradients alone; what is hidden is predicted and does not count."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from kfmocap.core.body.motion import Motion, stacked
from kfmocap.core.evidence.view_frames import ViewFrames
from kfmocap.core.numerics import rotations
from kfmocap.core.numerics.repeatable import GRID
from kfmocap.core.shot.settings import Settings
from kfmocap.core.tracking.solvers.equations.measurement import MeasuredMotion, Workspace
from kfmocap.core.tracking.solvers.equations.problem import SegmentProblem
from kfmocap.core.tracking.solvers.paper_relaxation import gradient_following
from kfmocap.core.tracking.solvers.paper_relaxation.gradient_following import (
    follow_gradients,
    out_of_sight,
    predicted_step,
    without_drift,
)
from kfmocap.core.tracking.solvers.paper_relaxation.motion_steps import Steps
from kfmocap.core.tracking.solvers.paper_relaxation.relaxation import relaxed
from made_evidence import AlteredWorkspace, with_share
from synthetic import at_rest, ends_held, figure, look_at, picture, poses_of, random_motion

BODY = figure()
D, PARTS = BODY.dof, len(BODY)
ARM = [BODY.index("upper_arm.L"), BODY.index("forearm.L")]
HIDDEN_FROM = 8
WITH, WITHOUT = Settings("relaxation", sweeps=20), Settings("relaxation", sweeps=20, prediction=False)


def test_an_initial_solution_ends_at_the_key_pose_and_has_lost_most_of_its_drift() -> None:
    """Drift of velocities that wander, in place and turn: closer than as it was, and than with equal shares (28)."""
    n, draws = 20, 200
    s = np.linspace(0, 1, n + 1)[:, None]
    errors = np.zeros(3)
    keyed, fixed = at_rest(BODY, n + 1), ends_held(BODY, n + 1)
    for seed in range(draws):
        drift = np.random.default_rng(seed).normal(0, 1e-4, (n + 1, D))
        drift[0] = 0.0
        drift = drift.cumsum(axis=0).cumsum(axis=0)
        strayed = keyed.moved(drift)
        found = without_drift(strayed, keyed, fixed)
        np.testing.assert_allclose(found.difference(keyed)[[0, -1]], 0, atol=1e-12)
        equal = strayed.moved(s * strayed.difference(keyed)[-1])
        errors += [np.square(m.difference(keyed)[1:-1]).sum() for m in (found, strayed, equal)]
    assert errors[0] < 0.1 * errors[1] and errors[0] < 0.5 * errors[2]
    fixed[-1, 3:] = False
    np.testing.assert_allclose(without_drift(strayed, keyed, fixed).rotations, strayed.rotations, atol=1e-12)


def turning(frames: int) -> Motion:
    """One joint turns to and fro about an axis, the root walks, the rest stands still."""
    motion = at_rest(BODY, frames)
    angle = 0.6 * np.sin(2 * np.pi * np.arange(frames) / 20)
    motion.rotations[:, ARM[0]] = rotations.exp(angle[:, None] * [0.0, 0.6, 0.8])
    motion.translations[:, 0] += 0.01 * np.arange(frames)
    return motion


def test_a_hidden_parts_steps_continue_its_series() -> None:
    motion = turning(60)
    hidden = np.zeros((59, PARTS), bool)
    hidden[50:, ARM[0]] = True
    known, found = motion[:51], []
    for j in range(50, 56):
        found.append(predicted_step(known, hidden[:j]))
        known = stacked([known, known[-1:].moved(found[-1][None])])
    truth = Steps.of(motion).vectors()[50:56]
    joint = slice(3 + 3 * ARM[0], 6 + 3 * ARM[0])
    off = np.linalg.norm(np.array(found)[:, joint] - truth[:, joint], axis=1)
    assert off.max() < 0.2 * np.linalg.norm(truth[:, joint], axis=1).max()


def test_what_was_predicted_teaches_nothing() -> None:
    motion = turning(50)
    hidden = np.zeros((49, PARTS), bool)
    hidden[40:, ARM[0]] = True
    wild = motion.replaced(41, random_motion(BODY, 9))
    wild.rotations[:, [p for p in range(PARTS) if p != ARM[0]]] = np.eye(3)
    wild.translations[:] = motion.translations
    np.testing.assert_allclose(predicted_step(wild, hidden), predicted_step(motion, hidden), atol=1e-12)


def test_before_it_was_ever_seen_a_part_stands_still() -> None:
    assert not predicted_step(at_rest(BODY), np.zeros((0, PARTS), bool)).any()
    assert not predicted_step(random_motion(BODY, 5), np.ones((4, PARTS), bool)).any()


@pytest.fixture(scope="module")
def passing() -> tuple[SegmentProblem, list[Motion]]:
    """An arm that goes out of a camera's sight behind the trunk."""
    motion = at_rest(BODY, 18)
    angle = np.linspace(1.2, -0.1, len(motion))
    motion.rotations[:, ARM[0]] = rotations.exp(angle[:, None] * [0.0, 0.0, 1.0])
    camera = look_at("side", (-3.5, 0.0, 1.3), (0, 0, 1.2))
    poses = poses_of([BODY], [motion])
    grey = np.stack([picture([BODY], poses, f, camera) for f in range(len(motion))])
    fixed = ends_held(BODY, len(motion))
    return SegmentProblem((ViewFrames(camera, grey, 0),), (BODY,), 0, 30.0, (fixed,)), [motion]


def gone(problem: SegmentProblem, motion: Motion, ahead: Motion) -> np.ndarray:
    pair = replace(problem, fixed=(problem.fixed[0][1:3],))
    return out_of_sight(pair, [stacked([motion, ahead])])[0]


def test_a_part_is_out_of_sight_with_all_it_carries_now_or_where_it_is_predicted_step(
    passing: tuple[SegmentProblem, list[Motion]],
) -> None:
    problem, [motion] = passing
    seen, unseen = motion[:1], motion[-1:]
    assert not gone(problem, seen, seen).any()
    for pair in ((unseen, unseen), (seen, unseen), (unseen, seen)):
        assert np.flatnonzero(gone(problem, *pair)).tolist() == ARM
    bent = motion[-1:].moved(np.zeros((1, D)))
    bent.rotations[:, ARM[1]] = rotations.exp(np.array([0, 0, 1.5]))
    assert not gone(problem, bent, bent).any(), "the forearm tells of the upper arm"


def test_a_part_that_is_keyed_is_never_out_of_sight(passing: tuple[SegmentProblem, list[Motion]]) -> None:
    problem, [motion] = passing
    fixed = problem.fixed[0].copy()
    fixed[2, 3 + 3 * ARM[1] : 6 + 3 * ARM[1]] = True
    keyed = replace(problem, fixed=(fixed,))
    assert np.flatnonzero(gone(keyed, motion[-1:], motion[-1:])).tolist() == ARM[:1]


def hide_the_arm(pair: SegmentProblem, *_: object) -> list[np.ndarray]:
    return [np.isin(np.arange(PARTS), ARM) & (pair.first >= HIDDEN_FROM)]


def test_a_hidden_arm_moves_as_predicted_until_it_is_seen_again(
    passing: tuple[SegmentProblem, list[Motion]], monkeypatch: pytest.MonkeyPatch
) -> None:
    problem, start = passing
    monkeypatch.setattr(gradient_following, "out_of_sight", hide_the_arm)
    found, gradients = (follow_gradients(replace(problem, settings=s), start, Workspace())[0] for s in (WITH, WITHOUT))
    x, hidden = Steps.of(found).vectors(), np.zeros((len(found) - 1, PARTS), bool)
    hidden[HIDDEN_FROM:, ARM] = True
    arm = np.repeat([False, False, True, True, False], 3)
    for j in range(HIDDEN_FROM, len(x)):
        expected = predicted_step(found[: j + 1], hidden[:j])
        np.testing.assert_allclose(x[j, arm], expected[arm], atol=1e-9)
    assert np.abs(x[HIDDEN_FROM:, arm]).max() > 1e-3
    np.testing.assert_allclose(x[:HIDDEN_FROM], Steps.of(gradients).vectors()[:HIDDEN_FROM], atol=1e-6)


def test_gradients_alone_follow_an_arm_that_is_seen(passing: tuple[SegmentProblem, list[Motion]]) -> None:
    """Equation (12): from the first pose on, each step takes the arm along on the way that it goes."""
    problem, [motion] = passing
    start = [stacked([motion[:1]] * HIDDEN_FROM)]
    fixed = (problem.fixed[0][:HIDDEN_FROM] & (np.arange(HIDDEN_FROM) == 0)[:, None],)
    [found] = follow_gradients(replace(problem, fixed=fixed, settings=WITHOUT), start, Workspace())
    gone, true = (m[[0]].difference(m[[HIDDEN_FROM - 1]])[0, 6:9] for m in (found, motion))
    assert 0.1 < gone @ true / (true @ true) < 1.1
    assert np.linalg.norm(gone - true * (gone @ true) / (true @ true)) < 0.05 * np.linalg.norm(true)


@pytest.mark.parametrize("metres", [0.1, 0.2, 0.3])
def test_a_first_step_that_leaves_the_pattern_behind_is_followed_from_coarse_to_fine(metres: float) -> None:
    """It goes sideways by up to 19 pixels; the arms are 9 pixels wide."""
    motion = at_rest(BODY, 2)
    motion.translations[1, 0] += metres
    camera = look_at("front", (0.0, -3.0, 1.3), (0, 0, 1.2))
    grey = np.stack([picture([BODY], poses_of([BODY], [motion]), f, camera) for f in range(2)])
    problem = SegmentProblem((ViewFrames(camera, grey, 0),), (BODY,), 0, 30.0, (np.zeros((2, D), bool),))
    settings = replace(WITHOUT, correlation_length=0.03)
    [found] = follow_gradients(replace(problem, settings=settings), [stacked([motion[:1]] * 2)], Workspace())
    np.testing.assert_allclose(found.translations[1], motion.translations[1], atol=0.01)


def test_a_step_begins_with_the_one_before_and_stands_still_where_nothing_is_seen(
    passing: tuple[SegmentProblem, list[Motion]],
) -> None:
    problem, start = passing
    begun: dict[int, np.ndarray] = {}

    def blind(problem: SegmentProblem, measured: MeasuredMotion) -> MeasuredMotion:
        begun.setdefault(problem.first, Steps.of(measured.motions[0]).vectors()[0])
        sums, seen = measured.evidence.gradients, problem.first < HIDDEN_FROM
        return replace(
            measured, evidence=replace(measured.evidence, gradients=replace(sums, H=sums.H * seen, g=sums.g * seen))
        )

    problem = replace(problem, settings=WITHOUT)
    x = Steps.of(follow_gradients(problem, start, AlteredWorkspace(alter=blind))[0]).vectors()
    np.testing.assert_allclose(begun[0], 0.0, atol=1e-12)
    np.testing.assert_allclose([begun[j] for j in range(1, len(x))], x[:-1], atol=1e-9)
    assert np.abs(x[HIDDEN_FROM - 1]).max() > 1e-2
    np.testing.assert_allclose(x[HIDDEN_FROM:], 0.0, atol=GRID)  # to which steps are rounded


def limbs_alone(_problem: SegmentProblem, measured: MeasuredMotion) -> MeasuredMotion:
    """Nothing is seen of the trunk."""
    sums, limbs = measured.evidence.gradients, np.arange(PARTS) > 0
    sums = replace(sums, H=sums.H * limbs[:, None, None], g=sums.g * limbs[:, None])
    return replace(measured, evidence=replace(measured.evidence, gradients=sums))


def test_a_hidden_parts_pixels_move_nothing_in_the_initial_solution(
    passing: tuple[SegmentProblem, list[Motion]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither do they move the trunk that the part hangs from, of which nothing is seen here."""
    problem, start = passing
    problem = replace(problem, settings=WITH)
    for hidden in (False, True):
        monkeypatch.setattr(gradient_following, "out_of_sight", lambda *_, h=hidden: [h & (np.arange(PARTS) > 0)])
        found = follow_gradients(problem, start, AlteredWorkspace(alter=limbs_alone))[0]
        moved = np.abs(found.difference(stacked([start[0][:1]] * len(found)))).max()
        assert moved < 1e-12 if hidden else moved > 1e-2


def test_pixels_of_hidden_parts_do_not_count_in_the_sweeps(passing: tuple[SegmentProblem, list[Motion]]) -> None:
    """Equation (38): what the pixels of a part say does not matter on frames where no view sees it."""
    problem, start = passing
    part, frames = 3, slice(4, 7)

    def unseen(problem: SegmentProblem, share: np.ndarray) -> np.ndarray:
        hidden = np.zeros(share.shape, bool)
        if share.shape[1] == len(start[0]):  # the sweeps see the whole segment, the initial solution pairs of frames
            hidden[:, frames, part] = True
        return np.where(hidden, 0.0, 1.0)

    def misled(problem: SegmentProblem, measured: MeasuredMotion) -> MeasuredMotion:
        sums = measured.evidence.gradients
        if measured.evidence.share.shape[1] == len(start[0]):
            sums = replace(sums, g=sums.g.copy())
            sums.g[:, frames.start - 1 : frames.stop, part] += 100.0
        return replace(measured, evidence=replace(measured.evidence, gradients=sums))

    def found(settings: Settings, *changes: AlteredWorkspace) -> Motion:
        def alter(problem: SegmentProblem, measured: MeasuredMotion) -> MeasuredMotion:
            for change in changes:
                measured = change.alter(problem, measured)
            return measured

        return relaxed(replace(problem, settings=settings), start, AlteredWorkspace(alter=alter)).motions[0]

    hiding, misleading = with_share(unseen), AlteredWorkspace(alter=misled)
    np.testing.assert_array_equal(found(WITH, hiding, misleading).rotations, found(WITH, hiding).rotations)
    assert np.abs(found(WITHOUT, hiding, misleading).difference(found(WITHOUT, hiding))).max() > 1e-2


def test_without_prediction_it_does_not_matter_what_is_hidden(passing: tuple[SegmentProblem, list[Motion]]) -> None:
    problem, start = passing
    blind = with_share(lambda _, share: np.zeros_like(share))

    def found(settings: Settings, workspace: Workspace) -> Motion:
        return relaxed(replace(problem, settings=settings), start, workspace).motions[0]

    before, after = found(WITHOUT, Workspace()), found(WITHOUT, blind)
    np.testing.assert_array_equal(after.rotations, before.rotations)
    np.testing.assert_array_equal(after.translations, before.translations)
    assert np.abs(found(WITH, blind).difference(before)).max() > 1e-3
