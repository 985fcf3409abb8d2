"""Motion that is keyed on bones above a body, such as a game rig's root: it becomes that of the body's topmost bone."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

from ....core.errors import listed
from ...scene_io import fcurves
from ...scene_io.body import body_armature
from ...scene_io.keys import key_pose_curves
from ...scene_io.visited_frames import same_time
from .tracked_bones import moves

_PLACES = ("location", "rotation_quaternion", "rotation_euler", "rotation_axis_angle", "scale")
_NAMED = 3


def keyed_on_body(current: bpy.types.Scene, armature: bpy.types.Object) -> tuple[str, ...]:
    """Key the topmost bone of a performer where it, or a bone that carries it, has keys, so that it is where it was;
    the keys of those that carry it are muted, and they stay as they are now. Returns what has been done, in words.

    The tracker moves the topmost bone alone: what moved above it would be added to what it finds.
    """
    parts = body_armature.body_bones(armature)
    top, names = parts[0].name, {bone.name for bone in parts}
    above = _with_followed(armature, {bone.name for bone in parts[0].parent_recursive})
    between = _with_followed(armature, {bone.name for part in parts for bone in part.parent_recursive} - above) - above
    said = tuple(
        f"bone {name}: it is no part, and counts as it stands now: key the bones below it"
        for name in _moving(armature, between - names)
    )
    moving = _moving(armature, above - names)
    if not moving:
        return said
    carried = _curves(armature, moving)
    keyed = [fcurves.frames_of(fcurves.get_keys(curve)) for curve in (*carried, *_curves(armature, [top]))]
    frames = np.unique(np.concatenate(keyed)).tolist()
    shown = list(_on_frames(current, armature, top, frames))
    for curve in carried:
        curve.mute = True
    posed = armature.pose.bones[top]
    for frame, matrix, _ in zip(frames, shown, _on_frames(current, armature, top, frames), strict=True):
        posed.matrix = matrix
        key_pose_curves.key_current_pose(armature, frame, {top})
    said_of = f"bone {moving[0]}" if len(moving) == 1 else f"bones {listed(moving, _NAMED)}"
    what = f"above the body, so its keys are muted, and {top} is keyed on {len(frames)} frames where it was"
    return (*said, f"{said_of}: {what}")


def _on_frames(
    current: bpy.types.Scene, armature: bpy.types.Object, bone: str, frames: Collection[int]
) -> Iterator[Matrix]:
    """Go to scene frames in turn, and back after the last; gives the bone's matrix in the armature on each."""
    with same_time(current):
        for frame in frames:
            current.frame_set(frame)
            yield armature.evaluated_get(bpy.context.evaluated_depsgraph_get()).pose.bones[bone].matrix.copy()


def _moving(armature: bpy.types.Object, names: Collection[str]) -> list[str]:
    return [name for name in sorted(names) if any(moves(armature, name, place) for place in _PLACES)]


def _curves(armature: bpy.types.Object, names: Collection[str]) -> list[bpy.types.FCurve]:
    """Return the curves of bones' places."""
    paths = {fcurves.bone_path(name, place) for name in names for place in _PLACES}
    bag = fcurves.find_channelbag(armature)
    return [curve for curve in bag.fcurves if curve.data_path in paths] if bag is not None else []


def _with_followed(armature: bpy.types.Object, names: set[str]) -> set[str]:
    """Return bones, and those of the armature that constraints of them follow."""
    held: list[Any] = [held for name in names for held in armature.pose.bones[name].constraints]
    ends = [end for each in held for end in (each, *getattr(each, "targets", ()))]
    followed = {getattr(end, "subtarget", "") for end in ends if getattr(end, "target", None) == armature}
    return names | (followed & set(armature.pose.bones.keys()))
