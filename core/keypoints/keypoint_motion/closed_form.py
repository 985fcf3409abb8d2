"""Poses of the default body from points, in closed form, as the start of a fit.

Every part points from one of its joints to the next, and the plane in which a limb bends gives its twist. The pose is
exact only if the points are as far apart as the joints of the body.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy  # its parts are loaded when they are used

from ...body import Body, landmark_positions, part_poses
from ...body.motion import Motion
from ...numerics import rotations
from ...numerics.arrays import Array
from ...numerics.resampling import gaps_filled


@dataclass(frozen=True)
class LimbChain:
    """A limb of two parts with a hinge between them, on either side of the body.

    Attributes
    ----------
    upper, lower : str
        The parts, without their side.
    joints : tuple of str
        Landmarks where the upper part begins, at the hinge, and where the lower part ends, without their side.
    sign : float
        Sign of the rotation about the x axis that bends the limb: elbows and knees bend in opposite directions.
    farthest : float
        Cosine of the farthest twist that is possible: points that show more are taken to be wrong.
    """

    upper: str
    lower: str
    joints: tuple[str, str, str]
    sign: float
    farthest: float

    def parts(self, body: Body, side: str) -> tuple[int, int]:
        """Return the indices of both parts on a side ("L" or "R")."""
        return body.index(f"{self.upper}.{side}"), body.index(f"{self.lower}.{side}")


TRUNK_LANDMARKS = ("LHip", "RHip", "LShoulder", "RShoulder")
LIMB_CHAINS = (
    LimbChain("upper_arm", "forearm", ("Shoulder", "Elbow", "Wrist"), sign=1.0, farthest=-0.3),
    LimbChain("thigh", "shin", ("Hip", "Knee", "Ankle"), sign=-1.0, farthest=0.3),
)
POSED_PARTS = frozenset(
    {"pelvis", "spine", "chest"}
    | {f"{part}.{side}" for limb in LIMB_CHAINS for part in (limb.upper, limb.lower) for side in "LR"}
)
"""Parts that a body needs to be posed in closed form; the default body has them."""
STRAIGHT_SINES = (0.1, 0.3)
"""Below the first sine of its bend a limb counts as straight; above the second, its bend alone gives its twist."""
TWIST_TIME = 0.07
"""Time over which the hinge axis of a limb is averaged, seconds. Frames are weighted by how far the limb is bent."""
NO_TWIST_WEIGHT = 0.02
"""Squared sine of a bend at which the bend and the prior (no twist) have equal weight in the limb's twist."""


def closed_form_pose(body: Body, names: Sequence[str], points_world: Array, fps: float | None = None) -> Motion | None:
    """Return the poses of the default body on points.

    Parameters
    ----------
    body : Body
    names : sequence of str, length L
    points_world : ndarray, shape (F, L, 3)
        NaN where not known.
    fps : float, optional
        Frame rate, if the frames follow one another: a straight limb then has the twist of the frames around, on which
        it is bent.

    Returns
    -------
    Motion or None
        None if the body lacks one of `POSED_PARTS`, or if too few points of the trunk are ever known.
    """
    known = {name: gaps_filled(points_world[:, i]) for i, name in enumerate(names)}
    known = {name: points for name, points in known.items() if np.isfinite(points).all()}
    if not set(body.names) >= POSED_PARTS:
        return None
    known = _with_trunk(body, known)
    if not set(TRUNK_LANDMARKS) <= set(known):
        return None
    R = _orientations(body, known, fps)
    Q = np.empty_like(R)
    for i, parent in enumerate(body.parents):
        rest = body.R_parent_rest[i] if parent < 0 else R[:, parent] @ body.R_parent_rest[i]
        Q[:, i] = np.swapaxes(np.broadcast_to(rest, R[:, i].shape), -1, -2) @ R[:, i]
    middle = np.mean([body.landmarks[side + "Hip"][1] + _joint(body, side + "Hip") for side in "LR"], axis=0)
    return Motion(_middle(known, "Hip") - R[:, 0] @ middle, rotations.orthonormal(Q))


