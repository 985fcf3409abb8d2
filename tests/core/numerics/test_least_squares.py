"""The optimiser: every step is tested, and what is returned belongs to the state that is returned."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from kfmocap.core.numerics.banded_blocks import BandedBlocks
from kfmocap.core.numerics.least_squares import GAUSS_NEWTON, Damping, StoppingRule, minimise
from kfmocap.core.numerics.normal_equations import (
    BandedEquations,
    DenseEquations,
    IndependentEquations,
    SparseEquations,
)
from kfmocap.core.numerics.robust_kernels import Cauchy, GemanMcClure, Huber, Quadratic, RobustKernel
from scipy import sparse

F, D, N = 5, 3, 2  # frames, unknowns of each, and unknowns that touch all frames
UNKNOWNS = F * D + N
PLAIN = Quadratic()


def added(state: np.ndarray, step: np.ndarray) -> np.ndarray:
    return state + step


def equations_of(residuals: np.ndarray, jacobian: np.ndarray, kernel: RobustKernel = PLAIN) -> DenseEquations:
    """Normal equations of whitened residuals (m, k) with derivatives (m, k, n)."""
    squared = np.sum(residuals**2, axis=1)
    weight = kernel.weight(squared)
    return DenseEquations(
        np.einsum("mki,m,mkj->ij", jacobian, weight, jacobian, optimize=True),
        np.einsum("mki,m,mk->i", jacobian, weight, residuals),
        float(kernel.cost(squared).sum()),
    )


def quadratic() -> tuple[np.ndarray, np.ndarray]:
    """A positive definite matrix that is block-pentadiagonal with a border, and its minimum."""
    rng = np.random.default_rng(3)
    rows = []
    for frame in range(F):
        J = np.zeros((D, UNKNOWNS))
        last = min(frame + 3, F) * D
        J[:, frame * D : last] = rng.normal(size=(D, last - frame * D))
        J[:, F * D :] = rng.normal(size=(D, N))
        rows.append(J)
    J = np.concatenate(rows)
    return J.T @ J + 3 * np.eye(UNKNOWNS), rng.normal(size=UNKNOWNS)


def banded_at(A: np.ndarray, minimum: np.ndarray, state: np.ndarray) -> BandedEquations:
    B = A.reshape(F, D, F, D)
    gradient = A @ (state.ravel() - minimum)
    cost = float((state.ravel() - minimum) @ gradient)
    blocks = BandedBlocks(
        np.stack([B[j, :, j] for j in range(F)]),
        np.stack([B[j + 1, :, j] for j in range(F - 1)]),
        np.stack([B[j + 2, :, j] for j in range(F - 2)]),
        gradient.reshape(F, D),
        cost,
    )
    return BandedEquations(blocks, np.zeros((F, D), bool))


def dense(A: np.ndarray, x: np.ndarray, minimum: np.ndarray) -> DenseEquations:
    return DenseEquations(A, A @ (x - minimum), float((x - minimum) @ A @ (x - minimum)))


@pytest.mark.parametrize("kind", ["dense", "sparse", "independent"])
def test_a_quadratic_is_solved_in_one_step(kind: str) -> None:
    A, minimum = quadratic()

    def linearise(x: np.ndarray) -> DenseEquations | SparseEquations | IndependentEquations:
        whole = dense(A, x, minimum)
        if kind == "dense":
            return whole
        if kind == "sparse":
            return SparseEquations(sparse.csc_array(A), whole.gradient, whole.cost)
        return IndependentEquations([whole, replace(whole, gradient=np.zeros(UNKNOWNS), cost=2.0)])

    def move(x: np.ndarray, step: np.ndarray) -> np.ndarray:
        return x + (step[0] if kind == "independent" else step)

    result = minimise(np.zeros(UNKNOWNS), linearise, move, damping=GAUSS_NEWTON, stopping=StoppingRule(iterations=1))
    np.testing.assert_allclose(result.state, minimum, atol=1e-9)
    assert result.iterations == 1


@pytest.mark.parametrize("share", [0.9, 1.1])
def test_a_step_that_promises_too_little_is_not_tried(share: float) -> None:
    A, minimum = quadratic()
    tried = []

    def move(x: np.ndarray, step: np.ndarray) -> np.ndarray:
        tried.append(step)
        return x + step

    begin = dense(A, np.zeros(UNKNOWNS), minimum)
    least = share * float(begin.gradient @ np.linalg.solve(A, begin.gradient))
    result = minimise(
        np.zeros(UNKNOWNS),
        lambda x: dense(A, x, minimum),
        move,
        damping=GAUSS_NEWTON,
        stopping=StoppingRule(iterations=1, least_promise=least),
    )
    assert len(tried) == result.iterations == (1 if share < 1 else 0)
    assert result.converged or share < 1


@pytest.mark.parametrize("share", [0.9, 1.1])
def test_a_step_to_a_state_nearby_is_not_tried(share: float) -> None:
    A, minimum = quadratic()
    seen = []

    def linearise(x: np.ndarray) -> DenseEquations:
        seen.append(x)
        return dense(A, x, minimum)

    def near(before: np.ndarray, after: np.ndarray) -> bool:
        return bool(np.linalg.norm(after - before) < share * np.linalg.norm(minimum))

    stopping = StoppingRule(iterations=1, negligible=near)
    result = minimise(np.zeros(UNKNOWNS), linearise, added, damping=GAUSS_NEWTON, stopping=stopping)
    assert len(seen) == 1 + result.iterations == (2 if share < 1 else 1)
    np.testing.assert_allclose(result.state, minimum if share < 1 else 0.0, atol=1e-9)
    assert result.converged or share < 1


def test_a_banded_quadratic_is_solved_in_one_step_but_for_what_is_fixed() -> None:
    A, minimum = quadratic()
    A, minimum = A[: F * D, : F * D], minimum[: F * D]
    fixed = np.zeros((F, D), bool)
    fixed[0], fixed[3, 1] = True, True
    start = np.where(fixed, minimum.reshape(F, D), 0.0)

    result = minimise(start, lambda x: replace(banded_at(A, minimum, x), fixed=fixed), added, damping=GAUSS_NEWTON)
    np.testing.assert_allclose(result.state.ravel(), minimum, atol=1e-5)  # the banded matrix has a ridge
    np.testing.assert_allclose(result.state[fixed], minimum.reshape(F, D)[fixed], rtol=0)
    assert result.cost < 1e-9 * result.cost_history[0]


def rosenbrock(x: np.ndarray) -> DenseEquations:
    """The banana-shaped valley: a full step of Gauss-Newton from (-1.2, 1) leaves it and raises the cost."""
    residuals = np.array([[10 * (x[1] - x[0] ** 2)], [1 - x[0]]])
    return equations_of(residuals, np.array([[[-20 * x[0], 10.0]], [[-1.0, 0.0]]]))


def test_a_step_that_raises_the_cost_is_refused() -> None:
    start = np.array([-1.2, 1.0])
    full = start + rosenbrock(start).solve(0.0)
    assert rosenbrock(full).cost > 50 * rosenbrock(start).cost
    result = minimise(start, rosenbrock, added, damping=GAUSS_NEWTON, stopping=StoppingRule(iterations=1))
    assert result.iterations == 1 and result.cost < rosenbrock(start).cost


@pytest.mark.parametrize("damping", [Damping(), GAUSS_NEWTON])
def test_the_cost_never_rises_on_the_way_to_the_minimum(damping: Damping) -> None:
    result = minimise(
        np.array([-1.2, 1.0]), rosenbrock, added, damping=damping, stopping=StoppingRule(200, relative_gain=1e-9)
    )
    np.testing.assert_allclose(result.state, 1.0, atol=1e-6)
    assert (np.diff(result.cost_history) <= 0).all()
    assert result.cost_history[0] == rosenbrock(np.array([-1.2, 1.0])).cost and result.cost == result.cost_history[-1]
    assert result.iterations > 3


def line(kernel: RobustKernel) -> Callable[[np.ndarray], DenseEquations]:
    """A straight line through points, one of which lies far off."""
    x = np.linspace(-1, 1, 21)
    y = 2 * x + 1
    y[4] = 400.0
    jacobian = np.stack([x, np.ones(21)], axis=1)[:, None]
    return lambda line: equations_of((jacobian[:, 0] @ line - y)[:, None], jacobian, kernel)


@pytest.mark.parametrize(("kernel", "off"), [(Huber(0.01), 1e-2), (Cauchy(0.01), 1e-4), (GemanMcClure(1.0), 1e-4)])
def test_a_robust_kernel_ignores_an_outlier(kernel: RobustKernel, off: float) -> None:
    start, stopping = np.array([1.9, 1.2]), StoppingRule[np.ndarray](100, relative_gain=1e-12)
    plain = minimise(start, line(Quadratic()), added, stopping=stopping).state
    robust = minimise(start, line(kernel), added, stopping=stopping).state
    assert np.abs(plain - [2.0, 1.0]).max() > 10
    np.testing.assert_allclose(robust, [2.0, 1.0], atol=off)


@pytest.mark.parametrize("kernel", [Quadratic(), Huber(1.5), Cauchy(1.5), GemanMcClure(1.5)])
def test_the_weight_of_a_kernel_is_the_slope_of_its_cost(kernel: RobustKernel) -> None:
    s, h = np.array([0.0, 0.5, 2.0, 2.5, 30.0]), 1e-6
    np.testing.assert_allclose(kernel.weight(s), (kernel.cost(s + h) - kernel.cost(s)) / h, atol=1e-5)


def test_the_covariance_is_that_of_the_returned_state() -> None:
    # The estimate of x from one measurement of x^2 with unit noise has the variance 1 / (2 x)^2.
    def squared(x: np.ndarray) -> DenseEquations:
        return equations_of(np.array([[x[0] ** 2 - 9.0]]), np.array([[[2 * x[0]]]]))

    for iterations in (1, 2, 50):
        result = minimise(np.array([1.0]), squared, added, stopping=StoppingRule(iterations))
        np.testing.assert_allclose(result.linearised().factor().covariance(), 1 / (4 * result.state[:, None] ** 2))
        assert result.linearised().cost == result.cost
        assert result.converged == (iterations == 50)


def test_the_small_step_is_measured_between_states() -> None:
    def size(before: np.ndarray, after: np.ndarray) -> float:
        return float(np.abs(after - before).max())

    rule = StoppingRule(1000, relative_gain=0.0, small_step=0.05, step_size=size)
    states: list[np.ndarray] = []
    result = minimise(
        np.array([-1.2, 1.0]), rosenbrock, added, stopping=rule, on_iteration=lambda _, x: states.append(x)
    )
    assert result.converged
    assert size(states[-1], result.state) < 0.05


@pytest.mark.parametrize(("small", "tried"), [(2.0, 1), (0.7, 3), (0.0, 4)])
def test_a_refused_step_that_is_small_is_not_shortened_any_further(small: float, tried: int) -> None:
    """All steps from 0 raise the cost here; with damping 0, 1e-4, 1 and 1e4 they are 1, 0.9999, 1/2 and 1e-4 long."""
    seen: list[float] = []

    def linearise(x: np.ndarray) -> DenseEquations:
        seen.append(float(x[0]))
        return DenseEquations(np.eye(1), np.array([-1.0]), 10.0 + abs(float(x[0])))

    stopping = StoppingRule[np.ndarray](
        relative_gain=0.0, small_step=small, step_size=lambda a, b: float(np.abs(b - a).max()), small_refused=True
    )
    damping = Damping(initial=0.0, grow=1e4, most=1e5)
    result = minimise(np.zeros(1), linearise, added, damping=damping, stopping=stopping)
    assert result.state == 0.0 and len(seen) - 1 == tried
    assert result.converged == (small > 0)


def test_raising_in_the_callback_cancels() -> None:
    class CancelledForTestError(Exception):
        pass

    def cancel(iteration: int, state: np.ndarray) -> None:
        if iteration == 2:
            raise CancelledForTestError

    with pytest.raises(CancelledForTestError):
        minimise(np.array([-1.2, 1.0]), rosenbrock, added, on_iteration=cancel)


def test_a_start_at_the_minimum_stays_there() -> None:
    start = np.array([2.0, 1.0])
    result = minimise(start, line(Quadratic()), added)
    again = minimise(result.state, line(Quadratic()), added)
    assert again.converged and again.cost <= result.cost
    np.testing.assert_allclose(again.state, result.state, atol=1e-6)


def test_where_no_step_lowers_the_cost_the_start_is_returned_as_not_converged() -> None:
    # A wrong gradient, as of evidence whose cost has nothing to do with it.
    result = minimise(np.zeros(1), lambda x: DenseEquations(np.eye(1), np.ones(1), float(x @ x)), added)
    assert result.state == 0 and result.iterations == 0 and not result.converged


def test_a_singular_matrix_is_damped() -> None:
    def linearise(x: np.ndarray) -> DenseEquations:
        return equations_of(np.array([[x[0] - 3]]), np.array([[[1.0, 0.0]]]))

    result = minimise(np.zeros(2), linearise, added, damping=GAUSS_NEWTON)
    np.testing.assert_allclose(result.state, [3.0, 0.0], atol=1e-5)


def test_a_cheaper_cost_finds_the_same_minimum_in_the_same_steps() -> None:
    start, rule = np.array([-1.2, 1.0]), StoppingRule[np.ndarray](200, relative_gain=1e-9)
    whole = minimise(start, rosenbrock, added, stopping=rule)
    cheap = minimise(start, rosenbrock, added, trial_cost=lambda x, _: rosenbrock(x).cost, stopping=rule)
    np.testing.assert_array_equal(whole.state, cheap.state)
    assert whole.cost_history == cheap.cost_history
    np.testing.assert_array_equal(whole.linearised().matrix, cheap.linearised().matrix)


def test_a_step_is_tested_with_the_associations_that_it_was_made_with() -> None:
    # The nearest of some points, associated anew at each state: without holding it while a step is tested, the cost
    # would compare the distance to one point with that to another.
    points = np.array([0.0, 10.0])

    def linearise(x: np.ndarray) -> DenseEquations:
        target = points[np.argmin(np.abs(points - x))]
        return equations_of((x - target)[:, None], np.ones((1, 1, 1)))

    asked: list[float] = []

    def held(x: np.ndarray, equations: DenseEquations) -> float:
        asked.append(float(x[0]))
        return equations.cost + equations.slope(x - state[0]) + float((x - state[0]) @ (x - state[0]))

    state = [np.array([6.0])]
    result = minimise(
        state[0], linearise, added, trial_cost=held, damping=GAUSS_NEWTON, stopping=StoppingRule(iterations=1)
    )
    np.testing.assert_allclose(result.state, 10.0)
    assert asked == [10.0] and result.cost == 0.0 and result.linearised().gradient == 0.0
