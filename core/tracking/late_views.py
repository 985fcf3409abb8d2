"""Views that show the performers too early or too late from some frame on.

If a camera, or the program that copied its file, lost a frame, everything that the view shows from there on is early by
one. The solution lies between what this view and the others show, so that how far the view is off cannot be read off
its residuals. It is therefore estimated together with the motion: a delay of one view from a frame on is one more
unknown beside the poses, which are eliminated from its normal equation (Schur complement). Key poses, the other views
and the gaps between frames all count, and a delay that the motion itself could explain has no precision. What is left
of the poses' own gradient is eliminated as well: a motion that has not quite converged would else pass for a delay.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..body import twist_jacobian
from ..body.motion import Motion
from ..numerics.arrays import Array, Bools, Ints, evenly_spaced
from .solvers.equations.hold_factor import TiedSystems
from .solvers.equations.measurement import Instants, MeasuredMotion
from .solvers.equations.problem import SegmentProblem
from .solvers.equations.weighted_evidence import WeightedEvidence

MAX_STARTS = 48
"""Number of frames of a segment on which a delay may begin, at most."""
CONSTANT_DELAY_SIGMA = 0.3
"""Prior standard deviation of a view's delay over the whole shot, frames: cameras may be synchronised inexactly."""
MIN_DELAY, MIN_DELAY_SIGMAS, MIN_DELAY_TIMES_SIGMAS = 0.15, 7.0, 2.1
"""Smallest delay that is reported, frames, in standard deviations, and the product of both. A frame that is missing or
there twice gives 0.17 to 0.74 frames, as outlines are farther away than their equations reach, and 8.7 to 26
deviations. Where none is, delays of 0.2 frames have at most 5.4 deviations, and those of 7 a product of at most 1.7
(docs/studies.md)."""
TORN_FACTOR, TORN_VIEW_FACTOR = 1.25, 1.5
"""How many times as sure a delay counts that begins where pictures do not continue from the one before: among those of
its view, and against those of other views."""
CLEAR_RATIO = 1.15
"""How many times as sure a delay must be as those of all other views for it to be clear whose it is."""


@dataclass(frozen=True, eq=False)
class Lateness:
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


@dataclass(frozen=True)
class LateView:
    """A view whose pictures are early or late from some frame on.

    Attributes
    ----------
    frame : int
        The first of these frames, counted from the shot's first.
    delay : float
        How much later they were taken than they should have been, frames: positive where a frame is missing, negative
        where one is there twice.
    deviations : float
        The same in standard deviations.
    clear : bool
        Whether it is this view: that another one is wrong the other way instead is clearly less likely.
    """

    frame: int
    delay: float
    deviations: float
    clear: bool = True

    def counted_from(self, first: int) -> LateView:
        """Return the same with frames in a count in which the shot's first has a number."""
        return replace(self, frame=first + self.frame)

    @property
    def brief(self) -> str:
        """Short message, for a panel."""
        early, what = ("early", "missing") if self.delay > 0 else ("late", "there twice")
        return f"{early} from about frame {self.frame} on: a frame seems to be {what}"

    @property
    def text(self) -> str:
        """Message that says what to do, too."""
        measured = f"{abs(self.delay):.1f} frames, {abs(self.deviations):.0f} standard deviations"
        copied = "put a copy of the one before in its place" if self.delay > 0 else "take it out"
        doubt = "" if self.clear else ", or another view is wrong the other way"
        return f"{self.brief} ({measured}){doubt}; copy the file from the camera again, or {copied}"


def segment_lateness(
    problem: SegmentProblem, measured: MeasuredMotion, hidden: Sequence[Bools], tied: TiedSystems
) -> Lateness:
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
    return Lateness(places, *found)


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


def late_views(segments: Sequence[tuple[int, Lateness]], torn: Sequence[Sequence[int]]) -> tuple[LateView | None, ...]:
    """Return, per view, from which frame on it is early or late by about a frame, if it is.

    A delay pushes the motion, and with it the other views the other way: among these, only the surest is reported.

    Parameters
    ----------
    segments : sequence of (int, Lateness)
        First shot frame of every segment, and what its footage says, in order.
    torn : sequence of sequence of int
        Per view: shot frames that do not continue the one before.
    """
    found = [_surest(segments, v, np.array(frames, int)) for v, frames in enumerate(torn)]
    best = max(sureness for sureness, _ in found)
    clear = sum(CLEAR_RATIO * sureness > best for sureness, _ in found) == 1
    return tuple(None if one is None or sureness < best else replace(one, clear=clear) for sureness, one in found)


def _surest(segments: Sequence[tuple[int, Lateness]], view: int, torn: Ints) -> tuple[float, LateView | None]:
    """Return the surest delay of a view from some frame on, apart from a delay of the whole shot, and how sure it is;
    None if there is none. If it may begin on one of some torn frames, it does.
    """
    whole = np.array([[own.gradient[view, 0], own.precision[view, 0]] for _, own in segments])
    gradient, precision = whole.sum(axis=0)
    precision += CONSTANT_DELAY_SIGMA**-2
    best, most = None, 0.0
    for (first, own), behind in zip(segments, np.cumsum(whole[::-1], axis=0)[::-1] - whole, strict=True):
        share = (own.coupling[view, 1:] + behind[1]) / precision
        pull = own.gradient[view, 1:] + behind[0] - share * gradient
        sure = own.precision[view, 1:] + behind[1] - share**2 * precision
        deviation = 1 / np.sqrt(np.maximum(sure, 1e-9))
        delays = -pull * deviation**2
        frames = first + _torn_near(own.places[1:], torn - first)
        sureness = np.abs(delays) / deviation * np.where(np.isin(frames, torn), TORN_FACTOR, 1.0)
        reported = np.abs(delays) >= np.maximum(MIN_DELAY, MIN_DELAY_SIGMAS * deviation)
        reported &= np.abs(delays) * sureness >= MIN_DELAY_TIMES_SIGMAS
        sureness = sureness * reported
        if len(sureness) and sureness.max() > most:
            k = int(np.argmax(sureness))
            most = float(sureness[k])
            best = LateView(int(frames[k]), float(delays[k]), float(delays[k] / deviation[k]))
    if best is None:
        return 0.0, None
    return abs(best.deviations) * (TORN_VIEW_FACTOR if best.frame in torn else 1.0), best


def _torn_near(places: Ints, torn: Ints) -> Ints:
    """Return K places, or the torn frame that each is the nearest of them to, shape (K,)."""
    found = places.copy()
    for frame in torn:
        if len(places) and places[0] <= frame <= places[-1]:
            found[np.argmin(np.abs(places - frame))] = frame
    return found
