"""Making a rig follow a source live, by constraints instead of keys, so that every change of the source shows at once.

A hidden helper armature has a bone for every control. The source's bones move it (by Armature constraints), so that it
has the orientation that the control needs: D A R0 of `rest_poses.rest_alignment`. The control copies its
rotation. The hips, and the root bone, copy a location in the space of an empty with the placement's scale.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

from ...core.body.skeleton_motion import SkeletonMotion
from ...core.errors import BodyError
from ...core.numerics.arrays import Array
from ...core.retargeting.bone_roles.roles import BoneMap
from ...core.retargeting.control_rig import ControlRig
from ...core.retargeting.rest_poses.rest_alignment import alignments
from ...core.retargeting.transfer import Placement, hip_centre, hip_path, source_blends
from ..properties.pointer_polls import LIVE_CHANGES
from ..scene_io.body import body_armature
from .rigs.held_bones import Driver
from .rigs.rig_changes import restore_rows, rows_of_holds, rows_of_settings
from .rigs.rig_settings import Owner

NAME = "KF Mocap Live"
_LENGTH = 0.1  # of every copied bone, metres


@dataclass(frozen=True, eq=False)
class LiveSource:
    """The armature that a rig follows.

    Attributes
    ----------
    armature : bpy.types.Object
    shown : mapping of str to str
        For source bones that do not show their own motion, the bone that shows it.
    """

    armature: bpy.types.Object
    shown: Mapping[str, str]


@dataclass(frozen=True, eq=False)
class _HelperBone:
    """A bone of the helper: its rest orientation (3, 3) and head (3,) in the world, and which source bone carries it.

    Where the control is turned by two of them, `beside` is another helper's bone and `share` how far this one is turned
    towards it.
    """

    name: str
    orientation: Array
    head: Array
    carrier: int
    beside: str = ""
    share: float = 0.0


def follow(
    scene: bpy.types.Scene,
    armature: bpy.types.Object,
    rig: ControlRig,
    source: tuple[SkeletonMotion, BoneMap, LiveSource],
    *,
    placement: Placement,
    root: str = "world",
) -> None:
    """Make a rig follow a source by constraints; `stop_following` undoes it.

    Parameters
    ----------
    source : SkeletonMotion, BoneMap and LiveSource
        Of the first one the rest pose and the hips' first place are used.
    root : str
        See `core.retargeting.transfer.RetargetOptions`.
    """
    motion, of_source, live = source
    helper = _helper(scene, armature, motion, live, list(_helper_bones(rig, motion, of_source, placement)))
    for role, k, name in rig.bones.items():
        if _turning(role, k) in helper.data.bones:
            turned = _constraint(armature, name, "COPY_ROTATION", helper, _turning(role, k))
            turned.target_space = turned.owner_space = "WORLD"
            if not armature.data.bones[name].use_connect:
                _hang_where_it_rests(armature, name)
    hips = rig.bones.bones["hips"][0]
    first = placement.scale * hip_path(motion, of_source)[0] * [1.0, 1.0, 0.0]
    shift = first if root == "in-place" else np.zeros(3)
    _place(armature, hips, helper, "place", _empty(scene, helper, placement, shift))
    if root == "in-place":
        still = Placement(placement.scale, np.zeros(3), np.zeros(3))
        back = _place(armature, hips, helper, "centre", _empty(scene, helper, still, np.zeros(3)))
        back.use_offset = back.invert_x = back.invert_y = True
        back.use_z = False
    if root == "root-bone":
        b = rig.index("root")
        offset = rig.rest.heads[b] - hip_centre(rig.rest, rig.bones)
        over = _place(armature, rig.rest.names[b], helper, "centre", _empty(scene, helper, placement, offset))
        over.use_z = False
    armature.update_tag()


def remember(
    armature: bpy.types.Object,
    holds: Mapping[tuple[str, str], float],
    settings: Mapping[tuple[Owner, str], Any],
    muted: Sequence[Driver] = (),
) -> None:
    """Store what has changed of the rig's constraints and settings, and its muted drivers, for `stop_following`."""
    helper: Any = _helper_of(armature)
    helper[LIVE_CHANGES] = json.dumps([rows_of_holds(holds), rows_of_settings(settings), muted])


def is_following(armature: bpy.types.Object) -> bool:
    """Whether a rig follows a source live."""
    return _helper_of(armature) is not None


def stop_following(armature: bpy.types.Object) -> bool:
    """Remove the constraints and the helper; returns whether there were any."""
    helper: Any = _helper_of(armature)
    found = list(_constraints(armature))
    for bone, constraint in found:
        bone.constraints.remove(constraint)
    if helper is not None:
        # Older files have no drivers, or shifts as well.
        holds, settings, muted, shifts = (*json.loads(helper.get(LIVE_CHANGES, "[[], []]")), [], [])[:4]
        restore_rows(armature, holds, settings, muted)
        for name, shift in shifts:
            if name in armature.pose.bones:
                armature.pose.bones[name].location = shift
        for child in list(helper.children):
            bpy.data.objects.remove(child)
        bpy.data.armatures.remove(helper.data)
    return bool(found)


def refuse_inverse_kinematics(preset: str, goals: Sequence[object]) -> None:
    """Raise a BodyError if a preset drives limbs by IK, whose controls correspond to no bone of the source."""
    if goals:
        raise BodyError(
            f"IK controls cannot follow live (preset {preset})", where="option Live", todo="choose a preset with FK"
        )


