"""Starts in which the whole body turns once more where the images show it, and when they do.

An even turn along the curve through the key poses fails if the body turns in part of the time between them only, or
travels otherwise than the curve: a cartwheel after which somebody stands still for as long is over before the even turn
is half done, and half a metre ahead of it. So the middle of the foreground first places the body on every frame. Then
the curve's poses are turned by multiples of 30 degrees about each of the pelvis's axes, and the path through these that
covers most, from no turn to a whole one, is the start.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ....body import Body, part_poses
from ....body.kinematics import tip_positions
from ....body.motion import Motion, with_motion
from ....evidence.foreground_images.foreground import SURE_LOG_RATIO, log_ratio
from ....evidence.rendering.part_geometry import Geometry
from ....evidence.view_frames import ViewFrames, views_with_foreground
from ....numerics import rotations
from ....numerics.arrays import Array
from ....numerics.likeliest_path import cheapest_path
from ..descent_stages import COARSE_STAGES
from ..equations.measurement import Workspace
from ..equations.problem import SegmentProblem
from ..limb_evidence.limb_images import shown_areas

STEPS = 12
"""Number of steps of a whole turn: limbs are found by a descent when turned by half of that, 15 degrees."""
LARGEST_STEP = 2
"""Most steps from one frame to the next, 60 degrees: at 20 frames a second more than three turns a second."""
RIVAL_SHARE = 0.5
"""Share of the difference between what the best solution covers and what the placed body covers without a turn. A turn
is worth solving if it gains more than this: before it is solved, nothing but the turn is right."""
_STRIDE = 4
_ITERATIONS = 4  # of the search for the body's place, which is exact but for the perspective
_NUDGE = 1e-3  # for derivatives of a projection, metres
_PULL = 1.0
"""How strongly the place stays where it is, pixels per metre: only where views do not show it does that count."""


def placed_turns(
    problem: SegmentProblem, start: Sequence[Motion], rival: float, workspace: Workspace
) -> list[list[Motion]]:
    """Return starts with a whole turn about one of the pelvis's three axes, in either direction, those that cover most
    first. Left out are those with which the placed body covers too little for them to cover more than a given solution
    once they are solved (`RIVAL_SHARE`).

    Parameters
    ----------
    problem : SegmentProblem
        A single performer in several views with foreground images, between two key poses of the whole body.
    start : sequence of Motion
        F poses per performer, the curve through the key poses.
    rival : float
        Cover of the solution that they must beat (`SegmentSolution.cover`).
    workspace : Workspace
    """
    [performer] = problem.sought
    curve = start[performer]
    middles = _middles(problem, performer, curve)
    sampling = COARSE_STAGES[-1].sampling_of(len(problem.views))

    def placed(steps: Array, axis: Array) -> Sequence[Motion]:
        motion = _placed(problem, performer, _turned(curve, steps, axis), middles, curve)
        return with_motion(start, performer, motion)

    def cover_of(k: int, axis: Array) -> Array:
        measured = workspace.measure(problem, placed(np.full(len(curve), k), axis), sampling)
        return np.asarray(measured.evidence.explained[:, performer].sum(axis=0))

    found, unturned = [], cover_of(0, np.eye(3)[0])
    least = unturned.sum() + RIVAL_SHARE * max(rival - unturned.sum(), 0.0)
    for axis in np.eye(3):
        covers = np.array([unturned, *(cover_of(k, axis) for k in range(1, STEPS))])
        for sign in (1, -1):
            steps, cover = _likeliest_steps(covers[sign * np.arange(STEPS + 1) % STEPS])
            if cover > least:
                found.append((cover, placed(sign * _smoothed(steps), axis)))
    return [list(motions) for _, motions in sorted(found, key=lambda one: -one[0])]


def _likeliest_steps(covers: Array) -> tuple[Array, float]:
    """Return the steps on all frames, (F,), from 0 to `STEPS` and never back, that cover most, and what they cover, by
    the cover of each number of steps, (STEPS + 1, F).
    """
    costs = -covers
    costs[1:, 0] = costs[:-1, -1] = np.inf
    onward = np.subtract.outer(np.arange(STEPS + 1), np.arange(STEPS + 1)).T
    change = np.where((onward >= 0) & (onward <= LARGEST_STEP), 0.0, np.inf)
    steps = cheapest_path(costs, lambda _: change)
    return steps.astype(float), -float(costs[steps, np.arange(len(steps))].sum())


def _smoothed(steps: Array) -> Array:
    """Return the means of steps over three frames, the first and the last as they are."""
    found = np.convolve(np.pad(steps, 1, mode="edge"), np.full(3, 1 / 3), "valid")
    found[[0, -1]] = steps[[0, -1]]
    return found


def _turned(motion: Motion, steps: Array, axis: Array) -> Motion:
    """Turn the root of a motion by a number of steps on each frame, (F,), about an axis of its own."""
    Q = motion.rotations.copy()
    Q[:, 0] = Q[:, 0] @ rotations.exp((2 * np.pi / STEPS * steps)[:, None] * axis)
    return Motion(motion.translations, Q)


def _placed(problem: SegmentProblem, performer: int, motion: Motion, middles: Array, curve: Motion) -> Motion:
    """Move a motion so that its body has certain middles, world, metres, (F, 3); what key poses fix is the curve's."""
    body, fixed = problem.bodies[performer], problem.fixed[performer]
    guess = Motion(motion.translations + middles - _middle_of(body, motion), motion.rotations)
    return guess.moved(np.where(fixed, guess.difference(curve), 0.0))


