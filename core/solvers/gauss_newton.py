"""Gauss-Newton over a whole segment: all its poses are unknown at once.

The energy is that of a model of the errors: residuals of brightness constancy have a robust standard deviation per
view, found from themselves, and neighbouring pixels repeat one another; accelerations of joints and of the root have
the spread of human motion. Gradients couple neighbouring frames and smoothness the next but one, so the normal matrix
is block-pentadiagonal and solved by a banded Cholesky factorisation; key poses are met exactly, as their degrees of
freedom are not among the unknowns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..body import Body
from ..constraints import BandedBlocks, acceleration
from ..evidence.collect import Evidence, joint_blocks, single_blocks
from ..evidence.images import telling
from ..motion import Motion
from ..occlusion import LONG, intervals
from ..prediction import predict_unseen
from ..shot import Settings
from ..timing import Seconds
from .banded import BandedFactor
from .initial import blended, follow
from .limbs import found_limbs, limbs, untangled_limbs
from .problem import Instants, Problem, Solution, Step, frame_residual

Array = NDArray[np.float64]

SMALLEST_STEP = 5e-3
"""A stage ends when no joint moves more than this, radians (and metres)."""
SMALL_STEP = 0.025
"""A stage that another follows ends when joints move less than this, root mean square: the next moves them more."""
OVERRELAXATION = 1.5
"""All steps of a stage but its last are taken this much longer, where all views are looked at: weights that follow the
residuals, and slopes measured beside the solution, make every step too short by about the same share."""
EXPLAINED = 0.8
"""Share of what the key poses explain of their images that a solution should explain of every other frame's."""
CONFIRMED = 0.9
"""Share of the keypoints' agreement with the first pass that clears a solution of doubt."""
LEAST_MOBILITY = 0.05
"""A joint that can hardly turn about an axis has this share of the usual acceleration there, at least."""
LONGEST_STEP = 0.5
"""No joint turns farther than this in one iteration, radians: beyond it the images' gradients say nothing."""


@dataclass(frozen=True)
class Stage:
    """One step from coarse to fine.

    Attributes
    ----------
    sigma : float
        Smoothing of the images, pixels of the reduced frames.
    tolerance : float
        Of Huber's limit: far from the solution large residuals still have to pull.
    stride : int
        Every how many pixels, each way, the evidence of a few views is taken; see `strided`.
    iterations : int
        At most.
    reach : float
        How far from the model's outlines the body's are looked for, metres.
    views : int, optional
        At least that many views are looked at in an iteration, in turn; None looks at all.
    """

    sigma: float
    tolerance: float
    stride: int
    iterations: int
    reach: float = 0.07
    views: int | None = None

    def strided(self, views: int) -> int:
        """The stride with so many views: all of them together tell as much with fewer pixels each."""
        return max(self.stride, min(views, COARSEST))


COARSEST = 4
"""Stride that no number of views makes larger, pixels: parts are not much wider."""
STAGES = (Stage(2.0, 8.0, 4, 2, 0.10, 2), Stage(1.0, 4.0, 4, 3, views=2), Stage(1.0, 1.0, 3, 2))
"""From the curve through the key poses to the solution."""
SETTLING = (Stage(1.0, 4.0, 3, 2), Stage(1.0, 1.0, 3, 1))
"""Of limbs that were looked for, around a trunk that is held."""
SETTLED = (Stage(1.0, 1.0, 3, 4),)
"""From there to the solution."""
EQUAL = 0.005
"""Solutions whose covers of the performers differ by less than this share of them are equals: which of them covers the
most is chance."""
LOOKS = 5
"""How often limbs are looked for, at most."""
WINDOW = (Stage(2.0, 4.0, 4, 2, 0.10), Stage(1.0, 1.0, 4, 2))
"""Within the window of `initial.follow`."""
REFINEMENT = (Stage(1.0, 1.0, 2, 2),)
"""From a solution to the better one that motion known on both sides allows."""


