"""How far the tracked bones may be off, in the scene: on every pose bone its expected error, animated, and as colours.

Each tracking writes it for the frames that it tracked. Like that of `bone_visibility`, it is not a channel of the body.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import bpy
import numpy as np
from numpy.typing import NDArray

from ....core.review.suggestions import suggest_keys_by_error
from .. import fcurves
from ..body import body_armature
from ..body.sides import Colour, colour_of
from ..keys import key_pose_curves
from . import bone_visibility, lost_parts, unknown_bones

if TYPE_CHECKING:
    from ....core.shot.shot import KeyPoses, Shot

ERROR = "kfmocap_error"
"""Custom property of a pose bone: how far its tip may be from its true place, mm."""
WHITE = (1.0, 1.0, 1.0, 1.0)
_DESCRIPTION = "How far the tip of this bone may be from its true place on this frame, as last tracked, mm"
_COLOUR_RAMP = ("min(1, 2 * e / {limit})", "min(1, 2 - 2 * e / {limit})", "0.1")
"""Red, green and blue by the error e: green where it is sure, over yellow to red at the limit."""
_HIDDEN_COLOUR = (0.35, 0.45, 1.0)
"""Colour of a bone that no camera sees."""
_UNKNOWN = (0.4, 0.4, 0.4)
"""Colour of a bone that nothing has shown."""
_MILLIMETRES = 1000.0


def write_confidence(
    scene: bpy.types.Scene,
    deviation: Sequence[NDArray[np.float64]],
    first: int = 0,
    *,
    slots: Sequence[bpy.types.PropertyGroup] | None = None,
) -> None:
    """Write the expected errors of its performers' bones into a scene; `refresh` then shows what follows from them.

    Parameters
    ----------
    deviation : sequence of ndarray, shape (F, P)
        Expected error of the parts of each performer, metres.
    first : int
        Of an excerpt of the scene's shot: its first frame there. Other frames keep what was written for them.
    slots : sequence of KFMocapPerformer, optional
        Whose errors these are; by default all performers'.
    """
    start = scene.kfmocap.frame_start + first
    for slot, found in zip(slots or scene.kfmocap.performers, deviation, strict=True):
        frames = start + np.arange(len(found))
        _replace(slot.armature, frames, _MILLIMETRES * found)


def refresh(scene: bpy.types.Scene, shot: Shot | None = None) -> None:
    """Update the suggested key frames, and the colours, from the present errors. `shot` is the scene's as it stands, if
    it has been read already.
    """
    for i, slot in enumerate(scene.kfmocap.performers):
        _write_helpful(scene, slot, None if shot is None else shot.performers[i].key_poses)
    if scene.kfmocap.show_confidence:
        show_colours(scene)


def forget(scene: bpy.types.Scene, slot: bpy.types.PropertyGroup, frames: Sequence[int]) -> None:
    """Forget the errors of scene frames that are no longer tracked, and what may be lost there."""
    lost_parts.forget(slot, frames)
    _replace(slot.armature, np.asarray(frames), None)
    _write_helpful(scene, slot)


def read_confidence(armature: bpy.types.Object, frame_start: int, length: int) -> NDArray[np.float64]:
    """Expected errors of the parts on scene frames from `frame_start` on, (F, P), metres; zero where there is none."""
    bag, bones = fcurves.find_channelbag(armature), body_armature.body_bones(armature)
    errors = np.zeros((length, len(bones)))
    for rank, bone in enumerate(bones):
        curve = bag.fcurves.find(bone_visibility.property_path(armature.pose.bones[bone.name], ERROR)) if bag else None
        if curve is not None:
            keys = fcurves.get_keys(curve, fcurves.PLACES)
            index = fcurves.frames_of(keys) - frame_start
            inside = (index >= 0) & (index < length)
            errors[index[inside], rank] = keys["co"][inside, 1] / _MILLIMETRES
    return errors


def show_colours(scene: bpy.types.Scene) -> None:
    """Colour the performers' bones and parts by their errors as the scene's properties say, or as they were again."""
    properties = scene.kfmocap
    limit = properties.confidence_limit if properties.show_confidence else None
    for slot in properties.performers:
        armature = slot.armature
        if armature is None:
            continue
        for bone in armature.pose.bones:
            _colour_bone(bone, limit)
        for part in armature.children:
            bone = armature.pose.bones.get(part.parent_bone)
            if bone is not None and part.type == "MESH":
                _drive(part, "color", bone, limit)
                if limit is None:
                    part.color = WHITE


def outline_colour(scene: bpy.types.Scene, slot: bpy.types.PropertyGroup, posed: bpy.types.PoseBone) -> Colour:
    """Return the colour of an evaluated bone's part as an outline: of its expected error, where that is shown, else its
    side's or in the middle the performer's.
    """
    if scene.kfmocap.show_confidence and posed.color.palette == "CUSTOM":
        return (*posed.color.custom.normal, 1.0)
    return colour_of(posed.name, slot.colour)


def _replace(armature: bpy.types.Object, frames: NDArray[np.int64], errors: NDArray[np.float64] | None) -> None:
    """Put errors (F, P), mm, or nothing in place of those of scene frames (F,)."""
    bag = fcurves.ensure_channelbag(armature, armature.name)
    for rank, rest in enumerate(body_armature.body_bones(armature)):
        bone = armature.pose.bones[rest.name]
        curve = fcurves.ensure_fcurve(bag, bone_visibility.property_path(bone, ERROR), 0, bone.name)
        old = fcurves.get_keys(curve)
        kept = [old[~fcurves.are_among(fcurves.frames_of(old), frames)]]
        if errors is not None:
            bone[ERROR] = float(errors[0, rank])
            bone.id_properties_ui(ERROR).update(min=0.0, soft_max=100.0, precision=1, description=_DESCRIPTION)
            kept.append(fcurves.new_keys(frames, errors[:, rank], "GENERATED", "LINEAR"))
        fcurves.set_keys(curve, kept, before=old)
        curve.lock = True  # so that moving keys in the timeline leaves it alone


def _write_helpful(scene: bpy.types.Scene, slot: bpy.types.PropertyGroup, keys: KeyPoses | None = None) -> None:
    start, length = scene.kfmocap.frame_start, scene.kfmocap.length
    bones = body_armature.body_bones(slot.armature)
    names = [bone.name for bone in bones]
    errors = read_confidence(slot.armature, start, length)
    slot.helpful.clear()
    if keys is None:
        keys = key_pose_curves.read_key_poses(slot.armature, start, length)
    unknown = [names.index(name) for name in unknown_bones.unknown_bones(slot.armature)]
    for key in suggest_keys_by_error(errors, keys, body_armature.parents_of(bones), unknown):
        item = slot.helpful.add()
        item.name = ", ".join(names[part] for part in key.parts)
        item.frame = start + key.frame
        item.error, item.gain = _MILLIMETRES * key.worst, _MILLIMETRES * key.gain


def _colour_bone(bone: bpy.types.PoseBone, limit: float | None) -> None:
    """Colour a bone by its expected error, unless the animator has given it a colour."""
    ours = _drive(bone.id_data, f"{bone.path_from_id()}.color.custom.normal", bone, None)
    if ours:
        bone.color.palette = "DEFAULT"
    if limit is not None and ERROR in bone and bone.color.palette == "DEFAULT":
        bone.color.palette = "CUSTOM"
        bone.color.custom.select, bone.color.custom.active = (1.0, 1.0, 1.0), (0.8, 1.0, 1.0)
        _drive(bone.id_data, f"{bone.path_from_id()}.color.custom.normal", bone, limit)


def _drive(owner: bpy.types.Object, path: str, bone: bpy.types.PoseBone, limit: float | None) -> bool:
    """Drive a colour by a bone's properties; without a limit it is driven no more. Tells whether it was driven."""
    data = owner.animation_data
    driven = data is not None and data.drivers.find(path) is not None
    unknown = bool(bone.get(unknown_bones.UNKNOWN, 0))
    for channel, (ramp, hidden) in enumerate(zip(_COLOUR_RAMP, _HIDDEN_COLOUR, strict=True)):
        if driven:
            owner.driver_remove(path, channel)
        if limit is not None and ERROR in bone:
            driver = owner.driver_add(path, channel).driver
            driver.type = "SCRIPTED"  # Blender evaluates as simple an expression as this without Python
            seen = f"{ramp.format(limit=f'{limit:.3f}')} if v else {hidden}"
            driver.expression = str(_UNKNOWN[channel]) if unknown else seen
            for name, prop in (("e", ERROR), ("v", bone_visibility.VIEWS)):
                variable = driver.variables.new()
                variable.name, variable.targets[0].id = name, bone.id_data
                variable.targets[0].data_path = bone_visibility.property_path(bone, prop)
    return driven
