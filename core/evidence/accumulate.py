"""Evidence of a whole segment: label images, gradients and outlines of every view and frame, summed per part."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields, replace
from functools import partial
from itertools import pairwise
from operator import attrgetter

import numpy as np
from numpy.typing import NDArray

from ..body.kinematics import Poses
from ..numerics.arrays import Array, Bools
from ..shot.continuity import single_frames
from .contours import OutlineSums, outline_sums
from .foreground import background_share, log_ratio
from .gradients import GradientSums, brightness_constancy
from .label_images import Geometry, render_labels
from .view_frames import GradientImageCache, ViewFrames

RUN = 32
"""Pairs of frames that are worked on at a time, about: enough to keep NumPy busy, few enough to stay in the cache."""


@dataclass(frozen=True)
class Sampling:
    """How the images are sampled.

    Attributes
    ----------
    sigma : float
        Smoothing of the images, pixels of the reduced frames.
    tolerance : float
        Factor on the limits of the robust weights: far from the solution large residuals still have to pull.
    stride : int
        Every how many pixels, each way, the evidence is taken: neighbours say nearly the same.
    reach : float
        How far from the model's outlines the body's are looked for, metres; 0 leaves outlines and foreground images
        out.
    """

    sigma: float
    tolerance: float
    stride: int
    reach: float = 0.0


@dataclass(frozen=True, eq=False)
class SegmentEvidence:
    """Evidence of the F frames of a segment from V views on P parts, those of all performers.

    Attributes
    ----------
    gradients : GradientSums
        Arrays of shape (V, F - 1, ...): brightness constancy between neighbouring frames.
    outlines : OutlineSums
        Arrays of shape (V, F, ...); zero where a view has no foreground images.
    explained : ndarray, shape (V, M, F)
        Of each of M performers: sum of the log likelihood ratios of the pixels that show it, with the colours of the
        part that each shows.
    unhidden : ndarray, shape (M, F)
        Its visible area over that which it would have without the others, over all views and parts, each with the
        weight of what a pixel explains there; 1 for those that are not sought.
    share : ndarray, shape (V, F, P)
        Visible share of every part, see `LabelImages`.
    agreeing : ndarray, shape (V, F, P)
        Share of the pixels that show a part which look like its performer, or like another one, who may stand before
        it; 1 where none shows it, or nothing tells.
    sampling : Sampling
        How the evidence was taken.
    seconds : dict
        Time spent, by stage.
    """

    gradients: GradientSums
    outlines: OutlineSums
    explained: Array
    unhidden: Array
    share: Array
    agreeing: Array
    sampling: Sampling
    seconds: dict[str, float]

    def pixel_share(self, correlation_length: float) -> Array:
        """What a pixel counts if those within a square of that side, metres, count as one together, shape (V,).

        Sums over pixels times this depend neither on the size of the footage nor on the stride.
        """
        density = np.maximum(np.median(self.gradients.density, axis=1), 1.0)
        return np.asarray(self.sampling.stride**2 / (density * correlation_length**2))

    def without(self, hidden: NDArray[np.bool_]) -> SegmentEvidence:
        """The evidence less the rows of parts where they are hidden (F, P), equation (38)."""
        seen, pairs = ~hidden, ~(hidden[:-1] | hidden[1:])
        gradients, outlines = self.gradients, self.outlines
        return replace(
            self,
            gradients=replace(gradients, H=gradients.H * pairs[..., None, None], g=gradients.g * pairs[..., None]),
            outlines=replace(outlines, H=outlines.H * seen[..., None, None], g=outlines.g * seen[..., None]),
        )


def accumulate_evidence(
    views: Sequence[ViewFrames],
    geometry: Geometry,
    poses: Mapping[float, Poses],
    sampling: Sampling,
    *,
    first: int,
    noise: Array | None = None,
    cache: GradientImageCache | None = None,
    threads: int = 1,
    sought: Sequence[int] | None = None,
) -> SegmentEvidence:
    """Collect the evidence of F frames; the result does not depend on the number of threads.

    Parameters
    ----------
    views : sequence of ViewFrames
    geometry : Geometry
        The parts of all performers.
    poses : mapping of float to tuple
        World poses (R, T) of all parts, (F, P, 3, 3) and (F, P, 3), by the delay of the views that show them.
    sampling : Sampling
    first : int
        Shot frame of the first of the F frames.
    noise : ndarray, shape (V, F - 1), optional
        Standard deviation of the residuals of each pair of frames under which their cost is measured; by default their
        own.
    cache : GradientImageCache, optional
        Keeps gradient images for the next call.
    threads : int
    sought : sequence of int, optional
        Performers whose gradients and outlines are wanted; by default all.
    """
    cache = GradientImageCache() if cache is None else cache
    F = len(next(iter(poses.values()))[0])
    runs = max(round((F - 1) / RUN), 1)
    bounds = [(F - 1) * k // runs for k in range(runs + 1)]
    spans = [(v, a, b) for v in range(len(views)) for a, b in pairwise(bounds)]

    def run(span: tuple[int, int, int]) -> _Run:
        v, a, b = span
        R, T = poses[views[v].delay]
        own = R[a : b + 1], T[a : b + 1]
        given = None if noise is None else noise[v, a:b]
        return _run(views[v], geometry, own, sampling, first=first + a, noise=given, cache=cache, sought=sought)

    if threads == 1:
        done = [run(span) for span in spans]
    else:
        with ThreadPoolExecutor(threads) as pool:
            done = list(pool.map(run, spans))
    rows = [done[i : i + runs] for i in range(0, len(done), runs)]

    def by_pair(of: Callable[[_Run], Array]) -> Array:
        return np.stack([np.concatenate([of(run) for run in row]) for row in rows])

    def by_frame(of: Callable[[_Run], Array], axis: int = 0) -> Array:
        """The frame where two runs meet is in both."""
        ends = [np.split(of(run), [1], axis) for row in rows for run in row]
        each = [[ends[k * runs][0]] + [rest for _, rest in ends[k * runs : (k + 1) * runs]] for k in range(len(rows))]
        return np.stack([np.concatenate(row, axis) for row in each])

    explained = by_frame(attrgetter("explained"), 1)
    whose = geometry.performer == np.arange(int(geometry.performer.max()) + 1)[:, None]
    return SegmentEvidence(
        GradientSums(*(by_pair(attrgetter(f"gradients.{f.name}")) for f in fields(GradientSums))),
        OutlineSums(*(by_frame(attrgetter(f"outlines.{f.name}")) for f in fields(OutlineSums))),
        np.asarray(whose @ explained),
        _unhidden(by_frame(attrgetter("areas"), 2), explained, whose),
        by_frame(attrgetter("share")),
        by_frame(attrgetter("agreeing")),
        sampling,
        {stage: sum(run.seconds[stage] for run in done) / min(threads, len(done)) for stage in done[0].seconds},
    )


def _unhidden(areas: Array, explained: Array, whose: Bools) -> Array:
    """What others leave in sight of each performer (M, F), from the areas (V, 2, P, F) of the parts with and without
    them, and what these explain (V, P, F): views in which a pixel of a part explains nothing do not count.

    `whose` (M, P) are the performers' parts. Parts that a view never sees explain what the performer's others do there.
    """
    seen, found = areas[:, 0].sum(axis=2), explained.sum(axis=2)
    others = (found @ whose.T / np.maximum(seen @ whose.T, 1)) @ whose
    each = np.maximum(np.where(seen > 0, found / np.maximum(seen, 1), others), 0.0)
    shown, alone = whose @ np.einsum("vp,vkpf->kpf", each, areas)
    return np.asarray(np.where(alone > 0, shown / np.where(alone > 0, alone, 1.0), 1.0))


@dataclass(frozen=True, eq=False)
class _Run:
    """Evidence of a few frames of one view, and the seconds for it by stage."""

    gradients: GradientSums
    outlines: OutlineSums
    explained: Array
    areas: NDArray[np.int64]
    share: Array
    agreeing: Array
    seconds: dict[str, float]

    def of_whole_frames(self, view: ViewFrames, first: int) -> _Run:
        """The evidence less that of frames that do not fit their neighbours; the first is shot frame `first`."""
        if view.torn is None or not view.torn.any():
            return self
        start, count = first - view.first, len(self.share)
        pairs = 1.0 - view.torn[start : start + count - 1]
        frames = 1.0 - single_frames(view.torn)[start : start + count]
        g, o = self.gradients, self.outlines
        return replace(
            self,
            gradients=replace(
                g,
                H=g.H * pairs[:, None, None, None],
                g=g.g * pairs[:, None, None],
                energy=g.energy * pairs,
                weight=g.weight * pairs,
                count=g.count * pairs,
            ),
            outlines=OutlineSums(o.H * frames[:, None, None, None], o.g * frames[:, None, None], o.energy * frames),
            explained=self.explained * frames,
            agreeing=np.where(frames[:, None] > 0, self.agreeing, 1.0),
        )


def _run(
    view: ViewFrames,
    geometry: Geometry,
    poses: Poses,
    sampling: Sampling,
    *,
    first: int,
    noise: Array | None,
    cache: GradientImageCache,
    sought: Sequence[int] | None,
) -> _Run:
    """Evidence of some frames of one view, the first of which is shot frame `first`."""
    begin = time.perf_counter()
    (R, T), stride = poses, sampling.stride
    every = render_labels(geometry, view.camera.subsampled(stride), first, R, T)
    labels = every if sought is None else every.of_performers(sought)
    drawn = time.perf_counter()
    left, top, right, bottom = (stride * edge for edge in labels.box())
    images = cache.images(view, range(first, first + len(R)), sampling.sigma, (left, top, right, bottom))
    foreground = view.foreground_at(first, len(R)) if sampling.reach and view.foreground is not None else None
    gradients = brightness_constancy(
        view.camera,
        images,
        labels,
        poses,
        first=first,
        stride=stride,
        tolerance=sampling.tolerance,
        foreground=foreground,
        given_noise=noise,
    )
    summed = time.perf_counter()
    outlines = OutlineSums(np.zeros((*T.shape[:2], 6, 6)), np.zeros((*T.shape[:2], 6)), np.zeros(len(T)))
    areas = every.areas(sought)
    explained = np.zeros(areas.shape[1:])  # by part
    agreeing = np.ones(T.shape[:2])
    if foreground is not None:
        frame, u, v = every.places
        part = every.part.ravel()[every.index].astype(np.intp)
        ratio = log_ratio(foreground[geometry.performer[part], frame, stride * v, stride * u])
        by_part = partial(np.bincount, part * len(T) + frame, minlength=explained.size)
        explained = by_part(stride**2 * ratio).astype(float).reshape(explained.shape)
        coloured = view.part_colours(first, len(R))
        if coloured is not None:
            own = coloured.colours.ratio[part, coloured.palette[frame, stride * v, stride * u]]
            explained = explained + by_part(stride**2 * own).astype(float).reshape(explained.shape)
        count = np.diff(every.ends)
        nobody = background_share(log_ratio(foreground[:, frame, stride * v, stride * u].max(axis=0)))
        unlike = np.bincount(np.repeat(np.arange(len(count)), count), nobody, len(count))
        agreeing = np.asarray(1.0 - unlike / np.maximum(count, 1), float).reshape(agreeing.shape)
        outlines = outline_sums(
            view.camera,
            foreground,
            labels,
            first=first,
            stride=stride,
            reach=max(4, round(sampling.reach * view.pixels_per_metre(T.mean(axis=(0, 1)), first))),
            tolerance=sampling.tolerance,
            halo=view.halo,
            coloured=coloured,
        )
    seconds = {
        "label images": drawn - begin,
        "gradients": summed - drawn,
        "outlines": time.perf_counter() - summed,
    }
    return _Run(gradients, outlines, explained, areas, labels.share, agreeing, seconds).of_whole_frames(view, first)
