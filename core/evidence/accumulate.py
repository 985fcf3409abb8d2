"""Evidence of a whole segment: label images, gradients and outlines of every view and frame, mapped to joints."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields, replace
from itertools import pairwise
from operator import attrgetter

import numpy as np
from numpy.typing import NDArray

from .contours import OutlineSums, outline_sums
from .foreground import log_ratio
from .gradients import Poses, WrenchSums, brightness_constancy
from .label_images import Geometry, render_labels
from .view_frames import ViewFrames

Array = NDArray[np.float64]

RUN = 32
"""Pairs of frames that are worked on at a time, about: enough to keep NumPy busy, few enough to stay in the cache."""
_WORKERS = 2


@dataclass(frozen=True, eq=False)
class Evidence:
    """Evidence of the frames of a segment, all views together.

    Attributes
    ----------
    H : ndarray, shape (V, F - 1, P, 12, 12)
    g : ndarray, shape (V, F - 1, P, 12)
        See `WrenchSums`; P counts the parts of all performers.
    energy, weight, noise, density : ndarray, shape (V, F - 1)
        Gradients between neighbouring frames.
    outline_H, outline_g, outline_energy : ndarray, shape (V, F, P, 6, 6), (V, F, P, 6) and (V, F)
        See `OutlineSums`; zero where a view has no foreground images.
    explained : ndarray, shape (V, F)
        Sum of the log likelihood ratios of the pixels that show a part.
    share : ndarray, shape (V, F, P)
        Visible share of every part, see `LabelImages`.
    stride : int
        Every how many pixels, each way, the evidence was taken.
    seconds : dict
        Time spent, by what.
    """

    H: Array
    g: Array
    energy: Array
    weight: Array
    noise: Array
    density: Array
    outline_H: Array
    outline_g: Array
    outline_energy: Array
    explained: Array
    share: Array
    stride: int
    seconds: dict[str, float]

    def without(self, hidden: NDArray[np.bool_]) -> Evidence:
        """The evidence less the rows of parts where they are hidden (F, P), equation (38)."""
        seen, pairs = ~hidden, ~(hidden[:-1] | hidden[1:])
        return replace(
            self,
            H=self.H * pairs[..., None, None],
            g=self.g * pairs[..., None],
            outline_H=self.outline_H * seen[..., None, None],
            outline_g=self.outline_g * seen[..., None],
        )


def image_evidence(
    views: Sequence[ViewFrames],
    geometry: Geometry,
    poses: Poses,
    first: int,
    sigma: float,
    tolerance: float,
    stride: int,
    reach: float = 0.0,
    delayed: Mapping[float, Poses] | None = None,
) -> Evidence:
    """Collect the evidence of F frames.

    Parameters
    ----------
    views : sequence of ViewFrames
    geometry : Geometry
        Of all performers.
    poses : tuple
        From `scene_poses`, F frames.
    first : int
        Shot frame of the first of them.
    sigma : float
        Smoothing of the images, pixels of the reduced frames.
    tolerance : float
        See `brightness_constancy`.
    stride : int
        Every how many pixels, each way, the evidence is taken: neighbours say nearly the same.
    reach : float
        How far from the model's outlines the body's are looked for, metres; 0 leaves them and the foreground images
        out.
    delayed : mapping of float to tuple, optional
        The poses that views with a delay show, by the delay.
    """
    at = {0.0: poses, **(delayed or {})}
    F = len(poses[0])
    runs = max(round((F - 1) / RUN), 1)
    bounds = [(F - 1) * k // runs for k in range(runs + 1)]
    tasks = [(view, a, b, geometry, at[view.delay]) for view in views for a, b in pairwise(bounds)]
    with ThreadPoolExecutor(_WORKERS) as pool:
        jobs = [pool.submit(_run, *task, first, sigma, tolerance, stride, reach) for task in tasks]
        done = [job.result() for job in jobs]
    rows = [done[i : i + runs] for i in range(0, len(done), runs)]

    def joined(name: str) -> Array:
        return np.stack([np.concatenate([getattr(run.sums, name) for run in row]) for row in rows])

    def by_frame(arrays: Callable[[_Run], Array]) -> Array:
        """The frame where two runs meet is in both."""
        return np.stack([np.concatenate([arrays(row[0])[:1]] + [arrays(run)[1:] for run in row]) for row in rows])

    workers = min(_WORKERS, len(tasks))
    seconds = {
        "label images": sum(run.seconds[0] for run in done) / workers,
        "gradients": sum(run.seconds[1] for run in done) / workers,
        "outlines": sum(run.seconds[2] for run in done) / workers,
    }
    sums = {f.name: joined(f.name) for f in fields(WrenchSums)}
    outlines = {f"outline_{f.name}": by_frame(attrgetter(f"outlines.{f.name}")) for f in fields(OutlineSums)}
    return Evidence(
        **sums,
        **outlines,
        explained=by_frame(lambda run: run.explained),
        share=by_frame(lambda run: run.share),
        stride=stride,
        seconds=seconds,
    )


@dataclass(frozen=True, eq=False)
class _Run:
    """Evidence of a few frames of one view, and the seconds for its label images, its gradients and its outlines."""

    sums: WrenchSums
    outlines: OutlineSums
    explained: Array
    share: Array
    seconds: tuple[float, float, float]


def _run(
    view: ViewFrames,
    start: int,
    stop: int,
    geometry: Geometry,
    poses: Poses,
    first: int,
    sigma: float,
    tolerance: float,
    stride: int,
    reach: float,
) -> _Run:
    """Evidence of frames start to stop, inclusive, of one view."""
    begin = time.perf_counter()
    R, T = (a[start : stop + 1] for a in poses)
    labels = render_labels(geometry, view.camera.subsampled(stride), first + start, R, T)
    drawn = time.perf_counter()
    left, top, right, bottom = (stride * edge for edge in labels.box())
    images = view.images(first + start, len(R), sigma, (left, top, right, bottom))
    foreground = view.foreground_at(first + start, len(R)) if reach and view.foreground is not None else None
    sums = brightness_constancy(view.camera, first + start, images, labels, (R, T), stride, tolerance, foreground)
    summed = time.perf_counter()
    outlines = OutlineSums(np.zeros((*T.shape[:2], 6, 6)), np.zeros((*T.shape[:2], 6)), np.zeros(len(T)))
    explained = np.zeros(len(T))
    if foreground is not None:
        frame, u, v = labels.places
        shown = stride**2 * log_ratio(foreground[frame, stride * v, stride * u])
        explained = np.bincount(frame, shown, minlength=len(T)).astype(float)
        half = max(4, round(reach * view.pixels_per_metre(T.mean(axis=(0, 1)), first + start)))
        outlines = outline_sums(view.camera, first + start, foreground, labels, stride, half, tolerance, view.halo)
    return _Run(sums, outlines, explained, labels.share, (drawn - begin, summed - drawn, time.perf_counter() - summed))