def _middles(problem: SegmentProblem, performer: int, curve: Motion) -> Array:
    """Return where the middle of a performer's body is by the foreground images, world, metres, (F, 3): where the rays
    through the middles of its foreground in all views meet, less how far that is from the body on the key poses.
    """
    body, views = problem.bodies[performer], views_with_foreground(problem.views)
    begin = _middle_of(body, curve)
    seen = [_image_middles(problem, view, performer) for view in views]
    found = np.array([_meeting(problem, views, begin[f], [own[f] for own in seen], f) for f in range(len(curve))])
    off = found - begin
    along = np.linspace(0, 1, len(curve))[:, None]
    return np.asarray(found - (1 - along) * off[0] - along * off[-1])


def _image_middles(problem: SegmentProblem, view: ViewFrames, performer: int) -> Array:
    """Return the mean pixel of a performer's foreground in a view, (F, 2); NaN where there is none."""
    ratio = log_ratio(view.foreground_at(problem.first, problem.length, _STRIDE)[performer])
    weight = np.clip(ratio / SURE_LOG_RATIO, 0, 1)
    total = weight.sum(axis=(1, 2))
    rows, columns = (np.arange(n) * _STRIDE for n in weight.shape[1:])
    sums = np.stack([weight.sum(axis=1) @ columns, weight.sum(axis=2) @ rows], axis=1)
    sums[(total == 0) | ~view.sound(problem.first, problem.length)[0]] = np.nan
    return np.asarray(sums / np.maximum(total, 1e-9)[:, None])


def _meeting(
    problem: SegmentProblem, views: Sequence[ViewFrames], begin: Array, pixels: Sequence[Array], frame: int
) -> Array:
    """Return the point (3,) that projects nearest to a pixel (2,) of each view on a frame; `begin` is a point near it.

    Pixels that are not known, NaN, do not count.
    """
    point = begin.copy()
    for _ in range(_ITERATIONS):
        H, b = _PULL**2 * np.eye(3), _PULL**2 * (begin - point)
        for view, pixel in zip(views, pixels, strict=True):
            around = view.camera.project(point + np.vstack([np.zeros(3), _NUDGE * np.eye(3)]), problem.first + frame)
            if np.isfinite(around).all() and np.isfinite(pixel).all():
                J = (around[1:] - around[0]).T / _NUDGE
                H, b = H + J.T @ J, b + J.T @ (pixel - around[0])
        point = point + np.linalg.solve(H, b)
    return point


def _middle_of(body: Body, motion: Motion) -> Array:
    """Return the middle of a body, the mean of its parts' by their areas, world, metres, (F, 3)."""
    poses, geometry = part_poses(body, motion), Geometry.of([body])
    areas = shown_areas(geometry, range(len(body)))
    return np.asarray(((poses[1] + tip_positions(body, poses)) / 2).swapaxes(1, 2) @ (areas / areas.sum()))
