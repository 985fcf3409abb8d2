"""Services for a run of the tracker beside the shot: journal, cache, and callbacks."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ...keypoints.observations import ShotKeypoints
from ...numerics.arrays import Array
from ...runtime.processes.worker_memory import WorkerMemory
from ...runtime.processes.worker_pool import WorkerPool
from ...shot.shot import Gap
from ..results.journal import Journal
from .schedule import SegmentShown


@dataclass(frozen=True, eq=False)
class SolvedShot:
    """The results that are final once all segments of a shot are solved, before they are refined.

    Attributes
    ----------
    pictures, observed, footage_offset, gaps, turns
        See `core.tracking.results.track_result.TrackResult`.
    """

    pictures: tuple[dict[int, Any], ...]
    observed: ShotKeypoints
    footage_offset: float
    gaps: tuple[tuple[Gap, ...], ...]
    turns: tuple[Array | None, ...]

    def of_views(self, views: Sequence[int]) -> SolvedShot:
        """Return the same of some views, in that order."""
        return replace(
            self,
            pictures=tuple(self.pictures[v] for v in views),
            observed=self.observed.of_views(views),
            gaps=tuple(self.gaps[v] for v in views),
            turns=tuple(self.turns[v] for v in views),
        )


@dataclass(frozen=True, eq=False)
class FirstPictures:
    """What is called as soon as some of a shot's frames are read, before most of it is tracked.

    Attributes
    ----------
    frames : frozenset of int
        These frames, counted from the shot's first.
    seen : callable
        Called with each view's pictures of at least these, by frame: see `TrackResult`.
    """

    frames: frozenset[int]
    seen: Callable[[Sequence[Mapping[int, Any]]], None]


@dataclass(frozen=True, eq=False)
class RunContext:
    """What a run of the tracker may store, reuse and hand out early. None of it changes the result.

    Attributes
    ----------
    journal : Journal, optional
        Where finished segments are written, and from where those of an earlier run are taken.
    memory : WorkerMemory, optional
        Cache of frames and processes for the next shot, which is often the same one with a changed key pose.
    show : callable, optional
        Called with a segment and its motions as soon as it is solved, and again once it is refined.
    solved : callable, optional
        Called with the pool of workers and a `SolvedShot` once all segments are solved, while the last are refined and
        some workers are idle. It is not called with a single worker.
    first_pictures : FirstPictures, optional
        What is called once some frames are read; these are decoded even if they are in memory.
    footage_checked : bool
        The footage has just been checked by `core.tracking.prepare`, and need not be checked again.
    """

    journal: Journal | None = None
    memory: WorkerMemory | None = None
    show: SegmentShown | None = None
    solved: Callable[[WorkerPool, SolvedShot], None] | None = None
    first_pictures: FirstPictures | None = None
    footage_checked: bool = False


PLAIN_RUN = RunContext()
