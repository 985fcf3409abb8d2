"""Recovering footage that was moved, cameras and bodies that were deleted, and those that are hidden."""

from __future__ import annotations

from pathlib import Path

import bpy

from ....core.errors import BodyError, ShotError
from ...scene_io import active_performer, visibility
from ..conditions import Conditional
from ..mixin import FileReader, OfPerformer
from .add_footage import IMAGES, VIDEOS, globbed


def _misses_footage(context: bpy.types.Context) -> str:
    return "" if any(view.missing for view in context.scene.kfmocap.views) else "No footage is missing"


class RelinkFootage(Conditional, FileReader, bpy.types.Operator):
    """Find footage that was moved: choose the folder where it is now. All that is missing is looked for there and in
    the folders below, by the names of its files. Where one view alone misses its footage, any video can be chosen"""

    bl_idname = "kfmocap.relink_footage"
    bl_label = "Relink"
    conditions = (_misses_footage,)

    filepath: bpy.props.StringProperty(
        subtype="FILE_PATH", name="Folder", description="Where the footage is now", options={"SKIP_SAVE"}
    )
    filter_glob: bpy.props.StringProperty(default=globbed(f"{VIDEOS};{IMAGES}"), options={"HIDDEN"})

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if bpy.data.filepath:
            self.filepath = bpy.path.abspath("//")  # otherwise Blender proposes the name of its own file
        return set(super().invoke(context, event))

    def read(self, context: bpy.types.Context, path: Path) -> None:
        from ...scene_io.cameras import missing_footage

        found, missing = missing_footage.relink(context.scene, path)
        if missing:
            self.report({"WARNING"}, f"Still missing: the footage of {', '.join(missing)}")
        self.report({"INFO"}, f"Found the footage of {', '.join(found)}")


def _has_lost_camera(context: bpy.types.Context) -> str:
    views = context.scene.kfmocap.views
    lost = any(view.can_be_restored for view in views)
    return "" if lost else "No camera was deleted that could be brought back"


class RestoreCamera(Conditional, bpy.types.Operator):
    """Bring back a view's camera that was deleted from the scene, with its calibration and the footage behind it"""

    bl_idname = "kfmocap.restore_camera"
    bl_label = "Bring Back"
    conditions = (_has_lost_camera,)

    view: bpy.props.IntProperty(min=0, name="View", description="Number of the view, from 0")

    def act(self, context: bpy.types.Context) -> None:
        from ...scene_io import added_views

        views = context.scene.kfmocap.views
        if self.view >= len(views) or not views[self.view].can_be_restored:
            raise ShotError(f"View {self.view} has no camera that could be brought back")
        added_views.restore_camera(context.scene, views[self.view])


def _has_lost_body(context: bpy.types.Context) -> str:
    slots = context.scene.kfmocap.performers
    lost = [
        slot for slot in slots if slot.armature is not None and not active_performer.is_present(context.scene, slot)
    ]
    return "" if lost else "No body was deleted that could be brought back"


class RestoreBody(Conditional, OfPerformer, bpy.types.Operator):
    """Bring back a performer's armature that was deleted from the scene, with its keys"""

    bl_idname = "kfmocap.restore_body"
    bl_label = "Bring Back"
    conditions = (_has_lost_body,)

    def act(self, context: bpy.types.Context) -> None:
        from ...scene_io import performers

        slot = self.slot(context)
        if slot.armature is None:
            raise BodyError(f"Performer {self.performer} has no armature that could be brought back")
        performers.restore(context.scene, slot)


def _has_hidden(context: bpy.types.Context) -> str:
    shot = context.scene.kfmocap
    owned = [*(view.camera for view in shot.views), *(slot.armature for slot in shot.performers)]
    hidden = any(thing is not None and visibility.is_hidden(context, thing) for thing in owned)
    return "" if hidden else "Nothing is hidden"


class ShowHidden(Conditional, bpy.types.Operator):
    """Show a hidden camera, behind which the footage is, or a hidden body: also if its collection or its object
    type is hidden, or a local view leaves it out"""

    bl_idname = "kfmocap.show_hidden"
    bl_label = "Show"
    conditions = (_has_hidden,)

    hidden: bpy.props.StringProperty(name="Hidden", description="Name of the camera or armature")

    def act(self, context: bpy.types.Context) -> None:
        thing: bpy.types.Object | None = context.scene.objects.get(self.hidden)
        if thing is None:
            raise ShotError(f"There is no object '{self.hidden}' in the scene")
        visibility.show(context, thing)


CLASSES = (RelinkFootage, RestoreCamera, RestoreBody, ShowHidden)
