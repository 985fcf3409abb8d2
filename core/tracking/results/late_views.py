"""Views that show the performers too early or too late from some frame on, as all segments together say.

A camera, or the program that copied its file, lost a frame or stored one twice. How far a view is off is estimated with
the motion of every segment (`core.tracking.solvers.equations.view_delays`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...numerics.arrays import Ints
from ..solvers.equations.view_delays import DelayEvidence

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


def late_views(
    segments: Sequence[tuple[int, DelayEvidence]], torn: Sequence[Sequence[int]]
) -> tuple[LateView | None, ...]:
    """Return, per view, from which frame on it is early or late by about a frame, if it is.

    A delay pushes the motion, and with it the other views the other way: among these, only the surest is reported.

    Parameters
    ----------
    segments : sequence of (int, DelayEvidence)
        First shot frame of every segment, and what its footage says, in order.
    torn : sequence of sequence of int
        Per view: shot frames that do not continue the one before.
    """
    found = [_surest(segments, v, np.array(frames, int)) for v, frames in enumerate(torn)]
    best = max(sureness for sureness, _ in found)
    clear = sum(CLEAR_RATIO * sureness > best for sureness, _ in found) == 1
    return tuple(None if one is None or sureness < best else replace(one, clear=clear) for sureness, one in found)


def _surest(segments: Sequence[tuple[int, DelayEvidence]], view: int, torn: Ints) -> tuple[float, LateView | None]:
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
