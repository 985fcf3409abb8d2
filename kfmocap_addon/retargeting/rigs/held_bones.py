"""Constraints that hold the controls of a rig: taken away while the controls are posed, and given back."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import bpy

from .rig_at_rest import update

_HOLDS = (
    "IK",
    "COPY_ROTATION",
    "COPY_TRANSFORMS",
    "DAMPED_TRACK",
    "LOCKED_TRACK",
    "TRACK_TO",
    "STRETCH_TO",
    "LIMIT_ROTATION",
    "LIMIT_LOCATION",
)
"""Kinds of constraints that set the rotation of the bones that they act on, or clip their rotation or their way."""


@contextmanager
def without_holds(armature: bpy.types.Object, controls: Sequence[str]) -> Iterator[dict[tuple[str, str], float]]:
    """Take the influence of constraints that pose controls in their owner's stead; after an error they have it again.

    Gives what they had, by bone and constraint. Inverse kinematics acts from the bone that ends its chain, which
    may be below the controls.
    """
    before = {}
    for bone in armature.pose.bones:
        for constraint in list[Any](bone.constraints):
            poses = [bone.name]
            if constraint.type == "IK":
                chain = [bone, *bone.parent_recursive]
                poses = [one.name for one in chain[: constraint.chain_count or len(chain)]]
            holds = constraint.type in _HOLDS and not constraint.mute and constraint.influence > 0
            if holds and set(poses) & set(controls):
                before[bone.name, constraint.name] = constraint.influence
                constraint.influence = 0.0
    update()
    try:
        yield before
    except BaseException:
        restore_holds(armature, before)
        raise


def restore_holds(armature: bpy.types.Object, before: Mapping[tuple[str, str], float]) -> None:
    """Give constraints the influence that they had, by bone and constraint, where they are still there."""
    for (name, held_by), influence in before.items():
        bone: Any = armature.pose.bones.get(name)
        constraint = None if bone is None else bone.constraints.get(held_by)
        if constraint is not None:
            constraint.influence = influence
