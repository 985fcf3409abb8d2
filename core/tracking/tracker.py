"""Tracking a shot: stages from footage to motion, for one segment between key poses after the other.

    read -> foreground -> part shapes -> solve -> time offset -> refine -> uncertainty -> result

The next segment is read while others are solved, and a segment is refined once the one after it is solved; see
`core.tracking.schedule`.
"""

from __future__ import annotations

import time
from collections.abc import Container, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from ..body.motion import Motion
from ..body.unknown_parts import without_hidden_solids
from ..evidence.view_frames import ViewFrames
from ..formats.keypoint_files import read_shot_keypoints
from ..keypoints.keypoint_delay import frames_off_by_view
from ..keypoints.observations import ShotKeypoints, fit_keypoints
from ..runtime.progress import Progress, report_progress
from ..runtime.threads import one_library_thread, worker_count
from ..runtime.timing import Seconds
from ..runtime.worker_pool import WorkerPool
from ..shot.carried_motion import carried
from ..shot.fixed_degrees import fixed_degrees
from ..shot.grips import completed
from ..shot.keypose_spline import spline
from ..shot.shot import Shot
from .damaged_footage import decoder_messages, found_damage, known_damage, without_damaged
from .footage_gaps import (
    MAX_GAPS,
    fits_better,
    unaffected,
    with_found_gaps,
    with_gaps,
    with_timed_gaps,
    without_false_delays,
)
from .frames_ahead import decoding_ahead
from .journal import FinishedSegment, KeptSegments
from .picture_store import StoredView, fits_in_memory, picture_folder
from .run_context import PLAIN_RUN, RunContext, SolvedShot
from .schedule import Observer, ScheduleCallbacks, SegmentSchedule
from .segment_footage import SegmentFootage
from .segment_stages import Around, EarlierTrack, TrackState
from .segments import Segment
from .shot_checks import check_shot, footage_checked
from .shot_result import result_of_segments
from .shot_scale import ShotScale
from .solvers.protocol import Solver
from .solvers.registry import solver_named
from .track_result import TrackResult
from .turned_cameras import Turns, turns_since, with_measured_turns
from .worker_counts import WORKER_MODULES, workers_of


@one_library_thread()
def track(
    shot: Shot,
    progress: Progress | None = None,
    observe: Observer | None = None,
    pictures: Sequence[int] = (),
    around: Around = (None, None),
    *,
    run: RunContext = PLAIN_RUN,
    earlier: Sequence[Motion] = (),
) -> TrackResult:
    """Track every performer of a shot.

    Parameters
    ----------
    shot : Shot
    progress : callable, optional
        See `core.runtime.progress.Progress`; returning False cancels.
    observe : callable, optional
        Called with a segment, the number of its iteration, and the motions of its frames before that iteration.
    pictures : sequence of int, optional
        Frames, counted from the shot's first, whose pictures are kept in the result.
    around : tuple of (tuple of Motion or None), optional
        If the shot is an excerpt of a longer one: every performer's pose on the frame before its first and on the one
        after its last, where known. These poses are held, and the motion continues smoothly from and to them.
    run : RunContext, optional
        Journal, cache and callbacks; none of them changes the result.
    earlier : sequence of Motion, optional
        Every performer's motion as it was tracked before some key poses changed, from which segments are solved. A
        segment whose solution is doubtful then is solved again without it. Not used if the footage offset is still to
        be measured.

    Raises
    ------
    ShotError
        The shot has one frame only, or a performer has no key pose.
    FootageError
        Footage is missing, unreadable, too short or of another size than the calibration's.
    CancelledError
    """
    check_shot(shot)
    given, scale = shot.performers, ShotScale.of(shot)
    shot, views_as_given = _in_order(scale.shot(shot))
    options = _TrackOptions(
        progress=progress,
        observe=scale.observer(observe),
        pictures=pictures,
        around=scale.around(around),
        run=scale.run(run),
        earlier=scale.motions(earlier),
        views_as_given=views_as_given,
    )
    result = _tracked_with_corrections(shot, options)
    return scale.result(result.of_views(views_as_given), given)


