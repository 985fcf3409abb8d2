"""Jobs of operators: their work runs in another process, is shown, can be ended, and its errors are reported."""

from __future__ import annotations

import os
import re
import time
from functools import partial
from types import SimpleNamespace

import pytest

bpy = pytest.importorskip("bpy")

import job_functions  # noqa: E402
from kfmocap.core.errors import CancelledError, CaptureError  # noqa: E402
from kfmocap.core.runtime.processes.job import Job, duration  # noqa: E402
from kfmocap.core.runtime.processes.worker_memory import CachingTask  # noqa: E402
from kfmocap.kfmocap_addon import registration  # noqa: E402
from kfmocap.kfmocap_addon.operators import conditions, job_operator, running_tools  # noqa: E402
from kfmocap.kfmocap_addon.operators.cameras.pick_colour import PickColour  # noqa: E402
from kfmocap.kfmocap_addon.operators.job_operator import JobOperator  # noqa: E402
from kfmocap.kfmocap_addon.session import SESSION  # noqa: E402
from user_keymaps import orbiting_with_alt  # noqa: E402

pytest_plugins = ("addon_fixtures",)

pytestmark = pytest.mark.blender


class Tool(JobOperator):
    """A modal tool outside Blender's window."""

    bl_label = "Tool"

    def __init__(self, work):
        self.work, self.reports, self.finished = work, [], []

    def prepare(self, context):
        return self.work

    def finish(self, context, result):
        self.finished.append(result)

    def report(self, kind, text):
        self.reports.append((kind, text))


def window():
    """A context with a window that notes what is asked of it."""
    manager = SimpleNamespace(
        windows=[],
        event_timer_add=lambda interval, window: "timer",
        event_timer_remove=lambda timer: None,
        progress_begin=lambda low, high: None,
        progress_update=lambda value: None,
        progress_end=lambda: None,
        modal_handler_add=lambda tool: None,
    )
    workspace = SimpleNamespace(status=[])
    workspace.status_text_set = workspace.status.append
    screen = SimpleNamespace(areas=[])
    return SimpleNamespace(
        window_manager=manager, window=SimpleNamespace(screen=screen), workspace=workspace, screen=screen
    )


def event(kind, value="PRESS"):
    held = {"alt": False, "ctrl": False, "shift": False, "oskey": False}
    return SimpleNamespace(type=kind, value=value, mouse_x=5, mouse_y=5, **held)


def started(work, monkeypatch):
    monkeypatch.setattr("kfmocap.kfmocap_addon.operators.job_operator.bpy.app", SimpleNamespace(background=False))
    tool, context = Tool(work), window()
    assert tool.invoke(context, event("LEFTMOUSE")) == {"RUNNING_MODAL"}
    return tool, context


def ended(tool, context):
    """What the tool returns at its end."""
    deadline = time.monotonic() + 30
    while (outcome := tool.modal(context, event("TIMER"))) == {"PASS_THROUGH"} and time.monotonic() < deadline:
        time.sleep(0.01)
    return outcome


def test_esc_answers_at_once_and_ends_the_work(monkeypatch, tmp_path):
    tool, context = started(partial(job_functions.silent, tmp_path / "pid"), monkeypatch)
    while not (tmp_path / "pid").exists() or not (tmp_path / "pid").read_text():
        time.sleep(0.01)
    begin = time.monotonic()
    assert tool.modal(context, event("ESC")) == {"CANCELLED"}
    assert time.monotonic() - begin < 0.2
    assert context.workspace.status[-1] is None and not tool.finished
    tool.job._thread.join(5)
    with pytest.raises(ProcessLookupError):
        os.kill(int((tmp_path / "pid").read_text()), 0)
    with pytest.raises(CancelledError):
        tool.job.result()


def test_a_job_ends_with_the_add_on_that_is_disabled_meanwhile(blender, monkeypatch):
    cancelled = []
    tool = Tool(None)
    tool.cancel = lambda context: cancelled.append(context.window)
    monkeypatch.setattr(running_tools, "running", lambda: [(bpy.context.window_manager.windows[0], tool)])
    registration.unregister()
    assert cancelled == [bpy.context.window_manager.windows[0]]
    registration.register()  # as the fixture expects it


