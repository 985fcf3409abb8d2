"""The published relaxation: its terminal terms are derivatives, and it converges to the minimum it is meant to."""

from __future__ import annotations

import numpy as np
import pytest
from kfmocap.core.body.motion import Motion
from kfmocap.core.numerics import rotations
from kfmocap.core.numerics.banded_blocks import BandedBlocks
from kfmocap.core.tracking.solvers.paper_relaxation.motion_steps import StepEquations, Steps
from kfmocap.core.tracking.solvers.paper_relaxation.relaxation import (
    LAMBDA,
    LENGTH_UNIT,
    NU,
    SMOOTHNESS,
    axis_vector,
    relax,
)
from synthetic import at_rest, ends_held, figure, numeric_jacobian, swing

BODY = figure()
D, PARTS = BODY.dof, len(BODY)


def no_gradients(motion: Motion) -> StepEquations:
    return StepEquations.of(BandedBlocks.zeros(len(motion), D), motion)


def own_rows(motion: Motion, A: np.ndarray, b: np.ndarray) -> StepEquations:
    """Rows of which each depends on its own step alone, as (23) has them: A_j x_j - b_j around a motion."""
    return StepEquations.printed(A, (A @ Steps.of(motion).vectors()[..., None])[..., 0] - b, motion)


def test_axis_vector_is_that_of_the_odd_half() -> None:
    v = np.array([0.3, -0.7, 0.2])
    angle = np.linalg.norm(v)
    np.testing.assert_allclose(axis_vector(rotations.exp(v)), v / angle * np.sin(angle), atol=1e-12)
    np.testing.assert_allclose(
        rotations.skew(axis_vector(np.arange(9.0).reshape(3, 3))), [[0, -1, -2], [1, 0, -1], [2, 1, 0]]
    )


@pytest.mark.parametrize("j", [0, 3, 6])
def test_terminal_terms_are_the_derivative_of_the_squared_error_of_the_last_pose(j: int) -> None:
    """(A.1), (A.2): the derivative of ||R^ - R||^2 by a small turn x_j is 4 (x_j - c), c from the odd half of P."""
    rng = np.random.default_rng(j)
    Q = rotations.exp(rng.normal(0, 0.3, (7, 3)))
    first, last = rotations.exp(rng.normal(0, 1, (2, 3)))

    def product(matrices: np.ndarray) -> np.ndarray:
        out = np.eye(3)
        for M in matrices:
            out = out @ M
        return out

    def error(x: np.ndarray) -> float:
        return float(np.sum((first @ product(Q[:j]) @ rotations.exp(x) @ product(Q[j + 1 :]) - last) ** 2))

    P = (first @ product(Q[:j])).T @ last @ product(Q[j + 1 :]).T
    np.testing.assert_allclose(-4 * axis_vector(P), numeric_jacobian(error, np.zeros(3)), atol=1e-8)
    # The factor of x_j is exact where P is near the identity: curvature 4.
    near = rotations.exp(np.array([1e-3, -2e-3, 1e-3]))
    x = np.array([0.02, 0.01, -0.03])
    gradient = numeric_jacobian(lambda y: float(np.sum((rotations.exp(y) - near) ** 2)), x)
    np.testing.assert_allclose(4 * (x - axis_vector(near)), gradient, atol=4 * np.linalg.norm(x) ** 3)


def test_the_translations_terminal_term_is_a_derivative() -> None:
    """(A.3), (A.4): half the derivative of ||T^ - T||^2 by S_j is S_j - (T - T^ + S_j)."""
    shifts, T = np.random.default_rng(0).normal(0, 1, (5, 3)), np.array([1.0, 2.0, 3.0])

    def error(x: np.ndarray) -> float:
        return float(np.sum((shifts.sum(axis=0) - shifts[2] + x - T) ** 2))

    b = T - shifts.sum(axis=0) + shifts[2]
    np.testing.assert_allclose(2 * (shifts[2] - b), numeric_jacobian(error, shifts[2]), atol=1e-7)


