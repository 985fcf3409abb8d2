"""Between two key poses the body may have turned all the way round, and the curve through them has not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from kfmocap.core.body.motion import Motion
from kfmocap.core.numerics import rotations
from kfmocap.core.shot.motion_warping import turned
from kfmocap.core.tracking.solvers.approach import Approach
from kfmocap.core.tracking.solvers.descent_stages import COARSE_STAGES, FINE_STAGES, POLISHED_AT_ONCE
from kfmocap.core.tracking.solvers.equations.problem import SegmentProblem, SegmentSolution
from kfmocap.core.tracking.solvers.starts import whole_turns
from kfmocap.core.tracking.solvers.starts.whole_turns import with_whole_turn
from made_evidence import Landscape
from synthetic import at_rest, ends_held, figure

BODY, LENGTH, FPS = figure(), 13, 30.0
REST = at_rest(BODY, LENGTH)
PROBLEM = SegmentProblem((), (BODY,), 0, FPS, (ends_held(BODY, LENGTH),))


def spinning(axis: int, angle: float) -> Motion:
    """A motion whose root turns at constant speed."""
    Q = REST.rotations.copy()
    Q[:, 0] = Q[:, 0] @ rotations.exp(np.linspace(0, angle, LENGTH)[:, None] * np.eye(3)[axis])
    return Motion(REST.translations, Q)


def farthest(motion: Motion, truth: Motion) -> float:
    return float(np.linalg.norm(motion.difference(truth)[:, 3:6], axis=1).max())


@pytest.mark.parametrize("only", [None, 0])
@pytest.mark.parametrize(("axis", "angle"), [(1, 2 * np.pi), (1, -1.7 * np.pi), (0, 2 * np.pi), (2, -2 * np.pi)])
def test_a_body_that_turned_the_longer_way_is_found(axis: int, angle: float, only: int | None) -> None:
    """It spins either way, turns a somersault, or a cartwheel; alone or as one of several."""
    truth = spinning(axis, angle)
    shorter = spinning(axis, angle - 2 * np.pi * np.sign(angle))
    landscape = Landscape(truth=truth, reach=0.7)
    start, found = with_whole_turn(
        replace(PROBLEM, only=only), [shorter], landscape.solution(PROBLEM, shorter), landscape
    )
    assert farthest(shorter, truth) > 3
    assert farthest(start[0], truth) < 0.7
    assert farthest(found.motions[0], truth) < 0.1


def test_a_solution_that_the_images_agree_with_stands_without_another_look() -> None:
    landscape = Landscape(truth=REST)
    first = landscape.solution(PROBLEM, REST)
    given = [REST]
    start, found = with_whole_turn(PROBLEM, given, first, landscape)
    assert found is first and start is given and not landscape.measured


def test_a_turn_that_covers_less_is_not_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(whole_turns, "frames_unexplained", lambda *_: np.arange(4))
    landscape = Landscape(truth=REST, reach=0.2)
    first = landscape.solution(PROBLEM, REST)
    given = [REST]
    start, found = with_whole_turn(PROBLEM, given, first, landscape)
    assert found is first and start is given and landscape.measured


def test_turns_are_solved_as_far_as_the_first_solution(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is solved further covers more."""
    landscape, used = Landscape(truth=spinning(1, 2 * np.pi), reach=0.7), list[object]()
    first = landscape.solution(PROBLEM, REST)

    def descend(problem: SegmentProblem, begun: Approach, _: object, stages: object) -> SegmentSolution:
        used.append(stages)
        return landscape.solution(problem, begun.motions[0])

    monkeypatch.setattr(whole_turns, "descend", descend)
    for stages in (FINE_STAGES, POLISHED_AT_ONCE):
        used.clear()
        with_whole_turn(replace(PROBLEM, only=0), [REST], first, landscape, stages)
        assert used == [stages] * whole_turns.SOLVED_TURNS


@pytest.mark.parametrize(("frames", "solved"), [(3, False), (4, True)])
@pytest.mark.parametrize("only", [None, 0])
def test_turns_are_solved_only_where_many_frames_are_unexplained(
    monkeypatch: pytest.MonkeyPatch, frames: int, only: int | None, solved: bool
) -> None:
    """One who has lost a limb, or whom others hide, is unexplained on a few of 13 frames. They are solved even if they
    cover much less at first."""
    landscape = Landscape(truth=REST)
    runs: list[int | None] = []
    first = landscape.solution(PROBLEM, REST)
    monkeypatch.setattr(whole_turns, "frames_unexplained", lambda *_: np.arange(frames))

    def descend(problem: SegmentProblem, begun: Approach, *_: object) -> SegmentSolution:
        runs.append(problem.only)
        return landscape.solution(problem, begun.motions[0])

    monkeypatch.setattr(whole_turns, "descend", descend)
    given = [REST]
    start, found = with_whole_turn(replace(PROBLEM, only=only), given, first, landscape)
    assert found is first and start is given
    assert runs == [only] * whole_turns.SOLVED_TURNS * solved


def test_turns_are_chosen_by_what_they_cover_once_limbs_and_hips_have_followed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of one who turns with stretched arms, the right start covered less than somersaults and cartwheels."""
    landscape = Landscape(truth=REST)
    monkeypatch.setattr(whole_turns, "frames_unexplained", lambda *_: np.arange(4))
    followed: list[Approach] = []
    solved: list[Approach] = []

    def approach(problem: SegmentProblem, motions: Sequence[Motion], __: object, stages: object) -> Approach:
        assert stages == COARSE_STAGES
        followed.append(Approach.start(problem, motions))
        return followed[-1]

    def cover(_: object, __: object, motions: Sequence[Motion], ___: object) -> float:
        [k] = (k for k, own in enumerate(followed) if own.motions is motions)
        return float([4, 1, 6, 2, 5, 3][k])

    def descend(problem: SegmentProblem, begun: Approach, *_: object) -> SegmentSolution:
        solved.append(begun)
        return landscape.solution(problem, begun.motions[0])

    for name, own in (("approach", approach), ("cover_at", cover), ("descend", descend)):
        monkeypatch.setattr(whole_turns, name, own)
    with_whole_turn(PROBLEM, [REST], landscape.solution(PROBLEM, REST), landscape)
    most = [followed[k] for k in (2, 4, 0, 5, 3, 1)]
    assert all(a is b for a, b in zip(solved, most, strict=False)) and len(solved) == whole_turns.SOLVED_TURNS


def test_of_solved_turns_the_one_that_covers_most_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    """It covers less than another turn before it is solved."""
    landscape = Landscape(truth=spinning(1, 2 * np.pi), reach=0.7)
    first = landscape.solution(PROBLEM, REST)
    covers = iter([3.0, 2.0, 0.0, 0.0, 0.0, 0.0])
    monkeypatch.setattr(whole_turns, "cover_at", lambda *_: next(covers))
    start, found = with_whole_turn(PROBLEM, [REST], first, landscape)
    assert farthest(start[0], landscape.truth) < 0.7
    assert farthest(found.motions[0], landscape.truth) < 0.1


def test_a_turned_start_keeps_what_key_poses_fix() -> None:
    fixed = ends_held(BODY, LENGTH)
    fixed[4, 3:6] = True
    whole = turned(REST, fixed, np.eye(3)[1])
    moved = np.abs(whole.difference(REST))
    np.testing.assert_allclose(moved[fixed], 0, atol=1e-12)
    assert moved[6, 3:6].max() > 3
    np.testing.assert_array_equal(whole.translations, REST.translations)