def test_every_tool_that_runs_until_the_user_ends_it_ends_with_the_add_on():
    modal = [cls for cls in registration.CLASSES if hasattr(cls, "modal")]
    assert len(modal) > 5
    assert [cls for cls in modal if not issubclass(cls, running_tools.KINDS)] == []


def test_a_tool_of_an_add_on_that_was_disabled_while_it_ran_is_passed_over():
    """Blender lists None in its place."""
    placing = SimpleNamespace(bl_idname="KFMOCAP_OT_place_joints")
    for running, is_placing in (([None], False), ([None, placing], True)):
        shown = SimpleNamespace(modal_operators=running)
        assert conditions.is_placing(SimpleNamespace(window=shown)) is is_placing
        assert job_operator.running_job(shown) is None


def test_picking_a_colour_that_is_cancelled_leaves_colour_and_editor_as_they_were():
    put, context = [], window()
    context.window.cursor_modal_restore = lambda: None
    tool = SimpleNamespace(_before=("red", (1, 0, 0)), _area=SimpleNamespace(type="IMAGE_EDITOR"), _was="VIEW_3D")
    tool._colour, tool._close = SimpleNamespace(put=lambda *to: put.append(to)), partial(PickColour._close, tool)
    PickColour.cancel(tool, context)
    assert (put, tool._area.type, context.workspace.status) == ([tool._before], "VIEW_3D", [None])


def test_a_job_that_ends_is_finished_once(monkeypatch):
    tool, context = started(partial(job_functions.halfway, 42), monkeypatch)
    assert ended(tool, context) == {"FINISHED"}
    assert tool.finished == [42] and context.workspace.status[-1] is None
    assert tool.job.state == ("half", 0.5) and re.match(r"Half 50%, \d+ s left", tool.job.status_text())


def test_names_in_a_jobs_status_keep_their_capitals(monkeypatch, tmp_path):
    tool, _ = started(partial(job_functions.halfway, 42), monkeypatch)
    tool.job._thread.join(10)
    tool.job.state = ("L-frame in cam04", 0.001)
    assert tool.job.status_text() == "L-frame in cam04 0%"


def test_what_a_job_shows_is_updated_ten_times_a_second_at_most(monkeypatch):
    tool, context = started(partial(job_functions.halfway, 42), monkeypatch)
    while not tool.job.done:  # its worker, which the next job takes, is not left at work
        time.sleep(0.01)
    now, asked = [100.0], []
    monkeypatch.setattr(job_operator, "time", SimpleNamespace(monotonic=lambda: now[0]))
    tool.job = SimpleNamespace(
        done=False, take_shown=lambda: asked.append(now[0]), status_text=lambda: "", cancelled=False
    )
    for _ in range(100):
        assert tool.modal(context, event("TIMER")) == {"PASS_THROUGH"}
        now[0] += 0.01
    assert 9 <= len(asked) <= 10
    tool.job = SimpleNamespace(done=True, cancelled=False, result=lambda: 7)
    assert tool.modal(context, event("TIMER")) == {"FINISHED"} and tool.finished == [7], "its end does not wait"


def test_errors_of_the_work_are_reported_as_they_were(monkeypatch):
    tool, context = started(job_functions.failing, monkeypatch)
    assert ended(tool, context) == {"CANCELLED"}
    assert tool.reports == [({"ERROR"}, "wand.mp4: it lies in a plane (wave it about)")]
    with pytest.raises(CaptureError) as caught:
        tool.job.result()
    assert caught.value.name == "wand-in-a-plane" and caught.value.where == "wand.mp4"


def test_a_bug_in_the_work_is_not_swallowed(monkeypatch):
    tool, context = started(job_functions.broken, monkeypatch)
    with pytest.raises(ZeroDivisionError) as caught:
        ended(tool, context)
    assert "job_functions.py" in caught.value.__notes__[0]


def test_work_that_dies_is_reported(monkeypatch):
    tool, context = started(job_functions.killed, monkeypatch)
    assert ended(tool, context) == {"CANCELLED"}
    assert "ended unexpectedly" in tool.reports[0][1]


