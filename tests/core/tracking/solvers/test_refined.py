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
from kfmocap.core.tracking.solvers.descent_stages import POLISH, POLISHED_AT_ONCE, REFINEMENT, DescentStage
from kfmocap.core.tracking.solvers.equations.measurement import Workspace
from kfmocap.core.tracking.solvers.equations.problem import SegmentProblem
from synthetic import at_rest, ends_held, figure, look_at

BODY, CAMERA = figure(), look_at("front", (0.0, -3.0, 1.0))
PROBLEM = SegmentProblem((), (BODY,), 0, 30.0, (ends_held(BODY, 5),))


@pytest.mark.parametrize(
    ("views", "doubted", "elsewhere", "made"),
    [
        (2, (), False, [POLISHED_AT_ONCE]),
        (2, (), True, [POLISHED_AT_ONCE, POLISH]),
        (2, (0,), False, [REFINEMENT, POLISH]),
        (2, (0,), True, [REFINEMENT, POLISH]),
        (1, (), False, [REFINEMENT, POLISH]),
    ],
)
def test_a_solution_that_nothing_contradicted_is_polished_as_it_is_refined(
    monkeypatch: pytest.MonkeyPatch,
    views: int,
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
        return SimpleNamespace(motions=tuple(start), seconds={})

    def searched(_problem: SegmentProblem, found: Any, _workspace: Workspace) -> Any:
        return SimpleNamespace(motions=(at_rest(BODY, 5),) if elsewhere else found.motions, seconds={})

    monkeypatch.setattr(gauss_newton, "refine", descended)
    monkeypatch.setattr(gauss_newton_solver, "pictures_find_limbs", lambda _: True)
    monkeypatch.setattr(gauss_newton_solver, "with_limbs_regained", searched)
    monkeypatch.setattr(gauss_newton_solver, "continued", lambda _, after: after)
    monkeypatch.setattr(gauss_newton_solver, "replace", lambda found, **_: found)
    seen = tuple(ViewFrames(CAMERA, np.zeros((5, 8, 8), np.uint8), 0) for _ in range(views))
    gauss_newton_solver.refined(replace(PROBLEM, views=seen, doubted=doubted), [at_rest(BODY, 5)], Workspace())
    assert asked == made
