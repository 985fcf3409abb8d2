"""Relaxation as published (paper 1, section 4 and appendix).

The unknowns are the motion parameters x_j between frames j - 1 and j: the translation S_j of the root in the world and
the rotation Q_j of each part about its own axes. An initial solution follows the gradients alone, frame by frame.
Sweeps of equation (30) then solve for x_j one frame after the other, with the terminal terms (A.1) to (A.4) and the
smoothness terms (A.5) and (A.6). Parts that no view sees are predicted in the initial solution, and have no gradient
terms in the sweeps, equation (38).

Two things differ from the paper.

*Gradient terms.* Equation (23) is printed with the constraints (12) of a step's own frame only. But a step moves all
later poses, so the constraints of all later frames depend on it as well. Without them the sweeps converge beside the
minimum of (21): when a body turns, different frames show different directions, above all depth. On the other hand,
where the initial solution has lost the body, later frames show something else and would hold the steps where they are.
So the first sweeps use (23) as printed, which lets the key pose bring the body back, and the others use the full
derivative (22).

*Weights.* lambda, nu and smoothness weigh grey levels, summed over pixels, against radians and lengths. The paper chose
its numbers by trial, without stating the scale of grey levels, the number of pixels, or the unit of length. For the
numbers to mean the same on all footage, all pixels within a square of `Settings.correlation_length` on the body count
as one: then the sums depend neither on the resolution, nor on the stride, nor on the distance. Grey levels run from 0
to 1, rotations are in radians, lengths in metres in the first sweeps and in units of `LENGTH` in the others.

With u = 1/n of equation (27) the sweeps converge to the minimum of (21) for lambda / n and nu / n, but slowly (section
4.3), as lambda and nu hold each step near its former value. The first sweeps do so, while the key pose is far away. The
others use u = 1 with lambda / n and nu / n, which has the same fixed point; each step is then the minimum of the energy
for its frame, and no sweep raises the energy. The axis vector (A.2) is the sine of the rotation angle, so the terminal
constraint is only met in the limit of small angles: finally the last pose is set to the key pose.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from ...body.joint_blocks import joint_blocks
from ...body.kinematics import scene_poses
from ...body.motion import Motion, stacked
from ...evidence.label_images import render_labels
from ...evidence.occlusion import intervals
from ...evidence.sampling import Sampling
from ...evidence.segment_evidence import SegmentEvidence
from ...numerics import rotations
from ...numerics.arrays import Array
from ...numerics.banded_blocks import BandedBlocks
from ...numerics.repeatable import on_grid
from ...runtime.timing import Seconds
from ...shot.acceleration_prior import USUAL_JOINT, USUAL_ROOT
from ..prediction import PAST, autoregression, predict
from .measurement import MeasuredMotion, Workspace, hidden_parts
from .motion_steps import StepEquations, Steps
from .problem import SegmentProblem, SegmentSolution

LAMBDA = 10.0
"""Weight of the rotations' terminal constraint."""
NU = 20.0
"""Weight of the root's terminal constraint."""
SMOOTHNESS = 1.0
"""Weight of the smoothness of every motion parameter."""
PRINTED = 0.5
"""Share of the sweeps, the first ones, that solve equation (23) as printed, with lengths in metres."""
LENGTH = USUAL_ROOT / USUAL_JOINT
"""Unit of length in the other sweeps, metres. The paper weighs the smoothness of translations and rotations equally,
which is right in the unit in which the root's usual acceleration equals that of a joint in radians."""
DAMPING = 0.01
"""Damping of the steps of the initial solution, so that a direction that no pixel measures stands still: the variance
of a patch's grey level (standard deviation about 0.01) over that of a step (about 0.1 radians or metres)."""
RELINEARISE = 10
"""Sweeps between two measurements of the gradients around the present motion."""
STRIDE = 2
"""Distance between the pixels whose gradients are used, in rows and in columns."""
INITIAL = (Sampling(2.0, 8.0, STRIDE), Sampling(1.0, 4.0, STRIDE), Sampling(1.0, 4.0, STRIDE))
"""Samplings for each step of the initial solution, from coarse to fine."""
FIRST = (Sampling(8.0, 8.0, STRIDE), Sampling(4.0, 8.0, STRIDE), *INITIAL)
"""Samplings for the first step, which has no earlier step to start from: gradients reach about as far as the images are
smoothed."""
FINE = Sampling(1.0, 1.0, STRIDE)
"""Sampling for the sweeps."""


