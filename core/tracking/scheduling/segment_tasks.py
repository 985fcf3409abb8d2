"""Solving and refining a segment as tasks for `core.runtime.processes.worker_pool`, with values that can be pickled."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace

import numpy as np

from ...body.motion import Motion
from ...evidence.part_shapes import ShapeEvidence
from ...evidence.time_offset import Offset
from ...evidence.view_frames import ViewFrames
from ...evidence.view_work import InThreads, ViewWork
from ...keypoints.observations import ShotKeypoints
from ...numerics.arrays import Array
from ...runtime.processes.worker_pool import WorkerPool
from ...runtime.progress import Progress, report_progress, step_share
from ...runtime.threads import one_library_thread
from ...runtime.timing import Seconds
from ...shot.acceleration_prior import usual_variances
from ...shot.segments import Segment, segments
from ...shot.shot import Shot
from ..expected_errors.uncertainty import segment_uncertainties
from ..footage_reading.picture_store import StoredView
from ..footage_reading.shared_views import SharedViews
from ..results.journal import FinishedSegment
from ..results.track_result import SegmentResult
from ..solvers.equations.measurement import StepCallback, Workspace
from ..solvers.equations.problem import SegmentSolution
from ..solvers.protocol import SettledMotions
from ..solvers.registry import solver_named
from ..track_state import EarlierTrack, TrackState
from .segment_stages import (
    SegmentData,
    SegmentState,
    measured_offset,
    refine_segment,
    resume_segment,
    segment_data,
    solve_segment,
    with_shape_beside,
)

UNCERTAINTY_SHARE = 0.08
"""Share of the work of refining a segment that its uncertainty takes, for reports of progress."""
Watcher = Callable[[int, Sequence[Motion]], None]
"""Called with the number of an iteration and the motions before it."""


@dataclass(frozen=True, eq=False)
class SegmentTask:
    """The input of solving or refining a segment.

    Attributes
    ----------
    shot : Shot
    segment : tuple of int
    views : tuple of ViewFrames or StoredView
    state : TrackState
        What is known of the shot when the task starts.
    threads : int
        Number of threads for image work.
    helpers : WorkerPool, optional
        If the segment is solved alone, in this process: whose processes work on its views as well.
    """

    shot: Shot
    segment: Segment
    views: tuple[ViewFrames | StoredView, ...]
    state: TrackState
    threads: int
    helpers: WorkerPool | None = None

    def opened(self) -> tuple[ViewFrames, ...]:
        """Return the views with their pictures mapped into memory."""
        return tuple(view.opened() if isinstance(view, StoredView) else view for view in self.views)

    @contextmanager
    def shared(self, views: tuple[ViewFrames, ...]) -> Iterator[ViewWork]:
        """Divide work on the opened views while the block runs."""
        stored = [view for view in self.views if isinstance(view, StoredView)]
        if self.helpers is None or len(stored) < len(views):
            yield InThreads(self.threads)
            return
        with self.helpers.lent(len(views) - 1) as processes:
            if not processes:
                yield InThreads(self.threads)
                return
            with closing(SharedViews(processes, views, stored)) as shared:
                yield shared


@dataclass(frozen=True, eq=False)
class RefinedSegment:
    """A refined segment.

    Attributes
    ----------
    finished : FinishedSegment
    seconds : dict
        Time spent, by stage.
    """

    finished: FinishedSegment
    seconds: dict[str, float]


@dataclass(frozen=True, eq=False)
class SolvedSegment:
    """A solved segment, before refinement.

    Attributes
    ----------
    data : SegmentData
        Without views.
    solution : SegmentSolution
        Without evidence.
    offset : Offset or None
        Footage offset measured on this segment.
    seconds : dict
        Time spent, by stage.
    finished : FinishedSegment, optional
        The finished segment, if it is not to be refined.
    """

    data: SegmentData
    solution: SegmentSolution
    offset: Offset | None
    seconds: dict[str, float]
    finished: FinishedSegment | None = None

    @property
    def shape(self) -> ShapeEvidence | None:
        """What its key frames say about the shapes of the parts."""
        return None if self.data.shape is None else self.data.shape.evidence


@one_library_thread()
def solve_task(
    task: SegmentTask,
    observed: ShotKeypoints,
    earlier: EarlierTrack | None = None,
    progress: Progress | None = None,
    watch: Watcher | None = None,
) -> SolvedSegment:
    """Solve a segment.

    Parameters
    ----------
    task : SegmentTask
    observed : ShotKeypoints
    earlier : EarlierTrack, optional
        The shot as it was tracked before. A segment that is solved from there and is not doubtful is not refined.
    progress, watch : callable, optional
        See `Progress` and `Watcher`.
    """
    views = task.opened()
    with task.shared(views) as by:
        return _solved(task, views, observed, earlier, by=by, progress=progress, watch=watch)


def _solved(
    task: SegmentTask,
    views: tuple[ViewFrames, ...],
    observed: ShotKeypoints,
    earlier: EarlierTrack | None,
    *,
    by: ViewWork,
    progress: Progress | None,
    watch: Watcher | None,
) -> SolvedSegment:
    """Solve a segment whose views are open; see `solve_task`."""
    shot, segment, state, seconds = task.shot, task.segment, task.state, Seconds()
    solver = solver_named(shot.settings.solver)
    with seconds.measure("appearance"):
        data = segment_data(shot, segment, views, state, observed, by=by)
    if earlier is not None:
        workspace = Workspace(by, on_step=_steps(progress, None))
        if (resumed := resume_segment(shot, solver, data, earlier, workspace)) is not None:
            seconds.add(resumed.solution.seconds)
            workspace.recent.forget()  # images are kept for the polish with planted feet
            state = earlier.carried
            return _without_refinement(replace(task, state=state), resumed, None, seconds, workspace.part(1.0, 1.0))
    steps = _steps(progress, watch)
    solved = solve_segment(shot, solver, data, state, Workspace(by, on_step=steps))  # not kept: large caches
    seconds.add(solved.solution.seconds)
    state = state.with_solution(segment, solved.solution.motions)
    with seconds.measure("appearance"):
        offset = measured_offset(shot, data, state)
    if solver.refine is None:
        rest = Workspace(by, on_step=step_share(steps, 1.0, 1.0))
        return _without_refinement(task, solved, offset, seconds, rest)
    slim = replace(solved.solution, evidence=None, misfit=None)
    return SolvedSegment(replace(data, views=()), slim, offset, dict(seconds))


@one_library_thread()
def refine_task(
    task: SegmentTask,
    solved: SolvedSegment,
    beside: Sequence[ShapeEvidence],
    progress: Progress | None = None,
    watch: Watcher | None = None,
) -> RefinedSegment:
    """Refine a solved segment once the motion on both sides of it is known.

    Parameters as in `solve_task`; `beside` is what key frames of the neighbouring segments say about shapes.
    """
    shot, seconds, views = task.shot, Seconds(), task.opened()
    data = with_shape_beside(replace(solved.data, views=views), beside)
    steps = _steps(progress, watch, solved.solution.iterations)
    with task.shared(views) as by:
        refined = refine_segment(
            shot,
            solver_named(shot.settings.solver),
            data,
            solved.solution,
            task.state,
            workspace=Workspace(by, on_step=step_share(steps, 0.0, 1 - UNCERTAINTY_SHARE)),  # not kept: large caches
        )
        seconds.add(refined.solution.seconds)
        rest = Workspace(by, on_step=step_share(steps, 1 - UNCERTAINTY_SHARE, 1.0))
        finished = _finished(task, refined, solved.solution.motions, solved.offset, seconds, workspace=rest)
    return RefinedSegment(finished, dict(seconds))


def _without_refinement(
    task: SegmentTask, ended: SegmentState, offset: Offset | None, seconds: Seconds, workspace: Workspace
) -> SolvedSegment:
    """Return a segment that is finished as soon as it is solved; parameters as in `_finished`."""
    finished = _finished(task, ended, ended.solution.motions, offset, seconds, workspace=workspace)
    slim = replace(ended.solution, evidence=None, misfit=None)
    return SolvedSegment(replace(ended.data, views=()), slim, offset, dict(seconds), finished)


def _steps(progress: Progress | None, watch: Watcher | None, before: int = 0) -> StepCallback:
    """Return the solver's callback, which reports progress and calls `watch`, counting iterations from `before`."""
    number = before

    def on_step(done: float, motions: Sequence[Motion]) -> None:
        nonlocal number
        report_progress(progress, "tracking", done)
        if not motions:
            return
        if watch is not None:
            watch(number, motions)
        number += 1

    return on_step


