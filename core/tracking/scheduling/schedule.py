"""The order in which the segments of a shot are solved and refined, and what each one knows of the others.

Segments that meet on a key pose of the whole body of every performer do not wait for each other: each is solved on its
own, and refined once both neighbours are solved. Where segments meet on another frame, the later one continues the
motion of the earlier one. What a segment knows does not depend on the number of workers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from ...body.motion import Motion
from ...evidence.part_shapes import ShapeEvidence
from ...evidence.view_frames import ViewFrames
from ...keypoints.observations import ShotKeypoints
from ...runtime.processes.worker_pool import WorkerPool
from ...runtime.progress import ParallelProgress, Progress
from ...runtime.timing import Seconds
from ...shot.segments import Segment, segments, whole_keys
from ...shot.shot import Shot
from ..footage_reading.picture_store import StoredView
from ..results.journal import FinishedSegment, KeptSegments
from ..solvers.registry import solver_named
from ..track_state import EarlierTrack, TrackState
from .segment_tasks import RefinedSegment, SegmentTask, SolvedSegment, Watcher, refine_task, solve_task

Observer = Callable[[Segment, int, Sequence[Motion]], None]
SegmentShown = Callable[[Segment, tuple[Motion, ...]], None]
"""Called with a segment and its motions as soon as it is solved, and again once it is refined."""
READ_AHEAD = 3
"""Segments per worker, from the first that is not solved on, whose pictures are read: one with a lost limb takes as
long as many others."""
READING_SHARE, SOLVING_SHARE = 0.15, 0.3
"""Shares of the work on a segment, for reports of progress: reading its footage, and solving it; the rest is its
refinement."""


@dataclass(frozen=True, eq=False)
class ScheduleCallbacks:
    """What is called while the segments of a shot are solved and refined.

    Attributes
    ----------
    progress : callable, optional
    observe : callable, optional
        See `tracker.track`; it needs a single worker.
    show : callable, optional
        See `SegmentShown`; called in the threads of the pool.
    """

    progress: Progress | None = None
    observe: Observer | None = None
    show: SegmentShown | None = None


@dataclass(frozen=True, eq=False)
class ScheduleStart:
    """What is known of a shot before any of its segments is solved.

    Attributes
    ----------
    state : TrackState
    observed : ShotKeypoints
    earlier : EarlierTrack, optional
        The shot as it was tracked before, to start from.
    """

    state: TrackState
    observed: ShotKeypoints = field(default_factory=ShotKeypoints)
    earlier: EarlierTrack | None = None


@dataclass(frozen=True, eq=False)
class SegmentWorkers:
    """What solves the segments of a shot.

    Attributes
    ----------
    pool : WorkerPool
    threads : int
        Threads of each worker.
    helpers : WorkerPool, optional
        See `SegmentTask`.
    """

    pool: WorkerPool
    threads: int = 1
    helpers: WorkerPool | None = None


class SegmentSchedule:
    """The segments of a shot on their way through a pool of workers.

    Parameters
    ----------
    shot : Shot
    start : ScheduleStart
    workers : SegmentWorkers
    finished : KeptSegments
        Segments of an earlier run, and where those of this one are kept.
    callbacks : ScheduleCallbacks, optional

    Attributes
    ----------
    state : TrackState
        The shot with all segments solved so far, before refinement.
    seconds : Seconds
        Time spent, by stage.
    """

    def __init__(
        self,
        shot: Shot,
        start: ScheduleStart,
        workers: SegmentWorkers,
        finished: KeptSegments,
        callbacks: ScheduleCallbacks = ScheduleCallbacks(),
    ) -> None:
        self.state, self.seconds = start.state, Seconds()
        self._shot, self._start, self._workers, self._pool = shot, start, workers, workers.pool
        self._segments, self._kept = segments(shot), finished
        self._observe, self._show = callbacks.observe, callbacks.show
        self._overall = ParallelProgress(callbacks.progress)
        refines = solver_named(shot.settings.solver).refine is not None
        self._solving_share = SOLVING_SHARE if refines else 1 - READING_SHARE
        self._refining_share = 1 - READING_SHARE - self._solving_share
        whole = set(whole_keys(shot, 0, shot.length - 1).tolist())
        # Segments that begin on no key pose of the whole body continue the motion of the one before.
        self._continues = [k > 0 and first not in whole for k, (first, _) in enumerate(self._segments)]
        self._views: list[tuple[ViewFrames | StoredView, ...]] = []
        self._solving: list[Future[SolvedSegment] | FinishedSegment] = []
        self._refining: list[Future[RefinedSegment] | FinishedSegment] = []
        self._done: list[FinishedSegment] = []
        self._solved = 0

    def add(self, views: tuple[ViewFrames | StoredView, ...]) -> None:
        """Take the views of the next segment; returns once no more are waiting than the workers need (`READ_AHEAD`)."""
        k = len(self._solving)
        self._await_solved(k if self._continues[k] else k - READ_AHEAD * self._pool.workers + 1)
        self._views.append(views)
        if (known := self._kept.known.get(self._segments[k])) is not None:
            self._part(k, 1.0)(1.0)
            self._solving.append(known)
            if self._show is not None:
                self._show(known.segment, known.motions)
        else:
            self._part(k, READING_SHARE)(1.0)
            start = self._start
            state = self.state if self._continues[k] else start.state
            work = partial(solve_task, self._task(k, state), start.observed, start.earlier, watch=self._watcher(k))
            solving: Future[SolvedSegment] = self._pool.submit(work, self._part(k, self._solving_share))
            solving.add_done_callback(lambda done: self._hand_out(done, k, lambda s: s.solution.motions))
            self._solving.append(solving)
        if self._pool.workers == 1:
            self._await_solved(k + 1)

    def finish(self, on_solved: Callable[[TrackState], None] | None = None) -> tuple[TrackState, list[FinishedSegment]]:
        """Wait for all segments; returns the shot with all segments refined, and the finished segments.

        `on_solved` is called with the state once all segments are solved, before the last ones are refined.
        """
        self._await_solved(len(self._segments))
        if on_solved is not None:
            on_solved(self.state)
        self._await_refined(len(self._segments))
        state = self.state
        for done in self._done:
            state = state.with_solution(done.segment, done.motions)
        return state, self._done

    def _task(self, k: int, state: TrackState) -> SegmentTask:
        threads, helpers = self._workers.threads, self._workers.helpers
        return SegmentTask(self._shot, self._segments[k], self._views[k], state, threads, helpers)

    def _part(self, k: int, work: float) -> Callable[[float], None]:
        """Return the callback for a part of the work on a segment."""
        first, last = self._segments[k]
        return self._overall.part("tracking", work * (last - first) / (self._shot.length - 1))

    def _watcher(self, k: int) -> Watcher | None:
        return None if self._observe is None else partial(self._observe, self._segments[k])

    def _hand_out(self, done: Future[Any], k: int, motions: Callable[[Any], tuple[Motion, ...]]) -> None:
        """Hand out the motions of a segment that is done; its errors are raised elsewhere."""
        if self._show is not None and not done.cancelled() and done.exception() is None:
            self._show(self._segments[k], motions(done.result()))

    def _await_solved(self, count: int) -> None:
        """Wait until `count` segments are solved; the refinement of each begins once the next one is solved."""
        while self._solved < count:
            k, found = self._solved, self._solving[self._solved]
            if isinstance(found, FinishedSegment):
                motions, offset = found.first_motions, found.offset
            else:
                solved = found.result()
                self.seconds.add(solved.seconds)
                motions, offset = solved.solution.motions, solved.offset
            self.state = self.state.with_solution(self._segments[k], motions).with_offset(offset)
            self._solved += 1
            if k > 0:
                self._refine(k - 1)
        if self._solved == len(self._segments) > len(self._refining):
            self._refine(self._solved - 1)

    def _refine(self, k: int) -> None:
        """Start the refinement of a segment whose neighbours are solved."""
        found, state = self._solving[k], self.state
        if isinstance(found, FinishedSegment):
            self._refining.append(found)
        elif (solved := found.result()).finished is not None:
            self._refining.append(solved.finished)
            self._part(k, self._refining_share)(1.0)
        else:
            if self._continues[k]:
                self._await_refined(k)
                state = state.with_solution(self._segments[k - 1], self._done[k - 1].motions)
            work = partial(refine_task, self._task(k, state), solved, self._shapes_beside(k), watch=self._watcher(k))
            refining: Future[RefinedSegment] = self._pool.submit(work, self._part(k, self._refining_share))
            refining.add_done_callback(lambda done: self._hand_out(done, k, lambda r: r.finished.motions))
            self._refining.append(refining)
        self._await_refined(k - 2 * self._pool.workers)

    def _shapes_beside(self, k: int) -> list[ShapeEvidence]:
        """What the key frames of the segments beside a segment, which are solved, say about the shapes of the parts."""
        beside = [self._solving[j] for j in (k - 1, k + 1) if 0 <= j < len(self._solving)]
        each = [found.shape if isinstance(found, FinishedSegment) else found.result().shape for found in beside]
        return [shape for shape in each if shape is not None]

    def _await_refined(self, count: int) -> None:
        """Wait until `count` segments are refined, write them to the journal, and release their pictures."""
        for k in range(len(self._done), len(self._refining)):
            refining = self._refining[k]
            if isinstance(refining, FinishedSegment):
                self._done.append(refining)
            elif k < count or refining.done():
                self._done.append(refining.result().finished)
                self.seconds.add(refining.result().seconds)
            else:
                break
            if self._segments[k] not in self._kept.known:
                self._kept.write(self._done[k])
            for view in self._views[k]:
                if isinstance(view, StoredView):
                    view.remove()
            self._views[k] = ()
