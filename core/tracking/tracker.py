"""Tracking a shot: a row of stages from footage to motion, one segment between key poses after the other.

    read -> foreground -> part shapes -> solve -> time offset -> refine -> uncertainty -> result

While segments are solved the next one is read, and a segment is refined when the one after it is solved; see
`core.tracking.schedule`.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Container, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from itertools import zip_longest
from pathlib import Path
from threading import Event

import numpy as np

from ..body.motion import Motion
from ..body.unknown_parts import unknown_reach, unshown_parts, without_hidden_solids
from ..errors import OutputError, ShotError
from ..evidence.occlusion import unseen
from ..evidence.view_frames import ViewFrames
from ..formats.keypoint_files import read_shot_keypoints
from ..keypoints.observations import ShotKeypoints, fit_keypoints
from ..keypoints.seen_landmarks import found_landmarks
from ..numerics.arrays import Array, Bools, slices_of
from ..runtime.progress import Progress, report_progress
from ..runtime.threads import one_library_thread, worker_count
from ..runtime.timing import Seconds
from ..runtime.worker_memory import WorkerMemory
from ..runtime.worker_pool import WorkerPool
from ..runtime.workplaces import RESULTS, workplace
from ..shot.carried_motion import carried, with_keys
from ..shot.footage import PICTURE_SIZE, Album, working_factor
from ..shot.footage_checks import check_view
from ..shot.footage_times import FootageRate, footage_rate
from ..shot.grips import completed
from ..shot.keypose_spline import spline
from ..shot.shot import Performer, Shot, fixed_degrees
from ..shot.shot_spec import ShotSpec
from .appearance import frames_with_foreground, grey_frames
from .body_uncertainty import body_covariances
from .journal import FinishedSegment, KeptSegments
from .picture_store import COLOUR, PictureStore, StoredView
from .reader import SegmentReader, is_kept
from .run_context import NOTHING_KEPT, RunContext, SolvedShot
from .schedule import Observer, SegmentSchedule
from .segment_stages import Around, EarlierTrack, TrackState
from .segment_tasks import solve_task
from .segments import Segment, posed_frames, segments
from .solvers.protocol import Solver
from .solvers.registry import solver_named
from .track_result import TrackResult
from .uncertainty import joint_errors

WORTH_PROCESSES = 200
"""Frames, of all views and performers together, from which on segments are solved in processes of their own."""
HELD_BYTES = 256 << 20
"""Most that the pictures of a segment may take in memory; those of longer ones are in files."""
SOLVING = (solve_task.__module__,)
"""What these processes need; they import it while the first footage is decoded."""


@one_library_thread()
def track(
    shot: Shot,
    progress: Progress | None = None,
    observe: Observer | None = None,
    pictures: Sequence[int] = (),
    around: Around = (None, None),
    *,
    run: RunContext = NOTHING_KEPT,
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
        Shot frames of which to keep pictures in the result.
    around : tuple of (tuple of Motion or None), optional
        Where the shot is an excerpt of a longer one: every performer's pose on the frame before its first and on the
        one after its last, where they are known. They are held, and the motion passes smoothly from and to them.
    run : RunContext, optional
        Where finished segments are kept, and what is handed out before the result is whole.
    earlier : sequence of Motion, optional
        Every performer's motion as it was tracked before some key poses changed. Segments are solved from there; those
        of which the images leave a doubt then are solved as if there were none. It is not used where the offset of the
        footage is still to be measured, for which segments are solved without it first.

    Raises
    ------
    ShotError
        The shot has one frame only, or a performer has no key pose.
    FootageError
        Footage is missing, unreadable, too short or of another size than the calibration's.
    CancelledError
    """
    _check(shot)
    shot, views_as_given = _in_order(shot)
    kept = frozenset(shot.frames[0] + frame for frame in pictures)
    albums = [Album(kept, working_factor(view, PICTURE_SIZE)) for view in shot.views]
    solver, seconds = solver_named(shot.settings.solver), Seconds()
    with _footage_checked(shot, run) as rates:  # SciPy's splines take as long to be loaded
        curves = tuple(spline(p.key_poses, shot.length) for p in shot.performers)
    observed = _first_pass(shot, solver, seconds, progress)
    begin = TrackState(tuple(own.motion for own in observed.performers) or curves, around)
    finished = KeptSegments.of(run.journal, shot, around)
    torn: list[list[int]] = [[] for _ in shot.views]
    threads = worker_count(shot.settings.threads)
    workers = 1 if observe is not None else _workers(shot, threads)
    with _places_to_work(shot, run, workers) as (pool, folder):
        schedule = SegmentSchedule(
            shot,
            begin,
            observed,
            pool,
            finished=finished,
            threads=max(1, threads // workers),
            progress=progress,
            observe=observe,
            show=run.show,
            earlier=_carried(begin, shot, earlier),
        )
        started = time.perf_counter()
        for segment, views in _footage_by_segment(
            shot, solver, albums, begin.motions, seconds=seconds, known=finished.known, folder=folder, memory=run.memory
        ):
            for frames, view in zip(torn, views, strict=True):
                frames += _torn_frames(segment, view)
            schedule.add(views)
        kept_pictures = tuple(
            {f - shot.frames[0]: image for f, image in albums[v].pictures.items()} for v in views_as_given
        )

        def solved(state: TrackState) -> None:
            if run.solved is not None and pool.workers > 1:
                offset = state.footage_offset(shot)
                run.solved(pool, SolvedShot(kept_pictures, observed.of_views(views_as_given), offset))

        state, done = schedule.finish(solved)
        passed = time.perf_counter() - started - seconds["footage"]
    seconds.add(_side_by_side(schedule.seconds, passed))
    report_progress(progress, "tracking", 1.0)
    tracked = _with_unknown_parts(_track_result(shot, state, done, observed, views_as_given), shot, observed)
    return replace(
        tracked,
        seconds=seconds,
        pictures=kept_pictures,
        observed=observed.of_views(views_as_given),
        torn=tuple(tuple(torn[v]) for v in views_as_given),
        rates=tuple(rates[v].result() for v in views_as_given),
    )


def _in_order(shot: Shot) -> tuple[Shot, list[int]]:
    """The shot as it is tracked, with views in the order of their names, and where each view that was given is then.

    Sums are rounded by their order, and labels turn roundings into steps: the order of the views must not count.
    """
    order = sorted(range(len(shot.views)), key=lambda v: shot.views[v].camera.name)
    performers = tuple(replace(p, body=without_hidden_solids(p.body, p.unknown)) for p in shot.performers)
    in_order = replace(shot, views=tuple(shot.views[v] for v in order), performers=performers)
    return completed(in_order), [order.index(v) for v in range(len(order))]


def _carried(begin: TrackState, shot: Shot, earlier: Sequence[Motion]) -> EarlierTrack | None:
    """The shot as it was tracked before, if it was, with the key poses as they are now."""
    if not earlier or shot.length < 3 or shot.settings.footage_offset is None:
        return None
    motions = tuple(carried(m, p.key_poses) for m, p in zip(earlier, shot.performers, strict=True))
    return EarlierTrack(tuple(earlier), replace(begin, motions=motions, solved=shot.length))


def _check(shot: Shot) -> None:
    """See that a shot can be tracked.

    Raises
    ------
    ShotError
    """
    if shot.length < 2:
        raise ShotError("a shot of one frame has nothing to track", where="[shot] frames")
    solver = solver_named(shot.settings.solver)
    if shot.holds and not solver.uses_holds:
        what = f"the solver {shot.settings.solver} does not support holds"
        raise ShotError(what, where=shot.holds[0].place, todo="use the solver gauss-newton, or remove the hold")
    for performer in shot.performers:
        if not len(performer.key_poses.frames):
            raise ShotError("there is no key pose", where=f"performer {performer.name}", todo="set one to begin with")


@contextmanager
def _footage_checked(shot: Shot, run: RunContext) -> Iterator[list[Future[FootageRate | None]]]:
    """See while the block runs that all footage can serve, unless that is known; of what is kept it is.

    Yields
    ------
    list of Future
        The rate of each view's frames, known when the block has ended.

    Raises
    ------
    FootageError
    """
    unseen_views = [
        view
        for view in shot.views
        if not (run.footage_checked or (run.memory is not None and is_kept(shot, view, run.memory)))
    ]
    with ThreadPoolExecutor(worker_count(shot.settings.threads)) as pool:
        checked = [pool.submit(check_view, view, shot.frames[0], shot.length) for view in unseen_views]
        yield [pool.submit(footage_rate, shot, view) for view in shot.views]
        for check in checked:
            check.result()


@contextmanager
def _places_to_work(shot: Shot, run: RunContext, workers: int) -> Iterator[tuple[WorkerPool, Path | None]]:
    """So many workers, and a folder for the frames' pictures where these are not held in memory."""
    with ExitStack() as stack:
        pool = stack.enter_context((WorkerPool if run.memory is None else run.memory.pool)(workers, SOLVING))
        in_memory = workers == 1 and _held_easily(shot)
        yield pool, None if in_memory else stack.enter_context(_picture_folder())


def _torn_frames(segment: Segment, view: ViewFrames | StoredView) -> list[int]:
    """Frames of a segment that do not fit the one before."""
    pairs = view.frames.torn if isinstance(view, StoredView) else view.torn
    return [] if pairs is None else (segment[0] + 1 + np.flatnonzero(pairs)).tolist()


def _first_pass(shot: Shot, solver: Solver, seconds: Seconds, progress: Progress | None) -> ShotKeypoints:
    """The keypoints of the views and the motions that they show, where there are any and the solver uses them."""
    if not solver.uses_keypoints or not any(view.keypoints for view in shot.views):
        return ShotKeypoints()
    report_progress(progress, "keypoints", 0.0)
    with seconds.measure("keypoints"):
        return fit_keypoints(
            shot, read_shot_keypoints(shot), [fixed_degrees(p, 0, shot.length - 1) for p in shot.performers]
        )


def _footage_by_segment(
    shot: Shot,
    solver: Solver,
    albums: Sequence[Album],
    start: Sequence[Motion],
    *,
    seconds: Seconds,
    known: Container[Segment],
    folder: Path | None,
    memory: WorkerMemory | None,
) -> Iterator[tuple[Segment, tuple[ViewFrames | StoredView, ...]]]:
    """Every segment with its frames, decoded once and in order; the next one is read meanwhile.

    Foreground images are made with the key poses as they are at the start: they do not depend on when a segment is
    read. Segments whose solution is known come without. With a folder, pictures are written to files in it.
    """
    stopped, chosen = Event(), segments(shot)
    readers = [
        SegmentReader(shot, view, album, stopped, memory=memory) for view, album in zip(shot.views, albums, strict=True)
    ]
    bodies, offset = [performer.body for performer in shot.performers], shot.settings.footage_offset or 0.0

    def prepared(number: int, segment: Segment) -> ViewFrames | StoredView:
        store = PictureStore(folder, f"{segment[0]}_{number}")
        frames = readers[number].read(segment, store)
        if solver.uses_foreground and segment not in known:
            keys = posed_frames(shot, *segment)
            view = frames_with_foreground(frames, bodies, start, keys, footage_offset=offset, fps=shot.fps, store=store)
        else:
            view = grey_frames(frames, store)
        store.remove(COLOUR)
        return store.stored(view)

    with ThreadPoolExecutor(worker_count(shot.settings.threads)) as pool:

        def submitted(segment: Segment) -> list[Future[ViewFrames | StoredView]]:
            return [pool.submit(prepared, number, segment) for number in range(len(readers))]

        coming = submitted(chosen[0])
        try:
            for segment, following in zip_longest(chosen, chosen[1:]):
                with seconds.measure("footage"):
                    views = tuple(job.result() for job in coming)
                if following is not None:
                    coming = submitted(following)
                yield segment, views
        finally:
            stopped.set()


def _workers(shot: Shot, threads: int) -> int:
    """How many segments are worked on at a time: a process takes as long to start as a small shot to solve."""
    return min(threads, len(segments(shot))) if _worth(shot.length, shot.views, shot.performers) else 1


def workers_for(spec: ShotSpec, threads: int | None = None) -> int:
    """How many workers the shot of a shot file is going to have; 1 where only its files tell.

    Parameters
    ----------
    spec : ShotSpec
    threads : int, optional
        Used instead of the file's.
    """
    first, last = spec.frames
    keyed = [set(p.keyframes) for p in spec.performers if isinstance(p.keyframes, tuple)]
    if len(keyed) < max(len(spec.performers), 1) or not _worth(last + 1 - first, spec.views, spec.performers):
        return 1
    cuts = {first, last}.union(set.intersection(*keyed))
    return min(worker_count(spec.settings.threads if threads is None else threads), len(cuts) - 1)


def _worth(frames: int, views: Sequence[object], performers: Sequence[object]) -> bool:
    """Whether so much work is worth processes."""
    return frames * len(views) * len(performers) >= WORTH_PROCESSES


def _held_easily(shot: Shot) -> bool:
    """Whether the pictures of any segment may be held in memory."""
    longest = max(last + 1 - first for first, last in segments(shot))
    images = 3 + 1 + len(shot.performers)  # colour, grey, and the foreground of each performer
    sizes = [view.camera.reduced(working_factor(view, shot.settings.working_size)).size for view in shot.views]
    return longest * images * sum(width * height for width, height in sizes) <= HELD_BYTES


@contextmanager
def _picture_folder() -> Iterator[Path]:
    """A folder for pictures that several processes look at, or that are too many for memory.

    Raises
    ------
    OutputError
        The disk has no room for them.
    """
    folder = Path(tempfile.gettempdir())
    try:
        with workplace(folder) as place:
            yield place / RESULTS
    except OSError as error:
        raise OutputError(f"the frames cannot be kept: {error.strerror or error}", where=str(folder)) from error


def _side_by_side(seconds: Seconds, passed: float) -> dict[str, float]:
    """Seconds by stage that several processes spent, so that together they are no more than the time that passed."""
    share = min(1.0, passed / max(sum(seconds.values()), 1e-9))
    return {stage: share * spent for stage, spent in seconds.items()}


def _track_result(
    shot: Shot, state: TrackState, done: Sequence[FinishedSegment], observed: ShotKeypoints, views: list[int]
) -> TrackResult:
    """The result of all segments together, with the views in that order."""
    performers = shot.performers
    share = np.ones((len(shot.views), shot.length, sum(len(p.body) for p in performers)))
    residual = np.zeros(shot.length)
    for one in done:
        frames = slice(one.result.first, one.result.last + 1)
        share[:, frames], residual[frames] = one.share, one.residual
    errors = []
    for i, (performer, motion) in enumerate(zip(performers, state.motions, strict=True)):
        own = observed.performers[i] if observed.performers else None
        beside = body_covariances(performer, motion, shot.fps, own)
        errors.append(joint_errors(performer.body, [one.uncertainties[i] for one in done], beside))
    return TrackResult(
        tuple(with_keys(m, p.key_poses) for m, p in zip(state.motions, performers, strict=True)),
        {},
        len(shot.views) * shot.length,
        tuple(one.result for one in done),
        tuple(share[views, :, own] for own in slices_of(len(performer.body) for performer in performers)),
        tuple(residual for _ in performers),
        tuple(errors),
        tuple(performer.unknown for performer in performers),
        planted=tuple(_planted(shot.length, done, i) for i in range(len(performers))),
        footage_offset=state.footage_offset(shot),
    )


def _planted(length: int, done: Sequence[FinishedSegment], performer: int) -> Bools | None:
    """When points of a performer's soles were held, by any of the segments that have a frame in common."""
    frames = None
    for one in done:
        if (own := one.planted[performer]) is not None:
            frames = np.zeros((length, own.shape[1]), bool) if frames is None else frames
            frames[one.result.first : one.result.last + 1] |= own
    return frames


def _with_unknown_parts(tracked: TrackResult, shot: Shot, observed: ShotKeypoints) -> TrackResult:
    """The result with what is unknown in it: no view sees it, and it may be anywhere in reach."""
    unknown, seen, errors = [], [], []
    for i, performer in enumerate(shot.performers):
        visible = tracked.visible[i].copy()
        visible[..., np.isin(performer.body.names, performer.unknown)] = 0.0
        unknown.append(_unknown_parts(performer, visible, observed, i))
        seen.append(visible)
        errors.append(tracked.errors[i].with_reach(unknown_reach(performer.body, unknown[-1])))
    return replace(tracked, unknown=tuple(unknown), visible=tuple(seen), errors=tuple(errors))


def _unknown_parts(performer: Performer, visible: Array, observed: ShotKeypoints, number: int) -> tuple[str, ...]:
    """The parts that rest, and those that neither pictures nor key poses nor keypoints have shown on any frame."""
    body, keys = performer.body, performer.key_poses
    keyed = keys.fixed[:, 3:].reshape(len(keys.frames), -1, 3).any(axis=(0, 2))
    hidden = unseen(visible).all(axis=0) & ~keyed
    if observed.performers:
        hidden &= np.isin(
            body.names, unshown_parts(body, found_landmarks(observed.performers[number].factor.keypoints))
        )
    resting = np.isin(body.names, performer.unknown)
    return tuple(name for name, is_unknown in zip(body.names, hidden | resting, strict=True) if is_unknown)
