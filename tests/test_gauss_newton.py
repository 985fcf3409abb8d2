"""Gauss-Newton over a segment: its parts add up, and its minima are those of the energy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from kfmocap.core import rotations
from kfmocap.core.body import landmark_positions
from kfmocap.core.constraints import BandedBlocks, acceleration, smoothness
from kfmocap.core.evidence.collect import Evidence
from kfmocap.core.evidence.images import ViewFrames
from kfmocap.core.motion import Motion, stacked
from kfmocap.core.shot import Settings
from kfmocap.core.solvers import gauss_newton
from kfmocap.core.solvers.problem import Problem, frame_residual
from synthetic import at_rest, figure, look_at, picture, poses_of, random_motion, swing

BODY = figure()
D = BODY.dof
CAMERAS = (look_at("front", (0.5, -2.8, 1.5)), look_at("side", (-2.4, -1.4, 1.3)))
SETTINGS = Settings()
FPS = 30.0
CONVERGED = (gauss_newton.Stage(1.0, 1.0, 2, 20),)
"""How soon it comes there is not what is tested here."""


def ends_held(frames: int) -> np.ndarray:
    fixed = np.zeros((frames, D), bool)
    fixed[[0, -1]] = True
    return fixed


def dark(frames: int) -> tuple[ViewFrames, ...]:
    """Pictures that show nothing."""
    return (ViewFrames(CAMERAS[0], np.full((frames, 120, 160), 90, np.uint8), 0),)


def filmed(motion: Motion) -> tuple[ViewFrames, ...]:
    poses = poses_of([BODY], [motion])
    return tuple(
        ViewFrames(c, np.stack([picture([BODY], poses, f, c) for f in range(len(motion))]), 0) for c in CAMERAS
    )


def no_evidence(views: int, frames: int, parts: int) -> Evidence:
    V, F, P = views, frames, parts
    gradients = (np.zeros((V, F - 1, P, *shape)) for shape in ((12, 12), (12,)))
    outlines = (np.zeros((V, F, P, *shape)) for shape in ((6, 6), (6,)))
    pairs = (np.zeros((V, F - 1)) for _ in range(4))
    single = (np.zeros((V, F)) for _ in range(2))
    return Evidence(*gradients, *pairs, *outlines, *single, share=np.ones((V, F, P)), stride=1, seconds={})


def systems(problem: Problem, motion: Motion) -> tuple[list[BandedBlocks], Evidence]:
    poses, evidence = problem.evidence(problem.geometry(), [motion], 1.0, 1.0, 2)
    return gauss_newton.normal_equations(problem, [motion], poses, evidence, SETTINGS), evidence


def test_without_evidence_the_motion_between_key_poses_is_the_smoothest() -> None:
    """Held at both ends, that is uniform motion: no acceleration at all."""
    F = 9
    start = swing(BODY, F, 0.3)
    uniform = start[:1].difference(start[-1:])[0] / (F - 1)
    problem = Problem(dark(F), (BODY,), 0, FPS, (ends_held(F),))
    found = gauss_newton.descend(problem, [start], SETTINGS, stages=CONVERGED).motions[0]
    expected = stacked([start[:1].moved(j * uniform[None]) for j in range(F)])
    np.testing.assert_allclose(expected.difference(found), 0, atol=2e-3)
    np.testing.assert_array_equal(found.translations[[0, -1]], start.translations[[0, -1]])


def test_fixed_degrees_of_freedom_do_not_move() -> None:
    F = 7
    start = swing(BODY, F, 0.3)
    fixed = ends_held(F)
    fixed[3, 6:9] = fixed[2, 0] = True
    found = gauss_newton.solve(Problem(dark(F), (BODY,), 0, FPS, (fixed,)), [start], SETTINGS).motions[0]
    moved = start.difference(found)
    np.testing.assert_allclose(moved[fixed], 0, atol=1e-12)
    assert np.abs(moved[1:-1]).max() > 1e-2


def test_views_add_to_the_normal_equations() -> None:
    motion = swing(BODY, 4, 0.1)
    views = filmed(motion)

    def gradients(chosen: tuple[ViewFrames, ...]) -> BandedBlocks:
        problem = Problem(chosen, (BODY,), 0, FPS, (ends_held(4),))
        smooth = problem.smoothness(0, motion, gauss_newton.acceleration_precision(BODY, FPS, SETTINGS))
        [system], _ = systems(problem, motion)
        return replace(
            system,
            diagonal=system.diagonal - smooth.diagonal,
            first=system.first - smooth.first,
            gradient=system.gradient - smooth.gradient,
            energy=system.energy - smooth.energy,
        )

    both, one, other = gradients(views), gradients(views[:1]), gradients(views[1:])
    for name in ("diagonal", "first", "gradient"):
        a, b, c = (getattr(system, name) for system in (both, one, other))
        np.testing.assert_allclose(a, b + c, atol=1e-9 * np.abs(a).max())
    assert both.energy == pytest.approx(one.energy + other.energy)


def test_smoothness_reaches_into_the_frames_known_around() -> None:
    """With the poses before and after it, a stretch has the blocks that it has within the whole motion."""
    motion = random_motion(BODY, 8, turn=0.3)
    precision = np.random.default_rng(0).uniform(1, 2, D)
    whole = smoothness(motion, precision)
    problem = Problem(dark(4), (BODY,), 2, FPS, (ends_held(4),), (motion[[1]],), (motion[[6]],))
    part = problem.smoothness(0, motion[2:6], precision)
    inner = smoothness(motion[1:7], precision)
    np.testing.assert_array_equal(part.diagonal, inner.diagonal[1:5])
    np.testing.assert_array_equal(part.gradient, inner.gradient[1:5])
    np.testing.assert_allclose(part.second, whole.second[2:4])
    alone = Problem(dark(4), (BODY,), 2, FPS, (ends_held(4),)).smoothness(0, motion[2:6], precision)
    np.testing.assert_array_equal(alone.gradient, smoothness(motion[2:6], precision).gradient)


def test_a_stretch_leaves_a_known_frame_with_its_speed() -> None:
    """The frame before the first says how fast the motion comes in."""
    F = 6
    step = np.zeros(D)
    step[0], step[8] = 0.02, 0.05
    whole = stacked([at_rest(BODY).moved(j * step[None]) for j in range(-1, F)])
    start = stacked([whole[[1]]] * F)
    fixed = np.zeros((F, D), bool)
    fixed[0] = True
    problem = Problem(dark(F), (BODY,), 1, FPS, (fixed,), (whole[[0]],))
    found = gauss_newton.descend(problem, [start], SETTINGS, stages=CONVERGED).motions[0]
    np.testing.assert_allclose(whole[1:].difference(found), 0, atol=5e-3)


def test_at_the_true_motion_it_stays_and_from_another_smooth_one_it_comes_back() -> None:
    truth, names = swing(BODY, 6, 0.15), list(BODY.landmarks)
    problem = Problem(filmed(truth), (BODY,), 0, 12.0, (ends_held(6),))
    bow = np.sin(np.pi * np.arange(6) / 5)[:, None]
    wrong = truth.moved(0.05 * bow * np.random.default_rng(1).normal(0, 1, D))

    def error_mm(motion: Motion) -> float:
        true, found = (landmark_positions(BODY, m, names) for m in (truth, motion))
        return 1000 * float(np.linalg.norm(found - true, axis=-1)[1:-1].mean())

    stayed, returned = (gauss_newton.descend(problem, [m], SETTINGS, stages=CONVERGED).motions[0] for m in (truth, wrong))
    assert error_mm(stayed) < 0.2 * error_mm(wrong)
    assert error_mm(returned) < 0.25 * error_mm(wrong)


def test_steps_are_limited_joint_by_joint_and_keep_their_direction() -> None:
    step = np.zeros((2, D))
    step[0, 3:6], step[1, 6:9] = [3.0, 0, 4.0], [0.1, 0.2, 0.2]
    cut = gauss_newton.limited(step)
    longest = gauss_newton.LONGEST_STEP
    np.testing.assert_allclose(cut[0, 3:6], longest * np.array([0.6, 0, 0.8]))
    np.testing.assert_array_equal(cut[1], step[1])


def test_precision_of_acceleration_is_per_frame_squared() -> None:
    """Twice the frames a second: a quarter of the acceleration a frame, sixteen times the precision."""
    slow, fast = (gauss_newton.acceleration_precision(BODY, fps, SETTINGS) for fps in (30, 60))
    np.testing.assert_allclose(fast, 16 * slow)
    assert slow[0] == pytest.approx((900 / SETTINGS.root_acceleration) ** 2)
    assert slow[3] == pytest.approx((900 / SETTINGS.joint_acceleration) ** 2)


def test_residuals_of_frames_are_those_of_the_pairs_on_both_sides() -> None:
    evidence = replace(
        no_evidence(views=2, frames=3, parts=1),
        energy=np.array([[4.0, 0.0], [12.0, 0.0]]),
        weight=np.array([[1.0, 2.0], [3.0, 2.0]]),
    )
    np.testing.assert_allclose(frame_residual(evidence), [2.0, np.sqrt(16 / 8), 0.0])


def test_the_acceleration_that_is_weighed_is_that_of_the_motion() -> None:
    motion = swing(BODY, 6)
    motion.rotations[:, 1] = rotations.exp(np.linspace(0, 1, 6)[:, None] ** 2 * np.array([0, 0, 1.0]))
    precision = gauss_newton.acceleration_precision(BODY, FPS, SETTINGS)
    problem = Problem(dark(6), (BODY,), 0, FPS, (ends_held(6),))
    [system], evidence = systems(problem, motion)
    assert system.energy == pytest.approx(float(np.sum(precision * acceleration(motion) ** 2)))
    assert evidence.energy.max() < 1e-9
