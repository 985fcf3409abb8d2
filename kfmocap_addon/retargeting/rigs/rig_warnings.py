"""Warnings about a rig that a motion was sent to: what it cannot do, and what was changed for it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import bpy
import numpy as np

from ....core.retargeting.bone_matching import sides_exchanged
from ....core.retargeting.control_rig import ControlRig
from ....core.retargeting.rest_poses.rest_alignment import feet_point_back
from ....core.retargeting.retarget import upright_turn
from ...scene_io.characters.object_motion import what_moves
from .held_bones import Driver
from .rig_settings import Owner, owner_of, setting_name

_TURNED, _SHIFTED = 1.0, 10.0  # degrees, and millimetres on a character of the performer's size, from which it is said
_SCALE_TOLERANCE = 1e-3  # difference of a bone's scales from which it is said


def standing_wrongly(armature: bpy.types.Object, rig: ControlRig) -> list[str]:
    """Return warnings about the rest pose of a rig: that it lies down, or that its sides are exchanged."""
    found = []
    if not np.array_equal(upright_turn(rig.rest, rig.bones), np.eye(3)):
        found.append(
            f"armature {armature.name}: it does not stand upright at rest, so its size and its feet are not exact: "
            "turn it upright, and apply its rotation (Ctrl A)"
        )
    if feet_point_back(rig.rest, rig.bones):
        found.append(
            "the feet point backward: if left and right are named as seen from the front, exchange them in the list of "
            "Find Bones, or in a bone map"
        )
    elif rig.bones.found_by != "file" and sides_exchanged(rig.bones):
        found.append(
            "left and right are exchanged, as the names of bones have the toes behind the feet: exchange them back in "
            "the list of Find Bones, or in a bone map, if that is wrong"
        )
    return found


def moving_as_a_whole(scene: bpy.types.Scene, armature: bpy.types.Object, frames: tuple[int, int]) -> list[str]:
    """Return a warning where something moves the armature object besides the motion of its bones."""
    moving = what_moves(scene, armature, frames)
    if moving is None:
        return []
    return [
        f"armature {armature.name}: {moving} moves it as a whole, and the motion is added to that: free it, if the "
        "motion is that in the world"
    ]


def set_elsewhere(armature: bpy.types.Object, settings: Mapping[tuple[Owner, str], Any]) -> list[str]:
    """Return what to report of settings that the armature's action cannot include."""
    return [
        f"{setting_name(name)}: its property '{key}' is {float(owner_of(armature, name)[key]):g} now: the limb is "
        "turned by FK controls"
        for name, key in settings
        if owner_of(armature, name).id_data != armature
    ]


def connections(connected: Mapping[str, bool]) -> list[str]:
    """Return what to report of bones that were connected to the one above, and of those that still are."""
    kept = (
        "it is connected to the bone above, which keeps it in place: disconnect it in the character's own file (Alt P)"
    )
    freed = "it was connected to the bone above, which kept it from moving, and is no longer"
    return [f"bone {name}: {kept if still else freed}" for name, still in connected.items()]


def undriven(muted: Sequence[Driver]) -> list[str]:
    """Return what to report of drivers that no longer act."""
    return [
        f"bone {bone}: the driver of its {attribute.partition('_')[0]} is muted, as keys would be without effect"
        for bone, attribute in muted
    ]


def freed(armature: bpy.types.Object, holds: Mapping[tuple[str, str], float], when: str) -> list[str]:
    """Return what to report of constraints that no longer hold a rig: by bone, or by the armature that all of it
    followed.
    """
    found: dict[str, None] = {}
    for name, hold in holds:
        other = getattr(armature.pose.bones[name].constraints[hold], "target", None)
        if other is None or other == armature or other.type != "ARMATURE":
            found[f"bone {name}: its constraint '{hold}' has no influence {when}"] = None
        else:
            found[
                f"armature {armature.name}: its bones do not follow {other.name} {when}: to move it through the "
                f"controls of {other.name}, send the motion to that"
            ] = None
    return list(found)


def apart(rig: ControlRig) -> list[str]:
    """Return warnings about controls that hang on nothing that carries them, for a rig that follows live: constraints
    turn them, and keys alone move them.
    """
    names = rig.rest.names
    return [
        f"bone {names[b]}: it does not hang on {names[carrier]}, and stays behind: send keys instead of following live"
        for b, carrier in rig.carriers.items()
    ]


def scaled_unevenly(armature: bpy.types.Object, rig: ControlRig) -> list[str]:
    """Return warnings about controls that are scaled by different amounts along their axes."""
    scales = {name: np.array(armature.pose.bones[name].scale) for name in rig.rest.names}
    return [
        f"bone {name}: it is scaled by different amounts along its axes, so the bones below it are not exactly in "
        "place: scale it evenly, or clear its scale (Alt S)"
        for name, scale in scales.items()
        if np.ptp(scale) > _SCALE_TOLERANCE and armature.data.bones[name].children
    ]


def not_as_asked(unsteady: tuple[str, ...], errors: Mapping[str, Mapping[str, float]], scale: float) -> list[str]:
    """Return warnings about controls that follow others, and about limbs that are not where their controls put them."""
    found = [f"bone {name} follows another control only in part: its rotation differs" for name in unsteady]
    for limb, error in errors.items():
        off = f"{error['worst_degrees']:.1f} degrees" if error["worst_degrees"] > _TURNED else ""
        if not off and error["worst_mm"] > _SHIFTED * scale:
            off = f"{error['worst_mm']:.0f} mm"
        if off:
            found.append(f"{limb}: the rig is up to {off} off what its controls were given")
    return found
