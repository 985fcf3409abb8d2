"""Long work beside Blender's window: it runs in a thread, the status bar shows how far it is, Esc ends it."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import bpy

from ...core.errors import CancelledError
from .reporting import progress_shown, reported

if TYPE_CHECKING:
    from ...core.shot import Progress

Work = Callable[["Progress"], Any]
_INTERVAL = 0.1


class Job:
    """A function of a progress callback, run in a thread. It must not touch Blender's data."""

    def __init__(self, work: Work) -> None:
        self.state = ("", 0.0)
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
        """Ask it to end: at its next report of progress it does."""
        self._cancelled = True

    @property
    def done(self) -> bool:
        return not self._thread.is_alive()

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

    Called with a window it runs modally; without one, and from scripts, it blocks until it is done.
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
        if any(isinstance(running, JobOperator) for running in context.window.modal_operators):
            self.report({"ERROR"}, "Something is still being worked on: wait, or end it with Esc")
            return {"CANCELLED"}
        with reported(self) as outcome:
            self._job = Job(self.prepared(context))
        if outcome.value != {"FINISHED"}:
            return outcome.value
        self._timer = context.window_manager.event_timer_add(_INTERVAL, window=context.window)
        context.window_manager.progress_begin(0.0, 1.0)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if event.type == "ESC" and event.value == "PRESS":
            self._job.cancel()
            return {"RUNNING_MODAL"}
        if event.type != "TIMER":
            # Nothing may change under the work's feet.
            return {"RUNNING_MODAL"}
        what, fraction = self._job.state
        context.window_manager.progress_update(fraction)
        context.workspace.status_text_set(f"{self.bl_label}: {what} {fraction:.0%} (Esc cancels)")
        if not self._job.done:
            return {"RUNNING_MODAL"}
        self._end(context)
        with reported(self) as outcome:
            self.finish(context, self._job.result())
        return outcome.value

    def cancel(self, context: bpy.types.Context) -> None:
        """Blender closes its file or itself."""
        self._job.cancel()
        self._end(context)

    def _end(self, context: bpy.types.Context) -> None:
        context.window_manager.event_timer_remove(self._timer)
        context.window_manager.progress_end()
        context.workspace.status_text_set(None)
