"""What the cameras saw of each part, in the scene: on every pose bone the number of cameras that see it, animated.

It is written by each tracking in place of the one before. It is not a channel of the body, so keys on it are not key
poses.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import bpy

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ....core.shot.shot import Performer, Shot

VIEWS = "kfmocap_views"
"""Custom property of a pose bone: the number of cameras that see the part."""
_DESCRIPTION = "Cameras that see this part on this frame, as last tracked. On frames without any its motion is a guess"


def write_occlusion(
    scene: bpy.types.Scene,
    shot: Shot,
    visible: Sequence[NDArray[np.float64]],
    first: int = 0,
    *,
    slots: Sequence[bpy.types.PropertyGroup] | None = None,
) -> None:
    """Show in a scene what the cameras saw of its performers, and which key frames would help.

    Parameters
    ----------
    shot : Shot
        As it was tracked.
    visible : sequence of ndarray, shape (V, F, P)
        Visible share of the parts of each performer.
    first : int
        Of an excerpt of the scene's shot: its first frame there. Other frames keep what was written for them.
    slots : sequence of KFMocapPerformer, optional
        Of the performers of the shot; by default all of the scene's.
    """
    from ....core.evidence.occlusion import occluded, unseen

    start = scene.kfmocap.frame_start + first
    for slot, performer, share in zip(slots or scene.kfmocap.performers, shot.performers, visible, strict=True):
        _write_views(slot.armature, ~occluded(share), scene.kfmocap, first)
        _write_suggestions(slot, performer, unseen(share), start)


def is_tracked(armature: bpy.types.Object | None) -> bool:
    """Whether a tracking has left what the cameras saw on an armature's bones."""
    return armature is not None and any(VIEWS in bone for bone in armature.pose.bones)


def hidden_parts(armature: bpy.types.Object) -> list[str]:
    """Return the names of the bones that no camera sees on the frame that is shown; of what was never tracked none."""
    return [bone.name for bone in armature.pose.bones if bone.get(VIEWS, 1) < 1]


def _write_views(
    armature: bpy.types.Object, sees: NDArray[np.bool_], shot: bpy.types.PropertyGroup, first: int
) -> None:
    """Animate the number of cameras that see each part, from sights of shape (V, F, P): keys where it changes."""
    import numpy as np

    from .. import fcurves
    from ..body import body_armature

    bag = fcurves.ensure_channelbag(armature, armature.name)
    for rank, rest in enumerate(body_armature.body_bones(armature)):
        bone, count = armature.pose.bones[rest.name], sees[..., rank].sum(axis=0)
        bone[VIEWS] = int(count[0])
        bone.id_properties_ui(VIEWS).update(min=0, max=len(sees), description=_DESCRIPTION)
        curve = fcurves.ensure_fcurve(bag, property_path(bone, VIEWS), 0, bone.name)
        counts = np.full(shot.length, len(sees))  # where nothing was tracked, nothing is known against it
        if len(count) < shot.length and len(curve.keyframe_points):
            counts[:] = [curve.evaluate(shot.frame_start + f) for f in range(shot.length)]
        counts[first : first + len(count)] = count
        changes = np.flatnonzero(np.diff(counts, prepend=-1))
        fcurves.set_keys(
            curve, [fcurves.new_keys(shot.frame_start + changes, counts[changes], "GENERATED", "CONSTANT")]
        )
        curve.lock = True  # so that moving keys in the timeline leaves it alone


def _write_suggestions(
    slot: bpy.types.PropertyGroup, performer: Performer, blind: NDArray[np.bool_], frame_start: int
) -> None:
    from ....core.review.suggestions import suggest_keys_beside_hidden

    for index in reversed(range(len(slot.suggestions))):
        if 0 <= slot.suggestions[index].frame - frame_start < len(blind):
            slot.suggestions.remove(index)
    for suggestion in suggest_keys_beside_hidden(blind, performer.key_poses):
        item = slot.suggestions.add()
        item.name = ", ".join(performer.body.names[part] for part in suggestion.parts)
        item.frame = frame_start + suggestion.frame
        item.hidden = [frame_start + frame for frame in suggestion.hidden]


def property_path(bone: bpy.types.PoseBone, name: str) -> str:
    """Return where a bone's custom property is found from its armature, as F-curves and drivers name it."""
    return f'{bone.path_from_id()}["{name}"]'