def _turning(role: str, place: int) -> str:
    return f"{role}.{place}"


def _helper_bones(
    rig: ControlRig, source: SkeletonMotion, of_source: BoneMap, placement: Placement
) -> Iterator[_HelperBone]:
    rest = source.rest
    A = alignments(rest, of_source, rig.rest, rig.bones, rig.palms)
    for role, alignment in A.items():
        for k, blend in enumerate(source_blends(rest, of_source, role, len(alignment))):
            orientation = alignment[k] @ rig.R_world_rest[rig.index(role, k)]
            name, other = _turning(role, k), ""
            if blend.share:
                other = f"{name} beside"
                yield _HelperBone(other, orientation, rest.heads[blend.high], blend.high)
            yield _HelperBone(name, orientation, rest.heads[blend.low], blend.low, other, blend.share)
    [hips] = rest.indices(of_source.bones["hips"])
    own = hip_centre(rig.rest, rig.bones) - rig.rest.heads[rig.index("hips")]
    centre = hip_centre(rest, of_source)
    yield _HelperBone("place", np.eye(3), centre - A["hips"][0] @ own / placement.scale, hips)
    yield _HelperBone("centre", np.eye(3), centre, hips)


def _helper(
    scene: bpy.types.Scene,
    armature: bpy.types.Object,
    source: SkeletonMotion,
    live: LiveSource,
    bones: list[_HelperBone],
) -> bpy.types.Object:
    """Return the helper armature, carried by the source's bones."""
    name = f"{NAME} {armature.name}"
    helper = bpy.data.objects.new(name, bpy.data.armatures.new(name))
    _hide(scene, helper)
    with body_armature.edit_bones(helper) as made:
        for bone in bones:
            one = made.new(bone.name)
            one.head, one.tail = (0.0, 0.0, 0.0), (0.0, _LENGTH, 0.0)
            matrix = np.eye(4)
            matrix[:3, :3], matrix[:3, 3] = bone.orientation, bone.head
            one.matrix = Matrix(matrix.tolist())
    for bone in bones:
        constraints: Any = helper.pose.bones[bone.name].constraints
        target = constraints.new("ARMATURE").targets.new()
        target.target = live.armature
        target.subtarget = live.shown.get(source.rest.names[bone.carrier], source.rest.names[bone.carrier])
        if bone.beside:
            turned = constraints.new("COPY_ROTATION")
            turned.target, turned.subtarget, turned.influence = helper, bone.beside, bone.share
    return helper


def _empty(scene: bpy.types.Scene, helper: bpy.types.Object, placement: Placement, shift: Array) -> bpy.types.Object:
    """Return an empty whose space places the source's world in the target's, with a shift."""
    empty = bpy.data.objects.new(f"{helper.name} space", None)
    empty.parent = helper
    _hide(scene, empty)
    matrix = np.eye(4) * placement.scale
    matrix[:3, 3], matrix[3, 3] = placement.moved(np.zeros(3)) + shift, 1.0
    empty.matrix_world = Matrix(matrix.tolist())
    return empty


def _hide(scene: bpy.types.Scene, made: bpy.types.Object) -> None:
    scene.collection.objects.link(made)
    made.hide_viewport = made.hide_select = made.hide_render = True


def _place(
    armature: bpy.types.Object, bone: str, helper: bpy.types.Object, followed: str, space: bpy.types.Object
) -> Any:
    """Return a constraint that puts a control where a bone of the helper is, in an empty's space."""
    made = _constraint(armature, bone, "COPY_LOCATION", helper, followed)
    made.target_space, made.owner_space, made.space_object = "WORLD", "CUSTOM", space
    return made


def _hang_where_it_rests(armature: bpy.types.Object, bone: str) -> None:
    """Undo what shifts a bone by hand or by keys: else it would be turned where it has been shifted to."""
    limit: Any = _first_constraint(armature, bone, "LIMIT_LOCATION")
    limit.owner_space = "LOCAL"
    for axis, side in product("xyz", ("min", "max")):
        setattr(limit, f"use_{side}_{axis}", True)  # the limits are 0


def _constraint(armature: bpy.types.Object, bone: str, kind: str, helper: bpy.types.Object, followed: str) -> Any:
    made = _first_constraint(armature, bone, kind)
    made.target, made.subtarget = helper, followed
    return made


def _first_constraint(armature: bpy.types.Object, bone: str, kind: str) -> Any:
    """Return a constraint of a control, before those that the rig has itself: these act as on keys."""
    constraints: Any = armature.pose.bones[bone].constraints
    made: Any = constraints.new(kind)
    made.name = NAME
    own = sum(one.name.startswith(NAME) for one in constraints) - 1
    constraints.move(len(constraints) - 1, own)
    return made


def _constraints(armature: bpy.types.Object) -> Iterator[tuple[bpy.types.PoseBone, Any]]:
    for bone in armature.pose.bones:
        for constraint in list[Any](bone.constraints):
            if constraint.name.startswith(NAME):
                yield bone, constraint


def _helper_of(armature: bpy.types.Object) -> bpy.types.Object | None:
    found = (getattr(constraint, "target", None) for _, constraint in _constraints(armature))
    return next((target for target in found if target is not None), None)