def _tracked_with_corrections(shot: Shot, options: _TrackOptions) -> TrackResult:
    """Track a shot, then again what changes with the damaged frames and the gaps in its footage that this has shown."""
    memory = options.run.memory
    known = known_damage(shot, memory)
    shot = without_damaged(shot, known)
    with decoder_messages(memory) as log:
        result, done = _tracked(shot, options)
    damage = found_damage(shot, result, log, known, memory)
    sound = with_found_gaps(without_damaged(shot, damage), result.gaps)
    if [view.damaged for view in sound.views] != [view.damaged for view in shot.views]:
        result, done = _tracked_again(sound, shot, options, result, done)
        shot = sound
    result = without_false_delays(shot, result)
    for _ in range(MAX_GAPS):
        corrected = with_gaps(shot, result)
        if corrected is None:
            break
        again, done_again = _tracked_again(corrected, shot, options, result, done)
        if not fits_better(again, result):
            result = replace(result, seconds=again.seconds)
            break
        shot, result, done = corrected, again, done_again
    return replace(result, damage=damage)


def _tracked_again(
    corrected: Shot, before: Shot, options: _TrackOptions, result: TrackResult, done: Sequence[FinishedSegment]
) -> tuple[TrackResult, list[FinishedSegment]]:
    """Track again what changes with corrected gaps or damaged frames; the time counts in all."""
    kept = unaffected(done, with_found_gaps(before, result.gaps), corrected)
    run = replace(options.run, solved=None, first_pictures=None)
    again, done_again = _tracked(corrected, replace(options, run=run), kept)
    seconds = Seconds(result.seconds)
    seconds.add(again.seconds)
    return replace(again, seconds=seconds), done_again


@dataclass(frozen=True, eq=False)
class _TrackOptions:
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

    def __init__(self, shot: Shot, options: _TrackOptions, seconds: Seconds) -> None:
        self.shot, self.options, self.seconds = shot, options, seconds


def _tracked(
    shot: Shot, options: _TrackOptions, known: Sequence[FinishedSegment] = ()
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
    shot: Shot, options: _TrackOptions, known: Sequence[FinishedSegment], given: Shot
) -> tuple[TrackResult, list[FinishedSegment]]:
    """Track a shot, some of whose cameras have been found to turn since it was given.

    Raises
    ------
    _TurningCamerasError
        Others do.
    """
    run, progress = options.run, options.progress
    solver, seconds = solver_named(shot.settings.solver), Seconds()
    # Loading SciPy's splines takes as long.
    with footage_checked(shot, run) as rates, decoding_ahead(run.memory):
        curves = tuple(spline(p.key_poses, shot.length) for p in shot.performers)
    shot = with_timed_gaps(shot, [rate.result() for rate in rates])
    if shot.settings.stabilise:
        with seconds.measure("camera motion"):
            shot = with_measured_turns(shot, range(len(shot.views)))
    observed = _first_pass(shot, solver, seconds, progress)
    begin = TrackState(tuple(own.motion for own in observed.performers) or curves, options.around)
    finished = KeptSegments.of(run.journal, shot, options.around).joined(known)
    with _pool_and_folder(shot, options) as (pool, folder):
        schedule = _schedule(shot, begin, observed, pool, finished=finished, options=options)
        footage = _segment_footage(shot, observed, pool, folder, options)
        started = time.perf_counter()
        for views in _watched(shot, footage, begin.motions, finished.known, options=options, seconds=seconds):
            schedule.add(views)
        turns = turns_since(shot, given)
        solved = partial(
            _hand_out_solved,
            shot=shot,
            options=options,
            pool=pool,
            pictures=footage.pictures,
            observed=observed,
            turns=turns,
        )
        state, done = schedule.finish(solved)
        passed = time.perf_counter() - started - seconds["footage"]
    seconds.add(_scaled_to_elapsed(schedule.seconds, passed))
    observed = replace(observed, frames_off=frames_off_by_view(footage.movements))
    report_progress(progress, "tracking", 1.0)
    result = replace(
        result_of_segments(shot, state, done, observed, tuple(tuple(frames) for frames in footage.torn)),
        seconds=seconds,
        pictures=tuple({f: own[f] for f in options.pictures if f in own} for own in footage.pictures),
        gaps=tuple(view.gaps for view in shot.views),
        turns=turns,
        rates=tuple(rate.result() for rate in rates),
        patterns=footage.patterns,
    )
    return result, done


