"""Load Shot: a shot file becomes a scene."""

from pathlib import Path

import bpy

from ...viewports import screens, timelines
from ..mixin import FileReader


class LoadShot(FileReader, bpy.types.Operator):
    """Show a shot file in a new scene: cameras with their footage, bodies, and key poses"""

    bl_idname = "kfmocap.load_shot"
    bl_label = "Load Shot"

    filepath: bpy.props.StringProperty(subtype="FILE_PATH", name="Shot", description="The shot file (.toml)")
    filter_glob: bpy.props.StringProperty(default="*.toml", options={"HIDDEN"})

    def read(self, context: bpy.types.Context, path: Path) -> None:
        from ....core.review.pretracking_warnings import warnings_before_tracking
        from ....core.tracking.prepare import load_shot
        from ...scene_io import scene as scenes

        shot = load_shot(path)
        scene = scenes.build_scene(shot)
        if context.window is not None:
            context.window.scene = scene
            for slot in scene.kfmocap.performers:  # Blender 4.5 applies their curves only when the frame changes
                slot.armature.update_tag(refresh={"TIME"})
            scene.view_layers[0].update()
            screens.look(context)
            screens.show_footage()
            timelines.show_keys(context)
        self.report({"INFO"}, f"{shot.name}: {len(shot.views)} views, {shot.length} frames")
        for text in warnings_before_tracking(shot):
            self.report({"WARNING"}, text)


def add_to_menu(self: bpy.types.Menu, _context: bpy.types.Context) -> None:
    """Draw the entry of the menu File > Import."""
    self.layout.operator(LoadShot.bl_idname, text="KF Mocap Shot (.toml)")


MENUS = (("TOPBAR_MT_file_import", add_to_menu),)
CLASSES = (LoadShot,)