def _middle(known: Mapping[str, Array], joint: str) -> Array:
    """Middle of a left and a right joint, shape (F, 3)."""
    return np.asarray(0.5 * (known["L" + joint] + known["R" + joint]))


def _trunk_orientations(body: Body, known: Mapping[str, Array]) -> dict[int, Array]:
    """World rotations (F, 3, 3) of pelvis, spine and chest, by part; the spine turns half as far as the chest."""
    up = _middle(known, "Shoulder") - _middle(known, "Hip")
    pelvis = along_and_across(up, known["LHip"] - known["RHip"])
    chest = along_and_across(up, known["LShoulder"] - known["RShoulder"])
    spine = pelvis @ rotations.exp(0.5 * rotations.log(np.swapaxes(pelvis, -1, -2) @ chest))
    return {body.index("pelvis"): pelvis, body.index("spine"): spine, body.index("chest"): chest}


def _orientations(body: Body, known: Mapping[str, Array], fps: float | None) -> Array:
    """World rotations of all parts, shape (F, P, 3, 3), from the known points (F, 3) by name, parents first."""
    world = _trunk_orientations(body, known)
    R = np.empty((len(known["LHip"]), len(body), 3, 3))
    for i, (name, parent) in enumerate(zip(body.names, body.parents, strict=True)):
        rest = body.R_parent_rest[i] if parent < 0 else R[:, parent] @ body.R_parent_rest[i]
        R[:, i] = world.get(i, rest)
        part, _, side = name.partition(".")
        for limb in LIMB_CHAINS:
            if part != limb.upper or side not in ("L", "R"):
                continue
            a, b, c = (known.get(side + joint) for joint in limb.joints)
            if a is not None and b is not None and c is not None:
                _, lower = limb.parts(body, side)
                R[:, i], world[lower] = limb_orientations(R[:, i], b - a, c - b, limb, fps)
            elif a is not None and b is not None:
                R[:, i] = _swung(R[:, i], b - a)
        toe, ankle = (known.get(side[:1] + joint) for joint in ("BigToe", "Ankle"))
        if part == "foot" and toe is not None and ankle is not None:
            R[:, i] = along_and_across(toe - ankle, R[:, i, :, 0])
    return R


def closed_form_limb(
    body: Body, motion: Motion, limb: LimbChain, side: str, points_world: Array, *, fps: float
) -> Array:
    """Return the rotations of a motion's parts after one limb is posed in closed form, shape (F, P, 3, 3).

    Parameters
    ----------
    body : Body
    motion : Motion
        F poses.
    limb : LimbChain
    side : str
        "L" or "R".
    points_world : ndarray, shape (F, 2, 3)
        Elbow and wrist, or knee and ankle; NaN where not known.
    fps : float
    """
    (R, T), Q = part_poses(body, motion), motion.rotations.copy()
    upper, lower = limb.parts(body, side)
    middle, end = (gaps_filled(points_world[:, k]) for k in range(2))
    rest = R[:, body.parents[upper]] @ body.R_parent_rest[upper]
    first, second = limb_orientations(rest, middle - T[:, upper], end - middle, limb, fps)
    Q[:, upper] = np.swapaxes(rest, -1, -2) @ first
    Q[:, lower] = np.swapaxes(first @ body.R_parent_rest[lower], -1, -2) @ second
    return rotations.orthonormal(Q)