def _watched(
    shot: Shot,
    footage: SegmentFootage,
    start: Sequence[Motion],
    known: Container[Segment],
    *,
    options: _TrackOptions,
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
    state: TrackState,
    *,
    shot: Shot,
    options: _TrackOptions,
    pool: WorkerPool,
    pictures: tuple[dict[int, Any], ...],
    observed: ShotKeypoints,
    turns: Turns,
) -> None:
    """Hand out what is final once all segments are solved; see `RunContext.solved`."""
    if options.run.solved is not None and pool.workers > 1:
        gaps = tuple(view.gaps for view in shot.views)
        found = SolvedShot(pictures, observed, state.footage_offset(shot), gaps, turns)
        options.run.solved(pool, found.of_views(options.views_as_given))


def _in_order(shot: Shot) -> tuple[Shot, list[int]]:
    """Return the shot with its views sorted by name, and the index there of each of the given views.

    The order of the views must not affect the result, and it would: the rounding of a sum depends on its order.
    """
    order = sorted(range(len(shot.views)), key=lambda v: shot.views[v].camera.name)
    performers = tuple(replace(p, body=without_hidden_solids(p.body, p.unknown)) for p in shot.performers)
    in_order = replace(shot, views=tuple(shot.views[v] for v in order), performers=performers)
    return completed(in_order), [order.index(v) for v in range(len(order))]


def _carried(begin: TrackState, shot: Shot, earlier: Sequence[Motion]) -> EarlierTrack | None:
    """Return the earlier track of the shot, if there is one, moved to the present key poses."""
    if not earlier or shot.length < 3 or shot.settings.footage_offset is None:
        return None
    motions = tuple(carried(m, p.key_poses) for m, p in zip(earlier, shot.performers, strict=True))
    return EarlierTrack(tuple(earlier), replace(begin, motions=motions, solved=shot.length))


@contextmanager
def _pool_and_folder(shot: Shot, options: _TrackOptions) -> Iterator[tuple[WorkerPool, Path | None]]:
    """Provide a pool of workers, and a folder for the segments' pictures unless these are held in memory."""
    memory = options.run.memory
    workers = _workers(shot, options)
    if memory is not None and options.observe is None:  # processes that are there already help
        workers = max(workers, min(memory.workers, worker_count(shot.settings.threads)))
    with ExitStack() as stack:
        pool = stack.enter_context((WorkerPool if memory is None else memory.pool)(workers, WORKER_MODULES))
        in_memory = workers == 1 and fits_in_memory(shot)
        yield pool, None if in_memory else stack.enter_context(picture_folder())


def _schedule(
    shot: Shot,
    begin: TrackState,
    observed: ShotKeypoints,
    pool: WorkerPool,
    *,
    finished: KeptSegments,
    options: _TrackOptions,
) -> SegmentSchedule:
    """Return the schedule by which the segments of a shot are solved and refined."""
    workers = _workers(shot, options)
    alone = workers == 1 < pool.workers  # a segment is solved in this process, its views in all
    return SegmentSchedule(
        shot,
        begin,
        observed,
        WorkerPool(1) if alone else pool,
        finished=finished,
        threads=max(1, worker_count(shot.settings.threads) // workers),
        helpers=pool if alone else None,
        callbacks=ScheduleCallbacks(options.progress, options.observe, options.run.show),
        earlier=_carried(begin, shot, options.earlier),
    )


def _segment_footage(
    shot: Shot, observed: ShotKeypoints, pool: WorkerPool, folder: Path | None, options: _TrackOptions
) -> SegmentFootage:
    """Return the reader of a shot's footage, which keeps the pictures that are asked for."""
    run = options.run
    first_frames = () if run.first_pictures is None else run.first_pictures.frames
    return SegmentFootage(
        shot,
        solver_named(shot.settings.solver),
        {*options.pictures, *first_frames},
        folder=folder,
        pool=pool,
        memory=run.memory,
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


def _workers(shot: Shot, options: _TrackOptions) -> int:
    """Return how many segments are solved at a time: one if their iterations are observed."""
    return 1 if options.observe is not None else workers_of(shot, worker_count(shot.settings.threads))


def _scaled_to_elapsed(seconds: Seconds, passed: float) -> dict[str, float]:
    """Scale the seconds that several processes spent on each stage to add up to the time that passed at most."""
    share = min(1.0, passed / max(sum(seconds.values()), 1e-9))
    return {stage: share * spent for stage, spent in seconds.items()}
