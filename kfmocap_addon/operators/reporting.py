"""Reporting errors in Blender's interface, and progress at the mouse pointer."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import bpy

from ...core.errors import CancelledError, FootageError, KFMocapError
from ..scene_io.cameras import missing_footage

if TYPE_CHECKING:
    from ...core.runtime.progress import Progress


class NothingToDoError(Exception):
    """An operator has nothing to do, which its user may not expect: the message says why, as a warning."""


class Outcome:
    """The result of an operator, in the form that Blender expects."""

    def __init__(self) -> None:
        self.value = {"FINISHED"}


@contextmanager
def reported(operator: bpy.types.Operator) -> Iterator[Outcome]:
    """Run an operator's body; a KFMocapError or a NothingToDoError is reported and makes the outcome CANCELLED.

    If footage is missing that was there when the file was opened, its views say so from then on.
    """
    outcome = Outcome()
    try:
        yield outcome
    except (CancelledError, NothingToDoError) as error:
        operator.report({"WARNING"}, str(error))
        outcome.value = {"CANCELLED"}
    except KFMocapError as error:
        operator.report({"ERROR"}, str(error))
        outcome.value = {"CANCELLED"}
        if isinstance(error, FootageError):
            missing_footage.find(bpy.context.scene)


@contextmanager
def progress_shown(context: bpy.types.Context) -> Iterator[Progress]:
    """Provide a progress callback that shows a number at the mouse pointer while the block runs."""
    manager = context.window_manager

    def progress(_what: str, fraction: float) -> bool:
        manager.progress_update(fraction)
        return True

    manager.progress_begin(0.0, 1.0)
    try:
        yield progress
    finally:
        manager.progress_end()
