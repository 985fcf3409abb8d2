"""The published relaxation: its terminal terms are derivatives, and it converges to the minimum it is meant to."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from kfmocap.core.body.motion import Motion, stacked
from kfmocap.core.evidence.sampling import Sampling
from kfmocap.core.evidence.view_frames import ViewFrames
from kfmocap.core.numerics import rotations
from kfmocap.core.numerics.banded_blocks import BandedBlocks
from kfmocap.core.numerics.repeatable import GRID
from kfmocap.core.shot.shot import Settings
from kfmocap.core.tracking.solvers.equations.measurement import MeasuredMotion, Workspace
from kfmocap.core.tracking.solvers.equations.problem import SegmentProblem
from kfmocap.core.tracking.solvers.paper_relaxation import gradient_following
from kfmocap.core.tracking.solvers.paper_relaxation.gradient_following import (
    follow_gradients,
    out_of_sight,
    predicted_step,
    without_drift,
)
from kfmocap.core.tracking.solvers.paper_relaxation.motion_steps import StepEquations, Steps
from kfmocap.core.tracking.solvers.paper_relaxation.relaxation import (
    LAMBDA,
    LENGTH_UNIT,
    NU,
    SMOOTHNESS,
    axis_vector,
    relax,
    relaxed,
)
from kfmocap.core.tracking.solvers.paper_relaxation.step_rows import rows_of_steps
from made_evidence import AlteredWorkspace, with_share
from synthetic import at_rest, ends_held, figure, look_at, numeric_jacobian, picture, poses_of, random_motion, swing

BODY = figure()
D, PARTS = BODY.dof, len(BODY)
ARM = [BODY.index("upper_arm.L"), BODY.index("forearm.L")]
HIDDEN_FROM = 8
WITH, WITHOUT = Settings("relaxation", sweeps=20), Settings("relaxation", sweeps=20, prediction=False)


def no_gradients(motion: Motion) -> StepEquations:
    return StepEquations.of(BandedBlocks.zeros(len(motion), D), motion)


def own_rows(motion: Motion, A: np.ndarray, b: np.ndarray) -> StepEquations:
    """Rows of which each depends on its own step alone, as (23) has them: A_j x_j - b_j around a motion."""
    return StepEquations.printed(A, (A @ Steps.of(motion).vectors()[..., None])[..., 0] - b, motion)


def any_rows(motion: Motion, seed: int, size: float = 1.0) -> BandedBlocks:
    """Rows that three neighbouring poses share, as views between the frames have them."""
    rng, F = np.random.default_rng(seed), len(motion)
    blocks = BandedBlocks.zeros(F, D)
    blocks.gradient[:] = size * rng.normal(0, 1, (F, D))
    for f in range(F):
        rows = rng.normal(0, size, (2 * D, 3, D))
        for a in range(min(3, F - f)):
            blocks.diagonal[f + a] += rows[:, a].T @ rows[:, a]
        if f + 1 < F:
            blocks.first[f] += rows[:, 1].T @ rows[:, 0]
        if f + 2 < F:
            blocks.first[f + 1] += rows[:, 2].T @ rows[:, 1]
            blocks.second[f] += rows[:, 2].T @ rows[:, 0]
    return blocks


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


def test_steps_accumulate_to_the_motion_they_are_of() -> None:
    motion = random_motion(BODY, 6)
    again = Steps.of(motion).accumulated(motion)
    np.testing.assert_allclose(again.difference(motion), 0, atol=1e-9)
    assert Steps.of(motion).vectors().shape == (5, D)


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


def test_an_initial_solution_ends_at_the_key_pose_and_has_lost_most_of_its_drift() -> None:
    """Drift of velocities that wander, in place and turn: closer than as it was, and than with equal shares (28)."""
    n, draws = 20, 200
    s = np.linspace(0, 1, n + 1)[:, None]
    errors = np.zeros(3)
    keyed, fixed = at_rest(BODY, n + 1), ends_held(BODY, n + 1)
    for seed in range(draws):
        drift = np.random.default_rng(seed).normal(0, 1e-4, (n + 1, D))
        drift[0] = 0.0
        drift = drift.cumsum(axis=0).cumsum(axis=0)
        strayed = keyed.moved(drift)
        found = without_drift(strayed, keyed, fixed)
        np.testing.assert_allclose(found.difference(keyed)[[0, -1]], 0, atol=1e-12)
        equal = strayed.moved(s * strayed.difference(keyed)[-1])
        errors += [np.square(m.difference(keyed)[1:-1]).sum() for m in (found, strayed, equal)]
    assert errors[0] < 0.1 * errors[1] and errors[0] < 0.5 * errors[2]
    fixed[-1, 3:] = False
    np.testing.assert_allclose(without_drift(strayed, keyed, fixed).rotations, strayed.rotations, atol=1e-12)


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


def moved_by_steps(motion: Motion, change: np.ndarray) -> Motion:
    """The motion whose steps are moved, and so all poses after each."""
    T = motion.translations.copy()
    T[1:] += np.cumsum(change[:, :3], axis=0)
    Q = [motion.rotations[0]]
    for before, after, step in zip(motion.rotations[:-1], motion.rotations[1:], change[:, 3:], strict=True):
        Q.append(Q[-1] @ before.swapaxes(-1, -2) @ after @ rotations.exp(step.reshape(-1, 3)))
    return Motion(T, np.stack(Q))


def test_the_derivative_by_a_step_has_the_rows_of_all_poses_that_it_moves() -> None:
    """Equation (22), of rows that depend on the poses in any way."""
    motion = random_motion(BODY, 5, turn=0.4)
    blocks = any_rows(motion, 2)
    rows = StepEquations.of(blocks, motion)

    def energy(change: np.ndarray) -> float:
        step = motion.difference(moved_by_steps(motion, change.reshape(4, D)))
        return float(((blocks.gradient_at(step) + blocks.gradient) * step).sum() / 2)

    numeric = numeric_jacobian(energy, np.zeros(4 * D)).reshape(4, D)
    np.testing.assert_allclose(rows.gradient(rows.steps), numeric, atol=1e-5 * np.abs(numeric).max())


def test_a_sweep_solves_each_step_for_the_whole_derivative() -> None:
    """By hand: at every step the derivative (22) is taken anew, with the steps before as they have become."""
    n = 5
    motion = random_motion(BODY, n + 1, turn=0.4)
    rows = StepEquations.of(any_rows(motion, 3), motion)
    fixed = np.zeros((n + 1, D), bool)
    fixed[0] = True
    found = Steps.of(relax(motion, motion, fixed, rows, 1, whole=True))
    x, each = rows.steps.copy(), np.eye(D)
    for j in range(n):

        def derivative(own: np.ndarray, j: int = j) -> np.ndarray:
            return rows.gradient(np.where(np.arange(n)[:, None] == j, own, x))[j]

        at_zero = derivative(np.zeros(D))
        A = np.stack([derivative(e) - at_zero for e in each], axis=1)
        smooth = SMOOTHNESS / np.concatenate([np.full(3, LENGTH_UNIT), np.ones(D - 3)]) ** 2
        beside = x[max(j - 1, 0)] + x[min(j + 1, n - 1)]
        x[j] = np.linalg.solve(A + np.diag(smooth), smooth * beside / 2 - at_zero)
    np.testing.assert_allclose(rotations.exp(found.turns), rotations.exp(x[:, 3:].reshape(n, -1, 3)), atol=1e-8)
    np.testing.assert_allclose(found.shifts, x[:, :3], atol=1e-8)


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


def test_weights_mean_the_same_at_every_resolution_and_stride() -> None:
    """The same scene in pictures of half and full size, by every pixel or every second one, gives the same rows."""
    motion = random_motion(BODY, 2, turn=0.02, shift=0.01)
    traces = []
    for scale, stride in ((1, 1), (2, 1), (2, 2)):
        camera = look_at("front", (0.3, -3.0, 1.4), (0, 0, 1.1), (160 * scale, 120 * scale), 150 * scale)
        poses = poses_of([BODY], [motion])
        grey = np.stack([picture([BODY], poses, f, camera) for f in range(len(motion))])
        fixed = (ends_held(BODY, len(motion)),)
        problem = SegmentProblem((ViewFrames(camera, grey, 0),), (BODY,), 0, 30.0, fixed)
        measured = Workspace().measure(problem, [motion], Sampling(1.5 * scale, 1.0, stride))
        [rows] = rows_of_steps(problem, measured, measured.evidence)
        traces.append(np.trace(rows.curvature, axis1=1, axis2=2))
    np.testing.assert_allclose(traces[1:], [traces[0]] * 2, rtol=0.2)


def turning(frames: int) -> Motion:
    """One joint turns to and fro about an axis, the root walks, the rest stands still."""
    motion = at_rest(BODY, frames)
    angle = 0.6 * np.sin(2 * np.pi * np.arange(frames) / 20)
    motion.rotations[:, ARM[0]] = rotations.exp(angle[:, None] * [0.0, 0.6, 0.8])
    motion.translations[:, 0] += 0.01 * np.arange(frames)
    return motion


def test_a_hidden_parts_steps_continue_its_series() -> None:
    motion = turning(60)
    hidden = np.zeros((59, PARTS), bool)
    hidden[50:, ARM[0]] = True
    known, found = motion[:51], []
    for j in range(50, 56):
        found.append(predicted_step(known, hidden[:j]))
        known = stacked([known, known[-1:].moved(found[-1][None])])
    truth = Steps.of(motion).vectors()[50:56]
    joint = slice(3 + 3 * ARM[0], 6 + 3 * ARM[0])
    off = np.linalg.norm(np.array(found)[:, joint] - truth[:, joint], axis=1)
    assert off.max() < 0.2 * np.linalg.norm(truth[:, joint], axis=1).max()


def test_what_was_predicted_teaches_nothing() -> None:
    motion = turning(50)
    hidden = np.zeros((49, PARTS), bool)
    hidden[40:, ARM[0]] = True
    wild = motion.replaced(41, random_motion(BODY, 9))
    wild.rotations[:, [p for p in range(PARTS) if p != ARM[0]]] = np.eye(3)
    wild.translations[:] = motion.translations
    np.testing.assert_allclose(predicted_step(wild, hidden), predicted_step(motion, hidden), atol=1e-12)


def test_before_it_was_ever_seen_a_part_stands_still() -> None:
    assert not predicted_step(at_rest(BODY), np.zeros((0, PARTS), bool)).any()
    assert not predicted_step(random_motion(BODY, 5), np.ones((4, PARTS), bool)).any()


@pytest.fixture(scope="module")
def passing() -> tuple[SegmentProblem, list[Motion]]:
    """An arm that goes out of a camera's sight behind the trunk."""
    motion = at_rest(BODY, 18)
    angle = np.linspace(1.2, -0.1, len(motion))
    motion.rotations[:, ARM[0]] = rotations.exp(angle[:, None] * [0.0, 0.0, 1.0])
    camera = look_at("side", (-3.5, 0.0, 1.3), (0, 0, 1.2))
    poses = poses_of([BODY], [motion])
    grey = np.stack([picture([BODY], poses, f, camera) for f in range(len(motion))])
    fixed = ends_held(BODY, len(motion))
    return SegmentProblem((ViewFrames(camera, grey, 0),), (BODY,), 0, 30.0, (fixed,)), [motion]


