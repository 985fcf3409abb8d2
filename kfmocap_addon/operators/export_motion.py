"""Export: the performers' motion as BVH and FBX."""

from pathlib import Path

import bpy

from .conditions import Conditional, has_shot
from .reporting import reported


def _has_file_kind(context: bpy.types.Context) -> str:
    settings = context.scene.kfmocap.export
    return "" if settings.bvh or settings.fbx else "Choose BVH, FBX or both"


class Export(Conditional, bpy.types.Operator):
    """Write every performer's motion as BVH and FBX, as the settings in the panel say"""

    bl_idname = "kfmocap.export"
    bl_label = "Export"
    bl_options = {"REGISTER"}
    conditions = (has_shot, _has_file_kind)

    directory: bpy.props.StringProperty(
        subtype="DIR_PATH", name="Folder", description="Where the files go; they take the shot's name"
    )

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        from ..export import exporters

        with reported(self) as outcome:
            folder = Path(bpy.path.abspath(self.directory))
            settings = context.scene.kfmocap.export
            options = exporters.ExportOptions(
                settings.preset,
                settings.bvh,
                settings.fbx,
                (settings.first, settings.last) if settings.use_range else None,
                settings.fps if settings.use_rate else None,
                settings.root_motion,
            )
            written = exporters.export_performers(context.scene, folder, options)
            self.report({"INFO"}, f"Wrote {', '.join(path.name for path in written)} to {folder}")
        return outcome.value


CLASSES = (Export,)