def relaxed(problem: SegmentProblem, start: Sequence[Motion], workspace: Workspace) -> SegmentSolution:
    """Solve for the motion of all performers by relaxation; parameters as in `gauss_newton.descend`.

    A segment that ends without a key pose has no terminal constraint. Key poses of single degrees of freedom within the
    segment are put in at the end.
    """
    seconds, settings = Seconds(), problem.settings
    with seconds.measure("initial solution"):
        motions = follow_gradients(problem, start, workspace.part(0.0, 0.2))
        workspace.report(0.2, motions)
        ends = zip(motions, start, problem.fixed, strict=True)
        motions = [_rounded(motion, without_drift(motion, keyed, fixed)) for motion, keyed, fixed in ends]
    energies: list[float] = []
    for sweep in range(0, settings.sweeps, RELINEARISE):
        if sweep:
            workspace.report(0.2 + 0.8 * sweep / settings.sweeps, motions)
        measured = workspace.measure(problem, motions, FINE)
        evidence = measured.evidence
        seconds.add(evidence.seconds)
        energies.append(float(evidence.gradients.energy.sum()))
        if settings.prediction:
            evidence = evidence.without(np.concatenate(hidden_parts(problem, evidence.share), axis=1))
        count = min(RELINEARISE, settings.sweeps - sweep)
        with seconds.measure("solve"):
            whole = sweep >= PRINTED * settings.sweeps
            rows = (rows_of_steps if whole else printed_rows)(problem, measured, evidence)
            motions = [
                _rounded(motion, relax(motion, keyed, fixed, own, count, whole=whole))
                for motion, keyed, fixed, own in zip(motions, start, problem.fixed, rows, strict=True)
            ]
    held = tuple(_held(m, s, fixed) for m, s, fixed in zip(motions, start, problem.fixed, strict=True))
    evidence = workspace.measure(problem, held, FINE).evidence
    seconds.add(evidence.seconds)
    energies.append(float(evidence.gradients.energy.sum()))
    return SegmentSolution.of(held, evidence, iterations=settings.sweeps, energy=energies, seconds=seconds)


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
        here = _moved_by_gradients(pair, here, gone, workspace, FIRST if j == 1 else INITIAL)
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
        runs = [x[a : b + 1, own] for a, b in intervals(~hidden[:, p])]
        models = [autoregression([run[:, d] for run in runs]) for d in range(own.stop - own.start)]
        seen = np.flatnonzero(~hidden[:, p]).max(initial=-1) + 1
        step[own] = predict(x[max(seen - PAST, 0) : seen, own], len(x) + 1 - seen, models)[0][-1]
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
    labels = [render_labels(geometry, v.camera.subsampled(STRIDE), pair.first, *poses) for v in pair.views]
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
        sums, count = measured.evidence.gradients, _pixel_counts(pair, measured.evidence)
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


def rows_of_steps(problem: SegmentProblem, measured: MeasuredMotion, evidence: SegmentEvidence) -> list[StepEquations]:
    """Return the gradient terms of every performer by the full derivative (22), summed over all views."""
    systems = [BandedBlocks.zeros(problem.length, body.dof) for body in problem.bodies]
    count = _pixel_counts(problem, evidence)
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
    count = _pixel_counts(problem, evidence)
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


def _pixel_counts(problem: SegmentProblem, evidence: SegmentEvidence) -> Array:
    """Weight of a pixel of each view, shape (V, 1, 1, 1, 1), by the correlation length; see the module's docstring."""
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


