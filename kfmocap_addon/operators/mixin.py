"""Mixin classes for operators: how they report, on which performer they work, and how they get their file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import bpy
from bpy_extras.io_utils import ImportHelper

from ...core.errors import BodyError
from .reporting import reported

# For mypy it is an operator; Blender must not see operators that are never registered.
OperatorMixin = bpy.types.Operator if TYPE_CHECKING else object


class ReportingOperator(OperatorMixin):
    """An operator that reports its errors in Blender's interface."""

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Carry it out; an error cancels it."""
        with reported(self) as outcome:
            self.act(context)
        return outcome.value

    def act(self, context: bpy.types.Context) -> None:
        """Do what the operator is for.

        Raises
        ------
        NothingToDoError, CancelledError
            Reported as warnings.
        KFMocapError
            Reported as an error.
        """
        raise NotImplementedError


class OfPerformer(OperatorMixin):
    """An operator for one performer of the shot, whoever is chosen."""

    performer: bpy.props.IntProperty(min=0, name="Performer", description="Number of the performer, from 0")

    def slot(self, context: bpy.types.Context) -> bpy.types.PropertyGroup:
        """Return the scene's entry of the performer.

        Raises
        ------
        BodyError
            There is no performer of this number.
        """
        performers = context.scene.kfmocap.performers
        if self.performer >= len(performers):
            raise BodyError(f"The shot has no performer {self.performer}")
        return performers[self.performer]


class FileReader(ImportHelper, ReportingOperator):
    """An operator that reads a file of the user's choice, and can be undone."""

    bl_options: set[Any] = {"REGISTER", "UNDO"}

    filepath: bpy.props.StringProperty(subtype="FILE_PATH")

    def act(self, context: bpy.types.Context) -> None:
        """Read the file."""
        self.read(context, Path(bpy.path.abspath(self.filepath)))

    def read(self, context: bpy.types.Context, path: Path) -> None:
        """Read the file."""
        raise NotImplementedError


class BesideFootage(ImportHelper):
    """An operator that reads a file which is likely to be in the folder of the shot's footage."""

    filepath: bpy.props.StringProperty(subtype="FILE_PATH")

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Open the file browser in the folder of the footage, unless a file was chosen before."""
        from ..scene_io.cameras import footage_background

        folder = footage_background.footage_folder(context.scene)
        if not self.filepath and folder is not None:
            self.filepath = f"{folder}/"
        return set(super().invoke(context, event))
