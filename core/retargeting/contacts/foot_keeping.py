"""Keeping feet and hands in place, whatever the proportions of the character.

After L. Kovar, J. Schreiner, M. Gleicher, Footskate Cleanup for Motion Capture Editing (SCA 2002): while a foot is
planted, the point of the sole that touches the ground moves as the source's does, and not as the same joint angles
would move it on legs of another length. The correction fades over the frames before and after.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from ...body.foot_plants import find_plants
from ...body.skeleton_motion import RestSkeleton, SkeletonMotion
from ...numerics.arrays import Array, Bools
from ...numerics.frame_ranges import runs
from ..bone_roles.roles import SIDES, BoneMap
from ..control_rig import ControlRig, RigPoses
from ..rest_poses.rest_alignment import alignments
from ..transfer import Placement, leg_length
from .foot_paths import BALL, HEEL, FootPath, sole_offsets
from .limb_goals import LimbGoal, limb_controls
from .long_feet import LIKELY_FOOT, Sole
from .stiff_feet import StiffFoot

_SAME_FOOT = 0.03  # relative: foot lengths this close to proportional to the legs are taken to be exactly so
_FADE_TIME = 0.25  # seconds over which a correction fades
_MAX_BRIDGED_TIME = 1.0  # seconds: over shorter swings a correction is interpolated to the next plant's
_FLOOR_TOLERANCE = 0.06  # of the leg length: plants within this height stand on the floor


def foot_goals(
    paths: list[FootPath],
    source: tuple[SkeletonMotion, BoneMap],
    rig: ControlRig,
    poses: RigPoses,
    *,
    placement: Placement,
    clean: bool,
) -> tuple[list[LimbGoal], RigPoses]:
    """Return goals for the target's ankles, and its poses with planted feet turned flat, and toes of long feet bent.

    Parameters
    ----------
    paths : list of FootPath
    source : SkeletonMotion and BoneMap
    rig : ControlRig
    poses : RigPoses
        The result of `transfer`.
    placement : Placement
    clean : bool
        Whether planted feet stand completely still and flat; if not, they move as the source's do.
    """
    motion, of_source = source
    A = alignments(motion.rest, of_source, rig.rest, rig.bones, rig.palms)
    turns, driven = poses.turns.copy(), poses.driven.copy()
    leg = leg_length(rig.rest, rig.bones)
    goals = []
    for path in paths:
        roles = tuple(f"{role}.{path.side}" for role in ("thigh", "shin", "foot"))
        controls = limb_controls(rig, roles, poses.driven)
        if controls is None:
            continue
        ankle = controls[2]
        offsets = _target_offsets(path, (motion.rest, of_source), rig, placement, A[roles[2]][0])
        toe = _bending_toe(of_source, rig, path.side)
        snap = _FLOOR_TOLERANCE * leg if clean else None
        longer = _longer(path, offsets, placement)
        turns[:, ankle] = _standing(turns[:, ankle], path, offsets, snap=snap, longer=longer, fps=motion.fps)
        points = _sole_points(path, placement, offsets, turns[:, ankle], snap, toes_bend=toe is not None)
        lowest = np.where(path.planted[:, BALL], points[:, BALL, 2], _least_height(points, placement))
        hip, foot = (poses.places[:, b] for b in (controls[0], ankle))
        joint = None if toe is None else rig.rest.heads[toe] - rig.rest.heads[ankle]
        sole = Sole(offsets[HEEL], offsets[BALL], joint)
        turns[:, ankle] = sole.with_lower_heel(turns[:, ankle], lowest, hip, foot, leg)
        bends = sole.toe_bends(turns[:, ankle], _least_rise(path, offsets, turns[:, ankle], foot[:, 2] - lowest))
        if toe is not None:
            turns[:, toe], driven[toe] = turns[:, ankle] @ sole.bent(bends), True
        ways = sole.ends(turns[:, ankle], bends)
        rolls = path.rolls_over_ball
        straight = turns[:, ankle] @ offsets[BALL] + sole.carried(turns[:, ankle], bends, path.ball)
        ways[rolls, BALL, :2] = straight[rolls, :2]  # as if the toes did not bend, but for what they carry of the ball
        stiff = None
        if path.side in rig.stiff_soles and abs(longer - 1) > _SAME_FOOT / 2:
            stiff = StiffFoot(rig.stiff_soles[path.side], turns[:, ankle], float(offsets[HEEL, 2]))
        shift = _ankle_shift(path, placement, points, ways, foot, stiff=stiff, fps=motion.fps)
        goals.append(LimbGoal(*controls, shift, path.planted.any(axis=1)))
    return goals, RigPoses(turns, poses.places, driven)


def _longer(path: FootPath, offsets: Array, placement: Placement) -> float:
    """Return how many times as long as the source's foot the target's is, in proportion to the legs."""
    own, of_source = (float(np.linalg.norm(each[BALL] - each[HEEL])) for each in (offsets, path.offsets))
    return own / of_source / placement.scale


def _ankle_shift(
    path: FootPath,
    placement: Placement,
    points: Array,
    ways: Array,
    ankle: Array,
    *,
    stiff: StiffFoot | None,
    fps: float,
) -> Array:
    """Return how far the target's ankle (F, 3) must be moved for its sole, from the ankle (F, 2, 3), to be where heel
    and ball should be, (F, 2, 3). A stiff foot is kept out of the floor while it swings or only its ball stands.
    """
    held, rolling = path.planted.any(axis=1), path.planted[:, BALL] & ~path.planted[:, HEEL]
    wanted = _ankle_path(points, path.planted, ways, ankle)
    if stiff is not None:
        wanted[:, 2] += np.where(rolling, stiff.lift(wanted[:, 2] - _touching(path, placement)), 0.0)
    shift = spread_shifts(np.where(held[:, None], wanted - ankle, 0.0), held, fps)
    shift[:, 2] += _lift(ankle[:, None] + shift[:, None] + ways, points, held, placement)
    if stiff is not None:
        floor = _least_height(placement.moved(path.heel_and_ball), placement)
        shift[:, 2] += np.where(held, 0.0, stiff.lift(ankle[:, 2] + shift[:, 2] - floor))
    return shift


def _sole_points(
    path: FootPath, placement: Placement, offsets: Array, turns: Array, snap: float | None, *, toes_bend: bool
) -> Array:
    """Return where heel and ball of the target should be, (F, 2, 3): they stand still (`_standing_points`), or move as
    the source's do where `snap` is None. Tips of toes that bend are not below what touches the floor.
    """
    if snap is None:
        points = _rolling_points(path, placement, offsets, turns)
    else:
        points = _standing_points(path, placement, offsets, turns, snap)
    if toes_bend:
        points[:, BALL, 2] = np.maximum(points[:, BALL, 2], _touching(path, placement))
    return points


def _standing_points(path: FootPath, placement: Placement, offsets: Array, turns: Array, snap: float) -> Array:
    """Return heel and ball of the target (F, 2, 3), which stand completely still while they are planted, and on the
    floor if they are as near to it as `snap`.
    """
    floor = float(placement.moved(np.array([0.0, 0.0, path.floor]))[2])
    stood = _still(placement.moved(path.heel_and_ball), path.planted, floor, snap)
    stood[:, BALL] += turns @ ((1 - path.ball) * (offsets[BALL] - offsets[HEEL]))
    return np.where(path.planted[..., None], stood, placement.moved(path.points))


def _rolling_points(path: FootPath, placement: Placement, offsets: Array, turns: Array) -> Array:
    """Return heel and tip of the target (F, 2, 3), which move as the source's do. While the ball is planted, what
    touches the floor is as high as there, unless the tip of a long foot would be deeper in the floor than the source's;
    and of a foot that rolls over its ball, the ball moves as there. Where the tip is follows from that.
    """
    found = placement.moved(path.points)
    along = turns @ (offsets[BALL] - offsets[HEEL])
    higher = np.maximum(found[:, BALL, 2], _touching(path, placement) + (1 - path.touching) * along[:, 2])
    found[:, BALL, 2] = np.where(path.planted[:, BALL], higher, found[:, BALL, 2])
    by_ball = placement.moved(path.heel_and_ball[:, BALL]) + (1 - path.ball) * along
    found[:, BALL, :2] = np.where(path.rolls_over_ball[:, None], by_ball[:, :2], found[:, BALL, :2])
    return found


def _touching(path: FootPath, placement: Placement) -> Array:
    """Return the height of what touches the floor while the heel is raised, for the target, (F,)."""
    heel, tip = path.points[:, HEEL], path.points[:, BALL]
    return np.asarray(placement.moved(heel + path.touching[:, None] * (tip - heel))[:, 2])


def _least_rise(path: FootPath, offsets: Array, turns: Array, rise: Array) -> Array:
    """Return the height of the ankle (F,) above what touches the floor: `rise`, or while the ball is planted, that of a
    stiff foot if that is less, of which the same part touches as of the source's.
    """
    touching = offsets[HEEL] + path.touching[:, None] * (offsets[BALL] - offsets[HEEL])
    stiff = -np.einsum("fj,fj->f", turns[:, 2], touching)
    return np.where(path.planted[:, BALL], np.minimum(rise, stiff), rise)


def _bending_toe(of_source: BoneMap, rig: ControlRig, side: str) -> int | None:
    """Return the control of toes for which the source has no motion, and whose tips are known; None without one."""
    role = f"toe.{side}"
    there = role in rig.bones.bones and role not in of_source.bones and side in rig.toe_tips
    return rig.index(role) if there else None


def _target_offsets(
    path: FootPath, source: tuple[RestSkeleton, BoneMap], rig: ControlRig, placement: Placement, A: Array
) -> Array:
    """Return heel and ball relative to the target's ankle at rest, (2, 3): the source's, scaled to the target's foot.

    The foot of a source without toe bones rolls over the tips of the toes. So does the target's then, which its foot
    bone ends before, with straight toes unless it is long for its leg.
    """
    own = sole_offsets(rig.rest, rig.bones, path.side)
    ratio = placement.scale
    both = [f"toe.{path.side}" in bones.bones for bones in (source[1], rig.bones)]
    reach = 0.0 if own is None else float(np.linalg.norm(own[BALL, :2]))
    if not both[0] and path.side in rig.toe_tips:
        reach = rig.toe_tips[path.side]
    if reach > 0 and (both[0] == both[1] or path.side in rig.toe_tips):
        found = reach / float(np.linalg.norm(path.offsets[BALL, :2]))
        known = both[0] or path.side in rig.toe_tips or LIKELY_FOOT[0] < found / ratio < LIKELY_FOOT[1]
        ratio = found if known and abs(found / ratio - 1) >= _SAME_FOOT else ratio
    ankle = rig.rest.heads[rig.index(f"foot.{path.side}")]
    offsets = ratio * (path.offsets * [1.0, 1.0, 0.0]) @ A
    offsets[:, 2] = rig.rest.ground - ankle[2]
    return np.asarray(offsets)


def _ankle_path(points: Array, planted: Bools, ways: Array, ankle: Array) -> Array:
    """Return the goal of the ankle while the foot is planted, (F, 3).

    Its height follows from the planted point; its horizontal position is on average the one that joint angles alone
    give, and moves with the planted point.
    """
    wanted = ankle.copy()
    for first, last in runs(planted.any(axis=1)):
        frames = np.arange(first, last + 1)
        point = np.where(planted[frames, BALL], BALL, HEEL)
        by_point = points[frames] - ways[frames]  # the ankle, as each of the points has it
        path = by_point[np.arange(len(frames)), point].copy()
        change = np.flatnonzero(np.diff(point)) + 1
        for k in change:  # the foot rolls over to the other point, and the ankle must not jump
            both = k - 1 if planted[frames[k - 1]].all() else k  # where both stand
            path[k:, :2] += by_point[both, point[k - 1], :2] - by_point[both, point[k], :2]
        path[:, :2] += (ankle[frames, :2] - path[:, :2]).mean(axis=0)
        wanted[frames] = path
    return wanted


def spread_shifts(shift: Array, held: Bools, fps: float) -> Array:
    """Return shifts (F, 3) that are given on held frames, and on the frames between interpolated or faded out."""
    if held.all() or not held.any():
        return shift
    found = np.where(held[:, None], shift, 0.0)
    fade = max(_FADE_TIME * fps, 1.0)
    for first, last in runs(~held):
        frames = np.arange(first, last + 1)
        before = shift[first - 1] if first > 0 else None
        after = shift[last + 1] if last + 1 < len(shift) else None
        if before is not None and after is not None and len(frames) <= _MAX_BRIDGED_TIME * fps:
            w = _ease((frames - first + 1) / (len(frames) + 1))[:, None]
            found[frames] = (1 - w) * before + w * after
            continue
        if before is not None:
            found[frames] += (1 - _ease((frames - first + 1) / fade))[:, None] * before
        if after is not None:
            found[frames] += (1 - _ease((last + 1 - frames) / fade))[:, None] * after
    return found


def _ease(t: Array) -> Array:
    t = np.clip(t, 0.0, 1.0)
    return np.asarray(t * t * (3 - 2 * t))


def _lift(soles: Array, points: Array, held: Bools, placement: Placement) -> Array:
    """Return how far a swinging foot must be raised to be no deeper in the ground than the source's, (F,)."""
    return np.where(held, 0.0, np.maximum(_least_height(points, placement) - soles[..., 2].min(axis=1), 0.0))


