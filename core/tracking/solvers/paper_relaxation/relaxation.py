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
to 1, rotations are in radians, lengths in metres in the first sweeps and in units of `LENGTH_UNIT` in the others.

With u = 1/n of equation (27) the sweeps converge to the minimum of (21) for lambda / n and nu / n, but slowly (section
4.3), as lambda and nu hold each step near its former value. The first sweeps do so, while the key pose is far away. The
others use u = 1 with lambda / n and nu / n, which has the same fixed point; each step is then the minimum of the energy
for its frame, and no sweep raises the energy. The axis vector (A.2) is the sine of the rotation angle, so the terminal
constraint is only met in the limit of small angles: finally the last pose is set to the key pose.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ....body.motion import Motion
from ....evidence.sampling import Sampling
from ....numerics import rotations
from ....numerics.arrays import Array
from ....numerics.repeatable import on_grid
from ....runtime.timing import Seconds
from ....shot.acceleration_prior import USUAL_JOINT, USUAL_ROOT
from ..equations.measurement import Workspace, hidden_parts
from ..equations.problem import SegmentProblem, SegmentSolution
from .gradient_following import PIXEL_STRIDE, follow_gradients, without_drift
from .motion_steps import StepEquations, Steps
from .step_rows import printed_rows, rows_of_steps

LAMBDA = 10.0
"""Weight of the rotations' terminal constraint."""
NU = 20.0
"""Weight of the root's terminal constraint."""
SMOOTHNESS = 1.0
"""Weight of the smoothness of every motion parameter."""
PRINTED_SHARE = 0.5
"""Share of the sweeps, the first ones, that solve equation (23) as printed, with lengths in metres."""
LENGTH_UNIT = USUAL_ROOT / USUAL_JOINT
"""Unit of length in the other sweeps, metres. The paper weighs the smoothness of translations and rotations equally,
which is right in the unit in which the root's usual acceleration equals that of a joint in radians."""
SWEEPS_PER_LINEARISATION = 10
"""Sweeps between two measurements of the gradients around the present motion."""
SWEEP_SAMPLING = Sampling(1.0, 1.0, PIXEL_STRIDE)
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
    for sweep in range(0, settings.sweeps, SWEEPS_PER_LINEARISATION):
        if sweep:
            workspace.report(0.2 + 0.8 * sweep / settings.sweeps, motions)
        measured = workspace.measure(problem, motions, SWEEP_SAMPLING)
        evidence = measured.evidence
        seconds.add(evidence.seconds)
        energies.append(float(evidence.gradients.energy.sum()))
        if settings.prediction:
            evidence = evidence.without(np.concatenate(hidden_parts(problem, evidence.share), axis=1))
        count = min(SWEEPS_PER_LINEARISATION, settings.sweeps - sweep)
        with seconds.measure("solve"):
            whole = sweep >= PRINTED_SHARE * settings.sweeps
            rows = (rows_of_steps if whole else printed_rows)(problem, measured, evidence)
            motions = [
                _rounded(motion, relax(motion, keyed, fixed, own, count, whole=whole))
                for motion, keyed, fixed, own in zip(motions, start, problem.fixed, rows, strict=True)
            ]
    held = tuple(_held(m, s, fixed) for m, s, fixed in zip(motions, start, problem.fixed, strict=True))
    evidence = workspace.measure(problem, held, SWEEP_SAMPLING).evidence
    seconds.add(evidence.seconds)
    energies.append(float(evidence.gradients.energy.sum()))
    return SegmentSolution.of(held, evidence, iterations=settings.sweeps, energy=energies, seconds=seconds)


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
        Use u = 1 and the unit `LENGTH_UNIT`, as in the second half of the sweeps.
    """
    n, D = rows.steps.shape
    u, smooth, terminal = weights_of_steps(n, D, whole=whole)
    weight = fixed[-1] * terminal
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


def weights_of_steps(n: int, D: int, *, whole: bool) -> tuple[float, Array, Array]:
    """Return u of equation (27), and the weights of the smoothness and of the terminal terms of each of the D motion
    parameters in a sweep over n steps; `whole` as in `relax`.
    """
    u, length = (1.0, LENGTH_UNIT) if whole else (1.0 / n, 1.0)
    units = np.concatenate([np.full(3, length), np.ones(D - 3)])
    terminal = np.concatenate([np.full(3, NU), np.full(D - 3, LAMBDA)])
    return u, SMOOTHNESS / units**2, terminal / (units**2 * n * u)


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
