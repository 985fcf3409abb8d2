"""Gauss-Newton over a whole segment: all its poses are unknown at once.

The energy is that of a model of the errors: residuals of brightness constancy have a robust standard deviation per
view, found from themselves, and neighbouring pixels repeat one another; accelerations of joints and of the root have
the spread of human motion. Gradients couple neighbouring frames and smoothness the next but one, so the normal matrix
is block-pentadiagonal and solved by a banded Cholesky factorisation; key poses are met exactly, as their degrees of
freedom are not among the unknowns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...body.joint_blocks import joint_blocks, single_blocks
from ...body.motion import Motion
from ...body.smoothness import acceleration, limited
from ...evidence.accumulate import Evidence
from ...numerics.banded import BandedFactor
from ...numerics.banded_blocks import BandedBlocks
from ...runtime.timing import Seconds
from ...shot.acceleration_prior import acceleration_precision
from ...shot.shot import Settings
from ..prediction import predict_unseen
from .problem import Instants, Problem, Solution, Step, frame_residual

Array = NDArray[np.float64]

SMALL_STEP = 0.007
"""Root mean square of joints' steps, radians (and metres), after which what is left, a third of it, does not count."""
ROUGH_STEP = 0.025
"""The same where another stage follows, which moves joints more than what is left."""
OVERRELAXATION = 1.5
"""All steps of a stage but its last are taken this much longer, where all views are looked at: weights that follow the
residuals, and slopes measured beside the solution, make every step too short by about the same share."""


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
    small : float
        The stage ends when steps are smaller, see `SMALL_STEP`.
    """

    sigma: float
    tolerance: float
    stride: int
    iterations: int
    reach: float = 0.07
    views: int | None = None
    small: float = SMALL_STEP

    def strided(self, views: int) -> int:
        """The stride with so many views: all of them together tell as much with fewer pixels each."""
        return max(self.stride, min(views, COARSEST))


COARSEST = 4
"""Stride that no number of views makes larger, pixels: parts are not much wider."""
STAGES = (
    Stage(2.0, 8.0, 4, 2, 0.10, views=2, small=ROUGH_STEP),
    Stage(1.0, 4.0, 4, 3, views=2, small=ROUGH_STEP),
    Stage(1.0, 1.0, 3, 2),
)
"""From the curve through the key poses to the solution."""
REFINEMENT = (Stage(1.0, 1.0, 2, 2),)
"""From a solution to the better one that motion known on both sides allows."""


def refine(problem: Problem, start: Sequence[Motion], settings: Settings, on_step: Step | None = None) -> Solution:
    """Go on from a solution, when more is known of the motion around it."""
    return descend(problem, start, settings, on_step, REFINEMENT)


def descend(
    problem: Problem,
    start: Sequence[Motion],
    settings: Settings,
    on_step: Step | None = None,
    stages: Sequence[Stage] = STAGES,
) -> Solution:
    """Go down from a start to the nearest solution.

    Parameters
    ----------
    problem : Problem
    start : sequence of Motion
        F poses per performer; their fixed degrees of freedom are kept.
    settings : Settings
    on_step : callable, optional
        Called before each iteration with the share of the work done and the motions; may raise to end the job.
    stages : sequence of Stage
    """
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
            if _size(steps) < stage.small:
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
