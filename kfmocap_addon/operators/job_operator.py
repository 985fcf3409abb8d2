"""Operators that run a job in another process: the status bar shows the progress, and Esc or its button cancels."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import bpy

from ...core.runtime.processes.job import Job
from ...core.runtime.processes.worker_process import Work, WorkerProcess
from ..session import SESSION
from ..viewports import viewport
from ..viewports.navigation import navigates
from .mixin import ReportingOperator
from .reporting import progress_shown, reported

_INTERVAL = 0.03  # seconds between two checks of the job: so long its result may wait
_REDRAWN = 0.1  # seconds between two updates of what is shown of it, which take the time of the work
_BAR = 14.0  # width in the status bar, in units of the interface
_NAVIGATION = {"MIDDLEMOUSE", "WHEELUPMOUSE", "WHEELDOWNMOUSE", "TRACKPADPAN", "TRACKPADZOOM", "NDOF_MOTION", "HOME"}
_NAVIGATION |= {f"NUMPAD_{key}" for key in (*range(10), "PERIOD", "PLUS", "MINUS")}
_FRAME_STEPS = {"LEFT_ARROW", "RIGHT_ARROW"}
_SCRUB_HEIGHT = 24  # height of the bar with the frames at the top of a timeline, in units of the interface
_PASSIVE = {"MOUSEMOVE", "INBETWEEN_MOUSEMOVE", "WINDOW_DEACTIVATE"}


class JobOperator(ReportingOperator):
    """An operator whose work is a job.

    `prepare` reads the scene and `finish` writes into it; both run in Blender's thread. With a window, the operator
    runs modally; without one, and from scripts, it blocks until the work is done. While it runs modally, the user can
    only orbit and zoom the 3D views and change the frame. Interim results of the work are shown by `show`, and removed
    again by `hide` before `finish` is called.

    Attributes
    ----------
    blocks : bool
        Whether the operator runs without a user who could change the scene meanwhile.
    """

    blocks = False

    def prepare(self, context: bpy.types.Context) -> Work:
        """Read the scene; returns the work to do."""
        raise NotImplementedError

    def finish(self, context: bpy.types.Context, result: Any) -> None:
        """Write the work's result into the scene."""
        raise NotImplementedError

    def show(self, context: bpy.types.Context, shown: dict[Any, Any]) -> None:
        """Show interim results, by their keys."""

    def hide(self, context: bpy.types.Context) -> None:
        """Remove everything that `show` has shown."""

    def kept(self, _context: bpy.types.Context) -> str:
        """Return what is kept of a cancelled job, as text that follows "nothing was changed"."""
        return ""

    def execute(self, context: bpy.types.Context) -> set[str]:
        self.blocks = True
        with progress_shown(context) as progress, reported(self) as outcome:
            self.finish(context, self.prepare(context)(progress))
        return outcome.value

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        if bpy.app.background or context.window is None:
            return self.execute(context)
        if any(running_job(window) for window in context.window_manager.windows):
            self.report({"ERROR"}, "Something is still being worked on: wait, or end it with Esc")
            return {"CANCELLED"}
        self._status, self._next_shown = "", 0.0
        with reported(self) as outcome:
            work = self.prepare(context)
            self._worker = SESSION.of(WaitingWorkers).take()
            self.job = Job(work, self._worker)
        if outcome.value != {"FINISHED"}:
            return outcome.value
        self._timer = context.window_manager.event_timer_add(_INTERVAL, window=context.window)
        context.window_manager.progress_begin(0.0, 1.0)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if event.type == "ESC" and event.value == "PRESS":
            self.cancel(context)
            return self._cancelled(context)
        if event.type.startswith("TIMER"):
            return self._continued(context)
        # Nothing on which the work depends may change.
        harmless = _only_looks(context.window, event) or _goes_to_a_frame(context.window, event)
        harmless = harmless or _is_over_status_bar(context.window, event)
        return {"PASS_THROUGH"} if harmless else {"RUNNING_MODAL"}

    def _continued(self, context: bpy.types.Context) -> set[str]:
        if not self.job.done:
            if time.monotonic() < self._next_shown:
                return {"PASS_THROUGH"}
            self._next_shown = time.monotonic() + _REDRAWN
            if shown := self.job.take_shown():
                self.show(context, shown)
            if (text := self.job.status_text()) != self._status:  # redrawing takes time, too
                self._status = text
                context.window_manager.progress_update(self.job.state[1])
                context.workspace.status_text_set(_status_of(self.job))
                _redraw_sidebars(context.window)
            return {"PASS_THROUGH"}
        self._end(context)
        if self._worker.alive:
            SESSION.of(WaitingWorkers).put(self._worker)
        if self.job.cancelled:
            return self._cancelled(context)
        with reported(self) as outcome:
            self.finish(context, self.job.result())
        return outcome.value

    def _cancelled(self, context: bpy.types.Context) -> set[str]:
        self.report({"WARNING"}, f"{self.bl_label}: cancelled, nothing was changed{self.kept(context)}")
        return {"CANCELLED"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Cancel the job; also called when Blender closes its file or quits."""
        self.job.cancel()
        self._end(context)

    def _end(self, context: bpy.types.Context) -> None:
        self.hide(context)
        context.window_manager.event_timer_remove(self._timer)
        context.window_manager.progress_end()
        if context.workspace is not None:
            context.workspace.status_text_set(None)
            _redraw_sidebars(context.window)


def _redraw_sidebars(window: bpy.types.Window) -> None:
    for area in window.screen.areas:
        for region in area.regions:
            if area.type == "VIEW_3D" and region.type == "UI":
                region.tag_redraw()


class WaitingWorkers:
    """Processes that have done their job, and wait for the next one with footage in their cache."""

    def __init__(self) -> None:
        self._workers: list[WorkerProcess] = []

    def put(self, worker: WorkerProcess) -> None:
        """Have a process wait."""
        self._workers.append(worker)

    def take(self) -> WorkerProcess:
        """Return the process of the last job, if it is alive, or else a new one."""
        while self._workers:
            worker = self._workers.pop()
            if worker.alive:
                return worker
            worker.close()
        return WorkerProcess()

    def clear(self) -> None:
        """End those that wait."""
        while self._workers:
            self._workers.pop().close()


def running_job(window: bpy.types.Window | None) -> Job | None:
    """Return the job that runs in a window, if any."""
    tools = window.modal_operators if window is not None else ()
    return next((tool.job for tool in tools if isinstance(tool, JobOperator)), None)


def _status_of(job: Job) -> Callable[[bpy.types.Header, bpy.types.Context], None]:
    """Return the function that draws the status bar while a job runs; Blender does not accept methods."""

    def draw(header: bpy.types.Header, _context: bpy.types.Context) -> None:
        header.layout.separator_spacer()
        draw_progress(header.layout, job).ui_units_x = _BAR
        header.layout.operator(CancelJob.bl_idname, text="Cancel (Esc)", icon="CANCEL")
        header.layout.separator_spacer()

    return draw


def draw_progress(layout: bpy.types.UILayout, job: Job) -> bpy.types.UILayout:
    """Draw a progress bar of a job; returns its row."""
    row = layout.row()
    row.progress(factor=min(max(job.state[1], 0.0), 1.0), text=job.status_text())
    return row


class CancelJob(bpy.types.Operator):
    """Stop what is running, and leave everything as it was"""

    bl_idname = "kfmocap.cancel_job"
    bl_label = "Cancel"
    bl_options = {"INTERNAL"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Check whether a job is running."""
        return running_job(context.window) is not None

    def execute(self, context: bpy.types.Context) -> set[str]:
        job = running_job(context.window)
        if job is not None:
            job.cancel()  # its operator notices at the next tick of its timer
        return {"FINISHED"}


def _goes_to_a_frame(window: bpy.types.Window, event: bpy.types.Event) -> bool:
    """Whether an event can only change the frame: arrow keys, or clicks on the frame bar of a timeline."""
    under = viewport.area_under(window, event.mouse_x, event.mouse_y)
    if under is None or under[1].type != "WINDOW":
        return False
    area, region = under
    if event.type in _FRAME_STEPS:
        return area.type in ("VIEW_3D", "DOPESHEET_EDITOR") and not (event.alt or event.ctrl or event.shift)
    height = _SCRUB_HEIGHT * (bpy.context.preferences.system.ui_scale or 1.0)  # without a window it is 0
    return (
        event.type == "LEFTMOUSE"
        and area.type == "DOPESHEET_EDITOR"
        and event.mouse_y >= region.y + region.height - height
    )


def _is_over_status_bar(window: bpy.types.Window, event: bpy.types.Event) -> bool:
    """Whether an event is a left click on the status bar, whose only button cancels the job."""
    return event.type == "LEFTMOUSE" and event.mouse_y < min((a.y for a in window.screen.areas), default=0)


def _only_looks(window: bpy.types.Window, event: bpy.types.Event) -> bool:
    """Whether an event can only orbit, pan or zoom a 3D view."""
    if event.type in _PASSIVE:
        return True
    usual = event.type in _NAVIGATION and not event.alt and not (event.ctrl and event.type.startswith("NUMPAD"))
    if not usual and not navigates(event):
        return False
    under = viewport.area_under(window, event.mouse_x, event.mouse_y)
    if under is None:
        return False
    area, region = under
    return area.type == "VIEW_3D" and region.type == "WINDOW" and not area.spaces.active.lock_camera


CLASSES = (CancelJob,)
