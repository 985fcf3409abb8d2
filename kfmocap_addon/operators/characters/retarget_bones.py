"""The bone map of a character: finding it, listing it for editing, saving and loading it."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy_extras.io_utils import ExportHelper

from ...properties.pointer_polls import chosen_character
from ..conditions import Conditional
from ..mixin import FileReader


def has_character(context: bpy.types.Context) -> str:
    """A character is chosen, or is the only other armature."""
    return "" if chosen_character(context.scene) is not None else "Choose the character's armature first"


def has_list(context: bpy.types.Context) -> str:
    """Bones are listed."""
    return "" if context.scene.kfmocap.retarget.bones else "Find the bones first"


class FindBones(Conditional, bpy.types.Operator):
    """List which bones of the character play which roles, by the preset, by their names or by their places. Correct the
    list where it is wrong: it is used instead of the preset"""

    bl_idname = "kfmocap.find_bones"
    bl_label = "Find Bones"
    conditions = (has_character,)

    def act(self, context: bpy.types.Context) -> None:
        from ...retargeting import listed_bones, target_armatures

        settings = context.scene.kfmocap.retarget
        preset = None if settings.preset == "auto" else settings.preset
        settings.target = chosen_character(context.scene)
        bones, other_hips = target_armatures.moved_bones(settings.target, preset)
        listed_bones.list_bones(settings, bones)
        how = f"preset {bones.preset}" if bones.preset else f"their {bones.found_by}"
        self.report({"INFO"}, f"{len(bones.names())} bones by {how}")
        for text in other_hips:
            self.report({"WARNING"}, text)


class ForgetBones(Conditional, bpy.types.Operator):
    """Empty the list of bones: they are found again when motion is sent"""

    bl_idname = "kfmocap.forget_bones"
    bl_label = "Forget Bones"
    conditions = (has_list,)

    def act(self, context: bpy.types.Context) -> None:
        context.scene.kfmocap.retarget.bones.clear()


class SaveBoneMap(Conditional, bpy.types.Operator, ExportHelper):
    """Write the list of bones to a file, for other scenes and for the command line"""

    bl_idname = "kfmocap.save_bone_map"
    bl_label = "Save Bone Map"
    bl_options = {"REGISTER"}
    conditions = (has_list,)

    filename_ext = ".json"
    filepath: bpy.props.StringProperty(subtype="FILE_PATH", name="Bone Map", description="The file to write (.json)")
    filter_glob: bpy.props.StringProperty(default="*.json", options={"HIDDEN"})

    def act(self, context: bpy.types.Context) -> None:
        from ....core.formats.bone_map_files import write_bone_map
        from ...retargeting.listed_bones import listed_map

        bones = listed_map(context.scene.kfmocap.retarget)
        write_bone_map(Path(bpy.path.abspath(self.filepath)), bones.bones, bones.preset)


class LoadBoneMap(FileReader, bpy.types.Operator):
    """Read the list of bones from a file"""

    bl_idname = "kfmocap.load_bone_map"
    bl_label = "Load Bone Map"

    filepath: bpy.props.StringProperty(subtype="FILE_PATH", name="Bone Map", description="A bone map (.json)")
    filter_glob: bpy.props.StringProperty(default="*.json", options={"HIDDEN"})

    def read(self, context: bpy.types.Context, path: Path) -> None:
        from ...retargeting import listed_bones

        listed_bones.list_bones(context.scene.kfmocap.retarget, listed_bones.read_map(path))


CLASSES = (FindBones, ForgetBones, SaveBoneMap, LoadBoneMap)
