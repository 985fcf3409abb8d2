"""Limbs that the images show less clearly for a moment are searched for, and found only where that is likelier."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import pytest
from kfmocap.core.body import human
from kfmocap.core.body.limbs import limbs
from kfmocap.core.body.motion import Motion
from kfmocap.core.evidence.view_frames import ViewFrames
from kfmocap.core.tracking.solvers import gauss_newton_solver
from kfmocap.core.tracking.solvers.equations.measurement import Workspace
from kfmocap.core.tracking.solvers.equations.problem import SegmentProblem, SegmentSolution
from kfmocap.core.tracking.solvers.judgement import settled_solutions
from kfmocap.core.tracking.solvers.limb_corrections import faded_limbs
from made_evidence import no_evidence
from synthetic import at_rest, ends_held, look_at

Array = np.ndarray
Support = dict[tuple[int, int], Array]
"""Support of limbs by performer and number of the limb; all others have full support."""
BODY, FRAMES, FPS = human(), 12, 30.0
LIMBS = limbs(BODY)
RIGHT = (at_rest(BODY, FRAMES), at_rest(BODY, FRAMES))
BOTH = SegmentProblem((), (BODY, BODY), 0, FPS, (ends_held(BODY, FRAMES),) * 2)
CAMERA = look_at("front", (0.3, -4, 1.6), size=(24, 13), focal=20)
DARK = np.zeros((FRAMES, 13, 24), np.uint8)
VIEWED = SegmentProblem((ViewFrames(CAMERA, DARK, 0, np.stack([DARK] * 2)),), BOTH.bodies, 0, FPS, BOTH.fixed)


def turned(motion: Motion, part: int, by: float) -> Motion:
    return motion.moved(np.eye(BODY.dof)[[3 + 3 * part]] * by * np.ones((FRAMES, 1)))


def support(low: float, first: int, last: int) -> Array:
    shown = np.full(FRAMES, 60.0)
    shown[first : last + 1] = 60.0 * low
    return shown


def solution(problem: SegmentProblem, motions: Sequence[Motion]) -> SegmentSolution:
    none = no_evidence(1, FRAMES, 2 * len(BODY))
    evidence = replace(none, explained=np.zeros((1, 2, FRAMES)), unhidden=np.ones((2, FRAMES)))
    return SegmentSolution.of(motions, evidence, iterations=1, energy=[0.0], only=problem.only)


def supported(monkeypatch: pytest.MonkeyPatch, of: Support) -> None:
    def each(problem: SegmentProblem, _motions: object) -> Iterator[tuple[object, ...]]:
        for i in problem.sought:
            for k, chain in enumerate(LIMBS):
                yield i, chain, np.zeros(FRAMES), lambda i=i, k=k: of.get((i, k), np.full(FRAMES, 60.0))

    monkeypatch.setattr(faded_limbs, "support_of_limbs", each)


@pytest.mark.parametrize(
    ("shown", "fades"),
    [
        (support(0.3, 4, 7), True),
        (support(-0.5, 4, 6), True),
        (support(0.3, 4, 5), False),
        (support(0.7, 2, 9), False),
        (np.full(FRAMES, 5.0), False),
    ],
)
def test_a_limb_has_faded_whose_support_falls_for_more_than_a_moment(
    monkeypatch: pytest.MonkeyPatch, shown: Array, fades: bool
) -> None:
    """One that is little seen all the time has not."""
    supported(monkeypatch, {(1, 0): shown})
    assert faded_limbs.faded_limbs(BOTH, RIGHT) == ([(1, LIMBS[0])] if fades else [])


def test_the_limb_that_has_faded_most_comes_first(monkeypatch: pytest.MonkeyPatch) -> None:
    supported(monkeypatch, {(0, 0): support(0.3, 4, 7), (0, 1): support(0.4, 5, 9), (1, 0): support(-0.2, 5, 8)})
    assert faded_limbs.faded_limbs(BOTH, RIGHT) == [(1, LIMBS[0]), (0, LIMBS[0]), (0, LIMBS[1])]


@pytest.fixture
def solved(monkeypatch: pytest.MonkeyPatch) -> list[int | None]:
    """Which performers are solved for, in turn; their motions stay what they are."""
    found: list[int | None] = []

    def descend(problem: SegmentProblem, motions: Sequence[Motion], *_: object) -> SegmentSolution:
        found.append(problem.only)
        return solution(problem, motions)

    for module in (faded_limbs, settled_solutions):
        monkeypatch.setattr(module, "descend", descend)
    monkeypatch.setattr(faded_limbs, "approach", lambda _problem, motions, *_: (motions, [], None, None))
    monkeypatch.setattr(settled_solutions, "noise_at", lambda *_: None)
    return found


@pytest.mark.parametrize("likelier", [True, False])
def test_a_faded_limb_is_taken_to_where_the_images_are_likelier_and_only_there(
    monkeypatch: pytest.MonkeyPatch, solved: list[int | None], likelier: bool
) -> None:
    """Its performer alone is solved with it and without it; all are solved together once it was found."""
    wrong = (RIGHT[0], turned(RIGHT[1], LIMBS[0][0], 0.6))
    there = turned(RIGHT[1], LIMBS[0][0], 0.0)

    def support_by_motion(problem: SegmentProblem, motions: Sequence[Motion]) -> Iterator[tuple[object, ...]]:
        low = 1.0 if motions[1] is there else 0.2
        if problem.sought == [1]:
            yield 1, LIMBS[0], np.zeros(FRAMES), lambda: support(low, 3, 7)

    monkeypatch.setattr(faded_limbs, "support_of_limbs", support_by_motion)
    monkeypatch.setattr(faded_limbs, "freed_limb", lambda *_: there)
    gain = 2 * faded_limbs.RESTING_GAIN * (1 if likelier else -1)
    monkeypatch.setattr(faded_limbs, "likelihood", lambda _p, _n, found: gain * (found.motions[1] is there))
    begin = solution(BOTH, wrong)
    found = faded_limbs.with_faded_limbs_found(BOTH, begin, Workspace())
    assert found.motions == ((RIGHT[0], there) if likelier else wrong)
    assert solved == ([1, 1, None] if likelier else [1, 1])


@pytest.mark.parametrize(("found", "settling"), [(0.05, 0.6), (0.6, 0.05)])
def test_a_limb_that_a_search_finds_where_it_was_stays_there_however_likely_the_rest_has_become(
    monkeypatch: pytest.MonkeyPatch, solved: list[int | None], found: float, settling: float
) -> None:
    """It is found there, or returns with the first iterations; nothing more is solved then."""
    supported(monkeypatch, {(1, 0): support(0.1, 4, 7)})
    way = {by: turned(RIGHT[1], LIMBS[0][0], by) for by in (found, settling)}
    monkeypatch.setattr(faded_limbs, "freed_limb", lambda *_: way[found])
    monkeypatch.setattr(faded_limbs, "approach", lambda *_: ((RIGHT[0], way[settling]), [], None, None))
    monkeypatch.setattr(faded_limbs, "likelihood", lambda _p, _n, there: 1e6 * (there.motions[1] is not RIGHT[1]))
    begin = solution(BOTH, RIGHT)
    assert faded_limbs.with_faded_limbs_found(BOTH, begin, Workspace()).motions is begin.motions
    assert not solved


def test_the_limbs_of_a_performer_are_compared_with_one_solution_until_one_is_found(
    monkeypatch: pytest.MonkeyPatch, solved: list[int | None]
) -> None:
    """Three limbs have faded, of which the second is found elsewhere."""
    supported(monkeypatch, {(1, 0): support(0.1, 4, 7), (1, 1): support(0.2, 4, 7), (1, 2): support(0.3, 4, 7)})
    monkeypatch.setattr(faded_limbs, "MAX_SEARCHES", 1)
    places = {tuple(chain): turned(RIGHT[1], chain[0], 0.6) for chain in LIMBS}
    monkeypatch.setattr(faded_limbs, "freed_limb", lambda _p, _m, place, _look: places[tuple(place[1])])
    right = places[tuple(LIMBS[1])]
    gain = 2 * faded_limbs.RESTING_GAIN
    monkeypatch.setattr(faded_limbs, "likelihood", lambda _p, _n, found: gain * (found.motions[1] is right))
    faded_limbs.with_faded_limbs_found(BOTH, solution(BOTH, RIGHT), Workspace())
    settled, with_limb = [1], [1]
    assert solved == [*settled, *with_limb, *with_limb, *settled, *with_limb, None]


@pytest.mark.parametrize(
    ("problem", "unhidden", "searched"), [(VIEWED, 0.7, True), (BOTH, 0.7, False), (VIEWED, 1.0, False)]
)
def test_faded_limbs_are_searched_for_where_some_performers_hide_others(
    monkeypatch: pytest.MonkeyPatch, problem: SegmentProblem, unhidden: float, searched: bool
) -> None:
    """Without foreground images there is nothing to search in."""
    asked: list[str] = []
    begin = solution(problem, RIGHT)
    begin.unhidden[1, 4] = unhidden

    def asked_for(_problem: SegmentProblem, found: SegmentSolution, _workspace: Workspace) -> SegmentSolution:
        asked.append("faded")
        return found

    monkeypatch.setattr(gauss_newton_solver, "best_of_starts", lambda *_: begin)
    monkeypatch.setattr(gauss_newton_solver, "with_faded_limbs_found", asked_for)
    monkeypatch.setattr(gauss_newton_solver, "with_leaps_bridged", lambda _problem, found, _workspace: found)
    assert gauss_newton_solver.solved(problem, RIGHT, Workspace()) is begin
    assert asked == (["faded"] if searched else [])
