"""Gradient terms of relaxation's motion parameters: by the full derivative (22), or as printed (23)."""

from __future__ import annotations

import numpy as np

from ....body.joint_blocks import joint_blocks
from ....evidence.segment_evidence import SegmentEvidence
from ....numerics.arrays import Array
from ....numerics.banded_blocks import BandedBlocks
from ..equations.measurement import MeasuredMotion
from ..equations.problem import SegmentProblem
from .motion_steps import StepEquations


def rows_of_steps(problem: SegmentProblem, measured: MeasuredMotion, evidence: SegmentEvidence) -> list[StepEquations]:
    """Return the gradient terms of every performer by the full derivative (22), summed over all views."""
    systems = [BandedBlocks.zeros(problem.length, body.dof) for body in problem.bodies]
    count = pixel_counts(problem, evidence)
    for instants in measured.instants:
        (R, T), views = instants.poses, list(instants.views)
        H = (count[views] * evidence.gradients.H[views]).sum(axis=0)
        g = (count[views, ..., 0] * evidence.gradients.g[views]).sum(axis=0)
        for i, (body, span) in enumerate(zip(problem.bodies, problem.spans(), strict=True)):
            blocks = joint_blocks(body, (R[:, span], T[:, span]), H[:, span], g[:, span], 0.0)
            systems[i] += instants.on_frames(i, blocks)
    return [StepEquations.of(own, motion) for own, motion in zip(systems, measured.motions, strict=True)]


def printed_rows(problem: SegmentProblem, measured: MeasuredMotion, evidence: SegmentEvidence) -> list[StepEquations]:
    """Return the gradient terms of every performer as printed in (23): those of a pair of frames, for its own step."""
    A = [np.zeros((problem.length - 1, body.dof, body.dof)) for body in problem.bodies]
    left = [np.zeros((problem.length - 1, body.dof)) for body in problem.bodies]
    count = pixel_counts(problem, evidence)
    for instants in measured.instants:
        (R, T), views = instants.poses, list(instants.views)
        H, g = np.zeros_like(evidence.gradients.H[0]), np.zeros_like(evidence.gradients.g[0])
        H[..., 6:, 6:] = (count[views] * evidence.gradients.H[views]).sum(axis=0)[..., 6:, 6:]
        g[..., 6:] = (count[views, ..., 0] * evidence.gradients.g[views]).sum(axis=0)[..., 6:]
        for i, (body, span) in enumerate(zip(problem.bodies, problem.spans(), strict=True)):
            blocks = joint_blocks(body, (R[:, span], T[:, span]), H[:, span], g[:, span], 0.0)
            A[i] += shared_out(blocks.diagonal[1:], instants.delay)
            left[i] += shared_out(blocks.gradient[1:], instants.delay)
    return [StepEquations.printed(*own) for own in zip(A, left, measured.motions, strict=True)]


def pixel_counts(problem: SegmentProblem, evidence: SegmentEvidence) -> Array:
    """Weight of a pixel of each view, shape (V, 1, 1, 1, 1), by the correlation length; see `relaxation`."""
    return evidence.pixel_share(problem.settings.lengths[0])[:, None, None, None, None]


def shared_out(rows: Array, delay: float) -> Array:
    """Distribute terms (n, ...) of the steps between instants to the steps between frames, by how long they overlap."""
    if delay == 0:
        return rows
    rows = rows if delay > 0 else rows[::-1]
    out = (1 - abs(delay)) * rows
    out[1:] += abs(delay) * rows[:-1]
    out[-1] += abs(delay) * rows[-1]
    return out if delay > 0 else out[::-1]
