"""Relaxation as published (paper 1, section 4 and appendix).

Unknown are the motion parameters x_j between frames j - 1 and j: the root's translation S_j in the world and each
part's turn Q_j about its own axes. An initial solution follows the gradients alone, frame after frame; sweeps of
equation (30) then solve one frame after the other for x_j, with the terminal terms (A.1) to (A.4) and the smoothness
terms (A.5) and (A.6). Parts that no view sees are predicted in the initial solution, and have no gradients in the
sweeps, equation (38).

Equation (23) is printed with the rows (12) of a step's own frame. A step moves all later poses, so the rows of all
later frames depend on it, too; without them sweeps come to rest beside the minimum of (21): where a body turns, rows of
one frame say what those of another do not, above all of depth. But where the initial solution has lost the body, rows
of later frames, which see something else, hold steps where they are. So the first sweeps are those of (23) as printed,
which let the key pose bring the body back, and the others take the derivative (22) whole.

The weights lambda, nu and smoothness weigh grey levels, summed over pixels, against radians and lengths. The paper
found its numbers by trial on its own footage, and states neither the scale of its grey levels, nor how many pixels it
took, nor its unit of length. So that the numbers mean the same on all footage, pixels within a square of
`Settings.correlation_length` on the body, which say nearly the same, count as one together: then the sums depend
neither on the resolution, nor on the stride, nor on the distance. Grey levels count 0 to 1, turns radians, lengths
metres in the first sweeps and `LENGTH` in the others.

With u = 1/n of equation (27) the sweeps come to rest where equation (21) is least for lambda / n and nu / n, but slowly
(section 4.3), as lambda and nu hold each step near to what it was. The first sweeps do so, while the key pose is far.
The others have u = 1 with lambda / n and nu / n, which rest in the same place: a step is then what the energy asks for,
and no sweep raises it. The axis vector (A.2) is the sine of a turn, so the terminal constraint is met in the limit of
small turns only; the last pose is then set to the key pose.
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
from ...evidence.accumulate import SegmentEvidence
from ...evidence.label_images import render_labels
from ...evidence.occlusion import intervals
from ...evidence.sampling import Sampling
from ...numerics import rotations
from ...numerics.arrays import Array
from ...numerics.banded_blocks import BandedBlocks
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
"""Share of the sweeps that solve equation (23) as it is printed, with lengths in metres."""
LENGTH = USUAL_ROOT / USUAL_JOINT
"""Unit of length of the weights in the others, metres. The paper gives translations and turns the same smoothness: that
is right in the unit in which the root is usually accelerated as much as a joint is in radians."""
DAMPING = 0.01
"""Of the initial solution's steps, so that a direction that no pixel measures stands still: the variance of a patch's
grey level, about 0.01 of the scale, over that of a step, about 0.1 radians or metres."""
RELINEARISE = 10
"""Sweeps between two measurements of the gradients around the current motion."""
STRIDE = 2
"""Every how many pixels, each way, the gradients are taken."""
INITIAL = (Sampling(2.0, 8.0, STRIDE), Sampling(1.0, 4.0, STRIDE), Sampling(1.0, 4.0, STRIDE))
"""Sampling for the steps from one frame to the next that make the initial solution."""
FIRST = (Sampling(8.0, 8.0, STRIDE), Sampling(4.0, 8.0, STRIDE), *INITIAL)
"""Sampling for the first of them, which has none before it to begin with: gradients reach about as far as the images
are smoothed."""
FINE = Sampling(1.0, 1.0, STRIDE)
"""Sampling for the sweeps."""


def relaxed(problem: SegmentProblem, start: Sequence[Motion], workspace: Workspace) -> SegmentSolution:
    """Fit the motion of all performers by relaxation; parameters as in `gauss_newton.descend`.

    A segment that ends without a key pose has no terminal constraint. Key poses of some degrees of freedom within
    the segment are held as they are.
    """
    seconds, settings = Seconds(), problem.settings
    with seconds.measure("initial solution"):
        motions = follow_gradients(problem, start, workspace.part(0.0, 0.2))
        workspace.report(0.2, motions)
        ends = zip(motions, start, problem.fixed, strict=True)
        motions = [without_drift(motion, keyed, fixed) for motion, keyed, fixed in ends]
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
                relax(motion, keyed, fixed, own, count, whole=whole)
                for motion, keyed, fixed, own in zip(motions, start, problem.fixed, rows, strict=True)
            ]
    held = tuple(_held(m, s, fixed) for m, s, fixed in zip(motions, start, problem.fixed, strict=True))
    evidence = workspace.measure(problem, held, FINE).evidence
    seconds.add(evidence.seconds)
    energies.append(float(evidence.gradients.energy.sum()))
    return SegmentSolution.of(held, evidence, iterations=settings.sweeps, energy=energies, seconds=seconds)


def follow_gradients(problem: SegmentProblem, start: Sequence[Motion], workspace: Workspace) -> list[Motion]:
    """Initial solution: from the first pose on, each frame from the one before by its gradients alone, equation (12).

    The gradients are taken where the step before would lead, equation (20): a limb that is on its way has gone too far
    for gradients around the pose that it left. The first step goes from coarse images to fine ones instead. A direction
    that no pixel measures does not move. With prediction, parts that are out of sight move as predicted until they are
    seen again (section 5.4). The first frame is that of `start`.
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
    """An initial solution that ends at the key pose; parameters as in `relax`.

    As each of its steps begins with the one before it, it strays as a velocity does that wanders, pose by pose more.
    Of how far it is off in the end, s^2 (3 - s) / 2 is expected at a share s of the way: the mean of a random walk that
    is summed once more, given where it ends. The same share for each step, (28), would move the first poses, which are
    right.
    """
    s = np.linspace(0.0, 1.0, len(motion))[:, None]
    return motion.moved(s**2 * (3 - s) / 2 * np.where(fixed[-1], motion.difference(keyed)[-1], 0.0))


