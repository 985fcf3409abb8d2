"""Tracking all segments of a shot, in stages from footage to motion, for one after the other.

    read -> foreground -> part shapes -> solve -> time offset -> refine -> uncertainty -> result

The next segment is read while others are solved, and a segment is refined once the one after it is solved; see
`core.tracking.scheduling.schedule`.
"""

from __future__ import annotations

import time
from collections.abc import Container, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from ...body.motion import Motion, stacked
from ...evidence.view_frames import ViewFrames
from ...formats.keypoint_files import read_shot_keypoints
from ...keypoints.keypoint_delay import frames_off_by_view
from ...keypoints.observations import ShotKeypoints, fit_keypoints
from ...runtime.processes.worker_pool import WorkerPool
from ...runtime.progress import Progress, report_progress, share
from ...runtime.threads import worker_count
from ...runtime.timing import Seconds
from ...shot.fixed_degrees import fixed_degrees
from ...shot.footage_faults.footage_times import FootageRate
from ...shot.keypose_spline import spline
from ...shot.motion_warping import carried
from ...shot.segments import Segment
from ...shot.shot import KeyPoses, Shot
from ..footage_corrections.footage_gaps import with_timed_gaps
from ..footage_reading.frames_ahead import decoding_ahead
from ..footage_reading.picture_store import StoredView, fits_in_memory, picture_folder
from ..footage_reading.segment_footage import ReadingResources, SegmentFootage
from ..footage_reading.turned_cameras import turns_since, with_measured_turns
from ..results.journal import FinishedSegment, KeptSegments
from ..results.shot_result import result_of_segments
from ..results.track_result import TrackResult
from ..solvers.protocol import Solver
from ..solvers.registry import solver_named
from ..track_state import Around, EarlierTrack, TrackState
from .run_context import RunContext, SolvedShot
from .schedule import Observer, ScheduleCallbacks, ScheduleStart, SegmentSchedule, SegmentWorkers
from .shot_checks import footage_checked
from .worker_counts import WORKER_MODULES, workers_of

KEYPOINTS_SHARE = 0.15
"""Share of the work that the first pass from keypoints takes, for reports of progress."""


@dataclass(frozen=True, eq=False)
class TrackOptions:
    """The parameters of `track`, and the index of each of the given views in the shot as it is tracked."""

    progress: Progress | None
    observe: Observer | None
    pictures: Sequence[int]
    around: Around
    run: RunContext
    earlier: Sequence[Motion]
    views_as_given: Sequence[int]


class _TurningCamerasError(Exception):
    """Footage shows, while a shot is tracked, that cameras turn: `shot` is the shot in which they do."""

    def __init__(self, shot: Shot, options: TrackOptions, seconds: Seconds) -> None:
        self.shot, self.options, self.seconds = shot, options, seconds


def track_segments(
    shot: Shot, options: TrackOptions, known: Sequence[FinishedSegment] = ()
) -> tuple[TrackResult, list[FinishedSegment]]:
    """Track a shot whose views are in order, from the beginning once its cameras turn out to; returns its segments,
    too. Some may be known.
    """
    given, seconds = shot, Seconds()
    while True:
        try:
            result, done = _tracked_once(shot, options, known, given)
        except _TurningCamerasError as found:
            shot, options = found.shot, found.options
            seconds.add(found.seconds)
        else:
            seconds.add(result.seconds)
            return replace(result, seconds=seconds), done


