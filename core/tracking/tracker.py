"""Tracking a shot: footage to evidence to solver to motion, one stretch between key poses after the other."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from itertools import count, pairwise, zip_longest

import cv2
import numpy as np
from numpy.typing import NDArray

from ..body import Body
from ..body.kinematics import scene_poses
from ..body.motion import Motion
from ..body.time_shift import poses_after
from ..errors import ShotError
from ..evidence.foreground import HALO, foreground_images
from ..evidence.label_images import Geometry, render_labels
from ..evidence.part_shapes import fitted_shape
from ..evidence.time_offset import Offset, key_frame_offset
from ..evidence.view_frames import ViewFrames, views_with_foreground
from ..formats.keypoint_files import read_shot_keypoints
from ..keypoints.observations import ShotKeypoints, fit_keypoints
from ..numerics.banded import BandedFactor
from ..runtime.progress import Progress, report_progress
from ..runtime.threads import one_blas_thread
from ..runtime.timing import Seconds
from ..shot.footage import PICTURE_SIZE, Album, check_view, footage_delay, frames_at, working_factor
from ..shot.keypose_spline import spline
from ..shot.shot import Performer, Shot, View, fixed_degrees
from .segments import Segment, posed_frames, segments, whole_keys
from .solvers import gauss_newton, multi_start, relaxation
from .solvers.problem import Problem, Solution
from .uncertainty import joint_deviations

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

Around = tuple[tuple[Motion, ...] | None, tuple[Motion, ...] | None]
"""Every performer's pose on the frame before some frames, and on the one after them, where they are known."""
Observer = Callable[[Segment, int, Sequence[Motion]], None]

SOLVE: dict[str, Callable[..., Solution]] = {"gauss-newton": multi_start.solve, "relaxation": relaxation.solve}
REFINE: dict[str, Callable[..., Solution]] = {"gauss-newton": gauss_newton.refine}
_WORKERS = 2


@dataclass(frozen=True, eq=False)
class SegmentResult:
    """How the solver went over one stretch of frames.

    Attributes
    ----------
    first, last : int
        Shot frames, inclusive.
    iterations : int
    energy : tuple of float
        Before each iteration.
    factors : tuple of BandedFactor
        Per performer, see `Solution`: the covariance of every pose.
    """

    first: int
    last: int
    iterations: int
    energy: tuple[float, ...]
    factors: tuple[BandedFactor, ...]


@dataclass(frozen=True, eq=False)
class TrackResult:
    """Tracked motion and how it came about.

    Attributes
    ----------
    motions : tuple of Motion
        One per performer, every frame of the shot; key poses are as they were set.
    seconds : dict of str to float
        Time spent, by stage.
    camera_frames : int
        Views times frames.
    segments : tuple of SegmentResult
    visible : tuple of ndarray, shape (V, F, P)
        Per performer: visible share of each part's projected area, 0 to 1.
    residual : tuple of ndarray, shape (F,)
        Per performer: root mean square grey-level difference between neighbouring frames, 0 to 1.
    deviation : tuple of ndarray, shape (F, P)
        Per performer: how far every part's tip may be from its true place, metres; see `core.review`.
    pictures : tuple of dict of int to ndarray of uint8, shape (h, w, 3)
        Per view: the pictures that were asked for, by shot frame; rectified; blue, green, red.
    observed : ShotKeypoints
        What keypoints said; empty where none were used.
    footage_offset : float
        How much later than on their frames the key poses are shown, frames; see `core.shot.shot.Settings`.
    """

    motions: tuple[Motion, ...]
    seconds: dict[str, float]
    camera_frames: int
    segments: tuple[SegmentResult, ...]
    visible: tuple[Array, ...]
    residual: tuple[Array, ...]
    deviation: tuple[Array, ...]
    pictures: tuple[dict[int, Image], ...] = ()
    observed: ShotKeypoints = field(default_factory=ShotKeypoints)
    footage_offset: float = 0.0


