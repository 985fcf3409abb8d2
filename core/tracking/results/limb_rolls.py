"""How the parts of limbs are rolled about their length: as elbows and knees bend, and between key poses as these say.

Images show where the parts of a limb point, but hardly how they are rolled: their outlines stay the same, and shading
and clothes do not roll with them. Elbows and knees are hinges, so wherever they are bent, the directions of both parts
tell how the upper one is rolled. How far the lower one is twisted on it is limited, most of all in a knee. Rolling a
part about the line through its joints moves no joint; hands and feet stay as they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded

from ...body import Body
from ...body.motion import Motion
from ...numerics import rotations
from ...numerics.arrays import Array, Bools
from ...shot.acceleration_prior import USUAL_JOINT
from ...shot.shot import KeyPoses

MAX_SIDE_RANGE, MIN_BEND_RANGE = 0.5, 1.5
"""A joint is a hinge if its range about the axis that tips its part out of the plane in which it bends is at most the
first, and its range about the axis of the hinge at least the second, radians."""
MAX_BACKWARD = 0.5
"""By how much a hinge bends backward at most, radians: a neck or a tail that bends both ways is none."""
MAX_REST_ANGLE = 0.5
"""Angle of both parts' lines to the lower part's y axis, at rest, up to which that axis tells where it points and about
what it is twisted, radians. Bones of other programs may point elsewhere."""
MAX_BESIDE_LINE = 0.005
"""By how much joints of other parts may lie beside the line about which a part is rolled, metres: they move by it."""
DIRECTION_SIGMA = 0.1
"""Usual error of the direction in which a tracked part points against the plane in which its joint bends, radians."""
ROLL_SIGMA = 0.5
"""Usual error of the roll that images show, radians."""
BODY_PLANE_SHARE = 0.2
"""Weight of the plane in which the body's joint bends, as the sine of a bend of a key pose: nearly straight limbs do
not show in which plane they bend."""
LIMITS_IN_SIGMAS = 4.0
"""Range of a twist between its limits, in standard deviations from the key poses' twist."""
MIN_TWIST_SIGMA = 0.01
"""The least of these standard deviations, of joints whose twist is locked, radians."""
_ALONG = np.array([0.0, 1.0, 0.0])


@dataclass(frozen=True)
class Hinge:
    """An elbow or a knee.

    Attributes
    ----------
    upper, lower : int
        The parts that it joins.
    way : float
        1 if positive turns about the hinge's axis, the lower part's x axis, bend it, otherwise -1.
    beyond : tuple of int
        The parts that hang on the lower one, the farthest joint first.
    """

    upper: int
    lower: int
    way: float
    beyond: tuple[int, ...]


@dataclass(frozen=True)
class RollTarget:
    """By how much a part should be rolled.

    Attributes
    ----------
    angles, weight : ndarray, shape (F,)
        Angles on all frames, radians, and their inverse variances.
    held : ndarray of int
        Frames on which the part stays as it is.
    fps : float
    """

    angles: Array
    weight: Array
    held: NDArray[np.int64]
    fps: float

    def smooth(self, sudden: Array) -> Array:
        """Return the angles (F,) with which the part rolls smoothly: 0 on frames that are held, near 0 where weights
        are small.

        Points on the unit circle are smoothed, as angles may wrap. Frames before and after a held one do not affect
        each other. There angles are level, as if they were mirrored beyond it: the part rolls on as it did.

        Parameters
        ----------
        sudden : ndarray, shape (F - 2,)
            How much faster the part rolls after each inner frame than before it, radians per frame.
        """
        F, stiffness = len(self.angles), (self.fps**2 / USUAL_JOINT) ** 2
        bands = np.zeros((3, F), complex)  # of the normal matrix: its diagonal, and those below it
        bands[0] = self.weight + ROLL_SIGMA**-2
        free = np.setdiff1d(np.arange(1, F - 1), self.held)
        aside = np.exp(0.5j * sudden[free - 1])
        bends = np.stack([aside, np.full(len(free), -2.0), aside])  # second differences of the part's roll
        for k in range(3):
            for m in range(3 - k):
                bands[k, free - 1 + m] += stiffness * bends[m + k].conj() * bends[m]
        aim = self.weight * np.exp(1j * self.angles) + ROLL_SIGMA**-2
        beside = np.intersect1d([self.held - 1, self.held + 1], np.arange(F))
        bands[0, beside] += 4.0 * stiffness  # a mirrored angle's second difference is twice the angle
        aim[beside] += 4.0 * stiffness
        hold = 1e9 * bands[0].real.max()
        bands[0, self.held] += hold
        aim[self.held] += hold
        smooth = np.angle(solveh_banded(bands, aim, lower=True))
        smooth[self.held] = 0.0
        return np.asarray(smooth)


