"""The base of mixin classes for operators."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy
from bpy_extras.io_utils import ImportHelper

# For mypy it is an operator; Blender must not see operators that are never registered.
OperatorMixin = bpy.types.Operator if TYPE_CHECKING else object


class BesideFootage(ImportHelper):
    """An operator that reads a file which is likely to be in the folder of the shot's footage."""

    filepath: bpy.props.StringProperty(subtype="FILE_PATH")

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Open the file browser in the folder of the footage, unless a file was chosen before."""
        from ..scene_io import footage_background

        folder = footage_background.footage_folder(context.scene)
        if not self.filepath and folder is not None:
            self.filepath = f"{folder}/"
        return set(super().invoke(context, event))