@one_blas_thread()
def track(
    shot: Shot,
    progress: Progress | None = None,
    observe: Observer | None = None,
    pictures: Sequence[int] = (),
    around: Around = (None, None),
) -> TrackResult:
    """Track every performer of a shot.

    Parameters
    ----------
    shot : Shot
    progress : callable, optional
        See `core.runtime.progress.Progress`; returning False cancels.
    observe : callable, optional
        Called with a stretch, the number of its iteration, and the motions of its frames before that iteration.
    pictures : sequence of int, optional
        Shot frames of which to keep pictures in the result.
    around : tuple of (tuple of Motion or None), optional
        Of an excerpt of a longer shot: every performer's pose on the frame before its first and on the one after its
        last, where they are known. They are held, and the motion passes smoothly from and to them.

    Raises
    ------
    ShotError
        The shot has one frame only, or a performer has no key pose.
    FootageError
        Footage is missing, unreadable, too short or of another size than the calibration's.
    CancelledError
    """
    if shot.length < 2:
        raise ShotError("a shot of one frame has nothing to track", where="[shot] frames")
    for performer in shot.performers:
        if not len(performer.key_poses.frames):
            raise ShotError("there is no key pose", where=f"performer {performer.name}", todo="set one to begin with")
    for view in shot.views:
        check_view(view, shot.frames[0], shot.length)
    # Sums are rounded by their order, and labels turn roundings into steps: the order of the views must not count.
    order = sorted(range(len(shot.views)), key=lambda v: shot.views[v].camera.name)
    shot = replace(shot, views=tuple(shot.views[v] for v in order))
    job = _Job(shot, progress, observe, around)
    kept = frozenset(shot.frames[0] + frame for frame in pictures)
    albums = [Album(kept, working_factor(view, PICTURE_SIZE)) for view in shot.views]
    stretches = segments(shot)
    waiting: tuple[Segment, tuple[ViewFrames, ...]] | None = None
    for stretch, views in _footage_by_segment(shot, stretches, albums, job.motions, job.seconds):
        job.look(stretch, views)
        job.solve(stretch, views)
        job.synchronise(stretch, views)
        if waiting is not None:
            job.refine(*waiting)
            job.judge(waiting[0])
        waiting = (stretch, views)
    if waiting is not None:
        job.refine(*waiting)
        job.judge(waiting[0])
    report_progress(progress, "tracking", 1.0)
    return job.result(albums, [order.index(v) for v in range(len(order))])


