"""Stages of a Gauss-Newton descent, from coarse to fine images, for different kinds of starts."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ...evidence.sampling import Sampling

SMALL_STEP = 0.007
"""Root mean square of a step, radians and metres, below which a stage ends: what remains is about a third of it."""
ROUGH_STEP = 0.025
"""The same for stages that another one follows, which will move joints by more than what remains."""
MIN_JOINT_MOVE = 0.005
"""Largest motion of any joint in a step, metres, below which a refinement ends: the next step would be a fraction of
it. A polish and a correction end before such a step: it would cost another evaluation of the pictures, and leads away
from the true motion as often as to it."""
UNCONVERGED_MOVE = 0.02
"""Metres. While steps still move some joint by more than this, a fast limb has not arrived: a tested stage goes on
beyond its iterations, a refinement is repeated, and a polish does not begin."""
MIN_STEP_SIGMAS = 0.2
"""Root mean square of a step, in posterior standard deviations, below which it is not made: it would reduce the
expected error by 2 % at most."""
OUTLINE_REACH = 0.07
"""Usual distance from the model's outlines within which those of the performer are searched for, metres."""
MAX_EXTRA_ITERATIONS = 6
"""Most iterations by which a tested stage goes on while joints move."""
MAX_STRIDE = 4
"""Largest stride between pixels, however many views there are: parts are hardly wider than that."""


@dataclass(frozen=True)
class DescentStage:
    """A stage of a descent: how the images are sampled, and when the stage ends.

    Attributes
    ----------
    sampling : Sampling
        Sampling of the images with few views; see `sampling_of`.
    iterations : int
        Most iterations.
    further : int
        Most iterations by which it goes on while joints move, if it is the stage that ends a descent.
    views : int, optional
        At least that many views are evaluated in each iteration, in turn; None for all.
    small : float
        The stage ends after a step that is smaller, see `SMALL_STEP`.
    small_refused : bool
        It also ends when such a step is refused, instead of trying shorter ones.
    still : float
        It also ends after a step that moves no joint by more than this on any frame, metres.
    negligible : float
        It also ends before a step that would move no joint by more than this on any frame, metres.
    noticed : float
        It also ends before a step that is shorter, see `MIN_STEP_SIGMAS`.
    thinned : bool
        Whether fewer pixels of each view are used the more views there are, see `sampling_of`.
    plants : bool
        Whether soles that seem planted are kept still if this is the stage that ends a descent; others never do that.
        It guides a descent, but would also hold feet that creep, so it is off in refinements, and in the first descent
        as long as nothing contradicts its solution; with a single view, which hardly shows creeping, plants are used
        all the same.
    """

    sampling: Sampling
    iterations: int
    further: int = MAX_EXTRA_ITERATIONS
    views: int | None = None
    small: float = SMALL_STEP
    small_refused: bool = False
    still: float = 0.0
    negligible: float = 0.0
    noticed: float = 0.0
    thinned: bool = True
    plants: bool = True

    def sampling_of(self, views: int) -> Sampling:
        """Return the sampling for a number of views: the more there are, the fewer pixels of each are needed on the
        way. At its end they are not spared: much of a body is seen by few of the views.
        """
        if not self.thinned:
            return self.sampling
        return replace(self.sampling, stride=max(self.sampling.stride, min(views, MAX_STRIDE)))


COARSE_STAGES = (
    DescentStage(Sampling(2.0, 8.0, 4, 0.10), 2, views=2, small=ROUGH_STEP),
    DescentStage(Sampling(1.0, 4.0, 4, OUTLINE_REACH), 3, views=2, small=ROUGH_STEP),
)
"""The first of all stages from the curve through the key poses."""
FINE_STAGES = (DescentStage(Sampling(1.0, 1.0, 3, OUTLINE_REACH), 2),)
"""From there to the solution."""
FREE_STAGES = (replace(FINE_STAGES[0], plants=False),)
"""The same with soles left free: those that only seem planted lead limbs to other minima."""
STAGES = (*COARSE_STAGES, *FINE_STAGES)
"""From the curve through the key poses to the solution."""
FREE_FROM_CURVE = (*COARSE_STAGES, *FREE_STAGES)
"""From the curve to the solution with soles left free."""
STAGES_ON_ALL_FRAMES = (*COARSE_STAGES, replace(FINE_STAGES[0], further=0))
"""The same where the rest of the way is made on some of the frames."""
REFINEMENT = (
    DescentStage(
        Sampling(1.0, 1.0, 2, OUTLINE_REACH), 6, small=0.004, small_refused=True, still=MIN_JOINT_MOVE, plants=False
    ),
)
"""From a solution to the better one that motion known on both sides allows."""
POLISH = (
    DescentStage(
        Sampling(1.0, 1.0, 2, OUTLINE_REACH, by_part=True),
        4,
        small=0.004,
        small_refused=True,
        negligible=MIN_JOINT_MOVE,
        thinned=False,
        plants=False,
    ),
)
"""The last stage, once limbs are where they belong: a limb elsewhere would pass for one with much noise, which counts
little."""
POLISHED_AT_ONCE = (replace(REFINEMENT[0], still=UNCONVERGED_MOVE), replace(POLISH[0], iterations=6))
"""Both at once, for a solution that nothing contradicts. The first steps have the noise of whole pairs of frames, until
no joint moves far: a limb that is elsewhere, or fast and still a few centimetres off, would otherwise pass for one with
much noise, and stay there."""
STAGES_AMONG_OTHERS = (*COARSE_STAGES, *POLISHED_AT_ONCE)
"""From the curve to the solution where several performers hide one another, by all pixels in the end: those who are
hidden are seen by few views."""
SETTLING = (
    DescentStage(Sampling(1.0, 4.0, 3, OUTLINE_REACH), 2, small=ROUGH_STEP),
    DescentStage(Sampling(1.0, 1.0, 3, OUTLINE_REACH), 1),
)
"""After a search for limbs: the body adapts to them, before `SETTLED`."""
COARSE_RESTART = (DescentStage(Sampling(1.0, 4.0, 4, 0.15), 4),)
"""From a minimum that may not be the best to one beside it, before `SETTLED`: coarse steps are not tested."""
SETTLED = (DescentStage(Sampling(1.0, 1.0, 3, OUTLINE_REACH), 3),)
"""From there to the minimum."""
RESUMED = (
    DescentStage(
        Sampling(1.0, 1.0, 2, OUTLINE_REACH, by_part=True),
        5,
        small=0.003,
        small_refused=True,
        negligible=MIN_JOINT_MOVE,
        noticed=MIN_STEP_SIGMAS,
        plants=False,
    ),
)
"""From the motion that was found before key poses changed to the one with the present key poses."""
WINDOW_STAGES = (
    DescentStage(Sampling(2.0, 4.0, 4, 0.10), 2, small=ROUGH_STEP),
    DescentStage(Sampling(1.0, 1.0, 4, OUTLINE_REACH), 2),
)
"""For each window of `sequential_start.follow`."""
