"""A pool of workers: this process and others, which do tasks in parallel.

Python runs one thread at a time, so threads alone keep fewer than one and a half cores busy.
"""

from __future__ import annotations

import queue
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from threading import Event
from typing import Any

from ...errors import CancelledError, WorkerEndedError
from ..progress import ParallelProgress, Progress, is_cancelled
from .worker_process import Work, WorkerProcess


class WorkerPool:
    """Workers that take tasks in the order in which they are submitted.

    With a single worker no process is started: a task is done as it is submitted, in the thread that submits it.

    Parameters
    ----------
    workers : int
        Number of tasks done in parallel: one in this process, and each of the others in a process that ends with the
        pool.
    imports : sequence of str
    copied : bool
        See `WorkerProcess`.
    """

    def __init__(self, workers: int, imports: Sequence[str] = (), *, copied: bool = False) -> None:
        self._ended = Event()
        self._failure: WorkerEndedError | None = None
        self._processes: list[WorkerProcess] = []
        self._threads: ThreadPoolExecutor | None = None
        self.grow(workers, imports, copied=copied)

    def grow(self, workers: int, imports: Sequence[str] = (), *, copied: bool = False) -> None:
        """Start processes until there are `workers` workers; only while no task is running. The rest as above."""
        for _ in range(workers - 1 - len(self._processes)):
            self._processes.append(WorkerProcess(yields=False, tidies=False, imports=imports, copied=copied))
        self.workers = 1 + len(self._processes)
        # This process is used last: it also decodes footage and draws meanwhile, under the same interpreter lock.
        self._idle: queue.PriorityQueue[int] = queue.PriorityQueue()
        for place in range(self.workers):
            self._idle.put(place)
        if self._threads is not None:
            self._threads.shutdown()
        self._threads = ThreadPoolExecutor(self.workers) if self.workers > 1 else None

    def __enter__(self) -> WorkerPool:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """End the processes; if an exception ends the block, unfinished tasks are dropped."""
        self._ended.set()
        if kind is not None:
            self._kill()
        if self._threads is not None:
            self._threads.shutdown(cancel_futures=True)
        self._kill()  # they are idle, and Python takes long to exit
        for process in self._processes:
            process.close()

    def _kill(self) -> None:
        for process in self._processes:
            process.kill()

    def submit(self, work: Work, progress: Callable[[float], object]) -> Future[Any]:
        """Submit a task.

        Parameters
        ----------
        work : callable
        progress : callable
            Called with the fraction of the task that is done, at its end with 1; an exception that it raises ends the
            task.

        Returns
        -------
        Future
            The task's result; raises WorkerEndedError if its process ended before the task was done.
        """
        if self._threads is not None:
            return self._threads.submit(self._done, work, progress)
        done: Future[Any] = Future()
        done.set_result(work(lambda _, fraction: not is_cancelled(progress(fraction))))
        progress(1.0)
        return done

    @contextmanager
    def lent(self, most: int) -> Iterator[list[WorkerProcess]]:
        """Lend up to so many idle processes to the block, which calls them itself; the other workers do the tasks."""
        taken: list[int] = []
        try:
            while len(taken) < most and (place := self._idle.get()) < len(self._processes):
                taken.append(place)
            if len(taken) < most:
                self._idle.put(len(self._processes))
            yield [self._processes[place] for place in taken]
        finally:
            for place in taken:
                self._idle.put(place)

    def do_all(self, tasks: Sequence[tuple[str, Work]], progress: Progress | None = None) -> list[Any]:
        """Do tasks, and return their results in their order.

        Parameters
        ----------
        tasks : sequence of tuple of str and callable
            What is reported while a task is done, and the task; all count as the same amount of work.
        progress : callable, optional

        Raises
        ------
        Exception
            Whatever the first of those that failed raised.
        """
        overall = ParallelProgress(progress)
        done = [self.submit(work, overall.part(what, 1 / len(tasks))) for what, work in tasks]
        return [task.result() for task in done]

    def _done(self, work: Work, progress: Callable[[float], object]) -> Any:
        """Do a task in an idle process; there are no more threads that run this than processes."""
        place = self._idle.get()

        def report(_: str, fraction: float) -> bool:
            if self._failure is not None:  # the other tasks are no longer needed
                raise self._failure
            if self._ended.is_set():
                raise CancelledError
            return not is_cancelled(progress(fraction))

        try:
            if place == len(self._processes):
                result = work(report)
            else:
                result = self._processes[place].call(work, lambda state: report(*state))
            progress(1.0)
            return result
        except WorkerEndedError as error:
            self._failure = error
            raise
        finally:
            self._idle.put(place)
