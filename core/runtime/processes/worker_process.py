"""A process that works for the program, one piece of work after the other, and ends with it."""

from __future__ import annotations

import contextlib
import os
import pickle
import subprocess
import sys
from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...errors import KFMocapError, WorkerEndedError
from . import worker
from .worker import LENGTH_BYTES

if TYPE_CHECKING:
    from ..progress import Progress

Work = Callable[["Progress"], Any]
"""A function of a module, or a `functools.partial` of one; it and its result are pickled between the processes."""
Show = Callable[[Any, Any], None]
"""show(key, value) hands out an interim result, which replaces an earlier one with the same key."""
_OPEN_FILES = Path("/proc/self/fd")
"""On Linux, a folder with an entry for every open file of this process, named by its number."""


class WorkerProcess:
    """A process that does tasks for this program.

    Parameters
    ----------
    yields : bool
        Whether its priority is lower than the program's, as is right if somebody is using the program.
    tidies : bool
        Whether its tasks create files, and are given a moment to remove them when the program has ended.
    imports : sequence of str
        Full names of modules that the process imports at once, in advance of its first task.
    copied : bool
        Whether the process begins as a copy of this one, which imports `imports` first; see `can_be_copied`.

    Raises
    ------
    KFMocapError
        Python cannot be started.
    """

    def __init__(
        self, *, yields: bool = True, tidies: bool = True, imports: Sequence[str] = (), copied: bool = False
    ) -> None:
        lower = getattr(subprocess, "BELOW_NORMAL_PRIORITY_CLASS", 0) if yields else 0
        flags = lower | getattr(subprocess, "CREATE_NO_WINDOW", 0)
        for module in imports if copied else ():
            import_module(module)
        try:
            self._process = (
                _CopiedProcess()
                if copied
                else subprocess.Popen(
                    [sys.executable, str(Path(__file__).with_name("worker.py"))],
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    creationflags=flags,
                )
            )
        except OSError as error:
            what = f"Python cannot be started: {error.strerror}"
            raise KFMocapError(what, where=str(sys.executable), todo="install the program again") from error
        package, folder = __package__.rsplit(".", 3)[0], Path(__file__).parents[3]
        with contextlib.suppress(OSError):  # if it has ended already, the first task reports it
            self._send((_search_path(), package, str(folder), yields, tidies, tuple(imports)))

    @property
    def alive(self) -> bool:
        """Whether the process is running."""
        return self._process.poll() is None

    @property
    def id(self) -> int:
        """Id of the process."""
        return self._process.pid

    def call(
        self,
        work: Work,
        progress: Callable[[tuple[str, float]], object] | None = None,
        show: Show | None = None,
    ) -> Any:
        """Do a task in the process, and wait for its result.

        Parameters
        ----------
        work : callable
        progress : callable, optional
            Called with the stage of the task and the fraction of it that is done.
        show : callable, optional
            Called with interim results, if the task hands out any.

        Raises
        ------
        WorkerEndedError
            The process ended before the work was done.
        Exception
            Whatever the task raised.
        """
        try:
            self._send(work)
        except OSError as error:
            raise WorkerEndedError(self._process.wait()) from error
        kind, value = self._next()
        while kind in ("progress", "shown"):
            if kind == "progress" and progress is not None:
                progress(value)
            elif kind == "shown" and show is not None:
                show(*value)
            kind, value = self._next()
        if kind == "error":
            raise value
        return value

    def _next(self) -> tuple[str, Any]:
        """Return the next message of the process: its kind, and its value."""
        assert self._process.stdout is not None
        try:
            kind, value = pickle.load(self._process.stdout)
        except (OSError, EOFError, pickle.UnpicklingError) as error:
            raise WorkerEndedError(self._process.wait()) from error
        return kind, value

    def _send(self, value: object) -> None:
        assert self._process.stdin is not None
        data = pickle.dumps(value, pickle.HIGHEST_PROTOCOL)
        # The pipe stays open: the worker ends when it is closed, which happens however this process ends.
        self._process.stdin.write(len(data).to_bytes(LENGTH_BYTES, "little") + data)
        self._process.stdin.flush()

    def kill(self) -> None:
        """Kill the process."""
        self._process.kill()

    def end(self, grace: float = 5.0) -> None:
        """End the process, giving it some seconds to clean up."""
        self._process.terminate()
        try:
            self._process.wait(grace)
        except subprocess.TimeoutExpired:
            self._process.kill()

    def close(self) -> None:
        """Tell the process that there are no more tasks."""
        for pipe in (self._process.stdin, self._process.stdout):
            assert pipe is not None
            with contextlib.suppress(OSError):
                pipe.close()
        self._process.wait()


def can_be_copied() -> bool:
    """Whether workers may begin as copies of this process, which need not import anything again.

    Elsewhere than on Linux system libraries do not allow it, and neither does Blender, wherever it runs.
    """
    return sys.platform == "linux" and "bpy" not in sys.modules and _OPEN_FILES.is_dir()


class _CopiedProcess:
    """A worker that begins as a copy of this process, used as a `subprocess.Popen` with pipes.

    Of the other threads of this process the copy has none. None of them may therefore hold a lock that it needs: they
    may wait for other processes, but do nothing else.
    """

    def __init__(self) -> None:
        from multiprocessing import get_context

        (tasks, send), (receive, results) = os.pipe(), os.pipe()
        self._process = get_context("fork").Process(target=_work_as_copy, args=(tasks, results), daemon=True)
        self._process.start()
        os.close(tasks)
        os.close(results)
        self.stdin, self.stdout = os.fdopen(send, "wb"), os.fdopen(receive, "rb")
        self.pid = int(self._process.pid or 0)

    def poll(self) -> int | None:
        return self._process.exitcode

    def wait(self, timeout: float | None = None) -> int:
        self._process.join(timeout)
        if (code := self._process.exitcode) is None:
            raise subprocess.TimeoutExpired("a copy of this process", timeout or 0.0)
        return code

    def kill(self) -> None:
        self._process.kill()

    def terminate(self) -> None:
        self._process.terminate()


def _work_as_copy(tasks: int, results: int) -> None:
    """Become a worker that reads tasks from one pipe and writes results to another."""
    os.dup2(tasks, 0)
    os.dup2(results, 1)
    last = max(int(file.name) for file in _OPEN_FILES.iterdir())
    os.closerange(3, last + 1)  # other workers end when their pipes are closed everywhere
    worker.main()
    os._exit(0)


def _search_path() -> list[str]:
    """Return where a process finds modules: as this one, but for the folders that Blender's module has put first, in
    which the process would find a part of Blender's module that cannot be loaded by itself.
    """
    blender = getattr(sys.modules.get("bpy"), "__file__", None)
    parts = Path(blender).parts if blender else ()
    if "bpy" not in parts[:-2]:  # in Blender itself they belong to its Python
        return list(sys.path)
    home = Path(*parts[: parts.index("bpy") + 1])
    return [folder for folder in sys.path if not Path(folder).is_relative_to(home)]