def test_without_gradients_the_last_pose_is_met_and_the_error_shared_evenly() -> None:
    """The axis vector of (A.2) is the sine of a turn: a step stops short of it by a sixth of its cube."""
    n = 5
    keyed = at_rest(BODY, n + 1)
    turn = np.array([[0.3, 0, 0], [0, 0.5, 0.2], [0, 0, -0.4], [0.1, 0.1, 0.1]])
    keyed.rotations[-1] = rotations.exp(turn)
    keyed.translations[-1] += [0.2, -0.1, 0.3]
    start = at_rest(BODY, n + 1)
    found = relax(start, keyed, ends_held(BODY, n + 1), no_gradients(start), 1000)
    steps = Steps.of(found)
    np.testing.assert_allclose(steps.shifts, np.tile(np.array([0.2, -0.1, 0.3]) / n, (n, 1)), atol=1e-6)
    np.testing.assert_allclose(steps.turns, np.tile(turn / n, (n, 1, 1)), atol=0.11**3 / 6)


def test_one_sweep_takes_a_part_of_the_error_and_never_all_of_it_in_one_frame() -> None:
    """Equations (26) to (28): with u = 1/n every frame bears its share, whatever the weight."""
    n = 8
    keyed = at_rest(BODY, n + 1)
    keyed.translations[-1] += [1.0, 0, 0]
    start = at_rest(BODY, n + 1)
    found = relax(start, keyed, ends_held(BODY, n + 1), no_gradients(start), 1)
    steps = Steps.of(found).shifts[:, 0]
    assert (steps > 0).all() and steps.max() <= 1 / n + 1e-9
    assert 0.4 < steps.sum() < 1


def test_a_sweep_goes_frame_after_frame_and_each_sees_what_the_one_before_has_become() -> None:
    n, target = 4, 0.6
    keyed = at_rest(BODY, n + 1)
    keyed.translations[-1, 0] += target
    x = np.zeros(n)
    for j in range(n):  # equation (30) by hand
        x_e = x[j] + (target - x.sum()) / n
        ends = x[max(j - 1, 0)] + x[min(j + 1, n - 1)]
        x[j] = (NU * x_e + SMOOTHNESS * ends / 2) / (NU + SMOOTHNESS)
    start = at_rest(BODY, n + 1)
    found = relax(start, keyed, ends_held(BODY, n + 1), no_gradients(start), 1)
    np.testing.assert_allclose(Steps.of(found).shifts[:, 0], x, rtol=1e-9)


def test_a_sweep_over_turns_is_equation_30_with_the_papers_weights() -> None:
    """By hand, for one joint whose turns do not commute: frame after frame, with Q_1 .. Q_j-1 as they have become.

    Lambda is 10, nu 20 and the smoothness 1 (paper 1, section 6).
    """
    n, joint = 5, 2
    rng = np.random.default_rng(4)
    start, keyed = at_rest(BODY, n + 1), at_rest(BODY, n + 1)
    x = rng.normal(0, 0.5, (n, 3))
    for j in range(n):
        start.rotations[j + 1, joint] = start.rotations[j, joint] @ rotations.exp(x[j])
    last = keyed.rotations[-1, joint] = rotations.exp(np.array([0.8, -0.6, 0.5]))
    A, b = np.zeros((n, D, D)), np.zeros((n, D))
    own = slice(3 + 3 * joint, 6 + 3 * joint)
    A[:, own, own] = (rows := rng.normal(0, 2, (n, 3, 3))) @ np.swapaxes(rows, 1, 2)
    b[:, own] = rng.normal(0, 1, (n, 3))
    found = relax(start, keyed, ends_held(BODY, n + 1), own_rows(start, A, b), 1)

    x = x.copy()
    for j in range(n):
        before, after = np.eye(3), np.eye(3)
        for i in range(j):
            before = before @ rotations.exp(x[i])
        for i in range(j + 1, n):
            after = after @ rotations.exp(x[i])
        P = before.T @ last @ after.T
        c = np.array([P[2, 1] - P[1, 2], P[0, 2] - P[2, 0], P[1, 0] - P[0, 1]]) / 2  # (A.2)
        x_e = x[j] + (c - x[j]) / n  # (27)
        beside = x[max(j - 1, 0)] + x[min(j + 1, n - 1)]
        x[j] = np.linalg.solve(A[j, own, own] + (10 + 1) * np.eye(3), b[j, own] + 10 * x_e + beside / 2)
    np.testing.assert_allclose(Steps.of(found).turns[:, joint], x, rtol=1e-9, atol=1e-12)
    assert (LAMBDA, NU, SMOOTHNESS) == (10, 20, 1)