def _least_height(points: Array, placement: Placement) -> Array:
    """Return the height that a sole must have: that of the ground, or of the source's (F, 2, 3), if that is deeper."""
    return np.minimum(points[..., 2].min(axis=1), placement.ground[2])


def _still(points: Array, planted: Bools, floor: float, snap: float) -> Array:
    """Return points (F, 2, 3) that stand at their mean position during each plant, and on the floor if that is near."""
    found = points.copy()
    for c in range(points.shape[1]):
        for first, last in runs(planted[:, c]):
            middle = points[first : last + 1, c].mean(axis=0)
            if abs(middle[2] - floor) < snap:
                middle[2] = floor
            found[first : last + 1, c] = middle
    return found


def _standing(turns: Array, path: FootPath, offsets: Array, *, snap: float | None, longer: float, fps: float) -> Array:
    """Return rotations (F, 3, 3) of a foot that stands: flat, see `_flattened`, or as the source's does if `snap` is
    None, see `_steadied`.
    """
    flat, ahead = path.planted.all(axis=1), offsets[BALL] - offsets[HEEL]
    if snap is None:
        return _steadied(turns, flat, ahead, longer=longer, fps=fps)
    return _flattened(turns, flat, ahead, snap=snap, fps=fps)


def _steadied(turns: Array, flat: Bools, ahead: Array, *, longer: float, fps: float) -> Array:
    """Return rotations (F, 3, 3) of a foot that turns less about the vertical while heel and ball are planted if it is
    longer than the source's, in proportion to the legs, so that both points move as far as the source's. `ahead` (3,)
    is the vector from heel to ball at rest.
    """
    if longer <= 1 + _SAME_FOOT:
        return turns
    shift = np.zeros((len(turns), 3))
    for first, last in runs(flat):
        along = turns[first : last + 1] @ ahead
        yaw = np.unwrap(np.arctan2(along[:, 1], along[:, 0]))
        shift[first : last + 1, 2] = (1 / longer - 1) * (yaw - yaw.mean())
    return np.asarray(Rotation.from_rotvec(spread_shifts(shift, flat, fps)).as_matrix() @ turns)


