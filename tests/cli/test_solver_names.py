"""Every solver that can be chosen is there."""

from __future__ import annotations

from kfmocap.core.choices import SOLVERS
from kfmocap.core.shot.settings import Settings
from kfmocap.core.tracking.solvers.registry import REGISTRY


def test_every_solver_that_a_shot_can_name_is_there() -> None:
    assert set(REGISTRY) == set(SOLVERS)
    assert Settings().solver == next(iter(SOLVERS))