def predicted_step(motion: Motion, hidden: NDArray[np.bool_]) -> Array:
    """The step that follows a motion, as many ahead of the last one seen as each part has been hidden, shape (D,).

    Parameters
    ----------
    motion : Motion
        j poses of one performer.
    hidden : ndarray of bool, shape (j - 1, P)
        Which of the steps between them are predicted themselves: a part's model is learnt from its others.
    """
    x = Steps.of(motion).vectors()
    step = np.zeros(x.shape[1])
    for p in range(hidden.shape[1]):
        own = slice(3 + 3 * p if p else 0, 6 + 3 * p)
        runs = [x[a : b + 1, own] for a, b in intervals(~hidden[:, p])]
        models = [autoregression([run[:, d] for run in runs]) for d in range(own.stop - own.start)]
        seen = np.flatnonzero(~hidden[:, p]).max(initial=-1) + 1
        step[own] = predict(x[max(seen - PAST, 0) : seen, own], len(x) + 1 - seen, models)[0][-1]
    return step


def out_of_sight(pair: SegmentProblem, motions: Sequence[Motion]) -> list[NDArray[np.bool_]]:
    """Per performer: parts whose motion from one frame to the next no view shows, shape (P,).

    A view does not show a part that is occluded in its current pose or in the predicted one (section 5.3). But what a
    part carries shows how it moves: arms before the trunk do not make the body stand still.

    Parameters
    ----------
    pair : SegmentProblem
        The two frames.
    motions : sequence of Motion
        The current pose and the predicted one.
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
    """Two poses per performer, the second moved by the gradients on all parts but those that are gone."""
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
            here[i] = _advanced(here[i], -np.linalg.solve(A, blocks.gradient[1] + damped))
    return here


def _last_step(motion: Motion) -> Array:
    """The motion parameters to a motion's last pose, shape (D,); none before the first one."""
    return Steps.of(motion[-2:]).vectors()[0] if len(motion) > 1 else np.zeros(3 + 3 * motion.rotations.shape[1])


def _degrees(parts: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The degrees of freedom of parts, shape (D,): the root's place goes with its turn."""
    return np.concatenate([np.repeat(parts[:1], 3), np.repeat(parts, 3)])


def _advanced(poses: Motion, step: Array) -> Motion:
    """Two poses of which the second is moved by a step."""
    return poses.moved(np.stack([np.zeros_like(step), step]))


def rows_of_steps(problem: SegmentProblem, measured: MeasuredMotion, evidence: SegmentEvidence) -> list[StepEquations]:
    """The spatio-temporal terms of every performer around what was measured, summed over the views of all instants."""
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
    """The spatio-temporal terms of every performer as (23) has them: the rows of a pair of frames, for its own step."""
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
    """What a pixel of each view counts, shape (V, 1, 1, 1, 1); see the module's docstring."""
    return evidence.pixel_share(problem.settings.lengths[0])[:, None, None, None, None]


def shared_out(rows: Array, delay: float) -> Array:
    """Rows of the n steps between instants, shared out to the steps between frames by how long these overlap."""
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
    """Sweeps of equation (30) over one performer's frames.

    Parameters
    ----------
    motion : Motion
        F = n + 1 poses; the first one stays.
    keyed : Motion
        F poses that are right where `fixed` is true; the last one gives the terminal constraint.
    fixed : ndarray of bool, shape (F, D)
    rows : StepEquations
        The spatio-temporal terms around the motion.
    sweeps : int
    whole : bool
        The sweeps are those of the second half, with u = 1 and `LENGTH` for a unit.
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
    """Products Q_{j+1} ... Q_n of the frames after each, shape as Q (n, P, 3, 3)."""
    out = np.empty_like(Q)
    out[-1] = np.eye(3)
    for j in range(len(Q) - 1, 0, -1):
        out[j - 1] = Q[j] @ out[j]
    return out


def _held(motion: Motion, keyed: Motion, fixed: NDArray[np.bool_]) -> Motion:
    """The motion with the fixed degrees of freedom of key poses put in: they are met in the limit only."""
    return motion.moved(np.where(fixed, motion.difference(keyed), 0.0))
