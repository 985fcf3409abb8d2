"""Export: the performers' motion as BVH and FBX."""

from pathlib import Path

import bpy

from .reporting import explained, reported


class Export(bpy.types.Operator):
    """Write every performer's motion over the frames of the shot as BVH and FBX, in metres"""

    bl_idname = "kfmocap.export"
    bl_label = "Export"
    bl_options = {"REGISTER"}

    directory: bpy.props.StringProperty(
        subtype="DIR_PATH", name="Folder", description="Where the files go; they take the shot's name"
    )
    bvh: bpy.props.BoolProperty(default=True, name="BVH", description="Skeleton and motion as text, Y up")
    fbx: bpy.props.BoolProperty(default=True, name="FBX", description="Skeleton and motion for other programs, Y up")

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return explained(cls, context)

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        from .. import export

        with reported(self) as outcome:
            folder = Path(bpy.path.abspath(self.directory))
            written = export.export_performers(context.scene, folder, bvh=self.bvh, fbx=self.fbx)
            self.report({"INFO"}, f"Wrote {', '.join(path.name for path in written)} to {folder}")
        return outcome.value


CLASSES = (Export,)
