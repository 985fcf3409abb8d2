"""What was measured is not measured again."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from kfmocap.core.body import human
from kfmocap.core.evidence.rendering.part_geometry import Geometry
from kfmocap.core.evidence.sampling import Sampling
from kfmocap.core.tracking.solvers.equations import measurement
from kfmocap.core.tracking.solvers.equations.measurement import CACHED_EVALUATIONS, Workspace
from kfmocap.core.tracking.solvers.equations.problem import SegmentProblem
from synthetic import coloured, ends_held, look_at, random_motion

BODY, LENGTH = human(1.75), 3
SAMPLING = Sampling(1.0, 1.0, 2, 0.1)


def test_recent_looks_are_not_taken_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither the noise nor the smallest step may go unnoticed."""
    motion = random_motion(BODY, LENGTH, seed=1)
    views = coloured(BODY, motion, [look_at("side", (4.0, 0.3, 1.1), (0, 0, 0.95), size=(150, 180), focal=150.0)])
    fixed, shape = (ends_held(BODY, LENGTH),), Geometry.of([BODY])
    problem = SegmentProblem(tuple(views), (BODY,), 0, 30.0, fixed, shape=shape)
    step = np.zeros((LENGTH, BODY.dof))
    step[1, -1] = 2.0**-17
    moved, noise, taken = motion.moved(step), np.full((1, LENGTH - 1, 1 + len(BODY)), 0.02), []
    accumulate = measurement.accumulate_evidence

    def counted(*given: Any, **named: Any) -> Any:
        taken.append(named["noise"])
        return accumulate(*given, **named)

    monkeypatch.setattr(measurement, "accumulate_evidence", counted)
    workspace = Workspace()
    queries = [(motion, None), (moved, None), (motion, noise)]
    first = [workspace.measure(problem, [m], SAMPLING, n).evidence for m, n in queries]
    assert len(taken) == 3
    again = [workspace.silent().measure(problem, [m], SAMPLING, n).evidence for m, n in queries]
    assert len(taken) == 3
    for a, b in zip(first, again, strict=True):
        assert a.gradients is b.gradients
        assert not any(b.seconds.values())
    for k in range(CACHED_EVALUATIONS):
        workspace.measure(problem, [motion], SAMPLING, noise + 0.01 * (k + 1))
    workspace.measure(problem, [motion], SAMPLING)
    assert len(taken) == 3 + CACHED_EVALUATIONS + 1
