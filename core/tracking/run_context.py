"""What a run of the tracker may use beside the shot."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ..keypoints.observations import ShotKeypoints
from ..runtime.worker_memory import WorkerMemory
from ..runtime.worker_pool import WorkerPool
from .journal import Journal
from .schedule import SegmentShown


@dataclass(frozen=True, eq=False)
class SolvedShot:
    """What is known of a shot once all of its segments are solved, and stays when they are refined.

    Attributes
    ----------
    pictures, observed, footage_offset
        See `core.tracking.track_result.TrackResult`.
    """

    pictures: tuple[dict[int, Any], ...]
    observed: ShotKeypoints
    footage_offset: float


@dataclass(frozen=True, eq=False)
class RunContext:
    """What a run may keep, reuse and hand out early. Nothing of it changes the result.

    Attributes
    ----------
    journal : Journal, optional
        Where finished segments are kept, and taken from if an earlier run has finished them.
    memory : WorkerMemory, optional
        Keeps frames and processes for the next shot that is tracked, which is often the same with one key pose changed.
    show : callable, optional
        Called with a segment and the motions of its frames as soon as it is solved, and again when it is refined.
    solved : callable, optional
        Called with the pool of workers and what is known of the shot, once all segments are solved and the last are
        being refined: not all workers have something to do then. It is not called where there is one alone.
    footage_checked : bool
        It was seen a moment ago that the footage can serve the shot, as `core.tracking.prepare` does.
    """

    journal: Journal | None = None
    memory: WorkerMemory | None = None
    show: SegmentShown | None = None
    solved: Callable[[WorkerPool, SolvedShot], None] | None = None
    footage_checked: bool = False


NOTHING_KEPT = RunContext()
