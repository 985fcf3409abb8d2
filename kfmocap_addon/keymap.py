"""Keys of the add-on in the 3D view, a pie menu, and the preferences that show them.

Blender's own keys stay as they are: all of these are held together with Ctrl and Alt, and free in Blender's keymap.
"""

from __future__ import annotations

from typing import Any

import bpy

from .operators.footage.look_through import StepView
from .operators.tracking.go_to_frame import StepKeyPose
from .session import SESSION

KEYS: tuple[tuple[str, str, dict[str, object]], ...] = (
    ("J", "kfmocap.place_joints", {}),
    ("K", "kfmocap.set_key_pose", {}),
    ("T", "kfmocap.track_here", {}),
    ("PAGE_UP", "kfmocap.step_view", {"step": -1}),
    ("PAGE_DOWN", "kfmocap.step_view", {"step": 1}),
    ("COMMA", "kfmocap.step_key_pose", {"backward": True}),
    ("PERIOD", "kfmocap.step_key_pose", {"backward": False}),
    ("N", "kfmocap.next_suggestion", {}),
    ("M", "wm.call_menu_pie", {"name": "KFMOCAP_MT_pie"}),
)
"""Key, tool and its settings."""
_NAMES = 0.2
"""Share of a row that names what its key does."""
_PACKAGE = __package__.rpartition(".kfmocap_addon")[0]


class PieMenu(bpy.types.Menu):
    """The tools that are used most, around the mouse."""

    bl_idname = "KFMOCAP_MT_pie"
    bl_label = "KF Mocap"

    def draw(self, _context: bpy.types.Context) -> None:
        """Draw the tools: left, right, below, above, then the corners."""
        pie = self.layout.menu_pie()
        pie.operator("kfmocap.step_view", text="Previous View", icon="TRIA_LEFT").step = -1
        pie.operator("kfmocap.step_view", text="Next View", icon="TRIA_RIGHT").step = 1
        pie.operator("kfmocap.track_here", icon="ARROW_LEFTRIGHT")
        pie.operator("kfmocap.place_joints", icon="OUTLINER_OB_ARMATURE")
        pie.operator("kfmocap.step_key_pose", text="Previous Key Pose", icon="PREV_KEYFRAME").backward = True
        pie.operator("kfmocap.step_key_pose", text="Next Key Pose", icon="NEXT_KEYFRAME").backward = False
        pie.operator("kfmocap.next_suggestion", icon="KEY_HLT")
        pie.operator("kfmocap.set_key_pose", icon="KEY_HLT")


class Preferences(bpy.types.AddonPreferences):
    """The add-on's keys, to be changed or turned off."""

    bl_idname = _PACKAGE

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the keys as Blender's own keymap editor does."""
        import rna_keymap_ui

        self.layout.label(text="Keys in the 3D view")
        keyconfig = context.window_manager.keyconfigs.user
        keymap: Any = keyconfig.keymaps.get("3D View")
        ours = {(key, tool) for key, tool, _ in KEYS}
        for item in keymap.keymap_items if keymap is not None else ():
            if (item.type, item.idname) in ours or item.idname.startswith("kfmocap."):
                row = self.layout.split(factor=_NAMES)
                row.label(text=name_of(item))
                rna_keymap_ui.draw_kmi([], keyconfig, keymap, item, row.column(), 0)


def name_of(item: bpy.types.KeyMapItem) -> str:
    """Return what a key does; Blender names its tool alone, which goes forward or backward."""
    properties: Any = item.properties
    if item.idname == StepView.bl_idname:
        return "Next View" if properties.step > 0 else "Previous View"
    if item.idname == StepKeyPose.bl_idname:
        return "Previous Key Pose" if properties.backward else "Next Key Pose"
    return "Pie Menu" if item.idname == "wm.call_menu_pie" else str(item.name)


CLASSES = (PieMenu, Preferences)


def register() -> None:
    """Add the keys; without a window Blender has no place for them."""
    keyconfig: Any = bpy.context.window_manager.keyconfigs.addon
    if keyconfig is None:
        return
    keymap = keyconfig.keymaps.new(name="3D View", space_type="VIEW_3D")
    for key, tool, settings in KEYS:
        item = keymap.keymap_items.new(tool, key, "PRESS", ctrl=True, alt=True)
        for name, value in settings.items():
            setattr(item.properties, name, value)
        SESSION.on_end(keymap.keymap_items.remove, item)
