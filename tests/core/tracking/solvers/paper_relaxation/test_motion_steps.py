"""The steps from pose to pose that the relaxation solves for, and the rows of their equations."""

from __future__ import annotations

import numpy as np
from kfmocap.core.body.motion import Motion
from kfmocap.core.evidence.sampling import Sampling
from kfmocap.core.evidence.view_frames import ViewFrames
from kfmocap.core.numerics import rotations
from kfmocap.core.numerics.banded_blocks import BandedBlocks
from kfmocap.core.tracking.solvers.equations.measurement import Workspace
from kfmocap.core.tracking.solvers.equations.problem import SegmentProblem
from kfmocap.core.tracking.solvers.paper_relaxation.motion_steps import StepEquations, Steps
from kfmocap.core.tracking.solvers.paper_relaxation.relaxation import LENGTH_UNIT, SMOOTHNESS, relax
from kfmocap.core.tracking.solvers.paper_relaxation.step_rows import rows_of_steps
from synthetic import ends_held, figure, look_at, numeric_jacobian, picture, poses_of, random_motion

BODY = figure()
D, PARTS = BODY.dof, len(BODY)
ARM = [BODY.index("upper_arm.L"), BODY.index("forearm.L")]


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


def test_steps_accumulate_to_the_motion_they_are_of() -> None:
    motion = random_motion(BODY, 6)
    again = Steps.of(motion).accumulated(motion)
    np.testing.assert_allclose(again.difference(motion), 0, atol=1e-9)
    assert Steps.of(motion).vectors().shape == (5, D)


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
