"""The add-on's tools that run in Blender's windows until the user ends them."""

from __future__ import annotations

from typing import Any

import bpy

from .cameras.pick_colour import PickColour
from .job_operator import JobOperator
from .posing.place_joints import PlacingTool

KINDS = (JobOperator, PlacingTool, PickColour)
"""Classes of all of them."""


def cancel_all() -> None:
    """Cancel those that run, as Blender lets go of the tools of an add-on that is disabled without telling them."""
    for window, tool in running():
        with bpy.context.temp_override(window=window):
            tool.cancel(bpy.context)


def running() -> list[tuple[bpy.types.Window, Any]]:
    """Return the tools that run, each with its window."""
    manager = bpy.context.window_manager
    windows = manager.windows if manager is not None else ()
    return [(window, tool) for window in windows for tool in window.modal_operators if isinstance(tool, KINDS)]
