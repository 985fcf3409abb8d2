"""Parts of a character's skin that stay in place while its hips go away."""

from __future__ import annotations

import bpy
import numpy as np

from ....core.errors import listed
from ....core.numerics.arrays import Array, Ints
from ....core.retargeting.control_rig import ControlRig, RigPoses
from ...scene_io.characters.skinned_parts import leading_bones
from ...scene_io.characters.skins import unbound_vertices
from ...scene_io.visited_frames import same_time
from .rig_at_rest import evaluated
from .rig_error import world_matrices

_AWAY = 0.2
"""How far the hips must go for a warning, in heights of the character."""
_STILL = 0.01
"""Share of the way of the hips that bones which stay behind may move."""
_NAMED = 3


def left_behind(
    scene: bpy.types.Scene, armature: bpy.types.Object, rig: ControlRig, poses: RigPoses, frames: Ints
) -> list[str]:
    """Return warnings about skin that stays in place while the hips go away: that of bones which do not move, such as a
    board on the root of a character who stands on it, and vertices that belong to no bone. Bones below one that moves,
    such as a foot that stands, are not meant.

    Parameters
    ----------
    frames : ndarray of int, shape (F,)
        Scene frames of the poses.
    """
    way = np.linalg.norm(poses.places[:, rig.index("hips")] - poses.places[0, rig.index("hips")], axis=1)
    farthest = int(way.argmax())
    if way[farthest] < _AWAY * np.ptp(rig.rest.heads[:, 2]):
        return []
    bones = list(armature.data.bones)
    first, last = _heads(scene, armature, [bone.name for bone in bones], frames[[0, farthest]])
    ways = np.linalg.norm(last - first, axis=1)
    still = {bone.name for bone, own in zip(bones, ways, strict=True) if own < _STILL * way[farthest]}
    still -= {bone.name for bone in bones if any(above.name not in still for above in bone.parent_recursive)}
    led = set(leading_bones(armature)) if still else set()
    staying = [bone.name for bone in bones if bone.use_deform and bone.name in still & led]
    moved = f"while the hips move by {way[farthest]:.1f} m"
    found = [
        f"mesh {mesh}: {count} of its vertices belong to no bone that deforms, so they stay where they are {moved}: "
        "weight them, or delete them"
        for mesh, count in unbound_vertices(armature).items()
    ]
    if staying:
        what = "bone" if len(staying) == 1 else "bones"
        found.append(
            f"{what} {listed(staying, _NAMED)}: no part of what moves, so the skin stays where it is {moved}: choose "
            "another bone for the hips in the list of Find Bones, or key it yourself"
        )
    return found


def _heads(scene: bpy.types.Scene, armature: bpy.types.Object, names: list[str], frames: Ints) -> list[Array]:
    """Return where the heads of bones are shown on scene frames, (B, 3) each."""
    found = []
    with same_time(scene), evaluated(armature):
        for frame in frames.tolist():
            scene.frame_set(frame)
            found.append(world_matrices(armature, names)[1])
    return found
