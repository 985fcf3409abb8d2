"""What classes inherit from that give methods to operators, beside `bpy.types.Operator` itself."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy
from bpy_extras.io_utils import ImportHelper

# For mypy it is an operator; Blender shall not meet operators that are never registered.
OperatorMixin = bpy.types.Operator if TYPE_CHECKING else object


class BesideFootage(ImportHelper):
    """Reads a file that is likely to be beside the shot's footage: there the file browser starts."""

    filepath: bpy.props.StringProperty(subtype="FILE_PATH")

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Open the file browser, beside the footage unless a file was chosen before."""
        from ..scene_io import footage_background

        folder = footage_background.footage_folder(context.scene)
        if not self.filepath and folder is not None:
            self.filepath = f"{folder}/"
        return set(super().invoke(context, event))
