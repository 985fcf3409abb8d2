"""Long work beside Blender's window: it runs in a thread, the status bar shows how far it is, Esc ends it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import bpy

from ...core.errors import CancelledError
from .reporting import progress_shown, reported

if TYPE_CHECKING:
    from ...core.shot import Progress

Work = Callable[["Progress"], Any]
_INTERVAL = 0.1
_TELLING = 0.02
"""Share of the work after which the time that it took tells how long the rest will take."""
_BAR = 14.0  # width in the status bar, in units of the interface
_LOOKS = {"MIDDLEMOUSE", "WHEELUPMOUSE", "WHEELDOWNMOUSE", "TRACKPADPAN", "TRACKPADZOOM", "NDOF_MOTION", "HOME"}
_LOOKS |= {f"NUMPAD_{key}" for key in (*range(10), "PERIOD", "PLUS", "MINUS")}
_PASSES = {"MOUSEMOVE", "INBETWEEN_MOUSEMOVE", "WINDOW_DEACTIVATE"}


class Job:
    """A function of a progress callback, run in a thread. It must not touch Blender's data."""

    def __init__(self, work: Work) -> None:
        self.state = ("", 0.0)
        self._begun = time.monotonic()
        self._cancelled = False
        self._outcome: tuple[Any, BaseException | None] = (None, None)
        self._thread = threading.Thread(target=self._run, args=(work,), daemon=True)
        self._thread.start()

    def _run(self, work: Work) -> None:
        try:
            self._outcome = work(self._progress), None
        except BaseException as error:  # it is raised again by `result`, in Blender's own thread
            self._outcome = None, error

    def _progress(self, what: str, fraction: float) -> bool:
        self.state = (what, fraction)
        return not self._cancelled

    def cancel(self) -> None:
        """Give it up: it ends at its next report of progress, and nobody waits for that."""
        self._cancelled = True

    @property
    def done(self) -> bool:
        return not self._thread.is_alive()

    def told(self) -> str:
        """What it does, how far it is, and how long it will go on."""
        what, fraction = self.state
        text = f"{what.capitalize()} {fraction:.0%}"
        if fraction < _TELLING:
            return text
        return f"{text}, {duration((time.monotonic() - self._begun) * (1 / fraction - 1))} left"

    def result(self) -> Any:
        """What the work returned; raises what it raised, or CancelledError where it ended before that was asked."""
        value, error = self._outcome
        if error is not None:
            raise error
        if self._cancelled:
            raise CancelledError
        return value


class JobOperator:
    """A tool whose work is a job. `prepared` reads the scene, `finish` writes into it; both run in Blender's thread.

    Called with a window it runs modally; without one, and from scripts, it blocks until it is done. While it runs
    modally the 3D views can be turned and zoomed; everything else waits.
    """

    def prepared(self, context: bpy.types.Context) -> Work:
        raise NotImplementedError

    def finish(self, context: bpy.types.Context, result: Any) -> None:
        raise NotImplementedError

    def execute(self, context: bpy.types.Context) -> set[str]:
        with progress_shown(context) as progress, reported(self) as outcome:
            self.finish(context, self.prepared(context)(progress))
        return outcome.value

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        if bpy.app.background or context.window is None:
            return self.execute(context)
        if any(running_job(window) for window in context.window_manager.windows):
            self.report({"ERROR"}, "Something is still being worked on: wait, or end it with Esc")
            return {"CANCELLED"}
        with reported(self) as outcome:
            self.job = Job(self.prepared(context))
        if outcome.value != {"FINISHED"}:
            return outcome.value
        self._timer = context.window_manager.event_timer_add(_INTERVAL, window=context.window)
        context.window_manager.progress_begin(0.0, 1.0)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if event.type == "ESC" and event.value == "PRESS":
            self.cancel(context)
            self.report({"WARNING"}, f"{self.bl_label}: cancelled, nothing was changed")
            return {"CANCELLED"}
        if event.type.startswith("TIMER"):
            return self._continued(context)
        # Nothing may change under the work's feet.
        return {"PASS_THROUGH"} if _only_looks(context.window, event) else {"RUNNING_MODAL"}

    def _continued(self, context: bpy.types.Context) -> set[str]:
        if not self.job.done:
            context.window_manager.progress_update(self.job.state[1])
            context.workspace.status_text_set(self._draw_status)
            for area in context.screen.areas:
                for region in area.regions:
                    if area.type == "VIEW_3D" and region.type == "UI":
                        region.tag_redraw()
            return {"PASS_THROUGH"}
        self._end(context)
        with reported(self) as outcome:
            self.finish(context, self.job.result())
        return outcome.value

    def _draw_status(self, header: bpy.types.Header, _context: bpy.types.Context) -> None:
        header.layout.label(text="Cancel", icon="EVENT_ESC")
        header.layout.separator_spacer()
        draw_progress(header.layout, self.job).ui_units_x = _BAR
        header.layout.separator_spacer()

    def cancel(self, context: bpy.types.Context) -> None:
        """Give up; also called where Blender closes its file or itself."""
        self.job.cancel()
        self._end(context)

    def _end(self, context: bpy.types.Context) -> None:
        context.window_manager.event_timer_remove(self._timer)
        context.window_manager.progress_end()
        if context.workspace is not None:
            context.workspace.status_text_set(None)


def running_job(window: bpy.types.Window | None) -> Job | None:
    """The job that a window waits for, if any."""
    tools = window.modal_operators if window is not None else ()
    return next((tool.job for tool in tools if isinstance(tool, JobOperator)), None)


def draw_progress(layout: bpy.types.UILayout, job: Job) -> bpy.types.UILayout:
    """A bar that shows how far a job is; returns its row."""
    row = layout.row()
    row.progress(factor=min(max(job.state[1], 0.0), 1.0), text=job.told())
    return row


def duration(seconds: float) -> str:
    """A duration as one tells it: 8 s, 2:05 min, 1:02 h."""
    whole = max(0, round(seconds))
    if whole < 60:
        return f"{whole} s"
    minutes, unit = (whole, "min") if whole < 3600 else (whole // 60, "h")
    return f"{minutes // 60}:{minutes % 60:02d} {unit}"


def _only_looks(window: bpy.types.Window, event: bpy.types.Event) -> bool:
    """Whether an event can do no more than turn, move or zoom a 3D view."""
    if event.type in _PASSES:
        return True
    if event.type not in _LOOKS or event.alt or (event.ctrl and event.type.startswith("NUMPAD")):
        return False
    for area in window.screen.areas:
        if area.type == "VIEW_3D" and _within(area, event):
            aside = [r for r in area.regions if r.type != "WINDOW" and _within(r, event)]
            return not aside and not area.spaces.active.lock_camera
    return False


def _within(place: bpy.types.Area | bpy.types.Region, event: bpy.types.Event) -> bool:
    return 0 <= event.mouse_x - place.x < place.width and 0 <= event.mouse_y - place.y < place.height