def hinges(body: Body) -> list[Hinge]:
    """Return the hinges of a body by the limits of its joints: they bend one way about the x axis, hardly about the z
    axis. Left out are those whose parts cannot be rolled: another joint would move, or twist though it is locked.
    """
    found = []
    locked = body.limits[:, 1, 0] == body.limits[:, 1, 1]
    for lower, upper in enumerate(body.parents):
        low, high = body.limits[lower, 0]
        bend, _, side = np.ptp(body.limits[lower], axis=1)
        if upper <= 0 or side > MAX_SIDE_RANGE or bend < MIN_BEND_RANGE or min(-low, high) > MAX_BACKWARD:
            continue
        beside, beyond = (_hanging_on(body, part) for part in (upper, lower))
        if locked[[upper, *beyond]].any():
            continue
        along = _can_be_rolled(body, lower, beside, body.R_parent_rest[lower, :, 1])
        if along and (not beyond or _can_be_rolled(body, beyond[0], beyond, _ALONG)):
            found.append(Hinge(upper, lower, float(np.sign(low + high)), beyond))
    return found


def _hanging_on(body: Body, part: int) -> tuple[int, ...]:
    """Return the parts that hang on a part, the one whose joint is farthest from its own first."""
    children = [child for child, parent in enumerate(body.parents) if parent == part]
    return tuple(sorted(children, key=lambda child: -float(np.linalg.norm(body.offsets[child]))))


def _can_be_rolled(body: Body, end: int, children: Sequence[int], axis: Array) -> bool:
    """Whether a part can be rolled about the line to the joint of the part `end` that hangs on it, as no other of its
    children's joints is beside the line, and it is near an axis, a unit vector (3,), of the part's frame.
    """
    length = float(np.linalg.norm(body.offsets[end]))
    if not length:
        return False
    line = body.offsets[end] / length
    beside = np.linalg.norm(np.cross(body.offsets[list(children)], line), axis=1)
    return bool(line @ axis >= np.cos(MAX_REST_ANGLE) and beside.max() <= MAX_BESIDE_LINE)