def gone(problem: SegmentProblem, motion: Motion, ahead: Motion) -> np.ndarray:
    pair = replace(problem, fixed=(problem.fixed[0][1:3],))
    return out_of_sight(pair, [stacked([motion, ahead])])[0]


def test_a_part_is_out_of_sight_with_all_it_carries_now_or_where_it_is_predicted_step(
    passing: tuple[SegmentProblem, list[Motion]],
) -> None:
    problem, [motion] = passing
    seen, unseen = motion[:1], motion[-1:]
    assert not gone(problem, seen, seen).any()
    for pair in ((unseen, unseen), (seen, unseen), (unseen, seen)):
        assert np.flatnonzero(gone(problem, *pair)).tolist() == ARM
    bent = motion[-1:].moved(np.zeros((1, D)))
    bent.rotations[:, ARM[1]] = rotations.exp(np.array([0, 0, 1.5]))
    assert not gone(problem, bent, bent).any(), "the forearm tells of the upper arm"


def test_a_part_that_is_keyed_is_never_out_of_sight(passing: tuple[SegmentProblem, list[Motion]]) -> None:
    problem, [motion] = passing
    fixed = problem.fixed[0].copy()
    fixed[2, 3 + 3 * ARM[1] : 6 + 3 * ARM[1]] = True
    keyed = replace(problem, fixed=(fixed,))
    assert np.flatnonzero(gone(keyed, motion[-1:], motion[-1:])).tolist() == ARM[:1]


