"""Armatures of the open file that motion can be sent to, and what their bones are."""

from __future__ import annotations

import bpy
import numpy as np

from ...core.errors import BodyError
from ...core.retargeting.bone_matching import match_bones, preset_of
from ...core.retargeting.bone_roles.roles import SIDES, BoneMap
from ...core.retargeting.retarget import way_up
from ..scene_io.body.body_armature import world_frame
from ..scene_io.characters.followed_bones import skeletons_following
from ..scene_io.characters.skins import read_skin
from .rigs.rig_at_rest import rest_skeleton

_BODY_SHARE = 0.05
"""Share of the skin from which on it belongs to the body, and is no board."""
_OWN_SHARE = 0.01
"""Share of the skin from which on what a bone leads itself is more than stray vertices."""


def target_bones(armature: bpy.types.Object, preset: str | None = None) -> BoneMap:
    """Return the roles of an armature's bones.

    Raises
    ------
    BodyError
        It is not human, or lacks bones of the preset.
    """
    return match_bones(rest_skeleton(armature), preset, f"armature {armature.name}")


def moved_bones(armature: bpy.types.Object, preset: str | None) -> tuple[BoneMap, tuple[str, ...]]:
    """Return the roles of an armature's bones for a motion that takes all of the body along, and what to report: where
    much of the skin hangs on a bone above the hips, such as the hindquarters of a centaur, that bone is the hips.

    Raises
    ------
    BodyError
        As `target_bones`.
    """
    bones = target_bones(armature, preset)
    hips = armature.data.bones[bones.bones["hips"][0]]
    above = [bone.name for bone in hips.parent_recursive if bone.use_deform]
    if not above or preset_of(bones).follows:
        return bones, ()
    skin, rest = read_skin(armature), rest_skeleton(armature)
    knees = rest.heads[rest.indices([bones.bones[f"shin.{side}"][0] for side in SIDES])].mean(axis=0)
    rise, (matrix, _) = way_up(rest, bones), world_frame(armature)
    heights = (skin.points @ matrix[:3, :3].T + matrix[:3, 3] - knees) @ rise
    carried = {hips.name, *(bone.name for bone in hips.children_recursive)}
    for name in reversed(above):
        hung = {name, *(bone.name for bone in armature.data.bones[name].children_recursive)} - carried
        led = np.isin(skin.leaders, [i for i, one in enumerate(skin.names) if one in hung])
        own = heights[skin.leaders == skin.names.index(name)]
        if led.sum() > _BODY_SHARE * len(led) and len(own) > _OWN_SHARE * len(led) and own.mean() > 0:
            roles = {role: played for role, played in bones.bones.items() if name not in played}
            whole = BoneMap(roles | {"hips": (name,)}, bones.preset, bones.found_by)
            said = f"bone {name}: it leads skin above {hips.name}, and moves as the hips instead"
            return whole, (f"{said}: choose another bone for the hips in the list of Find Bones if that is wrong",)
    return bones, ()


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
