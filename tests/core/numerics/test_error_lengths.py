"""Intervals of errors in space hold the share of them that they are said to hold."""

from __future__ import annotations

import numpy as np
import pytest
from kfmocap.core.numerics.error_lengths import length_quantile

DRAWS = 40_000
SHAPES = ((1.0, 1.0, 1.0), (1.0, 0.3, 0.1), (1.0, 1.0, 0.0), (1.0, 0.0, 0.0))


def drawn(shape: tuple[float, ...], tails: float, rng: np.random.Generator) -> np.ndarray:
    errors = rng.normal(size=(DRAWS, 3)) * np.sqrt(shape)
    return errors if np.isinf(tails) else errors / np.sqrt(rng.chisquare(tails, (DRAWS, 1)) / tails)


@pytest.mark.parametrize("tails", [np.inf, 8.0])
def test_nine_tenths_of_errors_of_any_shape_are_within_the_interval(tails: float) -> None:
    rng = np.random.default_rng(0)
    for shape in SHAPES:
        length = length_quantile(np.diag(shape), 0.9, tails=tails)
        assert np.mean(np.linalg.norm(drawn(shape, tails, rng), axis=1) <= length) == pytest.approx(0.9, abs=0.01)


@pytest.mark.parametrize("share", [0.05, 0.3])
def test_gross_errors_count_for_their_share(share: float) -> None:
    rng = np.random.default_rng(0)
    errors = drawn((1.0, 0.3, 0.1), np.inf, rng)
    gross = rng.random(DRAWS) < share
    errors[gross] = rng.normal(0, 20 / np.sqrt(3), (gross.sum(), 3))
    length = length_quantile(
        np.diag((1.0, 0.3, 0.1)), 0.9, tails=np.inf, gross=np.array(share), gross_length=np.array(20.0)
    )
    assert np.mean(np.linalg.norm(errors, axis=1) <= length) == pytest.approx(0.9, abs=0.01)


def test_what_is_certain_has_no_interval() -> None:
    assert not length_quantile(np.zeros((4, 3, 3)), 0.9, tails=8.0, gross=np.zeros(4), gross_length=np.ones(4)).any()
