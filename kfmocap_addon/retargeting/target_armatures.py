"""Armatures of the open file that motion can be sent to, and what their bones are."""

from __future__ import annotations

import bpy

from ...core.errors import BodyError
from ...core.retargeting.bone_matching import match_bones
from ...core.retargeting.bone_roles.roles import BoneMap
from ..scene_io.characters.followed_bones import skeletons_following
from .rigs.rig_at_rest import rest_skeleton


def target_bones(armature: bpy.types.Object, preset: str | None = None) -> BoneMap:
    """Return the roles of an armature's bones.

    Raises
    ------
    BodyError
        It is not human, or lacks bones of the preset.
    """
    return match_bones(rest_skeleton(armature), preset, f"armature {armature.name}")


def find_target(name: str | None, preset: str | None = None) -> bpy.types.Object:
    """Return the armature of the open file that motion can be sent to.

    Raises
    ------
    BodyError
        There is none with that name, none at all, or several without a name being given; names them.
    """
    overridden = [o.override_library.reference for o in bpy.data.objects if o.override_library]
    armatures = [o for o in bpy.data.objects if o.type == "ARMATURE" and o not in overridden]
    if name is not None:
        found = next((o for o in armatures if o.name == name), None)
        if found is None:
            names = ", ".join(o.name for o in armatures) or "none"
            raise BodyError(f"there is no armature '{name}'", where="--armature", todo=f"the file's are: {names}")
        return found
    if not armatures:
        raise BodyError("the file has no armature", where="--to", todo="give a file with a character")
    following = {o for other in armatures for o in skeletons_following(other)} if len(armatures) > 1 else set()
    able = [o for o in armatures if o not in following and (len(armatures) == 1 or _fits(o, preset))]
    generated = [o for o in able if "rig_id" in o.data]  # a metarig may stand beside the rig that was made of it
    able = generated if len(generated) == 1 else able
    if len(able) != 1:
        names = ", ".join(o.name for o in able or armatures)
        raise BodyError(f"{len(able)} armatures could be meant", where="--armature", todo=f"name one of: {names}")
    return able[0]


def _fits(armature: bpy.types.Object, preset: str | None) -> bool:
    try:
        target_bones(armature, preset)
    except BodyError:
        return False
    return True