def _with_trunk(body: Body, known: dict[str, Array]) -> dict[str, Array]:
    """Return the points by name, with missing hips added below the shoulders, or missing shoulders above the hips, as
    of a person who stands upright.
    """
    up = np.array([0.0, 0.0, 1.0])
    for near, far, sign in (("Shoulder", "Hip", -1.0), ("Hip", "Shoulder", 1.0)):
        missing = [side + far for side in "LR" if side + far not in known]
        if not missing or not {"L" + near, "R" + near} <= set(known):
            continue
        across = (known["L" + near] - known["R" + near]) * [1, 1, 0]
        across = across / np.maximum(np.linalg.norm(across, axis=-1, keepdims=True), 1e-9)
        known_side = [side for side in "LR" if side + far in known]
        rest = Motion(np.zeros((1, 3)), np.tile(np.eye(3), (1, len(body), 1, 1)))
        left, right, *others = landmark_positions(body, rest, ["L" + far, "R" + far, "L" + near, "R" + near])[0]
        height = np.linalg.norm(0.5 * (left + right) - np.mean(others, axis=0))
        middle = 0.5 * (known["L" + near] + known["R" + near]) + sign * height * up
        half = 0.5 * np.linalg.norm(left - right) * across
        if known_side == ["L"]:
            middle = known["L" + far] - half
        elif known_side == ["R"]:
            middle = known["R" + far] + half
        placed = {"L" + far: middle + half, "R" + far: middle - half}
        known = known | {name: placed[name] for name in missing}
    return known


def _joint(body: Body, name: str) -> Array:
    """Return the origin of a landmark's part in the frame of its parent, metres: of a hip, in the pelvis's frame."""
    return np.asarray(body.offsets[body.landmarks[name][0]])


def along_and_across(along: Array, across: Array) -> Array:
    """Return the rotations whose y axis is `along` and whose x axis is as close to `across` as possible, shape (F, 3,
    3).
    """
    y = along / np.maximum(np.linalg.norm(along, axis=-1, keepdims=True), 1e-9)
    x = across - np.sum(across * y, axis=-1, keepdims=True) * y
    x /= np.maximum(np.linalg.norm(x, axis=-1, keepdims=True), 1e-9)
    return np.stack([x, y, np.cross(x, y)], axis=-1)


def limb_orientations(
    rest: Array, upper: Array, lower: Array, limb: LimbChain, fps: float | None
) -> tuple[Array, Array]:
    """Return the world rotations of both parts of a limb, shape (..., 3, 3) each.

    The joint between them is a hinge, whose axis gives the twist. A straight limb has the twist of nearby frames, or of
    the shortest rotation from rest.

    Parameters
    ----------
    rest : ndarray, shape (..., 3, 3)
        World orientations of the upper part without a rotation of its joint.
    upper, lower : ndarray, shape (..., 3)
        Directions of the two parts, world frame.
    limb : LimbChain
    fps : float or None
        Frames per second, if the first axis is time; None for unrelated poses.
    """
    a, b = (v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-9) for v in (upper, lower))
    hinge = limb.sign * np.cross(a, b)
    bend = np.linalg.norm(hinge, axis=-1, keepdims=True)
    least = (rotations.shortest(rest[..., 1], a) @ rest[..., :1])[..., 0]
    likely = np.sum(hinge * least, axis=-1, keepdims=True) > limb.farthest * bend
    if fps is None:
        share = np.clip((bend - STRAIGHT_SINES[0]) / (STRAIGHT_SINES[1] - STRAIGHT_SINES[0]), 0.0, 1.0) * likely
        across = share * hinge / np.maximum(bend, 1e-9) + (1 - share) * least
    else:
        across = scipy.ndimage.gaussian_filter1d(hinge * bend * likely, TWIST_TIME * fps, axis=0, mode="nearest")
        across = across + NO_TWIST_WEIGHT * least
    return along_and_across(a, across), along_and_across(b, across)


def _swung(rest: Array, along: Array) -> Array:
    """World rotations of a part that points along a direction, with the least twist."""
    direction = along / np.maximum(np.linalg.norm(along, axis=-1, keepdims=True), 1e-9)
    return np.asarray(rotations.shortest(rest[..., 1], direction) @ rest)