class _Job:
    """A track in the making: the motion so far, and how every stretch of it was solved."""

    def __init__(self, shot: Shot, progress: Progress | None, observe: Observer | None, around: Around) -> None:
        self.shot, self.progress, self.observe, self.around = shot, progress, observe, around
        self.motions = [spline(performer.key_poses, shot.length) for performer in shot.performers]
        self.seconds = Seconds()
        self._shapes: dict[Segment, Geometry] = {}
        self._offsets: dict[Segment, Offset] = {}
        self._results: dict[Segment, SegmentResult] = {}
        self._unjudged: dict[Segment, tuple[Problem, Solution]] = {}
        self._share = np.ones((len(shot.views), shot.length, sum(len(p.body) for p in shot.performers)))
        self._residual = np.zeros(shot.length)
        self._deviation = [np.zeros((shot.length, len(p.body))) for p in shot.performers]
        self._begun, self._solved = 0.0, 0
        self.observed = self._first_pass()

    def _first_pass(self) -> ShotKeypoints:
        """Where keypoints are, what they say of every performer; the motion then starts from that."""
        if self.shot.settings.solver != "gauss-newton" or not any(view.keypoints for view in self.shot.views):
            return ShotKeypoints()
        report_progress(self.progress, "keypoints", 0.0)
        with self.seconds.measure("keypoints"):
            fixed = [fixed_degrees(p, 0, self.shot.length - 1) for p in self.shot.performers]
            observed = fit_keypoints(self.shot, read_shot_keypoints(self.shot), fixed)
        self.motions = [own.motion for own in observed.performers]
        return observed

    def look(self, stretch: Segment, views: tuple[ViewFrames, ...]) -> None:
        """Learn from a stretch's key frames how the performers are shaped."""
        keys, seeing = posed_frames(self.shot, *stretch), views_with_foreground(views)
        if not seeing:
            return
        bodies = [performer.body for performer in self.shot.performers]
        with self.seconds.measure("appearance"):
            shown = {d: poses_after(self.motions, d - self.footage_offset, keys) for d in {v.delay for v in seeing}}
            poses = {d: scene_poses(bodies, there) for d, there in shown.items()}
            self._shapes[stretch] = fitted_shape(seeing, Geometry.of(bodies), poses, keys.tolist())

    def synchronise(self, stretch: Segment, views: tuple[ViewFrames, ...]) -> None:
        """Learn from a stretch that is solved how far its key poses and the footage are out of step."""
        settings, keys = self.shot.settings, whole_keys(self.shot, *stretch)
        if settings.footage_offset is not None or stretch not in self._shapes:
            return
        bodies = [performer.body for performer in self.shot.performers]
        motions = [motion[stretch[0] : stretch[1] + 1] for motion in self.motions]
        with self.seconds.measure("appearance"):
            self._offsets[stretch] = key_frame_offset(
                views_with_foreground(views),
                Geometry.of(bodies),
                bodies,
                motions,
                stretch[0],
                (keys - stretch[0]).tolist(),
                settings.outline_correlation,
            )

    @property
    def footage_offset(self) -> float:
        """As the settings give it, or as the stretches solved so far tell it."""
        given = self.shot.settings.footage_offset
        return Offset.likeliest(self._offsets.values()).value if given is None else given

    def solve(self, stretch: Segment, views: tuple[ViewFrames, ...]) -> None:
        """Solve a stretch that follows what is solved already."""
        self._run(SOLVE[self.shot.settings.solver], self._problem(stretch, views), 0.7 if self._refines(stretch) else 1)
        self._solved = stretch[1] + 1

    def refine(self, stretch: Segment, views: tuple[ViewFrames, ...]) -> None:
        """Solve a stretch once more, now that the motion on both sides is known; not every solver looks there."""
        if self._refines(stretch):
            self._run(REFINE[self.shot.settings.solver], self._problem(stretch, views), 0.3)

    def judge(self, stretch: Segment) -> None:
        """Tell how far the joints may be off on a stretch that is done."""
        with self.seconds.measure("uncertainty"):
            found = joint_deviations(*self._unjudged.pop(stretch), self.shot.settings)
        for mine, new in zip(self._deviation, found, strict=True):
            mine[stretch[0] : stretch[1] + 1] = new

    def _refines(self, stretch: Segment) -> bool:
        alone = stretch == (0, self.shot.length - 1) and self.around == (None, None)
        in_step = self.footage_offset == (self.shot.settings.footage_offset or 0.0)
        return self.shot.settings.solver in REFINE and not (alone and in_step)

    def _problem(self, stretch: Segment, views: tuple[ViewFrames, ...]) -> Problem:
        frames = slice(stretch[0], stretch[1] + 1)
        return Problem(
            views,
            tuple(performer.body for performer in self.shot.performers),
            stretch[0],
            self.shot.fps,
            tuple(fixed_degrees(performer, *stretch) for performer in self.shot.performers),
            self._context(stretch[0] - 1),
            self._context(stretch[1] + 1),
            self._shapes.get(stretch),
            tuple(own.factor[frames] for own in self.observed.performers),
            self.footage_offset,
        )

    def _context(self, frame: int) -> tuple[Motion, ...] | None:
        """The poses on a frame where they are known: solved, or given from beside the shot."""
        if frame < 0 or frame == self.shot.length:
            return self.around[frame > 0]
        return tuple(m[[frame]] for m in self.motions) if frame < self._solved else None

    def _run(self, solver: Callable[..., Solution], problem: Problem, work: float) -> None:
        frames = slice(problem.first, problem.first + problem.length)
        part = work * (problem.length - 1) / max(1, self.shot.length - 1)

        stretch = (problem.first, problem.first + problem.length - 1)
        earlier = self._results.get(stretch)
        iterations, energy = (earlier.iterations, earlier.energy) if earlier else (0, ())
        number = count(iterations)

        def on_step(done: float, motions: Sequence[Motion]) -> None:
            report_progress(self.progress, "tracking", min(self._begun + done * part, 1.0))
            if self.observe is not None:
                self.observe(stretch, next(number), motions)

        solution = solver(problem, [m[frames] for m in self.motions], self.shot.settings, on_step)
        self._begun += part
        self.motions = [m.replaced(problem.first, new) for m, new in zip(self.motions, solution.motions, strict=True)]
        self.seconds.add(solution.seconds)
        self._share[:, frames] = solution.share
        self._residual[frames] = solution.residual
        self._unjudged[stretch] = problem, solution
        self._results[stretch] = SegmentResult(
            *stretch, iterations + solution.iterations, energy + solution.energy, solution.factors
        )

    def result(self, albums: Sequence[Album], views: list[int]) -> TrackResult:
        """The result, with the views in that order."""
        performers = self.shot.performers
        ends = np.cumsum([0] + [len(performer.body) for performer in performers])
        return TrackResult(
            tuple(_with_keys(m, p) for m, p in zip(self.motions, performers, strict=True)),
            self.seconds,
            len(self.shot.views) * self.shot.length,
            tuple(self._results.values()),
            tuple(self._share[views, :, a:b] for a, b in pairwise(ends)),
            tuple(self._residual for _ in performers),
            tuple(self._deviation),
            tuple({f - self.shot.frames[0]: image for f, image in albums[v].pictures.items()} for v in views),
            self.observed.of_views(views),
            self.footage_offset,
        )