def with_likely_rolls(
    body: Body,
    motion: Motion,
    keys: KeyPoses,
    fps: float,
    *,
    tied: Bools | None = None,
    ends: Sequence[int] = (),
) -> Motion:
    """Return a tracked motion whose limbs are rolled as their elbows and knees bend, and are twisted little between key
    poses.

    Poses on key frames stay as they are, and between them joints bend in the same plane. Limbs roll as smoothly as
    joints usually turn, also through key poses, and where a limb is straight, so that its hinge says nothing.

    Parameters
    ----------
    body : Body
    motion : Motion
        F poses; key frames have the key poses.
    keys : KeyPoses
    fps : float
    tied : ndarray of bool, shape (F, P), optional
        Parts that must not be rolled though no key pose holds them, such as one to which a prop is tied.
    ends : sequence of int
        Frames that join a motion that stays as it is: they stay as well, as on key frames.
    """
    fixed, touched = keys.fixed_axes.all(axis=2), keys.fixed_axes.any(axis=2)
    joined = np.array(ends, np.int64)
    for hinge in hinges(body):
        parts = [hinge.upper, hinge.lower, *hinge.beyond]
        known = np.union1d(keys.frames[fixed[:, hinge.upper] & fixed[:, hinge.lower]], joined)
        held = np.union1d(keys.frames[touched[:, parts].any(axis=1)], joined)
        if tied is not None:
            held = np.union1d(held, np.flatnonzero(tied[:, [hinge.upper, hinge.lower]].any(axis=1)))
        planes = _to_plane(motion.rotations[:, hinge.lower], hinge.way, known)
        motion = _rolled(body, motion, hinge.upper, (hinge.lower,), RollTarget(*planes, held, fps))
        twists = _to_twist(motion.rotations[:, hinge.lower], np.ptp(body.limits[hinge.lower, 1]), known)
        motion = _rolled(body, motion, hinge.lower, hinge.beyond, RollTarget(*twists, held, fps))
    return motion


def _rolled(body: Body, motion: Motion, part: int, beyond: tuple[int, ...], target: RollTarget) -> Motion:
    """Return the motion with a part rolled smoothly to a target, about the line to the first of the parts that hang
    on it, which stay as they are.
    """
    axis = body.offsets[beyond[0]] if beyond else _ALONG
    axis = axis / np.linalg.norm(axis)
    Q = motion.rotations.copy()
    rates = rotations.log(np.swapaxes(Q[:-1, part], -1, -2) @ Q[1:, part]) @ axis
    turns = target.smooth(np.diff(rates))[:, None] * axis
    Q[:, part] = Q[:, part] @ rotations.exp(turns)
    for child in beyond:
        Q[:, child] = rotations.exp(-turns @ body.R_parent_rest[child]) @ Q[:, child]
    return Motion(motion.translations, Q)


def _to_plane(Q: Array, way: float, keys: NDArray[np.int64]) -> tuple[Array, Array]:
    """Angles (F,) by which a part should be rolled for the joint at its end, whose rotations are Q (F, 3, 3), to bend
    in the plane in which it should, radians, and their inverse variances, (F,).

    Between key poses the plane turns with the line between their bends.
    """
    bends = way * Q[:, [0, 2], 1]  # how far the lower part points to the side and forward, (F, 2)
    # A joint that a key pose overstretches still bends forward beside it.
    plane = _between(np.maximum(bends, [-np.inf, -0.5 * BODY_PLANE_SHARE]), keys) + [0.0, BODY_PLANE_SHARE]
    found, wanted = (np.arctan2(side, forward) for side, forward in (bends.T, plane.T))
    return found - wanted, (bends**2).sum(axis=1) / DIRECTION_SIGMA**2


def _to_twist(Q: Array, limits: float, keys: NDArray[np.int64]) -> tuple[Array, Array]:
    """Angles (F,) by which a part with the rotations Q (F, 3, 3) should be rolled to be twisted as key poses say,
    radians, and their inverse variances, (F,), for a joint that can twist by `limits` in all, radians.
    """
    relative = np.swapaxes(rotations.shortest(_ALONG, Q[:, :, 1]), -1, -2) @ Q
    twist = np.unwrap(np.arctan2(relative[:, 0, 2], relative[:, 0, 0]))
    usual = max(float(limits) / LIMITS_IN_SIGMAS, MIN_TWIST_SIGMA)
    return _between(twist, keys) - twist, np.full(len(Q), usual**-2)


def _between(values: Array, keys: NDArray[np.int64]) -> Array:
    """Values (F, ...) on key frames, interpolated linearly between them; 0 without any."""
    if not len(keys):
        return np.zeros_like(values)
    columns = values.reshape(len(values), -1)
    found = np.stack([np.interp(np.arange(len(values)), keys, column[keys]) for column in columns.T], axis=1)
    return found.reshape(values.shape)
