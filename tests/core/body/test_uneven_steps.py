"""Motions whose poses are unevenly spaced in time: accelerations and delays."""

from __future__ import annotations

import numpy as np
import pytest
from kfmocap.core.body.motion import Motion, stacked
from kfmocap.core.body.smoothness import SecondDifferences, acceleration, second_differences, smoothness
from kfmocap.core.body.time_shift import delayed
from synthetic import at_rest, figure, numeric_jacobian, random_motion

BODY = figure()
STEPS = np.array([1.0, 0.5, 2.0, 1.0, 0.25, 1.0])
TIMES = np.cumsum([0.0, *STEPS])


def turning(times: np.ndarray) -> Motion:
    """The motion of constant velocities, at times."""
    velocity = np.random.default_rng(3).normal(0.0, 0.05, BODY.dof)
    return stacked([at_rest(BODY).moved(time * velocity[None]) for time in times])


def test_a_constant_velocity_is_no_acceleration() -> None:
    np.testing.assert_allclose(acceleration(turning(TIMES), STEPS), 0, atol=1e-12)
    assert np.abs(acceleration(turning(TIMES))).max() > 0.01


def test_a_constant_acceleration_is_the_same_at_all_steps() -> None:
    np.testing.assert_allclose(second_differences(0.5 * 0.3 * TIMES[:, None] ** 2, STEPS), 0.3)


def test_even_steps_are_no_different() -> None:
    motion = random_motion(BODY, 7, turn=0.1)
    np.testing.assert_allclose(acceleration(motion, np.ones(6)), acceleration(motion), atol=1e-14)


def test_the_gradient_is_that_of_the_energy() -> None:
    motion, weights = random_motion(BODY, 7, seed=5, turn=0.1), np.ones(BODY.dof)

    def energy(step: np.ndarray) -> np.ndarray:
        moved = motion.moved(step.reshape(7, -1))
        return np.array([smoothness(moved, weights, steps=STEPS).energy / 2])

    gradient = numeric_jacobian(energy, np.zeros(7 * BODY.dof))[0].reshape(7, -1)
    np.testing.assert_allclose(smoothness(motion, weights, steps=STEPS).gradient, gradient, atol=1e-6)
    assert SecondDifferences.of(motion, STEPS).values.shape == (5, BODY.dof)


@pytest.mark.parametrize("delay", [-0.2, 0.2])
def test_a_delay_is_one_in_time(delay: float) -> None:
    found = delayed(turning(TIMES), delay, steps=STEPS).motion
    np.testing.assert_allclose(found.difference(turning(TIMES + delay)), 0, atol=1e-12)


def test_a_delay_between_even_steps_is_no_different() -> None:
    motion = random_motion(BODY, 6, turn=0.1)
    one, other = delayed(motion, 0.3), delayed(motion, 0.3, steps=np.ones(5))
    np.testing.assert_allclose(one.motion.difference(other.motion), 0, atol=1e-14)
    for a, b in zip(one.jacobians, other.jacobians, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-14)
