"""Limbs that the images show less clearly for a moment are searched for where some performers hide others."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import pytest
from kfmocap.core.body import human
from kfmocap.core.body.limbs import limbs
from kfmocap.core.body.motion import Motion
from kfmocap.core.tracking.solvers.equations.measurement import Workspace
from kfmocap.core.tracking.solvers.equations.problem import SegmentProblem, SegmentSolution
from kfmocap.core.tracking.solvers.limb_corrections import faded_limbs, regained_limbs
from made_evidence import no_evidence
from synthetic import at_rest, ends_held

Array = np.ndarray
Support = dict[tuple[int, int], Array]
"""Support of limbs by performer and number of the limb; all others have full support."""
BODY, FRAMES, FPS = human(), 12, 30.0
LIMBS = limbs(BODY)
RIGHT = (at_rest(BODY, FRAMES), at_rest(BODY, FRAMES))
BOTH = SegmentProblem((), (BODY, BODY), 0, FPS, (ends_held(BODY, FRAMES),) * 2)


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

    for module in (faded_limbs, regained_limbs):
        monkeypatch.setattr(module, "support_of_limbs", each)


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


@pytest.mark.parametrize(("unhidden", "searched"), [(0.7, [(1, LIMBS[0])]), (1.0, [])])
def test_faded_limbs_are_searched_for_where_some_performers_hide_others(
    monkeypatch: pytest.MonkeyPatch, unhidden: float, searched: list[tuple[int, list[int]]]
) -> None:
    """Once the motion beside the segment is known. A limb that is lost by another sign, too, is searched for once."""
    asked: list[tuple[int, list[int]]] = []
    begin = solution(BOTH, RIGHT)
    begin.unhidden[1, 4] = unhidden

    def asked_for(
        _problem: SegmentProblem, found: SegmentSolution, place: tuple[int, list[int]], *_: object
    ) -> SegmentSolution:
        asked.append(place)
        return found

    supported(monkeypatch, {(1, 0): support(0.3, 4, 7), (0, 1): support(0.2, 4, 7)})
    monkeypatch.setattr(regained_limbs, "bent_limbs", lambda *_: [])
    monkeypatch.setattr(regained_limbs, "refuted_limbs", lambda *_: [(0, LIMBS[1])])
    monkeypatch.setattr(regained_limbs, "with_limb_regained", asked_for)
    regained_limbs.with_limbs_regained(BOTH, begin, Workspace())
    assert asked == [(0, LIMBS[1]), *searched]
