"""Work on the views of a segment, divided among threads or processes. Who does what does not change a result."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

from .frame_comparison import EvidenceCaches
from .view_frames import ViewFrames

Result = TypeVar("Result")
Work = Callable[[ViewFrames, EvidenceCaches, Any], Result]
"""Called with a view, caches for evaluations of its evidence, and what is asked."""
Task = tuple[ViewFrames, Any]
"""A view, and what is asked of it."""


class ViewWork(Protocol):
    """Who does work on views."""

    @property
    def parallel(self) -> int:
        """Number of tasks that are done at a time."""

    def of_each(self, work: Work[Result], tasks: Sequence[Task], caches: EvidenceCaches) -> Iterator[Result]:
        """Do tasks, and generate their results in their order.

        Parameters
        ----------
        work : callable
            A function of a module, as it may be called in another process.
        tasks : sequence of (ViewFrames, object)
        caches : EvidenceCaches
            For what is done in this process.
        """


@dataclass(frozen=True)
class InThreads:
    """Threads of this process, of which one at a time runs Python."""

    parallel: int = 1

    def of_each(self, work: Work[Result], tasks: Sequence[Task], caches: EvidenceCaches) -> Iterator[Result]:
        """Do tasks; see `ViewWork`."""
        if self.parallel == 1:
            yield from (work(view, caches, asked) for view, asked in tasks)
            return
        with ThreadPoolExecutor(self.parallel) as pool:
            yield from pool.map(lambda task: work(task[0], caches, task[1]), tasks)


IN_THIS_THREAD = InThreads()
