"""The footage of a shot, decoded once and in order, segment by segment."""

from __future__ import annotations

from collections.abc import Collection, Container, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from itertools import zip_longest
from pathlib import Path
from threading import Event

import numpy as np

from ...body import Body
from ...body.motion import Motion
from ...body.time_shift import poses_after
from ...evidence.view_frames import ViewFrames
from ...keypoints.keypoint_delay import ENOUGH_MOVEMENTS, KeypointMovements, keypoint_movements
from ...keypoints.keypoint_rays import Keypoints
from ...numerics.arrays import Bools
from ...runtime.processes.shared_arrays import SharedArray
from ...runtime.processes.worker_memory import WorkerMemory
from ...runtime.processes.worker_pool import WorkerPool
from ...runtime.progress import Progress
from ...runtime.threads import one_library_thread, worker_count
from ...runtime.timing import Seconds
from ...shot.footage import MAX_PICTURE_SIDE, Album, Image, working_factor
from ...shot.footage_faults.frame_pattern import FramePattern
from ...shot.footage_faults.skipped_frames import PairChanges, skipped_pairs
from ...shot.segments import PosedFrames, Segment, posed_frames, segments
from ...shot.shot import Shot
from ..solvers.protocol import Solver
from .appearance import frames_with_foreground, grey_frames
from .picture_store import COLOUR, PictureStore, StoredView
from .reader import ColourFrames, SegmentReader
from .turned_cameras import BackgroundWatch


@dataclass(frozen=True, eq=False)
class _AppearanceTask:
    """Making the foreground images of a view of a segment, which another process may do.

    Attributes
    ----------
    frames : ColourFrames
    colour : SharedArray, optional
        Their pictures, if these are in a file.
    bodies, shown, keys, fps, store
        See `frames_with_foreground`.
    """

    frames: ColourFrames
    colour: SharedArray | None
    bodies: Sequence[Body]
    shown: Sequence[Motion]
    keys: PosedFrames
    fps: float
    store: PictureStore

    @one_library_thread()
    def __call__(self, _: Progress | None = None) -> ViewFrames | StoredView:
        """Do it, which takes about a tenth of a second, and remove the pictures in colour."""
        frames = self.frames if self.colour is None else replace(self.frames, colour=self.colour.array())
        view = frames_with_foreground(frames, self.bodies, self.shown, self.keys, fps=self.fps, store=self.store)
        self.store.remove(COLOUR)
        return self.store.stored(view)


@dataclass(frozen=True, eq=False)
class _ReadView:
    """A view of a segment whose foreground images are being made, and how much its pairs of frames stand out."""

    view: Future[ViewFrames | StoredView]
    changes: PairChanges


@dataclass(frozen=True, eq=False)
class ReadingResources:
    """What reading footage may use.

    Attributes
    ----------
    folder : Path, optional
        Folder for the files with the segments' pictures; without one, these are held in memory.
    pool : WorkerPool, optional
        Makes foreground images, if the pictures are in files and it has several workers; otherwise the threads that
        read do.
    memory : WorkerMemory, optional
        Cache of frames for the next job; frames in it are not decoded again.
    """

    folder: Path | None = None
    pool: WorkerPool | None = None
    memory: WorkerMemory | None = None