def hide_the_arm(pair: SegmentProblem, *_: object) -> list[np.ndarray]:
    return [np.isin(np.arange(PARTS), ARM) & (pair.first >= HIDDEN_FROM)]


def test_a_hidden_arm_moves_as_predicted_until_it_is_seen_again(
    passing: tuple[SegmentProblem, list[Motion]], monkeypatch: pytest.MonkeyPatch
) -> None:
    problem, start = passing
    monkeypatch.setattr(gradient_following, "out_of_sight", hide_the_arm)
    found, gradients = (follow_gradients(replace(problem, settings=s), start, Workspace())[0] for s in (WITH, WITHOUT))
    x, hidden = Steps.of(found).vectors(), np.zeros((len(found) - 1, PARTS), bool)
    hidden[HIDDEN_FROM:, ARM] = True
    arm = np.repeat([False, False, True, True, False], 3)
    for j in range(HIDDEN_FROM, len(x)):
        expected = predicted_step(found[: j + 1], hidden[:j])
        np.testing.assert_allclose(x[j, arm], expected[arm], atol=1e-9)
    assert np.abs(x[HIDDEN_FROM:, arm]).max() > 1e-3
    np.testing.assert_allclose(x[:HIDDEN_FROM], Steps.of(gradients).vectors()[:HIDDEN_FROM], atol=1e-6)