def solve(problem: Problem, start: Sequence[Motion], settings: Settings, on_step: Step | None = None) -> Solution:
    """Fit the motion of all performers between their key poses.

    The curve through the key poses is one start. Where the images disagree with what it led to, and no keypoints
    confirm it, or limbs are out of all views' sight for long, the motion is followed from the key poses, and then
    limbs are looked for around the solutions. The best of them all counts.

    Parameters
    ----------
    problem : Problem
    start : sequence of Motion
        F poses per performer; their fixed degrees of freedom are kept.
    settings : Settings
    on_step : callable, optional
        Called before each iteration with the share of the work done and the motions; may raise to end the job.
    """
    solutions = [descend(problem, start, settings, _share_of(on_step, 0.0, 0.2))]
    seconds, best = Seconds(), solutions[0]
    if (doubtful(problem, best) and not confirmed(problem, start, best)) or concealed(problem, best):
        with seconds.measure("initial solution"):
            initial = followed(problem, start, settings, _share_of(on_step, 0.2, 0.3))
        solutions.append(descend(problem, initial, settings, _share_of(on_step, 0.3, 0.4)))
        if len(problem.whole_keys()) > 1 and not problem.pointers:  # keypoints tell where limbs are
            # That a doubt is gone does not tell that no arm is lost: it is a small part of what is to be covered.
            with seconds.measure("initial solution"):
                best = searched(problem, start, solutions, settings, _share_of(on_step, 0.4, 1.0))
        else:
            best = better(problem, *solutions)
    for solution in solutions:
        seconds.add(solution.seconds)
    return replace(best, seconds=seconds)


def confirmed(problem: Problem, start: Sequence[Motion], solution: Solution) -> bool:
    """Whether keypoints agree with a solution nearly as well as with the start, which they led to."""
    return bool(problem.pointers) and problem.agreement(solution.motions) >= CONFIRMED * problem.agreement(start)


def better(problem: Problem, *solutions: Solution) -> Solution:
    """The solution that covers the most of what looks like the performers and meets the most keypoints, if any."""
    merit = [float(found.explained.sum()) for found in solutions]
    if problem.pointers:
        most = max(*merit, 1.0)
        merit = [m / most + problem.agreement(s.motions) for m, s in zip(merit, solutions, strict=True)]
    return solutions[int(np.argmax(merit))]


def _share_of(on_step: Step | None, begin: float, end: float) -> Step | None:
    """Reports a part of the work as its share of the whole."""
    if on_step is None:
        return None
    return lambda done, motions: on_step(begin + done * (end - begin), motions)


def doubtful(problem: Problem, solution: Solution) -> bool:
    """Whether the images leave a doubt that a solution is near the true one.

    The body covers what looks like it on the key frames; on every other frame it should do so nearly as well.
    """
    keys = problem.whole_keys()
    if len(keys) < 2:
        return len(keys) == 1  # the curve that it began with stands still
    expected = np.interp(np.arange(problem.length), keys, solution.explained[keys])
    return bool((solution.explained < EXPLAINED * expected).any())


def concealed(problem: Problem, solution: Solution) -> bool:
    """Whether part of a limb is out of all views' sight, between whole key poses, for longer than prediction bridges.

    It may come into sight elsewhere than the solution has it. Foreground images would tell; keypoints do anyway.
    """
    if not telling(problem.views) or problem.pointers or len(problem.whole_keys()) < 2:
        return False
    return any(
        last + 1 - first >= LONG
        for body, hidden in zip(problem.bodies, problem.hidden(solution.share), strict=True)
        for chain in limbs(body)
        for part in chain
        for first, last in intervals(hidden[:, part])
    )


def searched(
    problem: Problem,
    start: Sequence[Motion],
    solutions: Sequence[Solution],
    settings: Settings,
    on_step: Step | None = None,
) -> Solution:
    """The solution from looking for limbs around some solutions, and then around the best until that has an equal.

    Of the solutions only equals of the best are looked around, or all where that is doubtful; they settle first. While
    all are doubtful, limbs are also looked for around a trunk that moves as at the start, which limbs in wrong places
    have not led astray. Poses are drawn by chance: limbs stay where they were when what is found is no better than an
    equal.
    """
    held = replace(problem, fixed=tuple(fixed | (np.arange(fixed.shape[1]) < 6) for fixed in problem.fixed))
    likely = solutions if doubtful(problem, better(problem, *solutions)) else equals(solutions)
    settled = [descend(problem, solution.motions, settings, None, SETTLED) for solution in likely]
    begins: list[tuple[Sequence[Motion], Problem]] = [(solution.motions, problem) for solution in settled]
    found: list[Solution] = []
    while begins and len(found) < LOOKS:
        motions, around = begins.pop(0)
        part = _share_of(on_step, len(found) / LOOKS, (len(found) + 1) / LOOKS)
        found.append(_looked_for(problem, around, motions, settings, len(found), part))
        best = better(problem, *settled, *found)
        if not begins and doubtful(problem, best) and around is not held:
            begins.append((start, held))
        elif not begins and len(equals([*settled, *found])) == 1:
            begins.append((best.motions, problem))
    kept = better(problem, *settled)
    return kept if kept in equals([*settled, *found]) else better(problem, *found)


