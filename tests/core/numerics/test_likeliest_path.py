"""The likeliest path through places, and the places' probabilities, against all paths written out."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from kfmocap.core.numerics.likeliest_path import (
    cheapest_path,
    likeliest_path,
    place_probabilities,
    state_probabilities,
    steadiest_path,
)


@pytest.mark.parametrize("seed", range(3))
def test_the_way_is_the_best_of_all_and_its_places_are_as_likely_as_they_are(seed: int) -> None:
    rng = np.random.default_rng(seed)
    score, places = rng.normal(size=(4, 3)), rng.normal(size=(4, 3, 2))
    ways = np.array(list(product(range(3), repeat=4)))
    frames = np.arange(4)
    values = np.array([score[frames, w].sum() - 0.5 * (np.diff(places[frames, w], axis=0) ** 2).sum() for w in ways])
    share = np.zeros((4, 3))
    for w, chance in zip(ways, np.exp(values) / np.exp(values).sum(), strict=True):
        share[frames, w] += chance
    best, value = likeliest_path(score, places)
    np.testing.assert_array_equal(best, ways[values.argmax()])
    assert value == pytest.approx(values.max())
    np.testing.assert_allclose(place_probabilities(score, places), share, atol=1e-12)


def all_paths(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Random costs of three states on five frames and of passing between them; all paths, and what each costs."""
    rng = np.random.default_rng(seed)
    costs, changes = rng.normal(size=(3, 5)), rng.normal(size=(5, 3, 3))
    ways = np.array(list(product(range(3), repeat=5)))
    values = [costs[w, range(5)].sum() + sum(changes[f, w[f - 1], w[f]] for f in range(1, 5)) for w in ways]
    return costs, changes, ways, np.array(values)


@pytest.mark.parametrize("seed", range(3))
def test_the_cheapest_path_is_the_cheapest_of_all(seed: int) -> None:
    costs, changes, ways, values = all_paths(seed)
    np.testing.assert_array_equal(cheapest_path(costs, lambda f: changes[f]), ways[np.argmin(values)])


@pytest.mark.parametrize("seed", range(3))
def test_states_are_as_likely_as_all_paths_through_them(seed: int) -> None:
    costs, changes, ways, values = all_paths(seed)
    share = np.zeros((3, 5))
    for w, value in zip(ways, values, strict=True):
        share[w, range(5)] += np.exp(-value)
    probability, together = state_probabilities(costs, lambda f: changes[f])
    np.testing.assert_allclose(probability, share / share.sum(axis=0), atol=1e-12)
    assert together == pytest.approx(-np.log(np.exp(-values).sum()))


@pytest.mark.parametrize("seed", range(3))
def test_the_steadiest_path_is_the_cheapest_of_all(seed: int) -> None:
    rng = np.random.default_rng(seed)
    begin, steps = rng.normal(size=(3, 3)), rng.normal(size=(3, 3, 3, 3))
    ways = list(product(range(3), repeat=5))
    costs = [begin[w[0], w[1]] + sum(steps[f, w[f], w[f + 1], w[f + 2]] for f in range(3)) for w in ways]
    found = steadiest_path(begin, lambda f: steps[f - 2], 5)
    assert tuple(found.tolist()) == ways[int(np.argmin(costs))]
    assert steadiest_path(begin, lambda _: np.zeros((3, 3, 3)), 2).tolist() == list(
        np.unravel_index(begin.argmin(), begin.shape)
    )
