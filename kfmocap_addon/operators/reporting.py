"""What the tools share: errors a user can cause become Blender's reports."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import bpy

from ...core.errors import CancelledError, KFMocapError

if TYPE_CHECKING:
    from ...core.runtime.progress import Progress


class Outcome:
    """How a tool ended, as Blender's operators return it."""

    def __init__(self) -> None:
        self.value = {"FINISHED"}


@contextmanager
def reported(operator: bpy.types.Operator) -> Iterator[Outcome]:
    """Run a tool's body; an error of ours is reported and makes the outcome CANCELLED."""
    outcome = Outcome()
    try:
        yield outcome
    except CancelledError as error:
        operator.report({"WARNING"}, str(error))
        outcome.value = {"CANCELLED"}
    except KFMocapError as error:
        operator.report({"ERROR"}, str(error))
        outcome.value = {"CANCELLED"}


@contextmanager
def progress_shown(context: bpy.types.Context) -> Iterator[Progress]:
    """A progress callback that the mouse pointer shows while the block runs."""
    manager = context.window_manager

    def progress(_what: str, fraction: float) -> bool:
        manager.progress_update(fraction)
        return True

    manager.progress_begin(0.0, 1.0)
    try:
        yield progress
    finally:
        manager.progress_end()


def explained(operator: type[bpy.types.Operator], context: bpy.types.Context) -> bool:
    """Whether the scene holds a shot; if not, the disabled button says so."""
    missing = missing_of(context.scene.kfmocap)
    if missing:
        operator.poll_message_set(missing)
    return not missing


def missing_of(shot: bpy.types.PropertyGroup) -> str:
    """What a shot lacks to be tracked and how to come by it; empty where it lacks nothing."""
    if not shot.views:
        return "There is no footage yet: use Add Footage or Load Shot"
    unknown = next((view.name for view in shot.views if not view.is_calibrated), None)
    if unknown is not None:
        return f"The camera of {unknown} is not calibrated: use Import Calibration"
    return "" if shot.performers else "There is nobody to track yet: use Add Body"
