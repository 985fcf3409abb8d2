"""Which objects a field of a panel may point to."""

import bpy


def is_camera(_self: bpy.types.PropertyGroup, candidate: bpy.types.Object) -> bool:
    """A camera object."""
    return candidate.type == "CAMERA"


def is_armature(_self: bpy.types.PropertyGroup, candidate: bpy.types.Object) -> bool:
    """An armature object."""
    return candidate.type == "ARMATURE"


def is_character(self: bpy.types.PropertyGroup, candidate: bpy.types.Object) -> bool:
    """An armature that motion can be sent to: not the one whose motion that is, chosen or as the only performer."""
    performers = [slot.armature for slot in self.id_data.kfmocap.performers]
    sources = [self.source] if self.source is not None else performers if len(performers) == 1 else []
    return is_armature(self, candidate) and candidate not in sources


def is_performer(self: bpy.types.PropertyGroup, candidate: bpy.types.Object) -> bool:
    """The body of one of the performers of the scene."""
    return any(slot.armature == candidate for slot in self.id_data.kfmocap.performers)
