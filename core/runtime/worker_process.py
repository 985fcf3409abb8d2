"""A process that works for the program, one piece of work after the other, and ends with it."""

from __future__ import annotations

import contextlib
import pickle
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import KFMocapError, WorkerEndedError
from .worker import LENGTH_BYTES

if TYPE_CHECKING:
    from .progress import Progress

Work = Callable[["Progress"], Any]
"""A function of a module, or a `functools.partial` of one: it and its result are pickled between the processes."""
Show = Callable[[Any, Any], None]
"""show(key, value) hands out an interim result; it takes the place of an earlier one of that key."""


class WorkerProcess:
    """A process to work in.

    Parameters
    ----------
    yields : bool
        The program goes first where both have something to do, as one should that somebody is using.
    tidies : bool
        Its work makes files, and has a moment to remove them when the program has ended.
    imports : sequence of str
        Modules, by their full names, that the process imports at once: its first piece of work then finds it ready.

    Raises
    ------
    KFMocapError
        Python cannot be started.
    """

    def __init__(self, *, yields: bool = True, tidies: bool = True, imports: Sequence[str] = ()) -> None:
        lower = getattr(subprocess, "BELOW_NORMAL_PRIORITY_CLASS", 0) if yields else 0
        flags = lower | getattr(subprocess, "CREATE_NO_WINDOW", 0)
        try:
            self._process = subprocess.Popen(
                [sys.executable, str(Path(__file__).with_name("worker.py"))],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                creationflags=flags,
            )
        except OSError as error:
            what = f"Python cannot be started: {error.strerror}"
            raise KFMocapError(what, where=str(sys.executable), todo="install the program again") from error
        package, folder = __package__.rsplit(".", 2)[0], Path(__file__).parents[2]
        with contextlib.suppress(OSError):  # where it has ended, the first piece of work finds that out
            self._send((sys.path, package, str(folder), yields, tidies, tuple(imports)))

    @property
    def alive(self) -> bool:
        """Whether the process has not ended."""
        return self._process.poll() is None

    @property
    def id(self) -> int:
        """The id of the process."""
        return self._process.pid

    def call(
        self,
        work: Work,
        progress: Callable[[tuple[str, float]], object] | None = None,
        show: Show | None = None,
    ) -> Any:
        """Have a piece of work done, and wait for it.

        Parameters
        ----------
        work : callable
        progress : callable, optional
            Called with what is being done and the share of it that is done.
        show : callable, optional
            Called with interim results, where the work hands out some.

        Raises
        ------
        WorkerEndedError
            The process ended before the work was done.
        Exception
            Whatever the work raised.
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
        """The next message of the process: its kind, and its value."""
        assert self._process.stdout is not None
        try:
            kind, value = pickle.load(self._process.stdout)
        except (OSError, EOFError, pickle.UnpicklingError) as error:
            raise WorkerEndedError(self._process.wait()) from error
        return kind, value

    def _send(self, value: object) -> None:
        assert self._process.stdin is not None
        data = pickle.dumps(value, pickle.HIGHEST_PROTOCOL)
        # It stays open: the worker ends when it is closed, as it is when this process ends, however that happens.
        self._process.stdin.write(len(data).to_bytes(LENGTH_BYTES, "little") + data)
        self._process.stdin.flush()

    def kill(self) -> None:
        """End it at once."""
        self._process.kill()

    def end(self, grace: float = 5.0) -> None:
        """Let it tidy up, for some seconds at most."""
        self._process.terminate()
        try:
            self._process.wait(grace)
        except subprocess.TimeoutExpired:
            self._process.kill()

    def close(self) -> None:
        """Tell it that there is no more work."""
        for pipe in (self._process.stdin, self._process.stdout):
            assert pipe is not None
            with contextlib.suppress(OSError):
                pipe.close()
        self._process.wait()