def _found_accelerations(ended: SegmentState) -> tuple[Array, ...]:
    """Return the estimated accelerations per performer (`AccelerationVariances.typical_accelerations`); empty if none
    were.
    """
    problem, found = ended.problem, ended.solution.variances
    usual = [usual_variances(body, problem.fps, problem.settings) for body in problem.bodies]
    if all(np.array_equal(own.typical, before) for own, before in zip(found, usual, strict=False)):
        return ()
    return tuple(own.typical_accelerations(problem.fps) for own in found)


def _finished(
    task: SegmentTask,
    ended: SegmentState,
    first_motions: tuple[Motion, ...],
    offset: Offset | None,
    seconds: Seconds,
    *,
    workspace: Workspace,
) -> FinishedSegment:
    """Return the finished segment, with its uncertainty and with planted feet held. The workspace's progress is that of
    both; the solver's polish with planted feet reports it, and can be cancelled.
    """
    solution = ended.solution
    energy = sum((earlier.energy for earlier in (*ended.earlier, solution)), ())
    found = _found_accelerations(ended)
    result = SegmentResult(*ended.data.segment, ended.iterations, energy, found)
    with seconds.measure("uncertainty"):
        uncertainties, delays, equations = segment_uncertainties(ended.problem, solution, workspace.by)
    settled = SettledMotions(solution.motions, (None,) * len(solution.motions))
    if (settle := solver_named(ended.problem.settings.solver).settle) is not None:
        ratios = [own.ratios(body) for own, body in zip(uncertainties, ended.problem.bodies, strict=True)]
        state, shot = task.state.with_solution(task.segment, first_motions), task.shot
        keys = [performer.key_poses.full() for performer in shot.performers]
        before = state.beside(task.segment, segments(shot), keys)
        with seconds.measure("solve"):
            settled = settle(ended.problem, solution, equations, before, ratios, workspace=workspace.part(0.5, 1.0))
    return FinishedSegment(
        result=result,
        first_motions=first_motions,
        motions=settled.motions,
        offset=offset,
        share=solution.share,
        residual=solution.residual,
        uncertainties=tuple(uncertainties),
        planted=settled.planted,
        delays=delays,
        shape=None if ended.data.shape is None else ended.data.shape.evidence,
    )
