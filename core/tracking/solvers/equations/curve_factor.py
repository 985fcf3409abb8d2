"""A prior on stiff parts, the trunk and the collar bones: they stay near the curve through their key poses.

Images hardly show how a bend is shared between these parts, as their outlines run along the body and clothes move over
them, and all of them may go astray together.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ....body import Body
from ....body.joint_limits import habitual_prior
from ....body.motion import Motion
from ....body.shoulder_rhythm import RISE, ShoulderRhythm, shoulder_rhythms
from ....numerics import rotations
from ....numerics.arrays import Array
from ....numerics.banded_blocks import BandedBlocks
from ....numerics.resampling import places_between
from ....numerics.robust_kernels import GemanMcClure
from .problem import SegmentProblem

FRAME_SIGMA_RATIO = 1 / 3
"""Usual departure from the curve on a frame, relative to the part's usual departure from its rest orientation."""
RISE_SIGMA_RATIO = 1 / 8
"""The same for the rise of a collar bone, of which that with its arm is known."""
RISE_KERNEL = GemanMcClure(2.0)
"""Kernel of that rise: collar bones also rise and sink for other reasons, and the rhythm then says little."""


def with_curves(
    problem: SegmentProblem, systems: list[BandedBlocks], motions: tuple[Motion, ...]
) -> list[BandedBlocks]:
    """Add the prior on stiff parts (`Body.is_stiff`) to the normal equations of the performers that are solved for, in
    their arrays.

    Parameters
    ----------
    problem : SegmentProblem
    systems : list of BandedBlocks
        One per performer.
    motions : tuple of Motion
        F poses per performer; where parts are fixed, these are key poses.
    """
    found = list(systems)
    for i in problem.sought:
        if problem.bodies[i].is_stiff.any():
            found[i] = systems[i].add(near_curve(problem, i, motions[i]))
    return found


def near_curve(problem: SegmentProblem, performer: int, motion: Motion) -> BandedBlocks:
    """Build the normal equations of the departures of one performer's stiff parts from the curve.

    The curve turns at a constant rate from one key pose to the next (slerp). Before the first key pose and after the
    last one it stays there; without any key pose it is the rest orientation. Collar bones also rise with their arms,
    see `_with_arm`, but not with a single view, which hardly shows how high an arm is that points towards it.
    """
    body, F = problem.bodies[performer], len(motion)
    fixed = problem.fixed_axes(performer).all(axis=2)
    curve: Array = np.tile(np.eye(3), (F, len(body), 1, 1))
    precision = np.zeros((F, len(body)))
    for part in np.flatnonzero(body.is_stiff):
        keys = np.flatnonzero(fixed[:, part])
        if len(keys):
            curve[:, part] = _between(motion.rotations[keys, part], problem.times[keys], problem.times)
        precision[:, part] = 1 / (FRAME_SIGMA_RATIO * body.departures[part]) ** 2
    coupled = []
    for shoulder in shoulder_rhythms(body) if problem.shows_depth else ():
        keys = np.flatnonzero(fixed[:, shoulder.collar])
        if len(keys) and fixed[keys, shoulder.arm].all():
            precision[:, shoulder.collar] = 0
            coupled.append((shoulder, keys))
    blocks = habitual_prior(motion, precision, curve)
    for shoulder, keys in coupled:
        J, residual, columns = _with_arm(body, motion, shoulder, curve[:, shoulder.collar], (problem.times, keys))
        weight, cost = np.ones_like(residual), residual**2
        weight[:, 3], cost[:, 3] = RISE_KERNEL.weight(residual[:, 3] ** 2), RISE_KERNEL.cost(residual[:, 3] ** 2)
        weighted = weight[:, :, None] * J
        blocks.diagonal[:, columns[:, None], columns] += np.swapaxes(J, 1, 2) @ weighted
        blocks.gradient[:, columns] += np.einsum("fri,fr->fi", weighted, residual)
        blocks = replace(blocks, energy=blocks.energy + float(cost.sum()))
    return blocks


def _between(known: Array, keys: Array, times: Array) -> Array:
    """Rotations at all times (F,), (F, 3, 3), from those at the times of K key frames, (K, 3, 3)."""
    if len(keys) == 1:
        return np.broadcast_to(known, (len(times), 3, 3))
    last, share = places_between(keys, times)
    turns = rotations.log(np.swapaxes(known[:-1], -1, -2) @ known[1:])
    return np.asarray(known[last] @ rotations.exp(np.clip(share, 0, 1)[:, None] * turns[last]))


def _with_arm(
    body: Body, motion: Motion, shoulder: ShoulderRhythm, curve: Array, when: tuple[Array, NDArray[np.intp]]
) -> tuple[Array, Array, NDArray[np.intp]]:
    """Return the residuals of a collar bone that rises with its arm, and their derivatives.

    What the rhythm does not explain follows the curve: the collar bone's turn from the curve is expected to be that of
    the rhythm for the arm's rise above its own curve, which is linear between the key frames; `when` are the times of
    all frames and the indices of these.

    Returns
    -------
    J : ndarray, shape (F, 4, 6)
        Derivatives of the residuals.
    residual : ndarray, shape (F, 4)
        Three of the collar bone's turn, in usual departures, and one of its rise alone, for `RISE_KERNEL`.
    columns : ndarray of int, shape (6,)
        The degrees of freedom, increments of the collar bone's and the upper arm's rotation.
    """
    rise, (times, keys) = shoulder.rise(body, motion), when
    beyond = rise.values - np.interp(times, times[keys], rise.values[keys])
    turns = rotations.log(np.swapaxes(curve, -1, -2) @ motion.rotations[:, shoulder.collar])
    axis = np.swapaxes(curve, -1, -2) @ shoulder.raising  # in the frame of the curve, (F, 3)
    by_rise = -RISE * axis[:, :, None]
    by_collar = rotations.right_jacobian_inverse(turns) + by_rise * rise.by_collar[:, None]
    J = np.concatenate([by_collar, by_rise * rise.by_arm[:, None]], axis=2)
    rows = np.concatenate([J, (turns - RISE * beyond[:, None] * axis)[:, :, None]], axis=2)
    more = np.sqrt(RISE_SIGMA_RATIO**-2 - FRAME_SIGMA_RATIO**-2) * axis[:, None] @ rows
    rows = np.concatenate([rows / FRAME_SIGMA_RATIO, more], axis=1) / body.departures[shoulder.collar]
    columns = np.concatenate([3 + 3 * part + np.arange(3) for part in (shoulder.collar, shoulder.arm)])
    return rows[..., :-1], rows[..., -1], columns
