"""Landmarks for the body that a human character's armature becomes."""

from __future__ import annotations

from dataclasses import replace

import bpy
import numpy as np

from ....core.body import Body
from ....core.errors import BodyError
from ....core.retargeting.bone_roles.roles import BoneMap
from ....core.retargeting.human_landmarks import human_landmarks
from ...scene_io.body import armature_landmarks, body_armature
from ..target_armatures import target_bones
from .part_roles import PART_ROLES
from .rigify_animals import goes_on_four

_MAX_START_DISTANCE = 0.02
"""Share of a body's height within which a part begins where a bone does, which it then stands for."""


def add_landmarks(armature: bpy.types.Object) -> None:
    """Store landmarks for an armature that carries the parts of a body, if it is human and has none."""
    if armature_landmarks.has_landmarks(armature):
        return
    try:
        roles = target_bones(armature)
    except BodyError:
        return
    if {"hand.L", "hand.R"} <= set(roles.bones) and goes_on_four(armature, roles):
        return
    body = body_armature.body_from_armature(armature)
    if landmarks := human_landmarks(body, _parts(armature, body, roles)):
        armature_landmarks.keep_landmarks(armature, replace(body, landmarks=landmarks))


def _parts(armature: bpy.types.Object, body: Body, roles: BoneMap) -> dict[str, int]:
    """Return the part of each role: that of its bone, or one that begins where its bone does, such as a control's. Hips
    whose bone leads no skin are the topmost part.
    """
    R, place, scale = body_armature.object_pose(armature)
    heads = np.array([part.head_world for part in body.parts])
    near = _MAX_START_DISTANCE * float(np.ptp(heads, axis=0).max())
    found: dict[str, int] = {}
    for role, number, name in roles.items():
        if number or role.partition(".")[0] not in PART_ROLES:
            continue
        if name in body.names:
            found[role] = body.index(name)
            continue
        head = scale * R @ np.array(armature.data.bones[name].head_local) + place
        apart = np.linalg.norm(heads - head, axis=1)
        if apart.min() < near:
            found[role] = int(apart.argmin())
    return {"hips": body.parents.index(-1)} | found