def _footage_by_segment(
    shot: Shot, stretches: Sequence[Segment], albums: Sequence[Album], start: Sequence[Motion], seconds: Seconds
) -> Iterator[tuple[Segment, tuple[ViewFrames, ...]]]:
    """Every stretch with its frames, decoded once and in order; three stretches are held at most."""
    stopped = threading.Event()
    readers = [_Reader(shot, view, album, start, stopped) for view, album in zip(shot.views, albums, strict=True)]
    with ThreadPoolExecutor(_WORKERS) as pool:

        def read(stretch: Segment) -> list[Future[ViewFrames]]:
            return [pool.submit(reader.read, stretch) for reader in readers]

        coming = read(stretches[0])
        try:
            for stretch, following in zip_longest(stretches, stretches[1:]):
                with seconds.measure("footage"):
                    views = tuple(job.result() for job in coming)
                if following is not None:  # it is read while this one is solved
                    coming = read(following)
                yield stretch, views
        finally:
            stopped.set()


class _Reader:
    """Reads one view's frames, stretch by stretch, and tells there what looks like the performers.

    Their key poses are those of the motion at the start: what is learned does not hang on when it is read.
    """

    def __init__(self, shot: Shot, view: View, album: Album, start: Sequence[Motion], stopped: threading.Event) -> None:
        factor = working_factor(view, shot.settings.working_size)
        self.shot, self.view, self.start, self.stopped = shot, view, start, stopped
        self.camera = view.camera.reduced(factor).rectified()
        self._stream = frames_at(view, range(shot.frames[0], shot.frames[1] + 1), factor, grey=False, album=album)
        self._held: list[Image] = []

    def read(self, stretch: Segment) -> ViewFrames:
        """A stretch that begins where the last one ended; fewer frames when stopped meanwhile."""
        frames = self._held
        while len(frames) < stretch[1] + 1 - stretch[0] and not self.stopped.is_set():
            frames.append(next(self._stream))
        self._held = frames[-1:]
        colour = np.stack(frames)
        grey = np.stack([cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) for image in colour])
        found = ViewFrames(self.camera, grey, stretch[0], delay=footage_delay(self.view))
        settings, keys = self.shot.settings, posed_frames(self.shot, *stretch)
        if not len(keys) or settings.solver != "gauss-newton" or self.stopped.is_set():
            return found  # the papers' solver looks at gradients alone
        shown = poses_after(self.start, found.delay - (settings.footage_offset or 0.0), keys)
        return _with_foreground(found, colour, [performer.body for performer in self.shot.performers], shown, keys)


def _with_foreground(
    view: ViewFrames, colour: Image, bodies: Sequence[Body], shown: Sequence[Motion], keys: NDArray[np.int64]
) -> ViewFrames:
    """A view with the foreground images that the performers' poses on key frames, as shown there, lead to."""
    R, T = scene_poses(bodies, shown)
    seen = render_labels(Geometry.of(bodies), view.camera.at(keys.tolist()), 0, R, T).part >= 0
    if not seen.any():
        return view  # it saw nobody to learn from
    scale = view.pixels_per_metre(T[0].mean(axis=0), int(keys[0]))
    masks = dict(zip((keys - view.first).tolist(), seen, strict=True))
    foreground = foreground_images(colour, masks, scale, view.camera.stands_still)
    return replace(view, foreground=foreground, halo=HALO)


def _with_keys(motion: Motion, performer: Performer) -> Motion:
    """The motion with the key poses as they were set, to the last bit."""
    T, Q = motion.translations.copy(), motion.rotations.copy()
    keys = performer.key_poses
    turned = keys.fixed[:, 3:].reshape(len(keys.frames), -1, 3).all(axis=2)
    for k, frame in enumerate(keys.frames):
        T[frame] = np.where(keys.fixed[k, :3], keys.poses.translations[k], T[frame])
        Q[frame, turned[k]] = keys.poses.rotations[k, turned[k]]
    return Motion(T, Q)