def equals(solutions: Sequence[Solution]) -> list[Solution]:
    """Those of some solutions that cover as much of the performers as the one that covers the most."""
    covers = [float(solution.explained.sum()) for solution in solutions]
    least = max(covers) - EQUAL * abs(max(covers))
    return [solution for solution, cover in zip(solutions, covers, strict=True) if cover >= least]


def _looked_for(
    problem: Problem,
    around: Problem,
    motions: Sequence[Motion],
    settings: Settings,
    seed: int,
    on_step: Step | None = None,
) -> Solution:
    """The solution from looking for limbs around motions, which settle first with what `around` has fixed."""
    begin = found_limbs(problem, motions, seed, _share_of(on_step, 0.0, 0.6))
    settled = descend(around, begin, settings, _share_of(on_step, 0.6, 0.8), SETTLING)
    begin = untangled_limbs(problem, settled.motions)
    return descend(problem, begin, settings, _share_of(on_step, 0.8, 1.0), SETTLED)


def followed(
    problem: Problem, start: Sequence[Motion], settings: Settings, on_step: Step | None = None
) -> list[Motion]:
    """The initial solution from the key poses at one or both ends of the problem."""
    keyed = [end in problem.whole_keys() for end in (0, problem.length - 1)]
    directions = [backward for backward in (False, True) if keyed[backward]]
    found = []
    for k, backward in enumerate(directions):
        part = _share_of(on_step, k / len(directions), (k + 1) / len(directions))
        found.append(follow(problem, start, settings, _in_window, backward, part))
    return blended(*found) if len(found) == 2 else found[0] if found else list(start)


def _in_window(problem: Problem, start: Sequence[Motion], settings: Settings) -> Solution:
    return descend(problem, start, replace(settings, prediction=False), None, WINDOW)


def refine(problem: Problem, start: Sequence[Motion], settings: Settings, on_step: Step | None = None) -> Solution:
    """Go on from a solution of `solve`, when more is known of the motion around it."""
    return descend(problem, start, settings, on_step, REFINEMENT)


def descend(
    problem: Problem,
    start: Sequence[Motion],
    settings: Settings,
    on_step: Step | None = None,
    stages: Sequence[Stage] = STAGES,
) -> Solution:
    """Go down from a start to the nearest solution; parameters as of `solve`."""
    geometry, motions = problem.geometry(), list(start)
    seconds = Seconds()
    energies: list[float] = []
    planned = sum(stage.iterations for stage in stages)
    hidden: list[NDArray[np.bool_]] = []
    expected: list[Array] = []
    for s, stage in enumerate(stages):
        before = sum(earlier.iterations for earlier in stages[:s])
        for i in range(stage.iterations):
            if on_step is not None:
                on_step((before + i) / planned, motions)
            seen = problem if stage.views is None else problem.some_views(stage.views, i)
            stride = stage.strided(len(seen.views))
            poses, evidence = seen.evidence(geometry, motions, stage.sigma, stage.tolerance, stride, stage.reach)
            seconds.add(evidence.seconds)
            longer = i + 1 < stage.iterations and len(seen.views) == len(problem.views)
            pace = OVERRELAXATION if longer else 1.0
            with seconds.measure("solve"):
                if settings.prediction and (i == 0 or not hidden):
                    hidden = seen.hidden(evidence.share)
                    expected = foretold_accelerations(motions, hidden)
                systems = normal_equations(seen, motions, poses, evidence, settings, stage.tolerance, hidden, expected)
                factors = [BandedFactor(n, fixed) for n, fixed in zip(systems, problem.fixed, strict=True)]
                steps = [limited(-pace * f.solve(n.gradient)) for f, n in zip(factors, systems, strict=True)]
                motions = [motion.moved(step) for motion, step in zip(motions, steps, strict=True)]
                energies.append(sum(n.energy for n in systems))
            if stage is not stages[-1] and _size(steps) < SMALL_STEP:
                break
            if max(float(np.abs(step).max()) for step in steps) < SMALLEST_STEP:
                break
    return Solution(
        tuple(motions),
        len(energies),
        tuple(energies),
        tuple(factors),
        evidence.share,
        evidence.explained.sum(axis=0),
        frame_residual(evidence),
        seconds,
        evidence,
    )


def _size(steps: Sequence[Array]) -> float:
    """Root mean square of steps."""
    return float(np.sqrt(np.mean(np.concatenate([step.ravel() for step in steps]) ** 2)))


