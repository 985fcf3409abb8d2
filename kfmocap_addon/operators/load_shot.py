"""Load Shot: a shot file becomes a scene."""

import bpy
from bpy_extras.io_utils import ImportHelper

from ..viewports import screens
from .reporting import reported


class LoadShot(bpy.types.Operator, ImportHelper):
    """Show a shot file in a new scene: cameras with their footage, bodies, and key poses"""

    bl_idname = "kfmocap.load_shot"
    bl_label = "Load Shot"
    bl_options = {"REGISTER", "UNDO"}

    filepath: bpy.props.StringProperty(subtype="FILE_PATH", name="Shot", description="The shot file (.toml)")
    filter_glob: bpy.props.StringProperty(default="*.toml", options={"HIDDEN"})

    def execute(self, context: bpy.types.Context) -> set[str]:
        from ...core.tracking.prepare import load_shot
        from ..scene_io import scene as scenes

        with reported(self) as outcome:
            shot = load_shot(bpy.path.abspath(self.filepath))
            scene = scenes.build_scene(shot)
            if context.window is not None:
                context.window.scene = scene
                for slot in scene.kfmocap.performers:  # Blender 4.5 applies their curves only when the frame changes
                    slot.armature.update_tag(refresh={"TIME"})
                scene.view_layers[0].update()
                screens.look(context)
                screens.show_keys(context)
            self.report({"INFO"}, f"{shot.name}: {len(shot.views)} views, {shot.length} frames")
        return outcome.value


def add_to_menu(self: bpy.types.Menu, _context: bpy.types.Context) -> None:
    """Draw the entry of the menu File > Import."""
    self.layout.operator(LoadShot.bl_idname, text="KF Mocap Shot (.toml)")


MENUS = (("TOPBAR_MT_file_import", add_to_menu),)
CLASSES = (LoadShot,)