def _tracked_once(
    shot: Shot, options: TrackOptions, known: Sequence[FinishedSegment], given: Shot
) -> tuple[TrackResult, list[FinishedSegment]]:
    """Track a shot, some of whose cameras have been found to turn since it was given.

    Raises
    ------
    _TurningCamerasError
        Others do.
    """
    run, progress = options.run, options.progress
    solver, seconds = solver_named(shot.settings.solver), Seconds()
    shot, curves, rates = _checked(shot, options, seconds)
    observed = _first_pass(shot, solver, seconds, progress)
    if observed.performers:
        progress = share(progress, KEYPOINTS_SHARE, 1.0)
    begin = TrackState(tuple(own.motion for own in observed.performers) or curves, options.around)
    finished = KeptSegments.of(run.journal, shot, options.around).joined(known)
    with _pool_and_folder(shot, options) as (pool, folder):
        start = ScheduleStart(begin, observed, _carried(begin, shot, options.earlier))
        callbacks = ScheduleCallbacks(progress, options.observe, options.run.show)
        schedule = SegmentSchedule(shot, start, _segment_workers(shot, pool, options), finished, callbacks)
        footage = _segment_footage(shot, observed, pool, folder, options)
        started = time.perf_counter()
        for views in _watched(shot, footage, begin.motions, finished.known, options=options, seconds=seconds):
            schedule.add(views)
        gaps = tuple(view.gaps for view in shot.views)
        read = SolvedShot(footage.pictures, observed, 0.0, gaps, turns_since(shot, given))
        state, done = schedule.finish(partial(_hand_out_solved, shot=shot, options=options, pool=pool, read=read))
        passed = time.perf_counter() - started - seconds["footage"]
    seconds.add(_scaled_to_elapsed(schedule.seconds, passed))
    observed = replace(observed, frames_off=frames_off_by_view(footage.movements))
    report_progress(progress, "tracking", 1.0)
    result = replace(
        result_of_segments(shot, state, done, observed, tuple(tuple(frames) for frames in footage.torn)),
        seconds=seconds,
        pictures=tuple({f: own[f] for f in options.pictures if f in own} for own in read.pictures),
        gaps=read.gaps,
        turns=read.turns,
        rates=rates,
        patterns=footage.patterns,
    )
    return result, done


def _checked(
    shot: Shot, options: TrackOptions, seconds: Seconds
) -> tuple[Shot, tuple[Motion, ...], tuple[FootageRate | None, ...]]:
    """Check the footage of a shot; return the shot with the gaps that its times show, and with cameras that turn where
    that is to be measured from the start; the curve through each performer's key poses; and the rates of the footage.
    """
    # Loading SciPy's splines takes as long.
    with footage_checked(shot, options.run) as checked, decoding_ahead(options.run.memory):
        curves = _curves(shot, options)
    rates = tuple(rate.result() for rate in checked)
    shot = with_timed_gaps(shot, rates)
    if shot.settings.stabilise:
        with seconds.measure("camera motion"):
            shot = with_measured_turns(shot, range(len(shot.views)))
    return shot, curves, rates


def _curves(shot: Shot, options: TrackOptions) -> tuple[Motion, ...]:
    """Return the curve through each performer's key poses; for one who has none in an excerpt, its earlier motion, or
    else the curve through the poses beside.
    """
    curves = []
    for i, performer in enumerate(shot.performers):
        keys = performer.key_poses
        if not len(keys.frames) and options.earlier:
            curves.append(options.earlier[i])
            continue
        if not len(keys.frames):
            beside = zip((-1, shot.length), options.around, strict=True)
            frames, poses = zip(*[(frame, side[i]) for frame, side in beside if side], strict=True)
            keys = KeyPoses.whole(list(frames), stacked(list(poses)))
        curves.append(spline(keys, shot.length))
    return tuple(curves)


def _watched(
    shot: Shot,
    footage: SegmentFootage,
    start: Sequence[Motion],
    known: Container[Segment],
    *,
    options: TrackOptions,
    seconds: Seconds,
) -> Iterator[tuple[ViewFrames | StoredView, ...]]:
    """Generate the views of every segment as they are read; hand out the first pictures, and see whether cameras turn.

    Raises
    ------
    _TurningCamerasError
        They do.
    """
    first, checked = options.run.first_pictures, set[int]()
    for views in footage.by_segment(start, known, seconds):
        if first is not None and all(first.frames <= own.keys() for own in footage.pictures):
            first.seen([footage.pictures[v] for v in options.views_as_given])
            first = None
        if moved := footage.moved - checked:
            with seconds.measure("camera motion"):
                turned = with_measured_turns(shot, moved)
            if turned is not shot:
                left = replace(options.run, first_pictures=first, footage_checked=True)
                raise _TurningCamerasError(turned, replace(options, run=left), seconds)
            checked |= moved
        yield views


