"""Least-squares problems that are solved side by side."""

from __future__ import annotations

import numpy as np
from kfmocap.core.numerics.least_squares_batch import minimise_each
from scipy.optimize import least_squares

TIMES = np.linspace(0.0, 3.0, 25)
TRUTH = np.array([[2.0, 0.7], [0.5, 1.6], [1.2, 0.2]])
"""Heights and rates of three decays."""
OFF = 0.02 * np.sin(np.arange(75)).reshape(3, 25)
"""No curve goes through all of a problem's values."""
VALUES = TRUTH[:, :1] * np.exp(-TRUTH[:, 1:] * TIMES) + OFF
START = np.array([[1.0, 0.0], [3.0, 3.0], [0.3, 0.5]])


def residuals(x, which):
    return x[:, :1] * np.exp(-x[:, 1:] * TIMES) - VALUES[which]


def linearise(x, which):
    fall, r = np.exp(-x[:, 1:] * TIMES), residuals(x, which)
    J = np.stack([fall, -x[:, :1] * TIMES * fall], axis=2)
    return (r**2).sum(axis=1), np.swapaxes(J, 1, 2) @ J, np.einsum("ktd,kt->kd", J, r)


def test_each_problem_comes_to_its_minimum():
    found = minimise_each(START, linearise, tolerance=1e-12, evaluations=100)
    for k, start in enumerate(START):
        alone = least_squares(lambda x, k=k: residuals(x[None], [k])[0], start, xtol=1e-15, ftol=1e-15, gtol=1e-15)
        np.testing.assert_allclose(found[k], alone.x, atol=1e-6)


def test_a_problem_does_not_depend_on_those_beside_it():
    together = minimise_each(START, linearise, tolerance=1e-9, evaluations=100)
    for k in range(3):
        alone = minimise_each(START[[k]], lambda x, _, k=k: linearise(x, [k]), tolerance=1e-9, evaluations=100)
        np.testing.assert_allclose(together[k], alone[0], atol=1e-12)


def test_no_cost_is_higher_than_at_the_start_however_few_evaluations_there_are():
    costs = linearise(START, slice(None))[0]
    for evaluations in range(1, 6):
        found = minimise_each(START, linearise, tolerance=0.0, evaluations=evaluations)
        assert (linearise(found, slice(None))[0] <= costs).all()
        costs = linearise(found, slice(None))[0]
