"""A worker's cache from one task to the next: decoded pictures, small values, and a pool of processes.

It never changes a result. Tasks that use it are wrapped in `CachingTask`.
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

    from ..progress import Progress

MAX_PICTURE_BYTES = 384 << 20
"""Largest size of the cached pictures: about 1000 frames at the usual working size."""
MAX_VALUES = 10000
"""Largest number of cached small values, mostly of one or two kilobytes."""


class WorkerMemory:
    """A cache of pictures, small values and processes.

    Parameters
    ----------
    limit : int
        Largest size of the pictures, bytes; the least recently used are dropped first.
    """

    def __init__(self, limit: int = MAX_PICTURE_BYTES) -> None:
        self._limit, self._bytes = limit, 0
        self._pictures: OrderedDict[Hashable, NDArray[np.uint8]] = OrderedDict()
        self._values: OrderedDict[Hashable, Any] = OrderedDict()
        self._lock = Lock()
        self._pool: WorkerPool | None = None

    def picture(self, key: Hashable) -> NDArray[np.uint8] | None:
        """Return the picture with a key, or None if it is not in the cache."""
        with self._lock:
            if key in self._pictures:
                self._pictures.move_to_end(key)
            return self._pictures.get(key)

    def keep(self, key: Hashable, picture: NDArray[np.uint8]) -> None:
        """Add a picture, which must not be changed afterwards."""
        with self._lock:
            if key in self._pictures or picture.nbytes > self._limit:
                return
            self._pictures[key] = picture
            self._bytes += picture.nbytes
            while self._bytes > self._limit:
                _, oldest = self._pictures.popitem(last=False)
                self._bytes -= oldest.nbytes

    def value(self, key: Hashable, make: Callable[[], Any]) -> Any:
        """Return the cached value of a key, or make it; it must be small and must not be changed.

        None is not cached.
        """
        with self._lock:
            value = self._values.get(key)
        if value is None:
            value = make()
        with self._lock:
            self._values[key] = value
            self._values.move_to_end(key)
            if len(self._values) > MAX_VALUES:
                self._values.popitem(last=False)
        return value

    def replace_value(self, key: Hashable, value: Any) -> None:
        """Cache another value of a key."""
        with self._lock:
            self._values[key] = value
            self._values.move_to_end(key)

    @contextmanager
    def pool(self, workers: int, imports: Sequence[str] = (), *, copied: bool = False) -> Iterator[WorkerPool]:
        """Provide a pool of at least `workers` workers, kept unless the block raises; the rest as in
        `WorkerProcess`.
        """
        if workers == 1:
            yield WorkerPool(1)
            return
        pool, self._pool = self._pool, None
        if pool is None:
            pool = WorkerPool(workers, imports, copied=copied)
        elif pool.workers < workers:
            pool.grow(workers, imports, copied=copied)
        try:
            yield pool
        except BaseException as error:
            pool.__exit__(type(error))
            raise
        self._pool = pool

    def start_workers(self, workers: int, imports: Sequence[str] = (), *, copied: bool = False) -> None:
        """Start the processes of a pool in advance, so that they are ready when it is needed."""
        with self.pool(workers, imports, copied=copied):
            pass

    @property
    def workers(self) -> int:
        """Number of workers of the pool in the cache; 1 if there is none."""
        return 1 if self._pool is None else self._pool.workers

    def close(self) -> None:
        """End the processes in the cache."""
        if self._pool is not None:
            self._pool.__exit__(None)
            self._pool = None


@dataclass(frozen=True)
class CachingTask:
    """A task that uses its worker's cache.

    Attributes
    ----------
    work : callable
        Called with progress and `memory`, a WorkerMemory.
    shows : bool
        Whether it hands out interim results; then it is also called with `show`, see `worker_process.Show`.
    """

    work: Callable[..., Any]
    shows: bool = False

    def __call__(self, progress: Progress) -> Any:
        """Do the work with an empty cache."""
        return self.work(progress)
