"""The floor on which feet stand, estimated from the heights of standing points on key poses."""

from __future__ import annotations

import numpy as np
import pytest
from kfmocap.core.tracking.solvers.plants.floor_height import FloorHeight


def test_it_is_where_most_points_stand() -> None:
    """Neither a foot on a step nor one that is held still in the air moves it."""
    found = FloorHeight.of(np.array([0.001, -0.001, 0.0, 0.0, 0.16, 0.4]))
    assert found is not None
    assert found.height == pytest.approx(0.0, abs=1e-9)
    assert found.sigma < 0.004


def test_heights_that_vary_say_little_of_others() -> None:
    """The standard deviation is that of a further height, as soon as there are enough to show it."""
    dice = np.random.default_rng(0)
    for sigma in (0.006, 0.010):
        found = [FloorHeight.of(dice.normal(0.1, sigma, 12)) for _ in range(200)]
        assert np.mean([floor.sigma for floor in found if floor]) == pytest.approx(sigma, rel=0.15)
    known = [FloorHeight.of(np.full(n, 0.1)) for n in (1, 4, 12)]
    assert np.all(np.diff([floor.sigma for floor in known if floor]) < 0)


@pytest.mark.parametrize("heights", [[], [0.0, 0.3], [0.0, 0.01, 0.3, 0.31]])
def test_no_heights_show_no_floor_nor_do_as_many_on_another_one(heights: list[float]) -> None:
    """Somebody stands with one foot on a step, or gets up from hands and toes."""
    assert FloorHeight.of(np.array(heights)) is None


def test_it_carries_what_is_tracked_a_little_above_it_but_no_step() -> None:
    floor = FloorHeight.of(np.zeros(4))
    assert floor is not None
    assert floor.carries(np.array([[0.0, 0.0, 0.01], [0.1, 0.2, 0.02]]))
    assert not floor.carries(np.array([[0.0, 0.0, 0.04], [0.1, 0.2, 0.05]]))
