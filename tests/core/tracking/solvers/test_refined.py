"""A refinement, a search for lost limbs and a polish follow each other, or are one where nothing is doubted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from kfmocap.core.body.motion import Motion
from kfmocap.core.evidence.view_frames import ViewFrames
from kfmocap.core.tracking.solvers import gauss_newton, gauss_newton_solver
from kfmocap.core.tracking.solvers.assessment import solution_ranking
from kfmocap.core.tracking.solvers.descent_stages import POLISH, POLISHED_AT_ONCE, REFINEMENT, DescentStage
from kfmocap.core.tracking.solvers.equations.measurement import Workspace
from kfmocap.core.tracking.solvers.equations.problem import AccelerationSearch, SegmentProblem
from kfmocap.core.tracking.solvers.thinned_frames import ThinnedProblem
from synthetic import at_rest, ends_held, figure, look_at

BODY, CAMERA = figure(), look_at("front", (0.0, -3.0, 1.0))
PROBLEM = SegmentProblem((), (BODY,), 0, 30.0, (ends_held(BODY, 5),))


def solution(motions: Sequence[Motion]) -> Any:
    found = SimpleNamespace(motions=tuple(motions), seconds={})
    found.without_equations = lambda: found
    return found


@pytest.mark.parametrize(
    ("views", "performers", "doubted", "elsewhere", "made"),
    [
        (2, 1, (), False, [POLISHED_AT_ONCE]),
        (2, 1, (), True, [POLISHED_AT_ONCE, POLISH]),
        (2, 1, (0,), False, [REFINEMENT, POLISH]),
        (2, 1, (0,), True, [REFINEMENT, POLISH]),
        (1, 1, (), False, [REFINEMENT, POLISH]),
        (2, 2, (0,), False, [POLISHED_AT_ONCE]),
        (2, 2, (0,), True, [POLISHED_AT_ONCE, POLISH]),
        (1, 2, (), False, [REFINEMENT, POLISH]),
    ],
)
def test_several_performers_and_what_nothing_contradicted_are_polished_as_they_are_refined(
    monkeypatch: pytest.MonkeyPatch,
    views: int,
    performers: int,
    doubted: tuple[int, ...],
    elsewhere: bool,
    made: list[Sequence[DescentStage]],
) -> None:
    """With a limb elsewhere it would be polished where it is wrong, as if it had much noise: it is polished again."""
    asked: list[Sequence[DescentStage]] = []

    def descended(
        _problem: SegmentProblem, start: Sequence[Motion], _workspace: Workspace, stages: Sequence[DescentStage]
    ) -> Any:
        asked.append(stages)
        return solution(start)

    def searched(_problem: SegmentProblem, found: Any, _workspace: Workspace) -> Any:
        return solution([at_rest(BODY, 5)] if elsewhere else found.motions)

    monkeypatch.setattr(gauss_newton, "refine", descended)
    monkeypatch.setattr(gauss_newton_solver, "can_search_limbs", lambda _: True)
    monkeypatch.setattr(gauss_newton_solver, "with_limbs_regained", searched)
    monkeypatch.setattr(gauss_newton_solver, "continued", lambda _, after: after)
    monkeypatch.setattr(gauss_newton_solver, "replace", lambda found, **_: found)
    seen = tuple(ViewFrames(CAMERA, np.zeros((5, 8, 8), np.uint8), 0) for _ in range(views))
    problem = replace(PROBLEM, bodies=(BODY,) * performers, fixed=PROBLEM.fixed * performers)
    start = [at_rest(BODY, 5)] * performers
    gauss_newton_solver.refined(replace(problem, views=seen, doubted=doubted), start, Workspace())
    assert asked == made


@pytest.mark.parametrize(("polished", "doubted"), [(False, ()), (True, ()), (True, (1,)), (True, (0, 1))])
def test_performers_who_are_polished_are_only_polished_again_and_those_in_doubt_brought_near_first(
    monkeypatch: pytest.MonkeyPatch, polished: bool, doubted: tuple[int, ...]
) -> None:
    """Steps under the noise of the views would lead those who are polished away from where they are led back to."""
    approached: list[tuple[int | None, Sequence[DescentStage]]] = []
    asked: list[Sequence[DescentStage]] = []
    near = at_rest(BODY, 5)

    def approach(problem: SegmentProblem, start: Sequence[Motion], _: Workspace, stages: Sequence[DescentStage]) -> Any:
        approached.append((problem.only, stages))
        return SimpleNamespace(motions=[near if i == problem.only else own for i, own in enumerate(start)])

    def descended(_: SegmentProblem, start: Sequence[Motion], __: Workspace, stages: Sequence[DescentStage]) -> Any:
        asked.append(stages)
        assert [own is near for own in start] == [polished and i in doubted for i in range(2)]
        return solution(start)

    monkeypatch.setattr(gauss_newton_solver, "approach", approach)
    monkeypatch.setattr(gauss_newton, "refine", descended)
    monkeypatch.setattr(gauss_newton_solver, "can_search_limbs", lambda _: False)
    problem = replace(two_views(), doubted=doubted, polished=polished)
    gauss_newton_solver.refined(problem, [at_rest(BODY, 5), at_rest(BODY, 5)], Workspace())
    assert asked == [POLISH if polished else POLISHED_AT_ONCE]
    assert approached == [(i, POLISHED_AT_ONCE[:-1]) for i in doubted if polished]


def two_views() -> SegmentProblem:
    """Two performers before two cameras."""
    seen = tuple(ViewFrames(CAMERA, np.zeros((5, 8, 8), np.uint8), 0) for _ in range(2))
    return replace(PROBLEM, bodies=(BODY,) * 2, fixed=PROBLEM.fixed * 2, views=seen)


LONG = 33
CLOSE = replace(PROBLEM, fps=240.0, fixed=(ends_held(BODY, LONG),))
"""Frames that follow each other so closely that most can be left out."""


def long_problem(doubted: tuple[int, ...] = ()) -> SegmentProblem:
    seen = tuple(ViewFrames(CAMERA, np.zeros((LONG, 8, 8), np.uint8), 0) for _ in range(2))
    return replace(CLOSE, views=seen, doubted=doubted)


@pytest.mark.parametrize("doubted", [(), (0,)])
def test_whoever_is_doubted_is_searched_for_on_few_frames_and_polished_on_all(
    monkeypatch: pytest.MonkeyPatch, doubted: tuple[int, ...]
) -> None:
    asked: list[tuple[Sequence[DescentStage], bool]] = []
    searched: list[int] = []

    def descended(
        problem: SegmentProblem,
        start: Sequence[Motion],
        _workspace: Workspace,
        stages: Sequence[DescentStage] = REFINEMENT,
    ) -> Any:
        assert len(start[0]) == problem.length
        asked.append((stages, problem.length == LONG))
        return SimpleNamespace(motions=tuple(start), seconds={})

    def regained(problem: SegmentProblem, found: Any, _workspace: Workspace) -> Any:
        searched.append(problem.length)
        return found

    monkeypatch.setattr(gauss_newton, "refine", descended)
    monkeypatch.setattr(gauss_newton_solver, "can_search_limbs", lambda _: True)
    monkeypatch.setattr(gauss_newton_solver, "with_limbs_regained", regained)
    monkeypatch.setattr(gauss_newton_solver, "continued", lambda _, after: after)
    monkeypatch.setattr(gauss_newton_solver, "replace", lambda found, **_: found)
    gauss_newton_solver.refined(long_problem(doubted), [at_rest(BODY, LONG)], Workspace())
    if doubted:
        assert asked == [(REFINEMENT, False), (REFINEMENT, True), (POLISH, True)]
        assert searched[0] < LONG / 2
    else:
        assert asked == [(POLISHED_AT_ONCE, True)]
        assert searched == [LONG]


@pytest.mark.parametrize(
    ("doubted_on_few", "doubted_on_all", "descents", "solved_on_all"),
    [(False, False, [False], False), (True, False, [False, True], True), (True, True, [False, True, False], False)],
)
def test_all_frames_are_tried_where_the_images_contradict_what_few_of_them_lead_to(
    monkeypatch: pytest.MonkeyPatch,
    doubted_on_few: bool,
    doubted_on_all: bool,
    descents: list[bool],
    solved_on_all: bool,
) -> None:
    made: list[bool] = []
    begun: list[tuple[bool, int]] = []

    def descended(problem: SegmentProblem, start: Sequence[Motion], *_: Any) -> Any:
        made.append(problem.length == LONG)
        return SimpleNamespace(motions=tuple(start), seconds={}, number=len(made))

    def continued_from(problem: SegmentProblem, _start: Any, _workspace: Any, first: Any) -> Any:
        begun.append((problem.length == LONG, first.number))
        return first

    for solving in ("descend", "first_solution"):
        monkeypatch.setattr(gauss_newton_solver, solving, descended)
    monkeypatch.setattr(
        gauss_newton_solver,
        "doubted_performers",
        lambda problem, *_: [0] if (doubted_on_all if problem.length == LONG else doubted_on_few) else [],
    )
    exchanged: list[Any] = []
    monkeypatch.setattr(gauss_newton_solver, "best_of_starts", continued_from)
    monkeypatch.setattr(gauss_newton_solver, "continued", lambda _, after: after)
    monkeypatch.setattr(gauss_newton_solver, "replace", lambda found, **_: found)
    monkeypatch.setattr(
        gauss_newton_solver, "with_sides_exchanged", lambda _problem, found, _: exchanged.append(found) or found
    )
    monkeypatch.setattr(ThinnedProblem, "on_all_frames", lambda _self, few: few)
    gauss_newton_solver.solved(long_problem(), [at_rest(BODY, LONG)], Workspace())
    assert made == descents
    assert begun == [(solved_on_all, len(descents))]
    assert bool(exchanged) == solved_on_all  # nothing contradicts limbs that have each other's pictures


@pytest.mark.parametrize(
    ("views", "doubted", "uncovered", "likelier", "taken"),
    [
        (1, (0,), [0], True, "estimated"),
        (1, (0,), [0], False, "usual"),
        (1, (0,), [], True, "usual"),
        (1, (), [0], True, "usual"),
        (2, (0,), [0], True, "usual"),
    ],
)
def test_where_a_view_alone_shows_a_limb_beside_the_solution_estimated_accelerations_are_tried(
    monkeypatch: pytest.MonkeyPatch,
    views: int,
    doubted: tuple[int, ...],
    uncovered: list[int],
    likelier: bool,
    taken: str,
) -> None:
    """Usual accelerations draw a fast limb back from wherever a search finds it."""

    def solved(problem: SegmentProblem, *_: Any) -> Any:
        kind = "estimated" if problem.search is AccelerationSearch.JOINTS and views == 1 else "usual"
        return SimpleNamespace(kind=kind, doubted=doubted, motions=(), seconds={})

    monkeypatch.setattr(gauss_newton_solver, "best_of_starts", solved)
    monkeypatch.setattr(gauss_newton_solver, "can_search_limbs", lambda _: False)
    monkeypatch.setattr(gauss_newton_solver, "performers_uncovered", lambda *_: uncovered)
    settled = SimpleNamespace(noise=None, solution=SimpleNamespace(kind="usual"))
    monkeypatch.setattr(gauss_newton_solver.SettledSolution, "after", lambda *_: settled)
    monkeypatch.setattr(gauss_newton_solver, "descend", solved)
    monkeypatch.setattr(gauss_newton_solver, "clearly_likelier", lambda *_: not likelier)
    monkeypatch.setattr(gauss_newton_solver, "continued", lambda _, after: after)
    monkeypatch.setattr(
        gauss_newton_solver, "replace", lambda one, **new: replace(one, **new) if "search" in new else one
    )
    search = AccelerationSearch.SCALE_THEN_JOINTS if views == 1 else AccelerationSearch.JOINTS
    found: Any = gauss_newton_solver.solved(replace(PROBLEM, search=search), [at_rest(BODY, 5)], Workspace())
    assert found.kind == taken


@pytest.mark.parametrize(
    ("first", "second", "clear"), [(249.0, 246.0, False), (257.0, 246.0, True), (246.0, 249.0, False)]
)
def test_a_solution_is_clearly_likelier_by_more_than_solutions_at_rest_still_gain(
    monkeypatch: pytest.MonkeyPatch, first: float, second: float, clear: bool
) -> None:
    monkeypatch.setattr(solution_ranking, "likelihood", lambda _problem, _noise, solution: solution)
    given: Any = PROBLEM, None, first, second
    assert solution_ranking.clearly_likelier(*given) == clear
