"""Which objects a field of a panel may point to."""

import bpy

LIVE_CHANGES = "kfmocap_changed"
"""Property that marks the hidden armature through which a character follows live, and holds what has changed for it."""


def is_camera(_self: bpy.types.PropertyGroup, candidate: bpy.types.Object) -> bool:
    """A camera object."""
    return candidate.type == "CAMERA"


def is_armature(_self: bpy.types.PropertyGroup, candidate: bpy.types.Object) -> bool:
    """An armature object of the user's."""
    return candidate.type == "ARMATURE" and LIVE_CHANGES not in candidate


def is_character(self: bpy.types.PropertyGroup, candidate: bpy.types.Object) -> bool:
    """An armature that motion can be sent to: not the one whose motion that is, chosen or as the only performer."""
    performers = [slot.armature for slot in self.id_data.kfmocap.performers]
    sources = [self.source] if self.source is not None else performers if len(performers) == 1 else []
    return is_armature(self, candidate) and candidate not in sources


def chosen_character(scene: bpy.types.Scene) -> bpy.types.Object | None:
    """Return the character that motion is sent to: the one that is chosen, or else the only other armature."""
    settings = scene.kfmocap.retarget
    if settings.target is not None:
        return settings.target
    bodies = [slot.armature for slot in scene.kfmocap.performers]
    others = [thing for thing in scene.objects if thing not in bodies and is_character(settings, thing)]
    return others[0] if len(others) == 1 else None


def is_performer(self: bpy.types.PropertyGroup, candidate: bpy.types.Object) -> bool:
    """The body of one of the performers of the scene."""
    return any(slot.armature == candidate for slot in self.id_data.kfmocap.performers)