def test_gradients_alone_follow_an_arm_that_is_seen(passing: tuple[SegmentProblem, list[Motion]]) -> None:
    """Equation (12): from the first pose on, each step takes the arm along on the way that it goes."""
    problem, [motion] = passing
    start = [stacked([motion[:1]] * HIDDEN_FROM)]
    fixed = (problem.fixed[0][:HIDDEN_FROM] & (np.arange(HIDDEN_FROM) == 0)[:, None],)
    [found] = follow_gradients(replace(problem, fixed=fixed, settings=WITHOUT), start, Workspace())
    gone, true = (m[[0]].difference(m[[HIDDEN_FROM - 1]])[0, 6:9] for m in (found, motion))
    assert 0.1 < gone @ true / (true @ true) < 1.1
    assert np.linalg.norm(gone - true * (gone @ true) / (true @ true)) < 0.05 * np.linalg.norm(true)


@pytest.mark.parametrize("metres", [0.1, 0.2, 0.3])
def test_a_first_step_that_leaves_the_pattern_behind_is_followed_from_coarse_to_fine(metres: float) -> None:
    """It goes sideways by up to 19 pixels; the arms are 9 pixels wide."""
    motion = at_rest(BODY, 2)
    motion.translations[1, 0] += metres
    camera = look_at("front", (0.0, -3.0, 1.3), (0, 0, 1.2))
    grey = np.stack([picture([BODY], poses_of([BODY], [motion]), f, camera) for f in range(2)])
    problem = SegmentProblem((ViewFrames(camera, grey, 0),), (BODY,), 0, 30.0, (np.zeros((2, D), bool),))
    settings = replace(WITHOUT, correlation_length=0.03)
    [found] = follow_gradients(replace(problem, settings=settings), [stacked([motion[:1]] * 2)], Workspace())
    np.testing.assert_allclose(found.translations[1], motion.translations[1], atol=0.01)


