"""Both solvers minimise the energy by which the study compares them."""

from __future__ import annotations

import numpy as np
import pytest
from kfmocap.benchmarks.studies.solver_study import LinearisedSegment, compared, fewest
from kfmocap.core.numerics import rotations
from kfmocap.core.numerics.banded_blocks import BandedBlocks
from kfmocap.core.tracking.solvers.paper_relaxation.motion_steps import StepEquations
from synthetic import at_rest, ends_held, figure, numeric_jacobian

BODY = figure()
N = 6


def segment(published: bool) -> LinearisedSegment:
    """Rows that say a little about every pose, and a key pose that is elsewhere."""
    rng = np.random.default_rng(5)
    start, keyed = at_rest(BODY, N + 1), at_rest(BODY, N + 1)
    keyed.translations[-1] += 0.01
    keyed.rotations[-1] = keyed.rotations[-1] @ rotations.exp(rng.normal(0, 0.02, (len(BODY), 3)))
    blocks = BandedBlocks.zeros(N + 1, BODY.dof)
    rows = rng.normal(0, 1, (N + 1, BODY.dof, BODY.dof))
    blocks.diagonal[:] = np.swapaxes(rows, 1, 2) @ rows
    blocks.gradient[:] = rng.normal(0, 0.02, (N + 1, BODY.dof))
    return LinearisedSegment(start, keyed, ends_held(BODY, N + 1), StepEquations.of(blocks, start), published)


@pytest.mark.parametrize("published", [True, False])
def test_the_normal_equations_are_the_derivative_of_the_energy(published: bool) -> None:
    own = segment(published)
    steps = own.rows.steps + np.random.default_rng(1).normal(0, 1e-3, own.rows.steps.shape)
    moved = own.rows.increments(steps)
    np.testing.assert_allclose(own.steps_of(moved), steps, atol=1e-12)
    slope = numeric_jacobian(lambda d: np.array([own.energy(own.steps_of(d.reshape(moved.shape)))]), moved.ravel())
    np.testing.assert_allclose(
        own.equations(steps).gradient_at(moved).ravel(), slope.ravel(), atol=2e-3 * np.abs(slope).max()
    )


@pytest.mark.parametrize("published", [True, False])
def test_sweeps_and_gauss_newton_end_at_the_same_energy_and_gauss_newton_needs_fewer(published: bool) -> None:
    own = segment(published)
    begin, swept, least = (own.energy(x) for x in (own.rows.steps, own.relaxed(3000), own.gauss_newton(20)))
    assert abs(swept - least) < 1e-3 * (begin - least)
    _, sweeps, _, steps, _, _ = ["", *compared(own)]
    assert int(steps) <= 3 < int(sweeps)


def test_the_fewest_steps_are_found_by_halving() -> None:
    for needed in range(1, 40):
        assert fewest(lambda count, needed=needed: float(count < needed), 0.5, 100) == needed
    assert fewest(lambda count: 1.0, 0.5, 100) is None
