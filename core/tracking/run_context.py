"""What a run of the tracker may use beside the shot."""

from __future__ import annotations

from dataclasses import dataclass

from ..runtime.worker_memory import WorkerMemory
from .journal import Journal
from .schedule import SegmentShown


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
    footage_checked : bool
        It was seen a moment ago that the footage can serve the shot, as `core.tracking.prepare` does.
    """

    journal: Journal | None = None
    memory: WorkerMemory | None = None
    show: SegmentShown | None = None
    footage_checked: bool = False


NOTHING_KEPT = RunContext()