def test_a_step_begins_with_the_one_before_and_stands_still_where_nothing_is_seen(
    passing: tuple[SegmentProblem, list[Motion]],
) -> None:
    problem, start = passing
    begun: dict[int, np.ndarray] = {}

    def blind(problem: SegmentProblem, measured: MeasuredMotion) -> MeasuredMotion:
        begun.setdefault(problem.first, Steps.of(measured.motions[0]).vectors()[0])
        sums, seen = measured.evidence.gradients, problem.first < HIDDEN_FROM
        return replace(
            measured, evidence=replace(measured.evidence, gradients=replace(sums, H=sums.H * seen, g=sums.g * seen))
        )

    problem = replace(problem, settings=WITHOUT)
    x = Steps.of(follow_gradients(problem, start, AlteredWorkspace(alter=blind))[0]).vectors()
    np.testing.assert_allclose(begun[0], 0.0, atol=1e-12)
    np.testing.assert_allclose([begun[j] for j in range(1, len(x))], x[:-1], atol=1e-9)
    assert np.abs(x[HIDDEN_FROM - 1]).max() > 1e-2
    np.testing.assert_allclose(x[HIDDEN_FROM:], 0.0, atol=GRID)  # to which steps are rounded


def limbs_alone(_problem: SegmentProblem, measured: MeasuredMotion) -> MeasuredMotion:
    """Nothing is seen of the trunk."""
    sums, limbs = measured.evidence.gradients, np.arange(PARTS) > 0
    sums = replace(sums, H=sums.H * limbs[:, None, None], g=sums.g * limbs[:, None])
    return replace(measured, evidence=replace(measured.evidence, gradients=sums))


def test_a_hidden_parts_pixels_move_nothing_in_the_initial_solution(
    passing: tuple[SegmentProblem, list[Motion]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither do they move the trunk that the part hangs from, of which nothing is seen here."""
    problem, start = passing
    problem = replace(problem, settings=WITH)
    for hidden in (False, True):
        monkeypatch.setattr(gradient_following, "out_of_sight", lambda *_, h=hidden: [h & (np.arange(PARTS) > 0)])
        found = follow_gradients(problem, start, AlteredWorkspace(alter=limbs_alone))[0]
        moved = np.abs(found.difference(stacked([start[0][:1]] * len(found)))).max()
        assert moved < 1e-12 if hidden else moved > 1e-2


def test_pixels_of_hidden_parts_do_not_count_in_the_sweeps(passing: tuple[SegmentProblem, list[Motion]]) -> None:
    """Equation (38): what the pixels of a part say does not matter on frames where no view sees it."""
    problem, start = passing
    part, frames = 3, slice(4, 7)

    def unseen(problem: SegmentProblem, share: np.ndarray) -> np.ndarray:
        hidden = np.zeros(share.shape, bool)
        if share.shape[1] == len(start[0]):  # the sweeps see the whole segment, the initial solution pairs of frames
            hidden[:, frames, part] = True
        return np.where(hidden, 0.0, 1.0)

    def misled(problem: SegmentProblem, measured: MeasuredMotion) -> MeasuredMotion:
        sums = measured.evidence.gradients
        if measured.evidence.share.shape[1] == len(start[0]):
            sums = replace(sums, g=sums.g.copy())
            sums.g[:, frames.start - 1 : frames.stop, part] += 100.0
        return replace(measured, evidence=replace(measured.evidence, gradients=sums))

    def found(settings: Settings, *changes: AlteredWorkspace) -> Motion:
        def alter(problem: SegmentProblem, measured: MeasuredMotion) -> MeasuredMotion:
            for change in changes:
                measured = change.alter(problem, measured)
            return measured

        return relaxed(replace(problem, settings=settings), start, AlteredWorkspace(alter=alter)).motions[0]

    hiding, misleading = with_share(unseen), AlteredWorkspace(alter=misled)
    np.testing.assert_array_equal(found(WITH, hiding, misleading).rotations, found(WITH, hiding).rotations)
    assert np.abs(found(WITHOUT, hiding, misleading).difference(found(WITHOUT, hiding))).max() > 1e-2


def test_without_prediction_it_does_not_matter_what_is_hidden(passing: tuple[SegmentProblem, list[Motion]]) -> None:
    problem, start = passing
    blind = with_share(lambda _, share: np.zeros_like(share))

    def found(settings: Settings, workspace: Workspace) -> Motion:
        return relaxed(replace(problem, settings=settings), start, workspace).motions[0]

    before, after = found(WITHOUT, Workspace()), found(WITHOUT, blind)
    np.testing.assert_array_equal(after.rotations, before.rotations)
    np.testing.assert_array_equal(after.translations, before.translations)
    assert np.abs(found(WITH, blind).difference(before)).max() > 1e-3