def _flattened(turns: Array, flat: Bools, ahead: Array, *, snap: float, fps: float) -> Array:
    """Return rotations (F, 3, 3) of a foot that is level and still while heel and ball are planted, unless one of them
    is higher than the other by `snap`: a foot may stand on its ball for a while, with a raised heel.
    """
    found = turns.copy()
    shift = np.zeros((len(turns), 3))
    for first, last in runs(flat):
        mean = Rotation.from_matrix(turns[first : last + 1]).mean().as_matrix()
        along = mean @ ahead
        level = along * [1.0, 1.0, 0.0]
        if abs(along[2]) > snap:
            continue
        pitch = Rotation.align_vectors(level[None], along[None])[0].as_matrix()
        wanted = pitch @ mean
        shift[first : last + 1] = Rotation.from_matrix(
            wanted @ np.swapaxes(turns[first : last + 1], -1, -2)
        ).as_rotvec()
    eased = spread_shifts(shift, flat, fps)
    return np.asarray(Rotation.from_rotvec(eased).as_matrix() @ found)


def hand_goals(
    source: SkeletonMotion, of_source: BoneMap, rig: ControlRig, poses: RigPoses, placement: Placement
) -> list[LimbGoal]:
    """Return goals for hands that stand still in the world: the same position, at the target's scale."""
    leg = leg_length(source.rest, of_source)
    goals = []
    for side in SIDES:
        roles = tuple(f"{role}.{side}" for role in ("upper_arm", "forearm", "hand"))
        controls = limb_controls(rig, roles, poses.driven)
        if controls is None or roles[2] not in of_source.bones:
            continue
        path = source.positions[:, source.rest.indices(of_source.bones[roles[2]])[0]]
        held = find_plants(path[:, None], source.fps, leg, by_height=False).planted[:, 0]
        shift = np.where(held[:, None], placement.moved(path) - poses.places[:, controls[2]], 0.0)
        goals.append(LimbGoal(*controls, spread_shifts(shift, held, source.fps), np.zeros(len(held), bool)))
    return goals
