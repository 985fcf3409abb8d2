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

from ...body.joint_blocks import joint_blocks
from ...body.motion import Motion
from ...body.smoothness import acceleration, limited
from ...evidence.accumulate import Sampling, SegmentEvidence
from ...numerics.banded import BandedFactor
from ...numerics.banded_blocks import BandedBlocks
from ...runtime.timing import Seconds
from ...shot.shot import Settings
from ..prediction import predict_unseen
from .measurement import Instants, MeasuredMotion, Workspace, hidden_parts, keypoint_instants
from .problem import SegmentProblem, SegmentSolution, frame_residual
from .smoothness_factor import SegmentSmoothness

Array = NDArray[np.float64]

SMALL_STEP = 0.007
"""Root mean square of joints' steps, radians (and metres), after which what is left, a third of it, does not count."""
ROUGH_STEP = 0.025
"""The same where another stage follows, which moves joints more than what is left."""
OVERRELAXATION = 1.5
"""All steps of a stage but its last are taken this much longer, where all views are looked at: weights that follow the
residuals, and slopes measured beside the solution, make every step too short by about the same share."""
REACH = 0.07
"""How far from the model's outlines the body's are usually looked for, metres."""
ROUNDS = 2
"""How often smoothness is estimated after each look at the pictures: these are looked at again."""
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
    """

    sampling: Sampling
    iterations: int
    views: int | None = None
    small: float = SMALL_STEP

    def sampling_of(self, views: int) -> Sampling:
        """The sampling of so many views: the more there are, the fewer pixels of each are needed."""
        return replace(self.sampling, stride=max(self.sampling.stride, min(views, COARSEST)))


STAGES = (
    DescentStage(Sampling(2.0, 8.0, 4, 0.10), 2, views=2, small=ROUGH_STEP),
    DescentStage(Sampling(1.0, 4.0, 4, REACH), 3, views=2, small=ROUGH_STEP),
    DescentStage(Sampling(1.0, 1.0, 3, REACH), 2),
)
"""From the curve through the key poses to the solution."""
REFINEMENT = (DescentStage(Sampling(1.0, 1.0, 2, REACH), 2),)
"""From a solution to the better one that motion known on both sides allows."""


def refine(problem: SegmentProblem, start: Sequence[Motion], workspace: Workspace) -> SegmentSolution:
    """Continue from a solution when more is known of the motion around the segment."""
    return descend(problem, start, workspace, REFINEMENT)


def descend(
    problem: SegmentProblem, start: Sequence[Motion], workspace: Workspace, stages: Sequence[DescentStage] = STAGES
) -> SegmentSolution:
    """Descend from a start to the nearest solution.

    Parameters
    ----------
    problem : SegmentProblem
    start : sequence of Motion
        F poses per performer; their fixed degrees of freedom are kept.
    workspace : Workspace
        Progress is reported before each iteration.
    stages : sequence of DescentStage
    """
    motions = list(start)
    seconds = Seconds()
    energies: list[float] = []
    planned = sum(stage.iterations for stage in stages)
    hidden: list[NDArray[np.bool_]] = []
    expected: list[Array] = []
    smooth = SegmentSmoothness.start(problem)
    for s, stage in enumerate(stages):
        before = sum(earlier.iterations for earlier in stages[:s])
        for i in range(stage.iterations):
            workspace.report((before + i) / planned, motions)
            seen = problem if stage.views is None else view_subset(problem, stage.views, i)
            measured = workspace.measure(seen, motions, stage.sampling_of(len(seen.views)))
            evidence = measured.evidence
            seconds.add(evidence.seconds)
            longer = i + 1 < stage.iterations and len(seen.views) == len(problem.views)
            pace = OVERRELAXATION if longer else 1.0
            with seconds.measure("solve"):
                if problem.settings.prediction and (i == 0 or not hidden):
                    hidden = hidden_parts(seen, evidence.share)
                    expected = predicted_accelerations(motions, hidden)
                images = evidence_equations(seen, measured, hidden)
                smooth = smooth.estimated(seen, motions, images, expected, rounds=ROUNDS)
                systems = with_smoothness(seen, motions, images, smooth, expected)
                factors = [BandedFactor(n, fixed) for n, fixed in zip(systems, problem.fixed, strict=True)]
                steps = [limited(-pace * f.solve(n.gradient)) for f, n in zip(factors, systems, strict=True)]
                motions = [motion.moved(step) for motion, step in zip(motions, steps, strict=True)]
                energies.append(sum(n.energy for n in systems))
            if _size(steps) < stage.small:
                break
    return SegmentSolution(
        tuple(motions),
        len(energies),
        tuple(energies),
        tuple(factors),
        evidence.share,
        evidence.explained.sum(axis=0),
        frame_residual(evidence),
        seconds,
        evidence,
        smooth.variances,
    )


def _size(steps: Sequence[Array]) -> float:
    """Root mean square of steps."""
    return float(np.sqrt(np.mean(np.concatenate([step.ravel() for step in steps]) ** 2)))


def view_subset(problem: SegmentProblem, least: int, turn: int) -> SegmentProblem:
    """The problem with every k-th view alone, beginning elsewhere with every turn, so that `least` are left."""
    every = max(1, len(problem.views) // least)
    return replace(problem, views=problem.views[turn % every :: every])


def normal_equations(
    problem: SegmentProblem,
    measured: MeasuredMotion,
    hidden: Sequence[NDArray[np.bool_]] = (),
    expected: Sequence[Array] = (),
    smooth: SegmentSmoothness | None = None,
) -> list[BandedBlocks]:
    """The normal equations of every performer: gradients and outlines of all views, keypoints, and smoothness.

    Parameters
    ----------
    problem : SegmentProblem
    measured : MeasuredMotion
        The motions, with the evidence there.
    hidden : sequence of ndarray of bool, shape (F, P)
        Per performer: the parts whose pixels are left out.
    expected : sequence of ndarray, shape (F, D)
        Per performer: accelerations that cost nothing; by default none.
    smooth : SegmentSmoothness, optional
        By default that before the pictures are looked at.
    """
    images = evidence_equations(problem, measured, hidden)
    return with_smoothness(problem, measured.motions, images, smooth or SegmentSmoothness.start(problem), expected)


def with_smoothness(
    problem: SegmentProblem,
    motions: Sequence[Motion],
    images: Sequence[BandedBlocks],
    smooth: SegmentSmoothness,
    expected: Sequence[Array] = (),
) -> list[BandedBlocks]:
    """The normal equations of the evidence with those of smoothness; parameters as in `normal_equations`."""
    return [
        seen + smooth.blocks(problem, i, motion, expected[i] if expected else None)
        for i, (seen, motion) in enumerate(zip(images, motions, strict=True))
    ]


def evidence_equations(
    problem: SegmentProblem, measured: MeasuredMotion, hidden: Sequence[NDArray[np.bool_]] = ()
) -> list[BandedBlocks]:
    """The normal equations of every performer without smoothness; parameters as in `normal_equations`."""
    evidence = measured.evidence.without(np.concatenate(hidden, axis=1)) if hidden else measured.evidence
    precision = view_precision(evidence, problem.settings)
    tolerance = evidence.sampling.tolerance
    # Lines that reach farther than the error find other limbs' outlines: far from the solution they count for little.
    outlines = 1 / (problem.settings.outline_correlation * tolerance**2)
    systems = [BandedBlocks.zeros(problem.length, body.dof) for body in problem.bodies]
    for instants in measured.instants:
        own_systems = _image_systems(problem, instants, evidence, precision, outlines)
        systems = [system + own for system, own in zip(systems, own_systems, strict=True)]
    if problem.keypoints:
        instants = keypoint_instants(problem, measured.motions)
        R, T = instants.poses
        for i, (body, span) in enumerate(zip(problem.bodies, problem.spans(), strict=True)):
            seen = problem.keypoints[i].blocks(body, (R[:, span], T[:, span]), tolerance)
            systems[i] += instants.on_frames(i, seen)
    return systems


def _image_systems(
    problem: SegmentProblem, instants: Instants, evidence: SegmentEvidence, precision: Array, outlines: float
) -> list[BandedBlocks]:
    """The normal equations of every performer: gradients and outlines of the views that were taken at some instants."""
    (R, T), views = instants.poses, list(instants.views)
    pairs, frames = evidence.gradients, evidence.outlines
    H = np.einsum("v,vfpij->fpij", precision[views], pairs.H[views])
    g = np.einsum("v,vfpi->fpi", precision[views], pairs.g[views])
    outline_H, outline_g = (outlines * a[views].sum(axis=0) for a in (frames.H, frames.g))
    energy = float(precision[views] @ pairs.energy[views].sum(axis=1)) / len(problem.bodies)
    outline_energy = outlines * float(frames.energy[views].sum()) / len(problem.bodies)
    systems = []
    for i, (body, span) in enumerate(zip(problem.bodies, problem.spans(), strict=True)):
        own = R[:, span], T[:, span]
        gradients = joint_blocks(body, own, H[:, span], g[:, span], energy)
        ends = joint_blocks(body, own, outline_H[:, span], outline_g[:, span], outline_energy)
        systems.append(instants.on_frames(i, gradients + ends))
    return systems


def predicted_accelerations(motions: Sequence[Motion], hidden: Sequence[NDArray[np.bool_]]) -> list[Array]:
    """Accelerations that parts have, where they are hidden, in the motion predicted for them, else zero, (F, D)."""
    expected = []
    for motion, mask in zip(motions, hidden, strict=True):
        predicted = np.zeros((len(motion), 3 + 3 * mask.shape[1]))
        if mask.any() and len(motion) > 2:
            predicted[1:-1] = acceleration(predict_unseen(motion, mask))
        degrees = np.concatenate([np.repeat(mask[:, :1], 3, axis=1), np.repeat(mask, 3, axis=1)], axis=1)
        expected.append(predicted * degrees)
    return expected


def view_precision(evidence: SegmentEvidence, settings: Settings) -> Array:
    """Inverse variance of a residual of each view, with the pixels that repeat one another counted once, shape (V,)."""
    noise = np.maximum(np.median(evidence.gradients.noise, axis=1), 1e-3)
    density = np.maximum(np.median(evidence.gradients.density, axis=1), 1.0)
    return evidence.sampling.stride**2 / (noise**2 * density * settings.correlation_length**2)
