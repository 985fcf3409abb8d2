"""What the footage of a segment says about delays of its views: their normal equations, with the motion eliminated.

If a camera, or the program that copied its file, lost a frame, everything that the view shows from there on is early by
one. The solution lies between what this view and the others show, so that how far the view is off cannot be read off
its residuals. It is therefore estimated together with the motion: a delay of one view from a frame on is one more
unknown beside the poses, which are eliminated from its normal equation (Schur complement). Key poses, the other views
and the gaps between frames all count, and a delay that the motion itself could explain has no precision. What is left
of the poses' own gradient is eliminated as well: a motion that has not quite converged would else pass for a delay.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ....body import twist_jacobian
from ....body.motion import Motion
from ....numerics.arrays import Array, Bools, Ints, evenly_spaced
from .hold_factor import TiedSystems
from .measurement import Instants, MeasuredMotion
from .problem import SegmentProblem
from .weighted_evidence import WeightedEvidence

MAX_STARTS = 48
"""Number of frames of a segment on which a delay may begin, at most."""


@dataclass(frozen=True, eq=False)
class DelayEvidence:
    """What a segment's footage says about delays of each of V views from one of K frames on, in frames.

    Attributes
    ----------
    places : ndarray of int, shape (K,)
        The frames, counted from the segment's first, which is the first of them: there the whole segment is delayed.
    gradient : ndarray, shape (V, K)
        Derivative of half the energy by the delay.
    precision : ndarray, shape (V, K)
        Inverse variance of the delay with all motion unknown.
    coupling : ndarray, shape (V, K)
        The same with the delay of the whole segment.
    """

    places: Ints
    gradient: Array
    precision: Array
    coupling: Array


def delay_evidence(
    problem: SegmentProblem, measured: MeasuredMotion, hidden: Sequence[Bools], tied: TiedSystems
) -> DelayEvidence:
    """Return what a segment says about delays of its views.

    Parameters
    ----------
    problem : SegmentProblem
    measured : MeasuredMotion
        The evidence at the solution.
    hidden : sequence of ndarray of bool, shape (F, P)
        Per performer: parts whose pixels are left out.
    tied : TiedSystems
        Normal equations of all performers at the solution, with all priors: their gradient is what the solution has not
        reached yet.
    """
    F = problem.length
    places = evenly_spaced(F, MAX_STARTS)
    weighted = WeightedEvidence.of(problem, measured.evidence, hidden)
    factors, spans = [system.factor() for system in tied.systems], problem.spans()
    ahead = [factor.solve(system.blocks.gradient) for factor, system in zip(factors, tied.systems, strict=True)]
    found = np.zeros((3, len(problem.views), len(places)))
    for instants in measured.instants:
        twists = [_twists(problem, instants, i) for i in range(len(problem.bodies))]
        for v in instants.views:
            H, g = weighted.paired_sums([v])
            for where, factor, step in zip(tied.places, factors, ahead, strict=True):
                delays = {i: _delays((H[:, spans[i]], g[:, spans[i]]), twists[i], places) for i in where}
                found[:, v] += sum(own for own, _ in delays.values())
                across = np.concatenate([_on_frames(instants, i, delays[i][1]) for i in where], axis=1)
                found[0, v] -= np.einsum("fdk,fd->k", across, step)
                followed = factor.solve(across)  # how the poses follow each delay
                found[1, v] -= (across * followed).sum(axis=(0, 1))
                found[2, v] -= np.einsum("fdk,fd->k", across, followed[..., 0])
    return DelayEvidence(places, *found)


def _twists(problem: SegmentProblem, instants: Instants, performer: int) -> tuple[Array, Array]:
    """Return twists of a performer's parts per frame of delay, (F, P, 6), and per degree of freedom, (F, P, 6, D)."""
    R, T = instants.poses
    span = problem.spans()[performer]
    J = twist_jacobian(problem.bodies[performer], R[:, span], T[:, span])
    return np.einsum("fpid,fd->fpi", J, _rates(instants.motions[performer])), J


def _rates(motion: Motion) -> Array:
    """Increments per frame, by differences of the frames around, shape (F, D)."""
    number = np.arange(len(motion))
    before, after = np.maximum(number - 1, 0), np.minimum(number + 1, len(motion) - 1)
    return np.asarray(motion[before].difference(motion[after]) / np.maximum(after - before, 1)[:, None])


def _on_frames(instants: Instants, performer: int, gradients: Array) -> Array:
    return gradients if instants.delayed is None else instants.delayed[performer].gradients_on_frames(gradients)


def _delays(sums: tuple[Array, Array], twists: tuple[Array, Array], places: Ints) -> tuple[Array, Array]:
    """Return gradient, precision and coupling of delays from each of K frames on, with all motion known, shape (3, K),
    and their coupling with the poses at the instants, shape (F, D, K).

    Parameters
    ----------
    sums : tuple of ndarray
        Those of a performer's parts, see `WeightedEvidence.paired_sums`.
    twists : tuple of ndarray
        See `_twists`.
    places : ndarray of int, shape (K,)
    """
    (H, g), (twist, J) = sums, twists
    both = np.concatenate([twist[:-1], twist[1:]], axis=2)
    later = np.where(np.arange(12) < 6, 0.0, both)  # only the later frame of a pair is delayed
    pushed, pushed_late = (np.einsum("fpij,fpj->fpi", H, own) for own in (both, later))

    def from_each(whole: Array, begun: Array) -> Array:
        """Sum over the pairs of frames that are delayed from each of the K places on, and the pair of which only the
        later frame is.
        """
        behind = np.append(np.cumsum(whole[::-1])[::-1], 0.0)
        return np.asarray(behind[places] + np.insert(begun, 0, 0.0)[places])

    def product(a: Array, b: Array) -> Array:
        return np.asarray(np.einsum("fpi,fpi->f", a, b))

    own = np.stack(
        [
            from_each(product(both, g), product(later, g)),
            from_each(product(both, pushed), product(later, pushed_late)),
            from_each(product(both, pushed), product(later, pushed)),
        ]
    )
    delayed = np.arange(len(twist))[:, None] >= places  # which frames each delay concerns, (F, K)
    across = np.zeros((len(twist), J.shape[-1], len(places)))
    for values, pairs in ((pushed, delayed[:-1]), (pushed_late, delayed[1:] & ~delayed[:-1])):
        for a in (0, 1):
            frames = slice(a, len(twist) - 1 + a)
            by_degree = np.einsum("fpid,fpi->fd", J[frames], values[..., 6 * a : 6 * a + 6])
            across[frames] += by_degree[..., None] * pairs[:, None]
    return own, across