def test_the_first_pose_stays_and_smooth_steps_stay_smooth() -> None:
    truth = swing(BODY, 9)
    found = relax(truth, truth, ends_held(BODY, 9), no_gradients(truth), 300)
    np.testing.assert_array_equal(found.translations[0], truth.translations[0])
    np.testing.assert_allclose(found.rotations[0], truth.rotations[0], atol=1e-12)
    assert np.abs(found[[-1]].difference(truth[[-1]])).max() < 2e-2
    roughness = [np.abs(np.diff(Steps.of(m).vectors(), axis=0)).max() for m in (found, truth)]
    assert roughness[0] < roughness[1]


def test_without_a_last_key_pose_nothing_pulls_to_it() -> None:
    keyed = at_rest(BODY, 6)
    keyed.translations[-1] += 1.0
    fixed = np.zeros((6, D), bool)
    fixed[0] = True
    start = at_rest(BODY, 6)
    found = relax(start, keyed, fixed, no_gradients(start), 50)
    np.testing.assert_allclose(found.difference(at_rest(BODY, 6)), 0, atol=1e-12)


def test_a_partial_last_key_pose_pulls_its_own_degrees_of_freedom() -> None:
    keyed = at_rest(BODY, 6)
    keyed.translations[-1] += [0.1, 0.2, 0.3]
    keyed.rotations[-1] = rotations.exp(np.full((PARTS, 3), 0.2))
    fixed = ends_held(BODY, 6)
    fixed[-1] = False
    fixed[-1, [0, *range(9, 12)]] = True
    start = at_rest(BODY, 6)
    found = relax(start, keyed, fixed, no_gradients(start), 600)
    delta = at_rest(BODY, 6).difference(found)[-1]
    expected = np.zeros(D)
    expected[0], expected[9:12] = 0.1, 0.2
    np.testing.assert_allclose(delta[:3], expected[:3], atol=1e-6)
    np.testing.assert_allclose(delta[3:], expected[3:], atol=0.07**3 / 6)  # see above, of a turn of 0.07 a step
    assert not delta[expected == 0].any()


def test_of_translations_alone_it_finds_the_minimum_of_the_energy_as_a_dense_solve_does() -> None:
    """Equation (21) with quadratic evidence and no turns is convex: a dense solve has its minimum.

    Where sweeps of equation (30) stand still, x' = x + u (x_e - x) leaves nu u (x - x_e) of the terminal term: it is
    the minimum of (21) for nu / n. Written with x_j as unknowns: sum A_j x_j^2 - 2 b_j x_j + (nu / n) |sum x_j - T|^2
    + 1/2 sum |x_j - x_{j-1}|^2. Lengths count in units of `LENGTH_UNIT`.
    """
    n = 8
    rng = np.random.default_rng(3)
    A, b = np.zeros((n, D, D)), np.zeros((n, D))
    nu, smoothness = NU / LENGTH_UNIT**2, SMOOTHNESS / LENGTH_UNIT**2
    for j in range(n):
        rows = rng.normal(0, 1.5 / LENGTH_UNIT, (3, 3))
        A[j, :3, :3] = rows.T @ rows
        b[j, :3] = A[j, :3, :3] @ rng.normal(0.05, 0.05, 3)
    keyed, target = at_rest(BODY, n + 1), np.array([0.7, 0.4, -0.2])
    keyed.translations[-1] += target
    start = at_rest(BODY, n + 1)
    found = relax(start, keyed, ends_held(BODY, n + 1), own_rows(start, A, b), 1500, whole=True)

    system = np.zeros((n, 3, n, 3))
    right = b[:, :3].copy()
    eye = np.eye(3)
    for j in range(n):
        system[j, :, j] += A[j, :3, :3]
        for i in range(n):
            system[j, :, i] += nu / n * eye
        right[j] += nu / n * target
        for i in (j - 1, j + 1):
            if 0 <= i < n:
                system[j, :, j] += smoothness / 2 * eye
                system[j, :, i] -= smoothness / 2 * eye
    expected = np.linalg.solve(system.reshape(3 * n, 3 * n), right.ravel()).reshape(n, 3)
    np.testing.assert_allclose(Steps.of(found).shifts, expected, atol=1e-7)
    np.testing.assert_allclose(found.rotations, at_rest(BODY, n + 1).rotations, atol=1e-12)


