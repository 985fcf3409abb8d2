"""A pool of workers: processes of their own, and this one, that do pieces of work side by side.

Python runs one thread at a time, so threads alone keep less than one and a half cores busy.
"""

from __future__ import annotations

import queue
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from threading import Event
from typing import Any

from ..errors import CancelledError, WorkerEndedError
from .worker_process import Work, WorkerProcess


class WorkerPool:
    """Workers that take work in the order in which it is submitted.

    With one worker nothing is started: work is done when it is submitted, in the thread that submits it.

    Parameters
    ----------
    workers : int
        How many pieces of work are done side by side: one in this process, and each of the others in a process that
        ends with the pool.
    imports : sequence of str
        See `WorkerProcess`.
    """

    def __init__(self, workers: int, imports: Sequence[str] = ()) -> None:
        self.workers = workers
        self._ended = Event()
        self._failure: WorkerEndedError | None = None
        self._processes = [WorkerProcess(yields=False, tidies=False, imports=imports) for _ in range(workers - 1)]
        # The processes come first, and this one last: it reads footage and draws meanwhile, under the same lock.
        self._idle: queue.PriorityQueue[int] = queue.PriorityQueue()
        for place in range(workers):
            self._idle.put(place)
        self._threads = ThreadPoolExecutor(workers) if workers > 1 else None

    def __enter__(self) -> WorkerPool:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """End the processes; where an exception ends the block, work that is not done is given up."""
        self._ended.set()
        if kind is not None:
            self._kill()
        if self._threads is not None:
            self._threads.shutdown(cancel_futures=True)
        self._kill()  # they have nothing to do, and Python takes its time to end
        for process in self._processes:
            process.close()

    def _kill(self) -> None:
        for process in self._processes:
            process.kill()

    def submit(self, work: Work, progress: Callable[[float], object]) -> Future[Any]:
        """Have a piece of work done.

        Parameters
        ----------
        work : callable
        progress : callable
            Called with the share of it that is done; what it raises ends the work.

        Returns
        -------
        Future
            Of its result; WorkerEndedError where its process ended before it was done.
        """
        if self._threads is not None:
            return self._threads.submit(self._done, work, progress)
        done: Future[Any] = Future()
        done.set_result(work(lambda _, fraction: progress(fraction) is not False))
        return done

    def _done(self, work: Work, progress: Callable[[float], object]) -> Any:
        """Do a piece of work in the process that is idle; runs in a thread for which there is one."""
        place = self._idle.get()

        def report(_: str, fraction: float) -> bool:
            if self._failure is not None:  # what the others do is of no use any more
                raise self._failure
            if self._ended.is_set():
                raise CancelledError
            return progress(fraction) is not False

        try:
            if place == len(self._processes):
                return work(report)
            return self._processes[place].call(work, lambda state: report(*state))
        except WorkerEndedError as error:
            self._failure = error
            raise
        finally:
            self._idle.put(place)
