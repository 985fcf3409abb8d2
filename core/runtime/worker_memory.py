"""What a worker keeps from one piece of work to the next: pictures that were decoded, and processes to work in.

Nothing of it changes a result. It is handed to work that asks for it, see `Remembering`.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from threading import Lock
from typing import TYPE_CHECKING, Any

from .worker_pool import WorkerPool

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from .progress import Progress

KEPT_BYTES = 384 << 20
"""Most that is kept of pictures: 1000 frames in the size to which footage is reduced."""


class WorkerMemory:
    """Pictures and processes that are kept.

    Parameters
    ----------
    limit : int
        Bytes of pictures that are kept at most; those that were not used for longest go first.
    """

    def __init__(self, limit: int = KEPT_BYTES) -> None:
        self._limit, self._bytes = limit, 0
        self._pictures: OrderedDict[Hashable, NDArray[np.uint8]] = OrderedDict()
        self._lock = Lock()
        self._pool: WorkerPool | None = None

    def picture(self, key: Hashable) -> NDArray[np.uint8] | None:
        """What was kept by that key, if it still is."""
        with self._lock:
            if key in self._pictures:
                self._pictures.move_to_end(key)
            return self._pictures.get(key)

    def keep(self, key: Hashable, picture: NDArray[np.uint8]) -> None:
        """Keep a picture, which must not be changed any more."""
        with self._lock:
            if key in self._pictures or picture.nbytes > self._limit:
                return
            self._pictures[key] = picture
            self._bytes += picture.nbytes
            while self._bytes > self._limit:
                _, oldest = self._pictures.popitem(last=False)
                self._bytes -= oldest.nbytes

    @contextmanager
    def pool(self, workers: int, imports: Sequence[str] = ()) -> Iterator[WorkerPool]:
        """A pool of so many workers at least, kept unless the block raises; `imports` as of `WorkerProcess`."""
        if workers == 1:
            yield WorkerPool(1)
            return
        pool, self._pool = self._pool, None
        if pool is not None and pool.workers < workers:
            pool.__exit__(None)
            pool = None
        pool = WorkerPool(workers, imports) if pool is None else pool
        try:
            yield pool
        except BaseException as error:
            pool.__exit__(type(error))
            raise
        self._pool = pool

    def expect(self, workers: int, imports: Sequence[str] = ()) -> None:
        """Start the processes of a pool of so many workers: they are ready by the time that it is asked for."""
        with self.pool(workers, imports):
            pass

    @property
    def workers(self) -> int:
        """How many workers the pool has that is kept; 1 where none is."""
        return 1 if self._pool is None else self._pool.workers

    def close(self) -> None:
        """End the processes that are kept."""
        if self._pool is not None:
            self._pool.__exit__(None)
            self._pool = None


@dataclass(frozen=True)
class Remembering:
    """Work that may use what its worker keeps.

    Attributes
    ----------
    work : callable
        Called with progress and `memory`, a WorkerMemory.
    shows : bool
        It hands out interim results: it is also called with `show`, see `worker_process.Show`.
    """

    work: Callable[..., Any]
    shows: bool = False

    def __call__(self, progress: Progress) -> Any:
        """Do the work where nothing is kept."""
        return self.work(progress)
