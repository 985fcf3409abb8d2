"""The initial solution of relaxation: frame by frame, each pose follows the gradients from the one before (section 4).

Parts that no view sees move as predicted until they are seen again (section 5).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from ....body.joint_blocks import joint_blocks
from ....body.kinematics import scene_poses
from ....body.motion import Motion, stacked
from ....evidence.rendering.label_images import render_labels
from ....evidence.sampling import Sampling
from ....numerics import frame_ranges
from ....numerics.arrays import Array
from ....numerics.banded_blocks import BandedBlocks
from ....numerics.repeatable import on_grid
from ..equations.measurement import Workspace, hidden_parts
from ..equations.problem import SegmentProblem
from ..unseen_parts.prediction import FILTER_STEPS, autoregression, predict
from .motion_steps import Steps
from .step_rows import pixel_counts

DAMPING = 0.01
"""Damping of the steps of the initial solution, so that a direction that no pixel measures stands still: the variance
of a patch's grey level (standard deviation about 0.01) over that of a step (about 0.1 radians or metres)."""
PIXEL_STRIDE = 2
"""Distance between the pixels whose gradients are used, in rows and in columns."""
STEP_SAMPLINGS = (Sampling(2.0, 8.0, PIXEL_STRIDE), Sampling(1.0, 4.0, PIXEL_STRIDE), Sampling(1.0, 4.0, PIXEL_STRIDE))
"""Samplings for each step of the initial solution, from coarse to fine."""
FIRST_STEP_SAMPLINGS = (Sampling(8.0, 8.0, PIXEL_STRIDE), Sampling(4.0, 8.0, PIXEL_STRIDE), *STEP_SAMPLINGS)
"""Samplings for the first step, which has no earlier step to start from: gradients reach about as far as the images are
smoothed."""


def follow_gradients(problem: SegmentProblem, start: Sequence[Motion], workspace: Workspace) -> list[Motion]:
    """Initial solution: each pose from the one before it by gradients alone, equation (12), from the first pose of
    `start` on.

    Gradients are measured at the pose to which a repetition of the last step leads, equation (20), since a fast limb
    has moved too far for gradients at its last pose. The first step uses coarse images first instead. Directions that
    no pixel measures do not move. With prediction, parts that no view sees move as predicted until they are seen again
    (section 5.4).

    Returns
    -------
    list of Motion
        F poses per performer.
    """
    motions = [motion[:1] for motion in start]
    hidden = [np.zeros((0, len(body)), dtype=bool) for body in problem.bodies]
    for j in range(1, problem.length):
        workspace.report(j / problem.length, start)
        pair = replace(problem, first=problem.first + j - 1, fixed=tuple(f[j - 1 : j + 1] for f in problem.fixed))
        here = [stacked([motion[-1:], motion[-1:]]) for motion in motions]
        gone = [np.zeros(len(body), dtype=bool) for body in problem.bodies]
        begun = [_last_step(motion) for motion in motions]
        if problem.settings.prediction:
            x = [predicted_step(motion, h) for motion, h in zip(motions, hidden, strict=True)]
            gone = out_of_sight(pair, [_advanced(h, step) for h, step in zip(here, x, strict=True)])
            begun = [np.where(_degrees(g), step, own) for g, step, own in zip(gone, x, begun, strict=True)]
        here = [_advanced(h, step) for h, step in zip(here, begun, strict=True)]
        here = _moved_by_gradients(pair, here, gone, workspace, FIRST_STEP_SAMPLINGS if j == 1 else STEP_SAMPLINGS)
        motions = [stacked([motion, h[1:]]) for motion, h in zip(motions, here, strict=True)]
        hidden = [np.concatenate([h, g[None]]) for h, g in zip(hidden, gone, strict=True)]
    return motions


def without_drift(motion: Motion, keyed: Motion, fixed: NDArray[np.bool_]) -> Motion:
    """Correct an initial solution so that it ends at the key pose; parameters as in `relax`.

    Each step starts from the one before, so the error behaves like an integrated random walk. Given its value at the
    end, its mean at a share s of the way is s^2 (3 - s) / 2 of that. Equal shares for all steps, equation (28), would
    also move the first poses, which are right.
    """
    s = np.linspace(0.0, 1.0, len(motion))[:, None]
    return motion.moved(s**2 * (3 - s) / 2 * np.where(fixed[-1], motion.difference(keyed)[-1], 0.0))


