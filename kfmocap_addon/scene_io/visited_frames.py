"""Going through frames of a scene, and back to the time that was shown."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import bpy

_POSED = ("location", "rotation_quaternion", "rotation_euler", "scale")


@contextlib.contextmanager
def same_time(scene: bpy.types.Scene) -> Iterator[None]:
    """Restore the frame, or the time between two, after the block has visited others."""
    frame, part = scene.frame_current, scene.frame_subframe
    try:
        yield
    finally:
        scene.frame_set(frame, subframe=part)


@contextlib.contextmanager
def same_time_and_poses(scene: bpy.types.Scene) -> Iterator[None]:
    """Restore poses that have not been keyed as well."""
    bones = [bone for thing in scene.objects if thing.pose for bone in thing.pose.bones]
    posed = [(bone, name, getattr(bone, name).copy()) for bone in bones for name in _POSED]
    try:
        with same_time(scene):
            yield
    finally:
        for bone, name, value in posed:
            setattr(bone, name, value)
