"""The FK controls of rigs that Rigify generates for animals: no preset knows them, and their tails, toes, faces and
fins have controls besides those of trunk and limbs.

A body is a tree of rigid parts, and Blender hangs each part's keys on the bone above. So of all FK controls those are
taken that move all others either rigidly or not at all, and of which each moves with the control that is above it.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np

from ....core.numerics import rotations
from ....core.numerics.arrays import Array, Bools
from ....core.retargeting.bone_roles.roles import BoneMap
from ..rigs.fk_controls import FkControls, alike
from ..rigs.rig_at_rest import at_rest, posed_matrices, rest_skeleton, update
from ..rigs.rig_reading import moved_matrices
from ..rigs.rig_settings import trying_settings

_NOT_FK = re.compile(r"tweak|(^|_)ik(_|\.|$)|master|gear|parent|heel|target|pivot|^root$|^hips$|^chest$")
"""Names of controls that do not turn one bone about its joint, as Rigify makes them."""
_SETTINGS = {"IK_FK": 1.0, "FK_limb_follow": 0.0, "neck_follow": 1.0, "head_follow": 1.0, "tail_follow": 1.0}
"""Properties of Rigify's controls with which limbs, neck and tail turn with what they hang on."""
_STILL_TOLERANCE = 2e-3
"""Radians, and lengths of the rig, within which a bone does not move."""
_WITH = 0.8
"""Share of a control's turn with which a bone that it does not move rigidly belongs to it: its twist is divided."""
_PAW_HEIGHT_RATIO = 0.5
"""Of the hips' height: below this, hands are front paws."""


def is_generated(armature: bpy.types.Object) -> bool:
    """Whether Rigify has generated an armature."""
    return "rig_id" in armature.data


def goes_on_four(armature: bpy.types.Object, bones: BoneMap) -> bool:
    """Whether what passes for the hands of a human are front paws."""
    rest = rest_skeleton(armature)  # in the world, as importers of FBX lay armatures on their backs
    heights = rest.heads[:, 2] - rest.heads[:, 2].min()
    hips, *hands = (heights[rest.indices(bones.bones[role])[0]] for role in ("hips", "hand.L", "hand.R"))
    return bool(max(hands) < _PAW_HEIGHT_RATIO * hips)


@dataclass(frozen=True, eq=False)
class _Moves:
    """What the turns of N controls move: these themselves, and D deforming bones.

    Attributes
    ----------
    names : list of str
        The controls, then the deforming bones.
    rigidly : ndarray of bool, shape (N, N + D)
    partly : ndarray of bool, shape (N, N + D)
        Whether a bone moves otherwise.
    share : ndarray, shape (N, N + D)
        Angle by which a bone turns, relative to the control's.
    """

    names: list[str]
    rigidly: Bools
    partly: Bools
    share: Array


def animal_controls(armature: bpy.types.Object, bones: Sequence[str], held: Collection[str]) -> FkControls:
    """Return the controls that turn the parts of an animal's body, by deforming bone, and the settings for that.

    Parameters
    ----------
    bones : sequence of str
        Deforming bones that lead skin.
    held : collection of str
        Bones moved by something other than their own pose.
    """
    pose: Any = armature.pose.bones
    settings = {bone.name: {key: value for key, value in _SETTINGS.items() if key in bone} for bone in pose}
    settings = {name: values for name, values in settings.items() if values}
    shaped = [bone.name for bone in pose if bone.custom_shape is not None and bone.name not in held]
    candidates = [name for name in shaped if not _NOT_FK.search(name)]
    with at_rest(armature, [bone.name for bone in pose]), trying_settings(armature, settings):
        moves = _observed(armature, candidates, bones)
    kept = _in_one_tree(armature, moves, _without_partly_moved(moves))
    return FkControls(_carriers(moves, kept), settings)


def _observed(armature: bpy.types.Object, controls: Sequence[str], bones: Sequence[str]) -> _Moves:
    """Turn each control a little; the rig must be at rest."""
    names = [*controls, *bones]
    update()
    rest = posed_matrices(armature, names)
    size = float(np.ptp(rest[:, :3, 3], axis=0).max()) or 1.0
    rigidly, partly, share = (np.zeros((len(controls), len(names)), kind) for kind in (bool, bool, float))
    for i, control in enumerate(controls):
        moved = moved_matrices(armature, control, names)
        change = moved @ np.linalg.inv(rest)
        angles = np.linalg.norm(rotations.log(rotations.orthonormal(change[:, :3, :3])), axis=-1)
        ways = np.linalg.norm(moved[:, :3, 3] - rest[:, :3, 3], axis=-1) / size
        rigidly[i] = alike(change, change[i], rest, size)
        partly[i] = ~rigidly[i] & ((angles > _STILL_TOLERANCE) | (ways > _STILL_TOLERANCE))
        share[i] = angles / max(angles[i], _STILL_TOLERANCE)
    update()
    return _Moves(names, rigidly, partly, share)


def _without_partly_moved(moves: _Moves) -> list[int]:
    """Return controls none of which moves another one in part: of one that does, and it alone moves nothing else, the
    other is left out.
    """
    kept = list(range(len(moves.rigidly)))
    while True:
        clashes = {i: [j for j in kept if moves.partly[i, j]] for i in kept}
        mover = next((i for i in kept if clashes[i]), None)
        if mover is None:
            return kept
        first = clashes[mover][0]
        alone = len(clashes[mover]) == 1 and moves.rigidly[first, kept].sum() == 1
        kept.remove(first if alone else mover)


def _in_one_tree(armature: bpy.types.Object, moves: _Moves, kept: list[int]) -> list[int]:
    """Return the controls that move with the nearest kept one above them. Where just one control stands between, that
    of the two is left out which leads fewer bones, else the one below.
    """
    kept, N = list(kept), len(moves.rigidly)
    while True:
        names = {moves.names[i]: i for i in kept}
        for j in sorted(kept, key=lambda each: -int(moves.rigidly[kept, each].sum())):
            above = armature.data.bones[moves.names[j]].parent_recursive
            tree = next((names[bone.name] for bone in above if bone.name in names), -1)
            movers = [i for i in kept if i != j and moves.rigidly[i, j]]
            between = [i for i in movers if i != tree and (tree < 0 or moves.rigidly[tree, i])]
            if between or (tree >= 0 and tree not in movers):
                break
        else:
            return kept
        own = moves.rigidly[between[0], N:] & ~moves.rigidly[j, N:] if len(between) == 1 else np.zeros(0, bool)
        kept.remove(between[0] if 0 < own.sum() <= moves.rigidly[j, N:].sum() and tree >= 0 else j)


def _carriers(moves: _Moves, kept: Sequence[int]) -> Mapping[str, str]:
    """Return the control of each deforming bone: of those that it moves with, the one that moves fewest."""
    N = len(moves.rigidly)
    with_it = moves.rigidly | (moves.partly & (moves.share > _WITH) & (moves.share < 1 / _WITH))
    below = {i: int(moves.rigidly[i, kept].sum()) for i in kept}
    found = {}
    for k, bone in enumerate(moves.names[N:], N):
        able = [i for i in kept if with_it[i, k]]
        if able:
            found[bone] = moves.names[min(able, key=below.__getitem__)]
    return found