def _hand_out_solved(
    state: TrackState, *, shot: Shot, options: TrackOptions, pool: WorkerPool, read: SolvedShot
) -> None:
    """Hand out what is final once all segments are solved; see `RunContext.solved`.

    Parameters
    ----------
    state : TrackState
        The shot with all segments solved, from which the offset of its footage follows.
    shot, options, pool
    read : SolvedShot
        All but that offset.
    """
    if options.run.solved is not None and pool.workers > 1:
        found = replace(read, footage_offset=state.footage_offset(shot))
        options.run.solved(pool, found.of_views(options.views_as_given))


def _carried(begin: TrackState, shot: Shot, earlier: Sequence[Motion]) -> EarlierTrack | None:
    """Return the earlier track of the shot, if there is one, moved to the present key poses."""
    if not earlier or shot.length < 3 or shot.settings.footage_offset is None:
        return None
    motions = tuple(carried(m, p.key_poses) for m, p in zip(earlier, shot.performers, strict=True))
    return EarlierTrack(tuple(earlier), replace(begin, motions=motions, solved=shot.length))


@contextmanager
def _pool_and_folder(shot: Shot, options: TrackOptions) -> Iterator[tuple[WorkerPool, Path | None]]:
    """Provide a pool of workers, and a folder for the segments' pictures unless these are held in memory."""
    memory = options.run.memory
    workers = _workers(shot, options)
    if memory is not None and options.observe is None:  # processes that are there already help
        workers = max(workers, min(memory.workers, worker_count(shot.settings.threads)))
    with ExitStack() as stack:
        pool = stack.enter_context((WorkerPool if memory is None else memory.pool)(workers, WORKER_MODULES))
        in_memory = workers == 1 and fits_in_memory(shot)
        yield pool, None if in_memory else stack.enter_context(picture_folder())


def _segment_workers(shot: Shot, pool: WorkerPool, options: TrackOptions) -> SegmentWorkers:
    """Return what solves the segments of a shot: the pool, or this process with the pool for its views."""
    workers = _workers(shot, options)
    threads = max(1, worker_count(shot.settings.threads) // workers)
    if workers == 1 < pool.workers:
        return SegmentWorkers(WorkerPool(1), threads, helpers=pool)
    return SegmentWorkers(pool, threads)


def _segment_footage(
    shot: Shot, observed: ShotKeypoints, pool: WorkerPool, folder: Path | None, options: TrackOptions
) -> SegmentFootage:
    """Return the reader of a shot's footage, which keeps the pictures that are asked for."""
    run = options.run
    first_frames = () if run.first_pictures is None else run.first_pictures.frames
    return SegmentFootage(
        shot,
        solver_named(shot.settings.solver),
        {*options.pictures, *first_frames},
        ReadingResources(folder, pool, run.memory),
        keypoints=[own.factor.keypoints for own in observed.performers],
    )


def _first_pass(shot: Shot, solver: Solver, seconds: Seconds, progress: Progress | None) -> ShotKeypoints:
    """Read the views' keypoints and fit motions to them, if there are any and the solver uses them."""
    if not solver.uses_keypoints or not any(view.keypoints for view in shot.views):
        return ShotKeypoints()
    report_progress(progress, "keypoints", 0.0)
    with seconds.measure("keypoints"):
        return fit_keypoints(
            shot, read_shot_keypoints(shot), [fixed_degrees(p, 0, shot.length - 1) for p in shot.performers]
        )


def _workers(shot: Shot, options: TrackOptions) -> int:
    """Return how many segments are solved at a time: one if their iterations are observed."""
    return 1 if options.observe is not None else workers_of(shot, worker_count(shot.settings.threads))


def _scaled_to_elapsed(seconds: Seconds, passed: float) -> dict[str, float]:
    """Scale the seconds that several processes spent on each stage to add up to the time that passed at most."""
    share = min(1.0, passed / max(sum(seconds.values()), 1e-9))
    return {stage: share * spent for stage, spent in seconds.items()}