def test_the_next_job_runs_in_the_process_of_the_last(monkeypatch):
    def process():
        tool, context = started(job_functions.process_id, monkeypatch)
        assert ended(tool, context) == {"FINISHED"}
        return tool.finished[0]

    first = process()
    assert process() == first
    SESSION.of(job_operator.WaitingWorkers).clear()
    assert process() != first


def test_interim_results_come_by_their_keys_each_once(tmp_path):
    job = Job(CachingTask(partial(job_functions.showing, tmp_path / "go"), shows=True))
    shown = {}
    deadline = time.monotonic() + 30
    while shown != {"a": 3, "b": 2} and time.monotonic() < deadline:
        shown |= job.take_shown()
        time.sleep(0.01)
    assert shown == {"a": 3, "b": 2} and job.take_shown() == {}
    (tmp_path / "go").touch()
    job._thread.join(30)
    assert job.result() == "end"


def test_nothing_but_looking_reaches_blender_while_a_job_runs(monkeypatch, tmp_path):
    tool, context = started(partial(job_functions.silent, tmp_path / "pid"), monkeypatch)
    view = SimpleNamespace(type="WINDOW", x=0, y=0, width=100, height=100)
    sidebar = SimpleNamespace(type="UI", x=80, y=0, width=20, height=100, tag_redraw=lambda: None)
    space = SimpleNamespace(active=SimpleNamespace(lock_camera=False))
    area = SimpleNamespace(
        type="VIEW_3D", x=0, y=0, width=100, height=100, regions=[view, sidebar], spaces=space, tag_redraw=None
    )
    context.screen.areas.append(area)

    def passes(kind, **changes):
        given = event(kind)
        vars(given).update(changes)
        return tool.modal(context, given) == {"PASS_THROUGH"}

    assert passes("MIDDLEMOUSE") and passes("WHEELUPMOUSE") and passes("NUMPAD_1") and passes("MOUSEMOVE")
    assert not any(passes(kind) for kind in ("LEFTMOUSE", "G", "Z", "I", "SPACE", "RET", "DEL", "UP_ARROW"))
    assert passes("LEFT_ARROW") and not passes("LEFT_ARROW", shift=True)
    assert not passes("LEFTMOUSE", mouse_x=90)  # over the sidebar
    assert not passes("NUMPAD_0", ctrl=True)  # makes another camera the scene's
    assert not passes("WHEELUPMOUSE", alt=True)  # goes to another frame
    assert not passes("WHEELUPMOUSE", mouse_x=90)  # over the sidebar, where it changes values
    assert not passes("MIDDLEMOUSE", mouse_x=200)
    assert not passes("LEFTMOUSE", alt=True)
    with orbiting_with_alt():
        assert passes("LEFTMOUSE", alt=True) and not passes("LEFTMOUSE") and not passes("RIGHTMOUSE", alt=True)
    space.active.lock_camera = True
    assert not passes("MIDDLEMOUSE")  # would move the camera
    tool.modal(context, event("ESC"))


def test_frames_can_be_gone_through_and_the_work_ended_by_its_button(monkeypatch, tmp_path):
    tool, context = started(partial(job_functions.silent, tmp_path / "pid"), monkeypatch)
    bar = SimpleNamespace(type="WINDOW", x=0, y=30, width=100, height=70)
    context.screen.areas.append(
        SimpleNamespace(type="DOPESHEET_EDITOR", x=0, y=30, width=100, height=70, regions=[bar], tag_redraw=None)
    )
    places = {}
    for y in (10, 40, 95):  # the status bar, the keys, the bar with the frames
        given = event("LEFTMOUSE")
        given.mouse_x, given.mouse_y = 50, y
        places[y] = tool.modal(context, given)
    assert places == {10: {"PASS_THROUGH"}, 40: {"RUNNING_MODAL"}, 95: {"PASS_THROUGH"}}
    tool.job.cancel()
    assert ended(tool, context) == {"CANCELLED"} and "cancelled" in tool.reports[-1][1] and not tool.finished


def test_durations_are_written_as_people_write_them():
    assert [duration(s) for s in (0.2, 59.4, 59.6, 125, 3725)] == ["0 s", "59 s", "1:00 min", "2:05 min", "1:02 h"]
