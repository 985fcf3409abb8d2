"""Limbs mirrored in depth: with one camera, a bone that points toward it looks nearly like one that points away.

Keypoints show where a limb is in the picture, so it is not searched for (`limb_search`); but they leave open whether a
knee or an elbow lies in front of the line of sight or behind it. Perspective, what hides what, and the direction in
which brightness moves tell both apart once each is solved for.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from ....body import Body, part_poses
from ....body.kinematics import tip_positions
from ....body.limbs import limbs, without_end
from ....body.motion import Motion, with_motion
from ....numerics import rotations
from ....numerics.arrays import Array, Bools
from ..approach import approach
from ..assessment.solution_ranking import likelihood, noise_at
from ..descent_stages import SETTLED, SETTLING
from ..equations.measurement import Workspace, solution_at
from ..equations.problem import SegmentProblem, SegmentSolution
from ..equations.segment_equations import SegmentNoise
from ..gauss_newton import continued, descend

MIN_TIP_MOVE = 0.4
"""Smallest distance by which the tip of a long bone moves on some frame, metres. A descent reaches what is nearer."""
MIN_MIRROR_DISTANCE = 0.75
"""Limbs of which no mirror image is farther away than this are not mirrored, metres: a limb that reaches less far
toward the camera is mostly where it seems to be, and trying all of them takes half as long as everything else."""
MAX_LIMIT_EXCESS = 2.0
"""Largest excess of the mirrored joints over their limits, radians, which is cut off; a knee or an elbow that is bent
by more the wrong way is no other reading of the picture."""
MIRRORED_GAIN = 100.0
"""Smallest gain in log likelihood, in natural units, for which a limb is mirrored: kicking legs that were on the wrong
side gained 146 to 196, mirror images of limbs that were not (or that were lost altogether) up to 66."""
ONSET_TIME = 0.1
"""Time from a frame on which a key pose fixes the limb within which it turns to its mirror image, seconds."""


def with_limbs_mirrored(problem: SegmentProblem, solution: SegmentSolution, workspace: Workspace) -> SegmentSolution:
    """Mirror limbs in depth where that makes the images likelier; only with a single view, which stands still.

    Of all mirror images of a performer's limbs, the one that is likeliest after a few steps is solved. It is taken if
    it is likelier than the solution by `MIRRORED_GAIN`; this is then repeated from there, at most once for every limb.

    Parameters
    ----------
    problem : SegmentProblem
    solution : SegmentSolution
    workspace : Workspace
    """
    if problem.shows_depth or not problem.views[0].camera.stands_still:
        return solution
    for i in problem.sought:
        solution = _with_own_mirrored(problem, i, solution, workspace)
    return solution


def _with_own_mirrored(
    problem: SegmentProblem, performer: int, before: SegmentSolution, workspace: Workspace
) -> SegmentSolution:
    ways = list(mirror_images(problem, performer, before.motions[performer]))
    if not ways:
        return before
    alone = problem.alone(performer)
    noise = noise_at(alone, replace(before, only=alone.only), workspace)
    first = best = descend(alone, before.motions, workspace.silent(), SETTLED, noise)
    for _ in limbs(problem.bodies[performer]):
        near = [_nearly_solved(alone, performer, best, way, noise=noise, workspace=workspace) for way in ways]
        begin = max(near, key=lambda one: likelihood(alone, noise, one), default=best)
        found = descend(alone, begin.motions, workspace.silent(), SETTLED, noise)
        if likelihood(alone, noise, found) < likelihood(alone, noise, best) + MIRRORED_GAIN:
            break
        best = found
        ways = list(mirror_images(problem, performer, best.motions[performer]))
    return before if best is first else replace(continued(before, best), only=problem.only)


def _nearly_solved(
    problem: SegmentProblem,
    performer: int,
    before: SegmentSolution,
    motion: Motion,
    *,
    noise: SegmentNoise,
    workspace: Workspace,
) -> SegmentSolution:
    """Return the result of the first steps from another motion of a performer: enough to tell the likeliest of many."""
    begin = with_motion(before.motions, performer, motion)
    motions = approach(problem, begin, workspace.silent(), SETTLING).motions
    sampling = SETTLED[0].sampling_of(len(problem.views))
    return solution_at(problem, motions, sampling, workspace, noise.sigma)


def mirror_images(problem: SegmentProblem, performer: int, motion: Motion) -> Iterator[Motion]:
    """Generate the motions with one limb of a performer mirrored, one, the other or both of its long bones.

    Left out are those that hardly differ (`MIN_TIP_MOVE`) or bend a joint far beyond its limits (`MAX_LIMIT_EXCESS`),
    and limbs that reach neither far toward the camera nor far away from it (`MIN_MIRROR_DISTANCE`).

    Parameters
    ----------
    problem : SegmentProblem
        With a single view.
    performer : int
    motion : Motion
        F poses; fixed degrees of freedom are kept.
    """
    body, held = problem.bodies[performer], problem.fixed_axes(performer).any(axis=2)
    eye = problem.views[0].camera.centres_world(problem.first, len(motion))
    for chain in limbs(body):
        keyed = held[:, chain].any(axis=1)
        images = list(_images_of_limb(body, motion, chain, eye=eye, keyed=keyed, share=_share(keyed, problem.fps)))
        if max((moved for moved, _ in images), default=0.0) >= MIN_MIRROR_DISTANCE:
            yield from (other for _, other in images)


def _images_of_limb(
    body: Body, motion: Motion, chain: Sequence[int], *, eye: Array, keyed: Bools, share: Array
) -> Iterator[tuple[float, Motion]]:
    """Generate the mirror images of a limb that differ enough and that its joints allow, and how far each moves it."""
    long, tips = without_end(chain), tip_positions(body, part_poses(body, motion))
    for bones in _some_of(long):
        image = mirrored(body, motion, (chain, bones), eye, share)
        other, beyond = _within_limits(body, motion, chain, image, keyed)
        moved = np.linalg.norm(tip_positions(body, part_poses(body, other)) - tips, axis=-1)[:, long].max()
        if moved >= MIN_TIP_MOVE and beyond <= MAX_LIMIT_EXCESS:
            yield float(moved), other


def _within_limits(
    body: Body, motion: Motion, chain: Sequence[int], image: Motion, keyed: Bools
) -> tuple[Motion, float]:
    """Cut off what joints of a mirrored limb are beyond their limits, or beyond how far they were bent before.

    Returns the motion, with the limb as it was on the frames that are `keyed` (F,), and the largest excess, radians.
    """
    before, turns = (rotations.log(one.rotations[:, chain]) for one in (motion, image))
    low = np.minimum(body.limits[chain, :, 0], before.min(axis=0))
    high = np.maximum(body.limits[chain, :, 1], before.max(axis=0))
    kept = np.where(keyed[:, None, None], before, np.clip(turns, low, high))
    Q = image.rotations.copy()
    Q[:, chain] = np.where(keyed[:, None, None, None], motion.rotations[:, chain], rotations.exp(kept))
    return Motion(image.translations, Q), float(np.abs(turns - kept).max())


def _some_of(bones: Sequence[int]) -> Iterator[tuple[int, ...]]:
    """Generate all choices of at least one of the bones."""
    for count in range(1, 1 + len(bones)):
        yield from combinations(bones, count)


def _share(held: Bools, fps: float) -> Array:
    """By how much a limb is mirrored on each frame, (F,): 0 where it is held, 1 from `ONSET_TIME` on."""
    frames, known = np.arange(len(held)), np.flatnonzero(held)
    away = np.abs(frames[:, None] - known).min(axis=1, initial=len(held))
    return np.asarray(np.minimum(away / max(ONSET_TIME * fps, 1.0), 1.0))


def mirrored(body: Body, motion: Motion, limb: tuple[Sequence[int], Sequence[int]], eye: Array, share: Array) -> Motion:
    """Mirror bones of a limb at the planes through their beginnings that are perpendicular to the line of sight.

    The other long bones of the limb keep their directions; its end keeps its rotation relative to the last of them.

    Parameters
    ----------
    body : Body
    motion : Motion
        F poses.
    limb : tuple
        The limb as a chain of parts, and those of them that are mirrored.
    eye : ndarray, shape (F, 3)
        The camera's centre, world, metres.
    share : ndarray, shape (F,)
        Share of the turn, 0 to 1.
    """
    (chain, bones), (R, T) = limb, part_poses(body, motion)
    tips, world, Q = tip_positions(body, (R, T)), R.copy(), motion.rotations.copy()
    long = set(without_end(chain))
    turn = np.broadcast_to(np.eye(3), R[:, 0].shape)
    for part in chain:
        if part in bones:
            turn = _turn_to_mirror_image(tips[:, part] - T[:, part], 0.5 * (tips[:, part] + T[:, part]) - eye, share)
        elif part in long:
            turn = np.broadcast_to(np.eye(3), turn.shape)
        world[:, part] = turn @ R[:, part]
        parent = world[:, body.parents[part]] @ body.R_parent_rest[part]
        Q[:, part] = np.swapaxes(parent, -1, -2) @ world[:, part]
    return Motion(motion.translations, Q)


def _turn_to_mirror_image(bone: Array, sight: Array, share: Array) -> Array:
    """Rotation matrices (F, 3, 3) that turn bones (F, 3) by a share (F,) of the shortest way to their mirror images at
    the planes perpendicular to lines of sight (F, 3).
    """
    bone, sight = (a / np.maximum(np.linalg.norm(a, axis=1, keepdims=True), 1e-9) for a in (bone, sight))
    depth = np.sum(bone * sight, axis=1)
    axis = np.cross(sight, bone)
    axis /= np.maximum(np.linalg.norm(axis, axis=1, keepdims=True), 1e-9)
    return np.asarray(rotations.exp((2 * np.arcsin(np.clip(depth, -1, 1)) * share)[:, None] * axis))
