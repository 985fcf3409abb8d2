"""Reading motion files: BVH with the core's reader, FBX with Blender's importer."""

from __future__ import annotations

import math
from pathlib import Path

import bpy

from ...core.body.skeleton_motion import SkeletonMotion
from ...core.errors import BodyError, ShotError
from ...core.formats.bvh import read_bvh
from ...core.retargeting.bone_roles.roles import BoneMap
from ..scene_io.body import body_armature
from .imported_files import import_alone
from .source_motion import motion_of_armature
from .target_armatures import target_bones


def read_motion(path: Path, bones: BoneMap | None = None) -> tuple[SkeletonMotion, BoneMap | None]:
    """Read a motion; returns the roles of its bones as well if they are given, or had to be found.

    An FBX file is imported into an empty file of Blender, which replaces the one that is open.

    Parameters
    ----------
    path : Path
        A .bvh or .fbx file.
    bones : BoneMap, optional
        Roles of its bones; by default they are found.

    Raises
    ------
    ShotError
        It cannot be read, or has no motion.
    BodyError
        It is not human.
    """
    kind = path.suffix.lower()
    if kind == ".bvh":
        return read_bvh(path), bones
    if kind != ".fbx":
        raise ShotError("it is no motion file", where=str(path), todo="give a .bvh or an .fbx file")
    import_alone(path)
    armature = _moving_human(path, bones)
    with body_armature.edit_bones(armature) as edited:
        for bone in edited:
            bone.use_connect = False  # the importer connects a lone child to its parent, and its way would be lost
    span = armature.animation_data.action.frame_range
    frames = math.ceil(span[0] - 1e-3), math.floor(span[1] + 1e-3)
    motion, found = motion_of_armature(bpy.context.scene, armature, frames, bones)
    return motion, found


def _moving_human(path: Path, bones: BoneMap | None) -> bpy.types.Object:
    """Return the moving human armature of a file just imported."""
    moving = [o for o in bpy.data.objects if o.type == "ARMATURE" and o.animation_data and o.animation_data.action]
    if not moving:
        raise ShotError("it holds no skeleton that moves", where=str(path), todo="export it with its animation")
    if len(moving) == 1 or bones is not None:
        return moving[0]
    for armature in moving:
        try:
            target_bones(armature)
        except BodyError:
            continue
        return armature
    raise BodyError("none of its skeletons is a human's", where=str(path), todo="give a bone map with --source-map")
