"""Tracking a shot: footage to evidence to solver to motion, one stretch between key poses after the other."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import reduce
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from .blas import one_blas_thread
from .evidence.images import ViewFrames
from .footage import check_view, frames_at
from .interpolation import spline
from .motion import Motion
from .shot import Performer, Progress, Shot, View, report_progress
from .solvers import gauss_newton, relaxation
from .solvers.banded import BandedFactor
from .solvers.problem import Problem, Solution

Array = NDArray[np.float64]

SOLVE = {"gauss-newton": gauss_newton.solve, "relaxation": relaxation.solve}
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
    """

    motions: tuple[Motion, ...]
    seconds: dict[str, float]
    camera_frames: int
    segments: tuple[SegmentResult, ...]
    visible: tuple[Array, ...]
    residual: tuple[Array, ...]


@one_blas_thread()
def track(shot: Shot, progress: Progress | None = None) -> TrackResult:
    """Track every performer of a shot.

    Parameters
    ----------
    shot : Shot
    progress : callable, optional
        See `core.shot.Progress`; returning False cancels.

    Raises
    ------
    FootageError
        Footage is missing, unreadable, too short or of another size than the calibration's.
    CancelledError
    """
    for view in shot.views:
        check_view(view, shot.frames[0], shot.length)
    motions = [spline(performer.key_poses, shot.length) for performer in shot.performers]
    seconds: Counter[str] = Counter()
    results: list[SegmentResult] = []
    parts = sum(len(performer.body) for performer in shot.performers)
    share = np.ones((len(shot.views), shot.length, parts))
    residual = np.zeros(shot.length)
    for (first, last), views in _footage_by_segment(shot, segments(shot), seconds):
        solution = _solve_segment(shot, (first, last), views, motions, progress)
        motions = [m.replaced(first, part) for m, part in zip(motions, solution.motions, strict=True)]
        seconds.update(solution.seconds)
        share[:, first : last + 1] = solution.share
        residual[first : last + 1] = np.maximum(residual[first : last + 1], solution.residual)
        results.append(SegmentResult(first, last, solution.iterations, solution.energy, solution.factors))
    report_progress(progress, "tracking", 1.0)
    ends = np.cumsum([0] + [len(performer.body) for performer in shot.performers])
    return TrackResult(
        tuple(_with_keys(m, p) for m, p in zip(motions, shot.performers, strict=True)),
        dict(seconds),
        len(shot.views) * shot.length,
        tuple(results),
        tuple(share[:, :, a:b] for a, b in zip(ends[:-1], ends[1:], strict=True)),
        tuple(residual for _ in shot.performers),
    )


def segments(shot: Shot) -> list[tuple[int, int]]:
    """First and last frames of the stretches that are solved on their own.

    They meet where every performer has a key pose of the whole body; before the first and after the last of these
    a stretch is held at one end only.
    """
    whole = [set(performer.key_poses.full().tolist()) for performer in shot.performers]
    cuts = sorted(reduce(set.intersection, whole) | {0, shot.length - 1})
    return list(zip(cuts[:-1], cuts[1:], strict=True)) or [(0, 0)]


def working_factor(view: View, working_size: int) -> float:
    """How much a view's frames are reduced for tracking."""
    return max(1.0, max(view.camera.size) / working_size)


def _footage_by_segment(
    shot: Shot, stretches: Sequence[tuple[int, int]], seconds: Counter[str]
) -> Iterator[tuple[tuple[int, int], tuple[ViewFrames, ...]]]:
    """Every stretch with its frames, decoded once and in order; only one stretch is held at a time."""
    factors = [working_factor(view, shot.settings.working_size) for view in shot.views]
    frames = range(shot.frames[0], shot.frames[1] + 1)
    streams = [frames_at(view, frames, factor) for view, factor in zip(shot.views, factors, strict=True)]
    cameras = [v.camera.reduced(f).rectified() for v, f in zip(shot.views, factors, strict=True)]
    held: list[list[NDArray[np.uint8]]] = [[] for _ in streams]
    with ThreadPoolExecutor(_WORKERS) as pool:
        for first, last in stretches:
            begin = time.perf_counter()
            count = last + 1 - first
            read = pool.map(lambda s, h, n=count: h + list(islice(s, n - len(h))), streams, held)  # type: ignore[misc]
            stacks = [np.stack(images) for images in read]
            seconds["footage"] += time.perf_counter() - begin
            yield (
                (first, last),
                tuple(ViewFrames(c, grey, first) for c, grey in zip(cameras, stacks, strict=True)),
            )
            held = [[grey[-1]] for grey in stacks]


def _solve_segment(
    shot: Shot,
    stretch: tuple[int, int],
    views: tuple[ViewFrames, ...],
    motions: Sequence[Motion],
    progress: Progress | None,
) -> Solution:
    first, last = stretch
    frames = slice(first, last + 1)
    problem = Problem(
        views,
        tuple(performer.body for performer in shot.performers),
        first,
        shot.fps,
        tuple(fixed_degrees(performer, first, last) for performer in shot.performers),
    )

    def on_step(done: float, _: Sequence[Motion]) -> None:
        report_progress(progress, "tracking", (first + done * (last - first)) / max(1, shot.length - 1))

    return SOLVE[shot.settings.solver](problem, [m[frames] for m in motions], shot.settings, on_step)


def fixed_degrees(performer: Performer, first: int, last: int) -> NDArray[np.bool_]:
    """Which degrees of freedom key poses hold, and those of locked joints, on frames first to last, shape (F, D)."""
    fixed = np.zeros((last + 1 - first, performer.body.dof), dtype=bool)
    keys = performer.key_poses
    inside = (keys.frames >= first) & (keys.frames <= last)
    fixed[keys.frames[inside] - first] = keys.fixed[inside]
    locked = performer.body.limits[..., 0] == performer.body.limits[..., 1]
    fixed[:, 3:] |= locked.ravel()
    return fixed


def _with_keys(motion: Motion, performer: Performer) -> Motion:
    """The motion with the key poses as they were set, to the last bit."""
    T, Q = motion.translations.copy(), motion.rotations.copy()
    keys = performer.key_poses
    turned = keys.fixed[:, 3:].reshape(len(keys.frames), -1, 3).all(axis=2)
    for k, frame in enumerate(keys.frames):
        T[frame] = np.where(keys.fixed[k, :3], keys.poses.translations[k], T[frame])
        Q[frame, turned[k]] = keys.poses.rotations[k, turned[k]]
    return Motion(T, Q)