def normal_equations(
    problem: Problem,
    motions: Sequence[Motion],
    poses: tuple[Array, Array],
    evidence: Evidence,
    settings: Settings,
    tolerance: float = 1.0,
    hidden: Sequence[NDArray[np.bool_]] = (),
    expected: Sequence[Array | None] = (),
) -> list[BandedBlocks]:
    """The normal equations of every performer: gradients and outlines of all views, keypoints, and smoothness."""
    if hidden:
        evidence = evidence.without(np.concatenate(hidden, axis=1))
    precision = view_precision(evidence, settings)
    # Lines that reach farther than the error find other limbs' outlines: far from the solution they count for little.
    outlines = 1 / (settings.outline_correlation * tolerance**2)
    systems = [BandedBlocks.zeros(problem.length, body.dof) for body in problem.bodies]
    for instants in problem.instants(motions, poses):
        own_systems = _image_systems(problem, instants, evidence, precision, outlines)
        systems = [system + own for system, own in zip(systems, own_systems, strict=True)]
    if problem.pointers:
        instants = problem.footage_instants(motions, poses)
        R, T = instants.poses
        for i, (body, span) in enumerate(zip(problem.bodies, problem.spans(), strict=True)):
            seen = problem.pointers[i].blocks(body, (R[:, span], T[:, span]), tolerance)
            systems[i] += instants.on_frames(i, seen)
    for i, body in enumerate(problem.bodies):
        systems[i] += problem.smoothness(
            i, motions[i], acceleration_precision(body, problem.fps, settings), expected[i] if expected else None
        )
    return systems


def _image_systems(
    problem: Problem, instants: Instants, evidence: Evidence, precision: Array, outlines: float
) -> list[BandedBlocks]:
    """The normal equations of every performer: gradients and outlines of the views that were taken at some instants."""
    (R, T), views = instants.poses, instants.views
    H = np.einsum("v,vfpij->fpij", precision[views], evidence.H[views])
    g = np.einsum("v,vfpi->fpi", precision[views], evidence.g[views])
    outline_H, outline_g = (outlines * a[views].sum(axis=0) for a in (evidence.outline_H, evidence.outline_g))
    energy = float(precision[views] @ evidence.energy[views].sum(axis=1)) / len(problem.bodies)
    outline_energy = outlines * float(evidence.outline_energy[views].sum()) / len(problem.bodies)
    systems = []
    for i, (body, span) in enumerate(zip(problem.bodies, problem.spans(), strict=True)):
        own = R[:, span], T[:, span]
        gradients = joint_blocks(body, own, H[:, span], g[:, span], energy)
        ends = single_blocks(body, own, outline_H[:, span], outline_g[:, span], outline_energy)
        systems.append(instants.on_frames(i, gradients + ends))
    return systems


def foretold_accelerations(motions: Sequence[Motion], hidden: Sequence[NDArray[np.bool_]]) -> list[Array]:
    """Accelerations that parts have, where they are hidden, in the motion foretold for them, else zero, (F, D)."""
    expected = []
    for motion, mask in zip(motions, hidden, strict=True):
        foretold = np.zeros((len(motion), 3 + 3 * mask.shape[1]))
        if mask.any() and len(motion) > 2:
            foretold[1:-1] = acceleration(predict_unseen(motion, mask))
        degrees = np.concatenate([np.repeat(mask[:, :1], 3, axis=1), np.repeat(mask, 3, axis=1)], axis=1)
        expected.append(foretold * degrees)
    return expected


def view_precision(evidence: Evidence, settings: Settings) -> Array:
    """Inverse variance of a residual of each view, with the pixels that repeat one another counted once, shape (V,)."""
    noise = np.maximum(np.median(evidence.noise, axis=1), 1e-3)
    density = np.maximum(np.median(evidence.density, axis=1), 1.0)
    return evidence.stride**2 / (noise**2 * density * settings.correlation_length**2)


def acceleration_precision(body: Body, fps: float, settings: Settings) -> Array:
    """Inverse variance of the acceleration of each degree of freedom, per frame squared, shape (D,).

    A joint is accelerated the less about an axis the less it can turn about it: knees and elbows are nearly hinges.
    """
    ranges = np.concatenate([np.ptp(part.limits, axis=1) for part in body.parts])
    deviation = np.full(body.dof, settings.root_acceleration)
    deviation[3:] = settings.joint_acceleration * np.clip(ranges / np.pi, LEAST_MOBILITY, 1)
    return (fps * fps / deviation) ** 2


def limited(step: Array) -> Array:
    """A step with every joint's part of it cut to `LONGEST_STEP`."""
    turns = step.reshape(len(step), -1, 3)
    length = np.linalg.norm(turns, axis=-1, keepdims=True)
    return (turns * np.minimum(1.0, LONGEST_STEP / np.maximum(length, 1e-12))).reshape(step.shape)
