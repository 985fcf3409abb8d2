"""In which order the segments of a shot are solved and refined, and what each of them knows of the others.

Segments that meet on a key pose of the whole body of every performer do not wait for each other: each is solved by
itself, and refined when those beside it are solved. Where they meet on another frame, the motion goes on from the one
before. What a segment knows does not depend on how many are worked on at a time.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Future
from functools import partial
from threading import Lock
from typing import Any

from ..body.motion import Motion
from ..evidence.view_frames import ViewFrames
from ..keypoints.observations import ShotKeypoints
from ..runtime.progress import Progress, report_progress
from ..runtime.timing import Seconds
from ..runtime.worker_pool import WorkerPool
from ..shot.shot import Shot
from .journal import FinishedSegment, KeptSegments
from .picture_store import StoredView
from .segment_stages import TrackState
from .segment_tasks import RefinedSegment, SegmentTask, SolvedSegment, Watcher, refine_task, solve_task
from .segments import Segment, segments, whole_keys

Observer = Callable[[Segment, int, Sequence[Motion]], None]
SegmentShown = Callable[[Segment, tuple[Motion, ...]], None]
"""Called with a segment and the motions of its frames as soon as it is solved, and once more when it is refined."""
SOLVING = 0.7
"""Share of the work on a segment that is done before it is refined."""


class SegmentSchedule:
    """The segments of a shot on their way through a pool of workers.

    Parameters
    ----------
    shot : Shot
    begin : TrackState
        What is known before the first is solved.
    observed : ShotKeypoints
    pool : WorkerPool
    finished : KeptSegments
        Segments that an earlier run has finished, and where those of this one are kept.
    threads : int
        Of each worker.
    progress : callable, optional
    observe : callable, optional
        See `tracker.track`; with a single worker alone.
    show : callable, optional
        See `SegmentShown`; called in the threads of the pool.

    earlier : TrackState, optional
        The shot as it was tracked before.

    Attributes
    ----------
    state : TrackState
        The shot with the segments that are solved so far, none of them refined.
    seconds : Seconds
        Time spent on them, by stage.
    """

    def __init__(
        self,
        shot: Shot,
        begin: TrackState,
        observed: ShotKeypoints,
        pool: WorkerPool,
        *,
        finished: KeptSegments,
        threads: int,
        progress: Progress | None = None,
        observe: Observer | None = None,
        show: SegmentShown | None = None,
        earlier: TrackState | None = None,
    ) -> None:
        self.state, self.seconds = begin, Seconds()
        self._begin, self._shot, self._observed, self._pool, self._threads = begin, shot, observed, pool, threads
        self._segments, self._observe, self._show, self._kept = segments(shot), observe, show, finished
        self._report, self._earlier = _Report(shot, progress), earlier
        whole = set(whole_keys(shot, 0, shot.length - 1).tolist())
        self._goes_on = [k > 0 and first not in whole for k, (first, _) in enumerate(self._segments)]
        self._views: list[tuple[ViewFrames | StoredView, ...]] = []
        self._solving: list[Future[SolvedSegment] | FinishedSegment] = []
        self._refining: list[Future[RefinedSegment] | FinishedSegment] = []
        self._done: list[FinishedSegment] = []
        self._solved = 0

    def add(self, views: tuple[ViewFrames | StoredView, ...]) -> None:
        """Take the views of the next segment; returns once no more segments are under way than there are workers."""
        k = len(self._solving)
        self._collect(k if self._goes_on[k] else k - self._pool.workers + 1)
        self._views.append(views)
        if (known := self._kept.known.get(self._segments[k])) is not None:
            self._report.part(self._segments[k], 1.0)(1.0)
            self._solving.append(known)
            if self._show is not None:
                self._show(known.segment, known.motions)
        else:
            state = self.state if self._goes_on[k] else self._begin
            work = partial(solve_task, self._task(k, state), self._observed, self._earlier, watch=self._watcher(k))
            solving: Future[SolvedSegment] = self._pool.submit(work, self._report.part(self._segments[k], SOLVING))
            solving.add_done_callback(lambda done: self._show_motions(done, k, lambda s: s.solution.motions))
            self._solving.append(solving)
        if self._pool.workers == 1:
            self._collect(k + 1)

    def finish(self, solved: Callable[[TrackState], None] | None = None) -> tuple[TrackState, list[FinishedSegment]]:
        """Wait for all segments; returns the shot with all of them refined, and what is kept of each.

        `solved` is called with the shot once all segments are solved, before the last of them are refined.
        """
        self._collect(len(self._segments))
        if solved is not None:
            solved(self.state)
        self._finish(len(self._segments))
        state = self.state
        for done in self._done:
            state = state.with_solution(done.segment, done.motions)
        return state, self._done

    def _task(self, k: int, state: TrackState) -> SegmentTask:
        return SegmentTask(self._shot, self._segments[k], self._views[k], state, self._threads)

    def _watcher(self, k: int) -> Watcher | None:
        return None if self._observe is None else partial(self._observe, self._segments[k])

    def _show_motions(self, done: Future[Any], k: int, motions: Callable[[Any], tuple[Motion, ...]]) -> None:
        """Hand out the motions of a segment that is done; what went wrong with it is raised elsewhere."""
        if self._show is not None and not done.cancelled() and done.exception() is None:
            self._show(self._segments[k], motions(done.result()))

    def _collect(self, count: int) -> None:
        """Wait until so many segments are solved; each is refined once the one after it is."""
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
        """Have a segment refined, among those that are solved."""
        found, state = self._solving[k], self.state
        if isinstance(found, FinishedSegment):
            self._refining.append(found)
        elif (solved := found.result()).finished is not None:
            self._refining.append(solved.finished)
        else:
            if self._goes_on[k]:
                self._finish(k)
                state = state.with_solution(self._segments[k - 1], self._done[k - 1].motions)
            work = partial(refine_task, self._task(k, state), solved, watch=self._watcher(k))
            refining: Future[RefinedSegment] = self._pool.submit(
                work, self._report.part(self._segments[k], 1 - SOLVING)
            )
            refining.add_done_callback(lambda done: self._show_motions(done, k, lambda r: r.finished.motions))
            self._refining.append(refining)
        self._finish(k - 2 * self._pool.workers)

    def _finish(self, count: int) -> None:
        """Wait until so many segments are refined, keep all that are, and let go of their pictures."""
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


class _Report:
    """Reports progress over the segments of a shot, which are worked on side by side."""

    def __init__(self, shot: Shot, progress: Progress | None) -> None:
        self._last, self._progress = shot.length - 1, progress
        self._parts: list[float] = []
        self._lock = Lock()

    def part(self, segment: Segment, work: float) -> Callable[[float], None]:
        """The callback for a share of the work on a segment."""
        share, place = work * (segment[1] - segment[0]) / self._last, len(self._parts)
        self._parts.append(0.0)

        def report(done: float) -> None:
            with self._lock:
                self._parts[place] = max(self._parts[place], done * share)
                report_progress(self._progress, "tracking", min(sum(self._parts), 1.0))

        return report
