"""Place Joints in the toolbar of the 3D view: a click on a joint in the footage begins it, on whatever frame."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import bpy

from .operators.conditions import is_placing
from .operators.footage.look_through import StepView
from .operators.posing.place_joints import PlaceJoints
from .operators.posing.set_key_pose import SetKeyPose
from .operators.tracking.go_to_frame import StepKeyPose
from .session import SESSION

if TYPE_CHECKING:
    from collections.abc import Sequence

# For mypy it is a tool; Blender shall not meet tools that are never registered.
_ToolMixin: Any = object
_CLICK: Sequence[tuple[str, dict[str, object], None]] = (
    (PlaceJoints.bl_idname, {"type": "LEFTMOUSE", "value": "PRESS"}, None),
)


class _PlaceJointsTool(_ToolMixin):
    bl_space_type = "VIEW_3D"
    bl_idname = "kfmocap.place_joints_tool"
    bl_label = "Place Joints"
    bl_description = "Click joints in the footage: the body follows every click. Enter keys the pose, Esc cancels"
    bl_icon = "ops.armature.extrude_cursor"
    bl_cursor = "CROSSHAIR"
    bl_keymap = _CLICK

    @staticmethod
    def draw_settings(context: bpy.types.Context, layout: bpy.types.UILayout, _tool: bpy.types.WorkSpaceTool) -> None:
        """Draw in the header what the tool needs, or what goes with it."""
        hint = "Enter keys the pose, Esc cancels" if is_placing(context) else PlaceJoints.missing(context)
        if hint:
            layout.label(text=hint, icon="INFO")
            return
        row = layout.row(align=True)
        row.operator(StepView.bl_idname, text="", icon="TRIA_LEFT").step = -1
        row.operator(StepView.bl_idname, text="", icon="TRIA_RIGHT").step = 1
        row = layout.row(align=True)
        row.operator(StepKeyPose.bl_idname, text="", icon="PREV_KEYFRAME").backward = True
        row.operator(SetKeyPose.bl_idname, text="", icon="KEY_HLT")
        row.operator(StepKeyPose.bl_idname, text="", icon="NEXT_KEYFRAME").backward = False


class PlaceJointsInObjectMode(_PlaceJointsTool, bpy.types.WorkSpaceTool):
    """The tool where objects are selected."""

    bl_context_mode = "OBJECT"


class PlaceJointsInPoseMode(_PlaceJointsTool, bpy.types.WorkSpaceTool):
    """The tool where bones are selected: these alone are posed and keyed."""

    bl_context_mode = "POSE"


TOOLS = (PlaceJointsInObjectMode, PlaceJointsInPoseMode)


def register() -> None:
    """Add the tool to the toolbars; without key configurations Blender has no place for its click."""
    if bpy.context.window_manager.keyconfigs.addon is not None:
        for tool in TOOLS:
            bpy.utils.register_tool(tool, separator=True)
            SESSION.on_end(bpy.utils.unregister_tool, tool)
