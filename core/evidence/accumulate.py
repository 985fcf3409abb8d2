"""Evidence of a whole segment: label images, gradients and outlines of every view and frame, summed per part."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, fields, replace
from functools import partial
from itertools import pairwise
from operator import attrgetter

import numpy as np
from numpy.typing import NDArray

from ..body.kinematics import Poses
from ..numerics.arrays import Array, Bools, Ints
from ..shot.continuity import single_frames
from .contours import OutlineSums, outline_sums
from .foreground import background_share, log_ratio
from .gradients import GradientSums, PixelGains, brightness_constancy
from .label_images import Geometry, LabelImages, StillParts, render_labels
from .view_frames import KEPT_BYTES, GradientImageCache, GradientImages, ViewFrames

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


class StillPartsCache:
    """Label images of the performers whose motion is given, kept from one evaluation of the evidence to the next.

    Threads may share a cache, and what it returns does not depend on which of them comes first.
    """

    def __init__(self) -> None:
        self._kept: dict[ViewFrames, dict[tuple[int, int], _StillEvidence]] = {}
        self._moving: dict[tuple[Geometry, tuple[int, ...]], tuple[Ints, Geometry]] = {}

    def moving(self, geometry: Geometry, sought: Sequence[int]) -> tuple[Ints, Geometry]:
        """The parts of the performers that are sought, and a geometry of them alone."""
        key = geometry, tuple(sought)
        found = self._moving.get(key)
        if found is None:
            parts = np.flatnonzero(np.isin(geometry.performer, sought))
            found = parts, geometry.subset(parts.tolist())
            self._moving = {key: found}  # one performer is solved at a time
        return found

    def drawn(
        self, view: ViewFrames, geometry: Geometry, poses: Poses, parts: Ints, *, stride: int, first: int
    ) -> _StillEvidence:
        """What some parts show in consecutive shot frames, the first of which is given, in poses of all parts."""
        count = len(poses[0])
        own = tuple(a[:, parts] for a in poses)
        kept = self._kept.setdefault(view, {})
        found = kept.get((first, count))
        if found is not None and found.matches(stride, geometry, own):
            return found
        camera = view.camera.subsampled(stride)
        still = StillParts.drawn(geometry, parts, camera, first, poses)
        explained = np.zeros((len(parts), count))
        if view.foreground is not None:
            foreground = view.foreground_at(first, count)
            explained = _explained(view, foreground, still.labels, parts, stride=stride, first=first)
        found = _StillEvidence(still, explained, stride, geometry, (own[0], own[1]))
        for begin, length in list(kept):
            if min(begin + length, first + count) - max(begin, first) > 1:
                kept.pop((begin, length), None)  # another thread may have done it
        if (1 + (first - view.first) / max(count - 1, 1)) * still.nbytes <= KEPT_BYTES:
            kept[first, count] = found
        return found


@dataclass(frozen=True, eq=False)
class _StillEvidence:
    """Parts that stay where they are, with what they explain by part (S, n), and what they were drawn from."""

    still: StillParts
    explained: Array
    stride: int
    geometry: Geometry
    poses: Poses
    kept_gains: dict[tuple[float, float, bytes], PixelGains] = field(default_factory=dict)

    def gains(
        self,
        view: ViewFrames,
        images: GradientImages,
        sampling: Sampling,
        *,
        first: int,
        foreground: NDArray[np.uint8] | None,
        noise: Array,
    ) -> PixelGains:
        """What their pixels gain by how they move, under a noise of each pair of frames."""
        key = sampling.sigma, sampling.tolerance, noise.tobytes()
        found = self.kept_gains.get(key)
        if found is None:
            found = PixelGains.of(
                view.camera,
                images,
                self.still.labels,
                self.poses,
                first=first,
                stride=self.stride,
                tolerance=sampling.tolerance,
                foreground=foreground,
                noise=noise,
            )
            self.kept_gains.clear()
            self.kept_gains[key] = found
        return found

    def matches(self, stride: int, geometry: Geometry, poses: Sequence[Array]) -> bool:
        """Whether it is what the same parts show in these poses."""
        return (
            self.stride == stride
            and self.geometry is geometry
            and all(np.array_equal(a, b) for a, b in zip(self.poses, poses, strict=True))
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
    still: StillPartsCache | None = None,
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
    still : StillPartsCache, optional
        Keeps the label images of the others for the next call.
    """
    cache = GradientImageCache() if cache is None else cache
    still = StillPartsCache() if still is None else still
    F = len(next(iter(poses.values()))[0])
    runs = max(round((F - 1) / RUN), 1)
    bounds = [(F - 1) * k // runs for k in range(runs + 1)]
    spans = [(v, a, b) for v in range(len(views)) for a, b in pairwise(bounds)]

    def run(span: tuple[int, int, int]) -> _Run:
        v, a, b = span
        R, T = poses[views[v].delay]
        own = R[a : b + 1], T[a : b + 1]
        given, caches = None if noise is None else noise[v, a:b], (cache, still)
        return _run(views[v], geometry, own, sampling, first=first + a, noise=given, caches=caches, sought=sought)

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
                gain=g.gain * pairs,
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
    caches: tuple[GradientImageCache, StillPartsCache],
    sought: Sequence[int] | None,
) -> _Run:
    """Evidence of some frames of one view, the first of which is shot frame `first`."""
    begin = time.perf_counter()
    cache, still = caches
    (R, T), stride = poses, sampling.stride
    given: tuple[_StillEvidence, LabelImages] | None = None
    camera = view.camera.subsampled(stride)
    own = np.arange(T.shape[1])
    if sought is None or len(sought) > geometry.performer.max():
        labels = render_labels(geometry, camera, first, R, T)
        areas = labels.areas()
    else:
        own, moving = still.moving(geometry, sought)
        rest = np.setdiff1d(np.arange(T.shape[1]), own)
        others = still.drawn(view, geometry, poses, rest, stride=stride, first=first)
        alone = render_labels(moving, camera, first, R[:, own], T[:, own])
        labels = others.still.among(alone, own)
        given = others, others.still.hidden(labels)
        areas = others.still.areas(labels, given[1], alone, own)
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
    if given is not None and noise is not None and view.camera.stands_still:
        others = given[0]
        gains = others.gains(view, images, sampling, first=first, foreground=foreground, noise=noise)
        added = gains.visible(labels.part, others.still.parts, len(noise))
        gradients = replace(gradients, gain=gradients.gain + added)
    summed = time.perf_counter()
    outlines = OutlineSums(np.zeros((*T.shape[:2], 6, 6)), np.zeros((*T.shape[:2], 6)), np.zeros(len(T)))
    explained = np.zeros(areas.shape[1:])  # by part
    agreeing = np.ones(T.shape[:2])
    coloured = view.part_colours(first, len(R)) if foreground is not None else None
    if foreground is not None:
        parts = np.arange(T.shape[1])
        explained = _explained(view, foreground, labels, parts, stride=stride, first=first)
        if given is not None:
            others, hidden = given
            numbers = others.still.parts
            lost = _explained(view, foreground, hidden, numbers, stride=stride, first=first)
            explained[numbers] = others.explained - lost
        frame, u, v = labels.places
        count = np.diff(labels.ends)
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


def _explained(
    view: ViewFrames, foreground: NDArray[np.uint8], labels: LabelImages, parts: Ints, *, stride: int, first: int
) -> Array:
    """How much likelier the pixels that labels list are with the parts that they show: sums by part and frame, (P, n).

    `foreground` (M, n, h, w) are the images of the labels' frames, the first of which is a shot frame; `parts` (P,) are
    the numbers of the labels' parts among those of all performers.
    """
    frame, u, v = labels.places
    n, P = labels.share.shape
    group = np.repeat(np.arange(n * P), np.diff(labels.ends))
    part = group % P
    by_part = partial(np.bincount, part * n + frame, minlength=n * P)
    ratio = log_ratio(foreground[labels.performer[part], frame, stride * v, stride * u])
    explained = by_part(stride**2 * ratio).astype(float).reshape(P, n)
    coloured = view.part_colours(first, n)
    if coloured is not None:
        own = coloured.colours.ratio[parts[part], coloured.palette[frame, stride * v, stride * u]]
        explained = explained + by_part(stride**2 * own).astype(float).reshape(P, n)
    return np.asarray(explained)
