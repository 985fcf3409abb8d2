"""Stages of Gauss-Newton's descent, from coarse to fine, for starts of different kinds."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ...evidence.sampling import Sampling

SMALL_STEP = 0.007
"""Root mean square of joints' steps, radians (and metres), after which what is left, a third of it, does not count."""
ROUGH_STEP = 0.025
"""The same where another stage follows, which moves joints more than what is left."""
STILL = 0.005
"""Farthest that a step moves any joint, metres, after which no other follows in a refinement: it would be a fraction of
that."""
NOTICED = 0.2
"""Root mean square of a step, in standard deviations that the evidence leaves open, below which it is not tested: it
would make the expected error smaller by 2 % at most."""
REACH = 0.07
"""How far from the model's outlines the body's are usually looked for, metres."""
COARSEST = 4
"""Stride that no number of views makes larger, pixels: parts are not much wider."""


@dataclass(frozen=True)
class DescentStage:
    """One step from coarse to fine.

    Attributes
    ----------
    sampling : Sampling
        How the images of a few views are sampled; see `sampling_of`.
    iterations : int
        At most.
    views : int, optional
        At least that many views are looked at in an iteration, in turn; None looks at all.
    small : float
        The stage ends when steps are smaller, see `SMALL_STEP`.
    small_refused : bool
        It also ends when such a step is refused, instead of trying shorter ones.
    still : float
        It also ends after a step that moves no joint farther on any frame, metres.
    noticed : float
        The stage ends before a step that is shorter, root mean square in standard deviations that the evidence leaves
        open, see `NOTICED`.
    plants : bool
        Soles that seem planted are kept still. That leads to the solution, but holds feet that creep as well: not
        where no other stage follows, unless there is one view alone, in which these hardly show.
    """

    sampling: Sampling
    iterations: int
    views: int | None = None
    small: float = SMALL_STEP
    small_refused: bool = False
    still: float = 0.0
    noticed: float = 0.0
    plants: bool = True

    def sampling_of(self, views: int) -> Sampling:
        """The sampling of so many views: the more there are, the fewer pixels of each are needed."""
        return replace(self.sampling, stride=max(self.sampling.stride, min(views, COARSEST)))


STAGES = (
    DescentStage(Sampling(2.0, 8.0, 4, 0.10), 2, views=2, small=ROUGH_STEP),
    DescentStage(Sampling(1.0, 4.0, 4, REACH), 3, views=2, small=ROUGH_STEP),
    DescentStage(Sampling(1.0, 1.0, 3, REACH), 2),
)
"""From the curve through the key poses to the solution."""
REFINEMENT = (
    DescentStage(Sampling(1.0, 1.0, 2, REACH), 6, small=0.004, small_refused=True, still=STILL, plants=False),
)
"""From a solution to the better one that motion known on both sides allows: no other stage follows."""
SETTLING = (
    DescentStage(Sampling(1.0, 4.0, 3, REACH), 2, small=ROUGH_STEP),
    DescentStage(Sampling(1.0, 1.0, 3, REACH), 1),
)
"""For limbs that were looked for, around a trunk that is held."""
SETTLED = (DescentStage(Sampling(1.0, 1.0, 3, REACH), 3),)
"""From there to the solution."""
RESUMED = (
    DescentStage(Sampling(1.0, 1.0, 2, REACH), 5, small=0.003, small_refused=True, noticed=NOTICED, plants=False),
)
"""From a motion that was found before to the one with the key poses as they are now: all of it may be a little off, and
no other stage follows."""
WINDOW = (
    DescentStage(Sampling(2.0, 4.0, 4, 0.10), 2, small=ROUGH_STEP),
    DescentStage(Sampling(1.0, 1.0, 4, REACH), 2),
)
"""For each window of `sequential_start.follow`."""