def predicted_step(motion: Motion, hidden: NDArray[np.bool_]) -> Array:
    """Predict the step that follows a motion, shape (D,); for each part from the steps on which it was last seen.

    Parameters
    ----------
    motion : Motion
        j poses of one performer.
    hidden : ndarray of bool, shape (j - 1, P)
        Which of the steps between the poses were predicted themselves; a part's model is learnt from the others.
    """
    x = Steps.of(motion).vectors()
    step = np.zeros(x.shape[1])
    for p in range(hidden.shape[1]):
        own = slice(3 + 3 * p if p else 0, 6 + 3 * p)
        runs = [x[a : b + 1, own] for a, b in frame_ranges.runs(~hidden[:, p])]
        models = [autoregression([run[:, d] for run in runs]) for d in range(own.stop - own.start)]
        seen = np.flatnonzero(~hidden[:, p]).max(initial=-1) + 1
        step[own] = predict(x[max(seen - FILTER_STEPS, 0) : seen, own], len(x) + 1 - seen, models)[0][-1]
    return on_grid(step)


def out_of_sight(pair: SegmentProblem, motions: Sequence[Motion]) -> list[NDArray[np.bool_]]:
    """Return, per performer, the parts whose motion from one frame to the next no view shows, shape (P,).

    A view does not show a part that is occluded in its present or predicted pose (section 5.3), unless it shows a part
    further out on the same chain, whose motion determines that of this one: arms in front of the trunk do not hide it.

    Parameters
    ----------
    pair : SegmentProblem
        The two frames.
    motions : sequence of Motion
        Two poses per performer: the present one and the predicted one.
    """
    poses, geometry = scene_poses(pair.bodies, motions), pair.geometry()
    labels = [render_labels(geometry, v.camera.subsampled(PIXEL_STRIDE), pair.first, *poses) for v in pair.views]
    share = np.stack([view.share for view in labels])
    carried = block_diag(*(body.ancestry for body in pair.bodies))
    shown = (share[..., None] * carried).max(axis=2)
    return [hidden[-1] for hidden in hidden_parts(pair, shown[:, :1], shown[:, 1:])]


def _moved_by_gradients(
    pair: SegmentProblem,
    motions: Sequence[Motion],
    gone: Sequence[NDArray[np.bool_]],
    workspace: Workspace,
    samplings: Sequence[Sampling],
) -> list[Motion]:
    """Move the second of two poses of each performer by the gradients on all parts but those that no view shows."""
    here, seen = list(motions), ~np.concatenate(gone)
    for sampling in samplings:
        measured = workspace.measure(pair, here, sampling)
        sums, count = measured.evidence.gradients, pixel_counts(pair, measured.evidence)
        systems = [BandedBlocks.zeros(2, body.dof) for body in pair.bodies]
        for instants in measured.instants:
            (R, T), views = instants.poses, list(instants.views)
            H = (count[views] * sums.H[views]).sum(axis=0) * seen[:, None, None]
            g = (count[views, ..., 0] * sums.g[views]).sum(axis=0) * seen[:, None]
            for i, (body, span) in enumerate(zip(pair.bodies, pair.spans(), strict=True)):
                blocks = joint_blocks(body, (R[:, span], T[:, span]), H[:, span], g[:, span], 0.0)
                systems[i] += instants.on_frames(i, blocks)
        for i, (body, blocks) in enumerate(zip(pair.bodies, systems, strict=True)):
            A = blocks.diagonal[1] + DAMPING * np.eye(body.dof)
            damped = DAMPING * _last_step(here[i]) * ~_degrees(gone[i])
            here[i] = _advanced(here[i], on_grid(-np.linalg.solve(A, blocks.gradient[1] + damped)))
    return here


def _last_step(motion: Motion) -> Array:
    """Return the last motion parameters of a motion, shape (D,); zero for a single pose."""
    return Steps.of(motion[-2:]).vectors()[0] if len(motion) > 1 else np.zeros(3 + 3 * motion.rotations.shape[1])


def _degrees(parts: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the degrees of freedom of parts, shape (D,); the root's translation belongs to the first part."""
    return np.concatenate([np.repeat(parts[:1], 3), np.repeat(parts, 3)])


def _advanced(poses: Motion, step: Array) -> Motion:
    """Move the second of two poses by a step."""
    return poses.moved(np.stack([np.zeros_like(step), step]))
