"""Export: the performers' motion as files for other programs."""

import shutil
import sys
from pathlib import Path

import bpy

from ....core.errors import OutputError, ShotError
from ...export.export_formats import chosen_formats
from ..conditions import Conditional, has_shot


def _has_format(context: bpy.types.Context) -> str:
    return "" if chosen_formats(context.scene.kfmocap.export) else "Choose what kind of files to write"


class Export(Conditional, bpy.types.Operator):
    """Write every performer's motion, or the character's, as the kinds of files that are chosen in the panel"""

    bl_idname = "kfmocap.export"
    bl_label = "Export"
    conditions = (has_shot, _has_format)

    directory: bpy.props.StringProperty(subtype="DIR_PATH", name="Folder", description="Where the files go")
    filename: bpy.props.StringProperty(
        subtype="FILE_NAME",
        name="Name",
        description="Name of the files, without an ending; by default the shot's",
    )

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        from ...export import destinations

        proposed = destinations.proposed(context.scene)
        self.directory, self.filename = f"{proposed.parent}/", proposed.name
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def draw(self, context: bpy.types.Context) -> None:
        """In the file browser: what will be written, and what of it replaces a file."""
        from ...export import destinations

        column = self.layout.column(align=True)
        try:
            paths = destinations.paths(context.scene, self._folder(), self.filename)
        except ShotError:
            column.label(text="This name cannot be a file's", icon="ERROR")
            return
        column.label(text="Files to write")
        for path in paths:
            exists = path.exists()
            column.label(text=f"Replaces {path.name}" if exists else path.name, icon="ERROR" if exists else "FILE")

    def act(self, context: bpy.types.Context) -> None:
        from ...export.destinations import chosen, proposed
        from ...export.export_options import ExportOptions
        from ...export.exporters import export_armatures

        settings = context.scene.kfmocap.export
        if not self.directory:  # called by a script
            self.directory = f"{proposed(context.scene).parent}/"
        options = ExportOptions(
            settings.preset,
            chosen_formats(settings),
            (settings.first, settings.last) if settings.use_range else None,
            settings.fps if settings.use_rate else None,
            settings.root_motion,
            leave_out_unknown=settings.leave_out_unknown,
        )
        written = export_armatures(context.scene, chosen(context.scene), self._folder(), options, self.filename)
        settings.path = str(self._folder() / (self.filename or context.scene.kfmocap.shot))
        settings.written = "\n".join(map(str, written))
        self.report({"INFO"}, f"Wrote {', '.join(path.name for path in written)} to {self._folder()}")

    def _folder(self) -> Path:
        return Path(bpy.path.abspath(self.directory))


def _was_exported(context: bpy.types.Context) -> str:
    return "" if context.scene.kfmocap.export.written else "Nothing was exported yet"


class OpenExportFolder(Conditional, bpy.types.Operator):
    """Open the folder with the files that were written last"""

    bl_idname = "kfmocap.open_export_folder"
    bl_label = "Open Folder"
    bl_options = {"INTERNAL"}
    conditions = (_was_exported,)

    def act(self, context: bpy.types.Context) -> None:
        folder = Path(context.scene.kfmocap.export.written.splitlines()[0]).parent
        if not folder.is_dir():
            raise OutputError(f"{folder} is gone: export again")
        if sys.platform.startswith("linux") and shutil.which("xdg-open") is None:
            raise OutputError(f"This system has no xdg-open to show a folder with: the files are in {folder}")
        bpy.ops.wm.path_open(filepath=str(folder))


def add_to_menu(self: bpy.types.Menu, _context: bpy.types.Context) -> None:
    """Draw the entry of the menu File > Export."""
    self.layout.operator(Export.bl_idname, text="KF Mocap Motion")


MENUS = (("TOPBAR_MT_file_export", add_to_menu),)
CLASSES = (Export, OpenExportFolder)
