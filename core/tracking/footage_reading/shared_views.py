"""The views of a segment that is solved alone, each in one of several processes, which keep its images and caches.

Segments are solved in parallel, but a single one is not, and of the threads of a process one at a time runs Python.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from typing import Any
from uuid import uuid4

from ...errors import WorkerEndedError
from ...evidence.frame_comparison import EvidenceCaches
from ...evidence.view_frames import ViewFrames
from ...evidence.view_work import IN_THIS_THREAD, Result, Task, Work
from ...runtime.processes.worker_memory import CachingTask, WorkerMemory
from ...runtime.processes.worker_process import WorkerProcess
from ...runtime.progress import Progress
from ...runtime.threads import one_library_thread
from .picture_store import StoredView

_KEY = "shared views"


class SharedViews:
    """Work on views that is done in the processes that they are divided among, this one first; a `ViewWork`.

    Parameters
    ----------
    processes : sequence of WorkerProcess
        They do nothing else meanwhile.
    views : sequence of ViewFrames
        As they are open in this process. Work on other ones, such as some of their frames, is done here.
    stored : sequence of StoredView
        The same views, as other processes open them.
    """

    def __init__(
        self, processes: Sequence[WorkerProcess], views: Sequence[ViewFrames], stored: Sequence[StoredView]
    ) -> None:
        self._processes, self._stored, self._key = tuple(processes), tuple(stored), uuid4().hex
        self._number = {view: v for v, view in enumerate(views)}
        self._threads = ThreadPoolExecutor(len(self._processes))

    @property
    def parallel(self) -> int:
        """Number of processes."""
        return 1 + len(self._processes)

    def of_each(self, work: Work[Result], tasks: Sequence[Task], caches: EvidenceCaches) -> Iterator[Result]:
        """Do tasks, and generate their results in their order; see `ViewWork`."""
        places = [self._number.get(view, 0) % self.parallel for view, _ in tasks]
        by_place = [[k for k, place in enumerate(places) if place == own] for own in range(self.parallel)]
        sent = [
            self._threads.submit(process.call, self._there(work, [tasks[k] for k in chosen]))
            for process, chosen in zip(self._processes, by_place[1:], strict=True)
            if chosen
        ]
        here = by_place[0]
        found = dict(zip(here, IN_THIS_THREAD.of_each(work, [tasks[k] for k in here], caches), strict=True))
        for chosen, done in zip(filter(None, by_place[1:]), sent, strict=True):
            found.update(zip(chosen, done.result(), strict=True))
        for k in range(len(tasks)):
            yield found.pop(k)

    def _there(self, work: Work[Any], tasks: Sequence[Task]) -> CachingTask:
        numbered = [(self._number[view], asked) for view, asked in tasks]
        return CachingTask(partial(_done_there, self._key, self._stored, work, numbered))

    def close(self) -> None:
        """Let the processes forget the views."""
        self._threads.shutdown()
        for process in self._processes:
            with suppress(WorkerEndedError):
                process.call(CachingTask(_forget))


@dataclass(frozen=True, eq=False)
class _Opened:
    """The views that a process has opened: whose, and what it keeps of them."""

    key: str
    views: tuple[ViewFrames, ...]
    caches: EvidenceCaches = field(default_factory=EvidenceCaches)


@one_library_thread()
def _done_there(
    key: str,
    stored: Sequence[StoredView],
    work: Work[Any],
    tasks: Sequence[tuple[int, Any]],
    _: Progress | None = None,
    *,
    memory: WorkerMemory,
) -> list[Any]:
    """Do tasks on views, given by their numbers, which are opened for the first of them; a task for a worker."""
    opened: _Opened | None = memory.value(_KEY, lambda: None)
    if opened is None or opened.key != key:
        opened = _Opened(key, tuple(view.opened() for view in stored))
        memory.replace_value(_KEY, opened)
    return [work(opened.views[v], opened.caches, asked) for v, asked in tasks]


def _forget(_: Progress | None = None, *, memory: WorkerMemory) -> None:
    memory.replace_value(_KEY, None)
