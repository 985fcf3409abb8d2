"""The baseline without the tracker: Blender's own curves through the key poses."""

from __future__ import annotations

import bpy

from ..core.body.motion import Motion
from ..core.shot.shot import Performer
from ..kfmocap_addon.scene_io.body import body_armature
from ..kfmocap_addon.scene_io.keys import key_pose_curves, motion_curves


def interpolated(performer: Performer, length: int) -> Motion:
    """Return the key poses interpolated by Blender's default curves: Bezier keys with auto-clamped handles.

    Blender's open file is closed.
    """
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    armature = body_armature.build_armature(performer.body, performer.name, bpy.context.scene.collection)
    key_pose_curves.write_key_poses(armature, performer.key_poses, 0)
    return motion_curves.read_motion(armature, 0, length)