class SegmentFootage:
    """Decodes the footage of a shot segment by segment, and collects what the result says about it.

    Parameters
    ----------
    shot : Shot
    solver : Solver
    pictures : collection of int
        Frames, counted from the shot's first, whose pictures are collected.
    resources : ReadingResources, optional
    keypoints : sequence of Keypoints
        Those of every performer, whose movements are compared with the pictures'.

    Attributes
    ----------
    torn : tuple of list of int
        Per view: frames read so far that do not continue the frame before, counted from the shot's first.
    moved : set of int
        Views of cameras that stand still by their calibration, but in whose pictures read so far the background shifts.
    patterns : tuple of FramePattern
        Per view, once all is read: how its frames were made from others.
    movements : tuple of list of KeypointMovements
        Per view, and in it per performer: how the movements of keypoints agree with the pictures read so far.
    """

    def __init__(
        self,
        shot: Shot,
        solver: Solver,
        pictures: Collection[int],
        resources: ReadingResources = ReadingResources(),
        *,
        keypoints: Sequence[Keypoints] = (),
    ) -> None:
        kept = frozenset(shot.frames[0] + frame for frame in pictures)
        self._albums = [Album(kept, working_factor(view, MAX_PICTURE_SIDE)) for view in shot.views]
        folder, pool = resources.folder, resources.pool
        self._shot, self._solver, self._folder, self._memory = shot, solver, folder, resources.memory
        self._keypoints = keypoints
        self._pool = pool if folder is not None and pool is not None and pool.workers > 1 else None
        self.torn: tuple[list[int], ...] = tuple([] for _ in shot.views)
        self.moved: set[int] = set()
        self.patterns: tuple[FramePattern, ...] = ()
        self._watches: dict[int, BackgroundWatch] = {}
        self.movements: tuple[list[KeypointMovements], ...] = tuple([] for _ in shot.views)

    @property
    def pictures(self) -> tuple[dict[int, Image], ...]:
        """The pictures collected so far, per view, by frame counted from the shot's first."""
        first = self._shot.frames[0]
        return tuple({f - first: image for f, image in album.pictures.items()} for album in self._albums)

    def by_segment(
        self, start: Sequence[Motion], known: Container[Segment], seconds: Seconds
    ) -> Iterator[tuple[ViewFrames | StoredView, ...]]:
        """Generate the views of every segment; the next segment is read in the background.

        Parameters
        ----------
        start : sequence of Motion
            The performers' motions before tracking. Foreground images are made with these key poses for all segments,
            so they do not depend on when a segment is read.
        known : container of tuple
            Segments whose solution is known, which need no foreground images.
        seconds : Seconds
            The time spent waiting is added to it, as the stage "footage".

        Raises
        ------
        FootageError
            The footage ends or breaks early.
        CancelledError
        """
        shot, memory, stopped = self._shot, self._memory, Event()
        readers = [
            SegmentReader(shot, view, album, stopped, memory=memory)
            for view, album in zip(shot.views, self._albums, strict=True)
        ]
        chosen = segments(shot)
        if shot.settings.stabilise is None:
            still = [v for v, view in enumerate(shot.views) if view.camera.stands_still]
            self._watches = {v: BackgroundWatch(shot, start) for v in still}
        with ThreadPoolExecutor(worker_count(shot.settings.threads)) as pool:

            def submitted(segment: Segment) -> list[Future[_ReadView]]:
                with_foreground = self._solver.uses_foreground and segment not in known
                return [
                    pool.submit(self._read, reader, segment, number, start if with_foreground else None)
                    for number, reader in enumerate(readers)
                ]

            coming, read = submitted(chosen[0]), list[_ReadView]()
            try:
                for segment, following in zip_longest(chosen, chosen[1:]):
                    with seconds.measure("footage"):
                        read = [job.result() for job in coming]
                        # Then foreground images of the next segment are begun before this one is solved.
                        coming = submitted(following) if following is not None else []
                        views = _without_skips([(own.view.result(), own.changes) for own in read])
                    for number, view in enumerate(views):
                        self.torn[number].extend(_torn_frames(segment, view))
                        self._compare_movements(number, view, segment)
                    yield views
                self.patterns = tuple(reader.pattern for reader in readers)
            finally:
                stopped.set()
                for own in [*read, *(job.result() for job in coming if job.done() and job.exception() is None)]:
                    own.view.cancel()

    def _read(self, reader: SegmentReader, segment: Segment, number: int, start: Sequence[Motion] | None) -> _ReadView:
        """Read one view of a segment; foreground images are made if motions are given."""
        store = PictureStore(self._folder, f"{segment[0]}_{number}")
        frames = reader.read(segment, store)
        watch = self._watches.get(number)
        if watch is not None and number not in self.moved and watch.shifts(frames, segment):
            self.moved.add(number)
        assert frames.changes is not None
        view: Future[ViewFrames | StoredView] = Future()
        if start is None:
            view.set_result(store.stored(grey_frames(frames, store)))
            store.remove(COLOUR)
        elif self._pool is None:
            view.set_result(self._appearance_task(frames, segment, start, store)())
        else:
            view = self._pool.submit(self._appearance_task(frames, segment, start, store), lambda _: True)
        return _ReadView(view, frames.changes)

    def _appearance_task(
        self, frames: ColourFrames, segment: Segment, start: Sequence[Motion], store: PictureStore
    ) -> _AppearanceTask:
        shot = self._shot
        keys = posed_frames(shot, *segment)
        shown = poses_after(start, frames.delay - (shot.settings.footage_offset or 0.0), keys.frames)
        colour = None if self._pool is None else store.shared(COLOUR, frames.colour.shape)
        sent = frames if colour is None else replace(frames, colour=frames.colour[:0].copy())
        bodies = [performer.body for performer in shot.performers]
        return _AppearanceTask(sent, colour, bodies, shown, keys, shot.fps, store)

    def _compare_movements(self, number: int, read: ViewFrames | StoredView, segment: Segment) -> None:
        """Compare the movements of keypoints in a view of a segment with its pictures, until enough are compared."""
        before = self.movements[number]
        if self._shot.views[number].keypoints is None or sum(m.counts.sum() for m in before) > ENOUGH_MOVEMENTS:
            return
        view = read.opened() if isinstance(read, StoredView) else read
        K, found = view.camera.matrix, list[KeypointMovements]()
        turned = self._shot.views[number].camera.moving and not view.camera.moving
        for keypoints in self._keypoints:
            shown = keypoints[segment[0] : segment[1] + 1]
            rays = shown.rays_to(number, view.camera.R_cam_world[0]) if turned else shown.rays[number]
            found.append(keypoint_movements(view.grey, rays @ K[:2, :2].T + K[:2, 2]))
        before[:] = [m.joined(then) for m, then in zip(found, before, strict=True)] if before else found


def _without_skips(read: Sequence[tuple[ViewFrames | StoredView, PairChanges]]) -> tuple[ViewFrames | StoredView, ...]:
    """Return all views of a segment, whose pairs of frames between which others are missing count as torn."""
    skipped = skipped_pairs([changes for _, changes in read])
    return tuple(_torn_at(view, pairs) for (view, _), pairs in zip(read, skipped, strict=True))


def _torn_at(view: ViewFrames | StoredView, pairs: Bools) -> ViewFrames | StoredView:
    """Return a view with more pairs of frames that do not continue each other."""
    if isinstance(view, StoredView):
        return replace(view, frames=_frames_torn_at(view.frames, pairs))
    return _frames_torn_at(view, pairs)


def _frames_torn_at(frames: ViewFrames, pairs: Bools) -> ViewFrames:
    return replace(frames, torn=pairs if frames.torn is None else frames.torn | pairs)


def _torn_frames(segment: Segment, view: ViewFrames | StoredView) -> list[int]:
    """Return the frames of a segment that do not continue the frame before."""
    pairs = view.frames.torn if isinstance(view, StoredView) else view.torn
    return [] if pairs is None else (segment[0] + 1 + np.flatnonzero(pairs)).tolist()
