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

from ..body import Body
from ..constraints import BandedBlocks
from ..evidence.collect import Evidence, joint_blocks, single_blocks
from ..motion import Motion
from ..shot import Settings
from ..timing import Seconds
from .banded import BandedFactor
from .problem import Problem, Solution, Step, frame_residual

Array = NDArray[np.float64]

SMALLEST_STEP = 5e-3
"""A stage ends when no joint moves more than this, radians (and metres)."""
OVERRELAXATION = 1.5
"""All steps of a stage but its last are taken this much longer: weights that follow the residuals, and slopes measured
beside the solution, make every step too short by about the same share."""
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
        Every how many pixels, each way, the evidence is taken.
    reach : float
        How far from the model's outlines the body's are looked for, metres.
    iterations : int
        At most.
    """

    sigma: float
    tolerance: float
    stride: int
    reach: float
    iterations: int


STAGES = (Stage(2.0, 8.0, 4, 0.10, 2), Stage(1.0, 4.0, 4, 0.07, 3), Stage(1.0, 1.0, 3, 0.07, 2))
"""From the curve through the key poses to the solution."""
REFINEMENT = (Stage(1.0, 1.0, 2, 0.07, 2),)
"""From a solution to the better one that motion known on both sides allows."""


def solve(
    problem: Problem,
    start: Sequence[Motion],
    settings: Settings,
    on_step: Step | None = None,
    stages: Sequence[Stage] = STAGES,
) -> Solution:
    """Fit the motion of all performers between their key poses.

    Parameters
    ----------
    problem : Problem
    start : sequence of Motion
        F poses per performer; their fixed degrees of freedom are kept.
    settings : Settings
    on_step : callable, optional
        Called before each iteration with the share of the work done and the motions; may raise to end the job.
    """
    geometry, motions = problem.geometry(), list(start)
    seconds = Seconds()
    energies: list[float] = []
    planned = sum(stage.iterations for stage in stages)
    for s, stage in enumerate(stages):
        before = sum(earlier.iterations for earlier in stages[:s])
        for i in range(stage.iterations):
            if on_step is not None:
                on_step((before + i) / planned, motions)
            poses, evidence = problem.evidence(
                geometry, motions, stage.sigma, stage.tolerance, stage.stride, stage.reach
            )
            seconds.add(evidence.seconds)
            pace = OVERRELAXATION if i + 1 < stage.iterations else 1.0
            with seconds.measure("solve"):
                systems = normal_equations(problem, motions, poses, evidence, settings, stage.tolerance)
                factors = [BandedFactor(n, fixed) for n, fixed in zip(systems, problem.fixed, strict=True)]
                steps = [limited(-pace * f.solve(n.gradient)) for f, n in zip(factors, systems, strict=True)]
                motions = [motion.moved(step) for motion, step in zip(motions, steps, strict=True)]
                energies.append(sum(n.energy for n in systems))
            if max(float(np.abs(step).max()) for step in steps) < SMALLEST_STEP:
                break
    return Solution(
        tuple(motions),
        len(energies),
        tuple(energies),
        tuple(factors),
        evidence.share,
        frame_residual(evidence),
        seconds,
    )


def refine(problem: Problem, start: Sequence[Motion], settings: Settings, on_step: Step | None = None) -> Solution:
    """Go on from a solution of `solve`, when more is known of the motion around it."""
    return solve(problem, start, settings, on_step, REFINEMENT)


def normal_equations(
    problem: Problem,
    motions: Sequence[Motion],
    poses: tuple[Array, Array],
    evidence: Evidence,
    settings: Settings,
    tolerance: float = 1.0,
) -> list[BandedBlocks]:
    """The normal equations of every performer: gradients and outlines of all views, and smoothness."""
    R, T = poses
    precision = view_precision(evidence, settings)
    H = np.einsum("v,vfpij->fpij", precision, evidence.H)
    g = np.einsum("v,vfpi->fpi", precision, evidence.g)
    # Lines that reach farther than the error find other limbs' outlines: far from the solution they count for little.
    outlines = 1 / (settings.outline_correlation * tolerance**2)
    outline_H, outline_g = outlines * evidence.outline_H.sum(axis=0), outlines * evidence.outline_g.sum(axis=0)
    energy = float(precision @ evidence.energy.sum(axis=1)) / len(problem.bodies)
    outline_energy = outlines * float(evidence.outline_energy.sum()) / len(problem.bodies)
    systems = []
    for i, (body, span) in enumerate(zip(problem.bodies, problem.spans(), strict=True)):
        own = R[:, span], T[:, span]
        gradients = joint_blocks(body, own, H[:, span], g[:, span], energy)
        ends = single_blocks(body, own, outline_H[:, span], outline_g[:, span], outline_energy)
        smooth = problem.smoothness(i, motions[i], acceleration_precision(body, problem.fps, settings))
        systems.append(gradients + ends + smooth)
    return systems


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
