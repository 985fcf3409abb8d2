"""The most likely path through states, such as candidate places that were sampled on every frame.

Where consecutive places are close together, this is a hidden Markov model whose states are samples: Viterbi's algorithm
finds the path, the forward-backward algorithm the probabilities of the places. Where it is velocities that change
little, states of three frames in a row have a cost.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from .arrays import Array, Ints


def likeliest_path(score: Array, places: Array) -> tuple[NDArray[np.intp], float]:
    """Return the best path through K places on each of F frames by Viterbi's algorithm: an index per frame (F,), and
    its value.

    The value is the sum of the scores (F, K) of its places minus half the sum of squared distances between consecutive
    places (F, K, d).
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
    """Return the posterior probability of every place, (F, K), if the probability of a path is proportional to exp(its
    value).

    Parameters are those of `likeliest_path`.
    """
    last = len(score) - 1
    ahead, behind = score.copy(), np.zeros(score.shape)
    before, after = _link_factors(places)
    # The factors between neighbouring frames are computed twice: storing those of a long segment would fill the memory.
    for f in range(last):
        ahead[f + 1] += _log_sum(ahead[f], np.exp(before[f] @ after[f + 1].T))
    for f in range(last - 1, -1, -1):
        behind[f] = _log_sum(behind[f + 1] + score[f + 1], np.exp(before[f] @ after[f + 1].T).T)
    log = ahead + behind
    share = np.exp(log - log.max(axis=1, keepdims=True))
    return np.asarray(share / share.sum(axis=1, keepdims=True))


def cheapest_path(costs: Array, change: Callable[[int], Array]) -> Ints:
    """Return the cheapest path through S states on each of F frames by Viterbi's algorithm: a state per frame, (F,).

    Parameters
    ----------
    costs : ndarray, shape (S, F)
        Of being in a state.
    change : callable
        Of a frame from 1 on: costs (S, S) of passing from each state on the frame before it to each on its own.
    """
    total, before = costs[:, 0], []
    for f in range(1, costs.shape[1]):
        paths = total[:, None] + change(f)
        before.append(paths.argmin(axis=0))
        total = paths.min(axis=0) + costs[:, f]
    chosen = [int(total.argmin())]
    for earlier in reversed(before):
        chosen.append(int(earlier[chosen[-1]]))
    return np.array(chosen[::-1], np.intp)


def state_probabilities(costs: Array, change: Callable[[int], Array]) -> tuple[Array, float]:
    """Return the posterior probability of every state, (S, F), if that of a path is proportional to exp(-its cost), by
    the forward-backward algorithm; and the cost of all paths together, minus the logarithm of the sum.

    Parameters are those of `cheapest_path`.
    """
    frames = costs.shape[1]
    ahead, behind = -costs, np.zeros(costs.shape)
    changes = [np.exp(-change(f)) for f in range(1, frames)]
    for f in range(1, frames):
        ahead[:, f] += _log_sum(ahead[:, f - 1], changes[f - 1])
    for f in range(frames - 2, -1, -1):
        behind[:, f] = _log_sum(behind[:, f + 1] - costs[:, f + 1], changes[f].T)
    log = ahead + behind
    share = np.exp(log - log.max(axis=0))
    top = ahead[:, -1].max()
    return share / share.sum(axis=0), -float(top + np.log(np.exp(ahead[:, -1] - top).sum()))


def steadiest_path(begin: Array, step: Callable[[int], Array], frames: int) -> Ints:
    """Return the cheapest path through S states on each of two frames or more by dynamic programming over pairs of
    neighbouring frames: a state per frame, shape (frames,).

    Parameters
    ----------
    begin : ndarray, shape (S, S)
        Costs of the states of the first two frames.
    step : callable
        Of a frame from 2 on: costs (S, S, S), by the states of the two frames before it and its own.
    frames : int
    """
    costs, before = begin, []
    for f in range(2, frames):
        paths = costs[:, :, None] + step(f)
        before.append(paths.argmin(axis=0))
        costs = paths.min(axis=0)
    chosen = [int(state) for state in np.unravel_index(costs.argmin(), costs.shape)][::-1]
    for earlier in reversed(before):
        chosen.append(int(earlier[chosen[-1], chosen[-2]]))
    return np.array(chosen[::-1], np.intp)


def _log_sum(log: Array, factors: Array) -> Array:
    """Logarithms of the L sums over K numbers times factors (K, L), from the logarithms of the numbers."""
    top = log.max()
    return np.asarray(top + np.log(np.maximum(np.exp(log - top) @ factors, np.finfo(float).tiny)))


def _link_factors(places: Array) -> tuple[Array, Array]:
    """Factors before and after (F, K, d + 2) of the costs between neighbouring frames, from places (F, K, d).

    before[f] @ after[f + 1].T (K, K) is minus half the squared distance of each place on a frame from each on the next.
    """
    norm = -0.5 * np.einsum("fkd,fkd->fk", places, places)[..., None]
    one = np.ones_like(norm)
    return np.concatenate([places, norm, one], axis=2), np.concatenate([places, one, norm], axis=2)
