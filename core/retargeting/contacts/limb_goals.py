"""Moving two-bone limbs to goals: closed-form inverse kinematics over all frames at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.ndimage import gaussian_filter1d, maximum_filter1d

from ...numerics.arrays import Array, Bools
from ..control_rig import ControlRig, RigPoses, control_poses
from ..rest_poses.rest_alignment import shortest_turn

_MAX_STRETCH = 1 - 1e-9  # of a limb, as a share of its length: where it is straight, its plane is undefined
_REACH_TOLERANCE = 1e-6  # beyond which a goal is out of reach, as a share of the limb's length
_LOWERING_TIME = 0.2  # seconds over which the hips are lowered


@dataclass(frozen=True, eq=False)
class LimbGoal:
    """Goals for the end of a limb.

    Attributes
    ----------
    upper, lower, end : int
        Controls of thigh, shin and foot, or of upper arm, forearm and hand.
    shift : ndarray, shape (F, 3)
        From the position of the limb's end to its goal, metres; zero leaves a frame unchanged.
    held : ndarray of bool, shape (F,)
        Frames on which the goal must be met: if it is out of reach, the hips are lowered.
    """

    upper: int
    lower: int
    end: int
    shift: Array
    held: Bools


def reach_goals(rig: ControlRig, poses: RigPoses, goals: list[LimbGoal], fps: float) -> RigPoses:
    """Move the ends of limbs to their goals; the ends keep their rotation, and elbows and knees their plane.

    The hips are lowered smoothly if a held foot is out of reach.

    Parameters
    ----------
    rig : ControlRig
    poses : RigPoses
        F frames.
    goals : list of LimbGoal
    fps : float
        Frames per second.
    """
    hips = rig.index("hips")
    goal_places = [poses.places[:, goal.end] + goal.shift for goal in goals]
    lowered = _lowered(poses, goals, goal_places, fps)
    tops = {b: poses.places[:, b] - (lowered if b == hips else 0.0) for b in _tops(rig, hips)}
    poses = control_poses(rig, poses.turns, poses.driven, tops)
    turns = poses.turns.copy()
    for goal, there in zip(goals, goal_places, strict=True):
        moved = np.flatnonzero(np.abs(there - poses.places[:, goal.end]).max(axis=1) > 1e-12)
        if len(moved):
            root, middle, end = (poses.places[moved][:, j] for j in (goal.upper, goal.lower, goal.end))
            for j, turn in zip((goal.upper, goal.lower), two_bone_turns(root, middle, end, there[moved]), strict=True):
                turns[moved, j] = turn @ turns[moved, j]
    return control_poses(rig, turns, poses.driven, tops)


def _tops(rig: ControlRig, hips: int) -> list[int]:
    return [hips, *(rig.index(role) for role in ("root",) if role in rig.bones.bones)]


def _lowered(poses: RigPoses, goals: list[LimbGoal], places: list[Array], fps: float) -> Array:
    """Return the shift of the hips on every frame, shape (F, 3), metres, that brings held ends within reach."""
    drop = np.zeros(len(poses))
    for goal, there in zip(goals, places, strict=True):
        joints = [poses.places[:, j] for j in (goal.upper, goal.lower, goal.end)]
        length = sum(np.linalg.norm(b - a, axis=1) for a, b in pairwise(joints))
        way = joints[0] - there
        far = np.linalg.norm(way, axis=1) > length * (1 + _REACH_TOLERANCE)
        high = np.sqrt(np.maximum(length**2 - np.sum(way[:, :2] ** 2, axis=1), 0.0))
        drop = np.maximum(drop, np.where(goal.held & far, way[:, 2] - high, 0.0))
    if not (drop > 0).any():
        return np.zeros((len(poses), 3))
    frames = max(_LOWERING_TIME * fps, 1.0)
    smooth = gaussian_filter1d(maximum_filter1d(drop, 2 * round(1.5 * frames) + 1), frames / 2, truncate=3.0)
    return np.stack([0 * smooth, 0 * smooth, smooth], axis=1)


def two_bone_turns(root: Array, middle: Array, end: Array, goal: Array) -> tuple[Array, Array]:
    """Return world rotations (F, 3, 3) of the upper and the lower bone that bring the end of a limb to its goal.

    The limb is turned by the shortest rotation towards the goal and bent in its own plane, so that it is not twisted.
    If a goal is out of reach, the straight limb points at it.

    Parameters
    ----------
    root, middle, end : ndarray, shape (F, 3)
        The limb's joints, metres.
    goal : ndarray, shape (F, 3)
        The position to which the end is moved.
    """
    a, b = (np.linalg.norm(q - p, axis=1, keepdims=True) for p, q in ((root, middle), (middle, end)))
    way = goal - root
    far = np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9)
    u = way / far
    d = np.clip(far, np.abs(a - b) * (1 + 1e-6) + 1e-9, (a + b) * _MAX_STRETCH)
    aim = shortest_turn(_unit(end - root), u)
    upper, lower = (np.einsum("fij,fj->fi", aim, v) for v in (middle - root, end - middle))
    bend = upper - u * np.sum(upper * u, axis=1, keepdims=True)
    straight = np.linalg.norm(bend, axis=1, keepdims=True) < 1e-6 * a
    bend = _unit(np.where(straight, _across(u), bend))
    along = (a**2 - b**2 + d**2) / (2 * d)
    knee = along * u + np.sqrt(np.maximum(a**2 - along**2, 0.0)) * bend
    ankle = d * u
    first = shortest_turn(_unit(upper), _unit(knee)) @ aim
    second = shortest_turn(_unit(lower), _unit(ankle - knee)) @ aim
    return first, second


def _across(u: Array) -> Array:
    """Return unit vectors perpendicular to u (F, 3), as near to forward as possible."""
    forward = np.where(np.abs(u[:, 1:2]) < 0.9, [0.0, -1.0, 0.0], [0.0, 0.0, 1.0])
    return np.asarray(forward - u * np.sum(forward * u, axis=1, keepdims=True))


def _unit(v: Array) -> Array:
    return np.asarray(v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-12))


def limb_controls(rig: ControlRig, roles: Sequence[str], driven: Bools) -> tuple[int, int, int] | None:
    """Return the controls of a limb's three roles, or None if one is missing or not driven."""
    if any(role not in rig.bones.bones for role in roles):
        return None
    upper, lower, end = (rig.index(role) for role in roles)
    return (upper, lower, end) if all(driven[b] for b in (upper, lower, end)) else None