def test_no_sweep_of_the_second_half_raises_the_energy_and_few_of_them_suffice() -> None:
    """Of shifts along one axis that the images hardly measure, as depth is with one camera."""
    n, target = 12, 0.3
    a, wanted = np.full(n, 0.2 / LENGTH_UNIT**2), np.random.default_rng(4).normal(0.02, 0.02, n)
    A, b = np.zeros((n, D, D)), np.zeros((n, D))
    A[:, 0, 0], b[:, 0] = a, a * wanted
    start, keyed = at_rest(BODY, n + 1), at_rest(BODY, n + 1)
    keyed.translations[-1, 0] += target
    rows = own_rows(start, A, b)

    def energy(sweeps: int, whole: bool) -> float:
        x = Steps.of(relax(start, keyed, ends_held(BODY, n + 1), rows, sweeps, whole=whole)).shifts[:, 0]
        unit = LENGTH_UNIT if whole else 1.0
        smooth, terminal = SMOOTHNESS / 2 * (np.diff(x) ** 2).sum(), NU / n * (x.sum() - target) ** 2
        return float((a * (x - wanted) ** 2).sum() + (smooth + terminal) / unit**2)

    falling = [energy(k, whole=True) for k in (0, 1, 2, 3, 5, 10, 20, 50, 100, 1000)]
    assert (np.diff(falling) <= 0).all()
    assert falling[-2] - falling[-1] < 1e-3 * (falling[0] - falling[-1])


def test_of_turns_about_one_axis_it_finds_the_minimum_too() -> None:
    """Turns of one joint about one axis commute; for small ones sin x is x to a millionth."""
    n, target = 6, 0.012
    A, b = np.zeros((n, D, D)), np.zeros((n, D))
    rng = np.random.default_rng(1)
    a, wanted = rng.uniform(1, 5, n), rng.normal(0.002, 0.001, n)
    A[:, 6, 6], b[:, 6] = a, a * wanted
    keyed = at_rest(BODY, n + 1)
    keyed.rotations[-1, 1] = rotations.exp(np.array([target, 0, 0]))
    start = at_rest(BODY, n + 1)
    found = relax(start, keyed, ends_held(BODY, n + 1), own_rows(start, A, b), 2000)
    D2 = np.diff(np.eye(n), axis=0)
    system = np.diag(a) + LAMBDA / n * np.ones((n, n)) + SMOOTHNESS / 2 * D2.T @ D2
    expected = np.linalg.solve(system, a * wanted + LAMBDA / n * target)
    np.testing.assert_allclose(Steps.of(found).turns[:, 1, 0], expected, rtol=1e-3, atol=1e-8)


def test_sweeps_rest_where_the_derivative_of_the_energy_vanishes() -> None:
    """Of rows that say where the poses are: (21) is least where (22) holds with all of them, for lambda / n."""
    n, joint = 6, 2
    motion = at_rest(BODY, n + 1)
    rng = np.random.default_rng(6)
    own = slice(3 + 3 * joint, 6 + 3 * joint)
    blocks = BandedBlocks.zeros(n + 1, D)
    blocks.diagonal[:, own, own] = (a := rng.normal(0, 2, (n + 1, 3, 3))) @ np.swapaxes(a, 1, 2)
    blocks.gradient[:, own] = -rng.normal(0, 0.002, (n + 1, 3))
    rows = StepEquations.of(blocks, motion)
    x = Steps.of(relax(motion, motion, ends_held(BODY, n + 1), rows, 2000)).vectors()
    beside = np.concatenate([x[:1], x, x[-1:]])
    smooth = SMOOTHNESS * (x - (beside[:-2] + beside[2:]) / 2)
    terminal = LAMBDA / n * x.sum(axis=0)  # of turns so small that they commute
    left = (rows.gradient(x) + smooth + terminal)[:, own]
    assert np.abs(left).max() < 1e-3 * np.abs(rows.gradient(rows.steps)[:, own]).max()


def test_it_does_not_matter_where_the_world_is() -> None:
    n = 6
    rng = np.random.default_rng(5)
    rows = rng.normal(0, 1, (n, 2 * D, D))
    A = np.swapaxes(rows, 1, 2) @ rows
    keyed = swing(BODY, n + 1)
    b = (A @ Steps.of(keyed).vectors()[..., None])[..., 0] + rng.normal(0, 0.01, (n, D))
    here = relax(keyed, keyed, ends_held(BODY, n + 1), own_rows(keyed, A, b), 50)
    shift = np.array([5.0, -3.0, 1.0])
    moved = Motion(keyed.translations + shift, keyed.rotations)
    there = relax(moved, moved, ends_held(BODY, n + 1), own_rows(moved, A, b), 50)
    np.testing.assert_allclose(there.translations - shift, here.translations, atol=1e-9)
    np.testing.assert_allclose(there.rotations, here.rotations, atol=1e-9)
