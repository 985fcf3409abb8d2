"""The likeliest path through places drawn on every frame, of which near ones follow each other.

A hidden Markov model whose states are drawn: Viterbi's algorithm finds the path, forward-backward the probabilities of
the places.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .arrays import Array


def likeliest_path(score: Array, places: Array) -> tuple[NDArray[np.intp], float]:
    """The best way through K places on each of F frames (Viterbi), and its value.

    The value is the sum of the places' scores (F, K) less half the squared distances between places (F, K, d).
    """
    F, K = score.shape
    best, total = np.zeros(F, np.intp), score[0]
    back = np.zeros((F, K), np.intp)
    before, after = _link_factors(places)
    for f in range(1, F):
        through = before[f - 1] @ after[f].T
        through += total[:, None]
        back[f] = through.argmax(axis=0)
        total = through.max(axis=0) + score[f]
    best[-1] = total.argmax()
    for f in range(F - 1, 0, -1):
        best[f - 1] = back[f, best[f]]
    return best, float(total.max())


def place_probabilities(score: Array, places: Array) -> Array:
    """The probability of every place, (F, K), where ways are the likelier the better they are.

    Parameters as of `likeliest_path`.
    """
    last = len(score) - 1
    ahead, behind = score.copy(), np.zeros(score.shape)
    before, after = _link_factors(places)
    # The factors between neighbouring frames are made twice: those of a long segment would fill the memory.
    for f in range(last):
        ahead[f + 1] += _log_sum(ahead[f], np.exp(before[f] @ after[f + 1].T))
    for f in range(last - 1, -1, -1):
        behind[f] = _log_sum(behind[f + 1] + score[f + 1], np.exp(before[f] @ after[f + 1].T).T)
    log = ahead + behind
    share = np.exp(log - log.max(axis=1, keepdims=True))
    return np.asarray(share / share.sum(axis=1, keepdims=True))


def _log_sum(log: Array, factors: Array) -> Array:
    """Logarithms of sums of K numbers, given by their logarithms, with each column of factors (K, L)."""
    top = log.max()
    return np.asarray(top + np.log(np.maximum(np.exp(log - top) @ factors, np.finfo(float).tiny)))


def _link_factors(places: Array) -> tuple[Array, Array]:
    """Rows before[f] and after[f], (K, d + 2), of places (F, K, d): before[f] @ after[f + 1].T is less half the squared
    distance from each of a frame's places to each of the next frame's, (K, K).
    """
    norm = -0.5 * np.einsum("fkd,fkd->fk", places, places)[..., None]
    one = np.ones_like(norm)
    return np.concatenate([places, norm, one], axis=2), np.concatenate([places, one, norm], axis=2)