def relax(
    motion: Motion,
    keyed: Motion,
    fixed: NDArray[np.bool_],
    rows: StepEquations,
    sweeps: int,
    *,
    whole: bool = False,
) -> Motion:
    """Make sweeps of equation (30) over one performer's frames, and return the motion.

    Parameters
    ----------
    motion : Motion
        F = n + 1 poses; the first one is not changed.
    keyed : Motion
        F poses, of which the values where `fixed` is true are used; the last one gives the terminal constraint.
    fixed : ndarray of bool, shape (F, D)
    rows : StepEquations
        Gradient terms, linearised around the motion.
    sweeps : int
    whole : bool
        Use u = 1 and the unit `LENGTH`, as in the second half of the sweeps.
    """
    n, D = rows.steps.shape
    u, length = (1.0, LENGTH) if whole else (1.0 / n, 1.0)
    units = np.concatenate([np.full(3, length), np.ones(D - 3)])
    smooth = SMOOTHNESS / units**2
    weight = fixed[-1] * np.concatenate([np.full(3, NU), np.full(D - 3, LAMBDA)]) / (units**2 * n * u)
    inverse = np.linalg.inv(rows.curvature + np.diag(smooth + weight))
    R_last, T_last = keyed.rotations[-1], keyed.translations[-1]
    x = rows.steps.copy()
    for _ in range(sweeps):
        Q = rotations.exp(x[:, 3:].reshape(n, -1, 3))
        after = _products_after(Q)
        before = motion.rotations[0]
        T_error = T_last - motion.translations[0] - x[:, :3].sum(axis=0)
        gradient = rows.gradient(x)
        moved, moved_before = np.zeros((2, D))
        for j in range(n):
            P = np.swapaxes(before, -1, -2) @ R_last @ np.swapaxes(after[j], -1, -2)
            x_e = np.concatenate([T_error + x[j, :3], axis_vector(P).ravel()])  # equation (25)
            x_e = u * (x_e - x[j]) + x[j]  # equation (27)
            ends = x[max(j - 1, 0)] + x[min(j + 1, n - 1)]  # x_0 = x_1, x_n+1 = x_n
            along = rows.carried[j] @ moved
            b = rows.curvature[j] @ (x[j] - along) - gradient[j]
            b -= rows.first[j] @ moved + rows.second[j] @ moved_before
            new = inverse[j] @ (b + weight * x_e + smooth * ends / 2)
            moved, moved_before = along + new - x[j], moved
            T_error -= new[:3] - x[j, :3]
            x[j] = new
            before = before @ rotations.exp(new[3:].reshape(-1, 3))
    return Steps(x[:, :3], x[:, 3:].reshape(n, -1, 3)).accumulated(motion)


def axis_vector(P: Array) -> Array:
    """Axis vector of (P - P^T) / 2, equation (A.2), shape (..., 3)."""
    return 0.5 * np.stack(
        [P[..., 2, 1] - P[..., 1, 2], P[..., 0, 2] - P[..., 2, 0], P[..., 1, 0] - P[..., 0, 1]], axis=-1
    )


def _products_after(Q: Array) -> Array:
    """Products Q_{j+1} ... Q_n of the rotations after each frame j, (n, P, 3, 3)."""
    out = np.empty_like(Q)
    out[-1] = np.eye(3)
    for j in range(len(Q) - 1, 0, -1):
        out[j - 1] = Q[j] @ out[j]
    return out


def _rounded(motion: Motion, new: Motion) -> Motion:
    """Return a new motion with its changes rounded, so that all processors give the same bits."""
    return motion.moved(on_grid(motion.difference(new)))


def _held(motion: Motion, keyed: Motion, fixed: NDArray[np.bool_]) -> Motion:
    """Set the fixed degrees of freedom to those of the key poses, which the sweeps meet only in the limit."""
    return motion.moved(np.where(fixed, motion.difference(keyed), 0.0))
