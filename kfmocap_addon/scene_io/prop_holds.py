"""Props in hands: what the scene says of which prop is held by which bone, and when."""

from __future__ import annotations

from dataclasses import replace

import bpy
import numpy as np

from ...core.body.kinematics import part_poses
from ...core.shot.grips import with_grips
from ...core.shot.holds import Hold
from ...core.shot.shot import Shot
from . import hold_checks
from .body import body_armature, shown_pose


def read_holds(scene: bpy.types.Scene) -> tuple[Hold, ...]:
    """Read the holds of a scene, in frames of its shot."""
    properties, found = scene.kfmocap, []
    last = properties.length - 1
    for hold in properties.holds:
        first, end = (frame - properties.frame_start for frame in (hold.first, hold.last))
        if not hold_checks.why_unused(scene, hold):
            prop, holder = (hold_checks.slot_of(scene, owner).name for owner in (hold.prop, hold.holder))
            found.append(Hold(prop, holder, hold.bone, (max(first, 0), min(end, last))))
    return tuple(found)


def with_grips_of_scene(scene: bpy.types.Scene, shot: Shot) -> Shot:
    """Return the scene's shot with how props are held; messages count frames as the scene does.

    Raises
    ------
    ShotError
        See `core.shot.grips.with_grips`.
    """
    return replace(shot, holds=with_grips(shot.holds, shot.performers, scene.kfmocap.frame_start))


def write_holds(scene: bpy.types.Scene, shot: Shot) -> None:
    """Write the holds of a shot whose performers the scene has."""
    slots, start = scene.kfmocap.performers, scene.kfmocap.frame_start
    for hold in shot.holds:
        frames = (start + hold.frames[0], start + hold.frames[1])
        add_hold(scene, slots[hold.prop], slots[hold.holder], hold.part, frames)


def add_hold(
    scene: bpy.types.Scene,
    prop: bpy.types.PropertyGroup,
    holder: bpy.types.PropertyGroup,
    bone: str,
    frames: tuple[int, int],
) -> bpy.types.PropertyGroup:
    """Add that a performer's bone holds a prop on scene frames, first to last."""
    hold = scene.kfmocap.holds.add()
    hold.prop, hold.holder, hold.bone = prop.armature, holder.armature, bone
    hold.first, hold.last = frames
    return hold


def bone_at(prop: bpy.types.PropertyGroup, holder: bpy.types.PropertyGroup) -> str:
    """Return the bone of a performer whose part is nearest to a prop, as both are posed now.

    Raises
    ------
    BodyError
        One of them is not a performer's body.
    """
    placed = []
    for slot in (prop, holder):
        body = body_armature.body_from_armature(slot.armature)
        R, T = part_poses(body, shown_pose.read_shown_pose(slot.armature))
        placed.append([part.vertices @ R[0, i].T + T[0, i] for i, part in enumerate(body.parts)])
    thing = np.concatenate(placed[0])
    apart = [
        np.linalg.norm(points[:, None] - thing, axis=2).min() + np.linalg.norm(points.mean(axis=0) - thing.mean(axis=0))
        for points in placed[1]
    ]
    return str(body.names[int(np.argmin(apart))])
