"""Render and compare: the bodies are drawn in given poses, and the drawing is compared with the frames of a view.

A comparison holds all that does not depend on the noise of the images: the drawn parts, the pixels that they have in
common on neighbouring frames, and the distances of outlines. It is the expensive part of the evidence, and is cached: a
descent often starts where another one ended, under another noise.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ..body.kinematics import Poses
from ..numerics.arrays import Array
from .foreground_images.foreground import background_share, log_ratio
from .foreground_likelihood import explained_by_part
from .gradient_evidence.compared_pixels import ComparedPixels, LabelledFrames, compare
from .outline_evidence.outline_lines import LineSearch, outline_lines
from .outline_evidence.outline_sums import OutlineSums, outline_sums
from .rendering.label_images import LabelImages, render_labels
from .rendering.part_geometry import PerformerParts
from .sampling import Sampling
from .static_evidence import StaticEvidence, StaticPartsCache
from .view_frames import GradientImageCache, ViewFrames, is_cached

MAX_CACHED_BYTES = 8 << 20
"""Largest size of what is kept of one view, bytes."""


@dataclass(frozen=True, eq=False)
class FramesInView:
    """Consecutive frames of a view from shot frame `first` on, with world poses (R, T) of all parts on them."""

    view: ViewFrames
    first: int
    poses: Poses
    sampling: Sampling

    def __len__(self) -> int:
        return len(self.poses[0])

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of frames and parts."""
        frames, parts = self.poses[1].shape[:2]
        return frames, parts

    def foreground(self) -> NDArray[np.uint8] | None:
        """Foreground images of these frames; None without any, or where the sampling leaves outlines out."""
        wanted = self.sampling.reach and self.view.foreground is not None
        return self.view.foreground_at(self.first, len(self)) if wanted else None


@dataclass(frozen=True, eq=False)
class SegmentInViews:
    """F consecutive frames in V views from shot frame `first` on, with world poses (R, T) of all parts on them,
    (F, P, 3, 3) and (F, P, 3), by the delay of the views that show them.
    """

    views: Sequence[ViewFrames]
    first: int
    poses: Mapping[float, Poses]
    sampling: Sampling

    def __len__(self) -> int:
        return len(next(iter(self.poses.values()))[0])

    def some(self, view: int, begin: int, end: int) -> FramesInView:
        """Return the frames from the one with index `begin` to the one with index `end`, inclusive, of a view."""
        shown = self.views[view]
        R, T = self.poses[shown.delay]
        frames = slice(begin, end + 1)
        return FramesInView(shown, self.first + begin, (R[frames], T[frames]), self.sampling)


@dataclass(frozen=True, eq=False)
class Drawing:
    """Label images of all performers, with those whose motion is given drawn only once.

    Attributes
    ----------
    labels : LabelImages
    areas : ndarray of int, shape (2, P, n)
        Pixels of every part with the other performers and without them.
    still : StaticEvidence or None
        The performers whose motion is given, if there are any.
    hidden : LabelImages or None
        Pixels of these that are hidden by the performers that are solved for.
    """

    labels: LabelImages
    areas: NDArray[np.int64]
    still: StaticEvidence | None = None
    hidden: LabelImages | None = None

    @classmethod
    def of(cls, frames: FramesInView, parts: PerformerParts, cache: StaticPartsCache) -> Drawing:
        """Draw the parts of all performers."""
        (R, T), stride, geometry = frames.poses, frames.sampling.stride, parts.geometry
        camera = frames.view.camera.subsampled(stride)
        if parts.sought is None or len(parts.sought) > geometry.performer.max():
            labels = render_labels(geometry, camera, frames.first, R, T)
            return cls(labels, labels.areas())
        moving = np.isin(geometry.performer, parts.sought)
        own, rest = np.flatnonzero(moving), np.flatnonzero(~moving)
        others = cache.drawn(frames.view, geometry, frames.poses, rest, stride=stride, first=frames.first)
        alone = render_labels(geometry.subset(own.tolist()), camera, frames.first, R[:, own], T[:, own])
        labels = others.still.among(alone, own)
        hidden = others.still.hidden(labels)
        return cls(labels, others.still.areas(labels, hidden, alone, own), others, hidden)


@dataclass(frozen=True, eq=False)
class FrameComparison:
    """The bodies drawn in given poses, compared with n consecutive frames of a view: P parts, whatever the noise.

    Attributes
    ----------
    frames : FramesInView
    parts : PerformerParts
    drawing : Drawing
    compared : ComparedPixels
    outlines : OutlineSums
    explained : ndarray, shape (P, n)
        See `explained_by_part`.
    agreeing : ndarray, shape (n, P)
        See `core.evidence.segment_evidence.SegmentEvidence`.
    """

    frames: FramesInView
    parts: PerformerParts
    drawing: Drawing
    compared: ComparedPixels
    outlines: OutlineSums
    explained: Array
    agreeing: Array

    def is_of(self, frames: FramesInView, parts: PerformerParts) -> bool:
        """Whether these frames, these parts and these poses were compared."""
        own = self.frames
        return (
            own.view is frames.view
            and own.first == frames.first
            and replace(own.sampling, by_part=frames.sampling.by_part) == frames.sampling
            and self.parts == parts
            and all(np.array_equal(a, b) for a, b in zip(own.poses, frames.poses, strict=True))
        )


class ComparisonCache:
    """The last two comparisons with each range of frames of each view: that at the end of a descent is among them even
    if a further step was refused.

    Threads may share a cache, if each compares other frames.
    """

    def __init__(self) -> None:
        self._kept: dict[ViewFrames, dict[tuple[int, int], list[FrameComparison]]] = {}

    def kept(self, frames: FramesInView, parts: PerformerParts) -> FrameComparison | None:
        """Return the comparison of the same, see `render_and_compare`; None if it is not kept."""
        recent = self._kept.get(frames.view, {}).get((frames.first, len(frames)), [])
        for known in recent:
            if known.is_of(frames, parts):
                recent.remove(known)
                recent.append(known)  # as the last one
                return known
        return None

    def keep(self, comparison: FrameComparison) -> None:
        """Keep a comparison, unless those of its view would take more than `MAX_CACHED_BYTES`; see `is_cached`."""
        frames, count = comparison.frames, len(comparison.frames)
        shown = range(frames.first, frames.first + count)
        kept = self._kept.setdefault(frames.view, {})
        for first, length in list(kept):  # what shows some of the same pairs of frames is replaced
            shared = min(first + length, frames.first + count) - max(first, frames.first)
            if shared > 1 and (first, length) != (frames.first, count):
                kept.pop((first, length), None)  # another thread may have done it
        if is_cached(frames.view, shown, 2 * comparison.compared.nbytes, MAX_CACHED_BYTES):
            kept[frames.first, count] = [*kept.get((frames.first, count), [])[-1:], comparison]


@dataclass(frozen=True, eq=False)
class EvidenceCaches:
    """What is kept from one evaluation of the evidence to the next. None of it changes the evidence.

    Attributes
    ----------
    images : GradientImageCache
    still : StaticPartsCache
        Label images of performers whose motion is given.
    comparisons : ComparisonCache
    """

    images: GradientImageCache = field(default_factory=GradientImageCache)
    still: StaticPartsCache = field(default_factory=StaticPartsCache)
    comparisons: ComparisonCache = field(default_factory=ComparisonCache)


def render_and_compare(
    frames: FramesInView, parts: PerformerParts, caches: EvidenceCaches
) -> tuple[FrameComparison, dict[str, float]]:
    """Draw the bodies and compare them with some frames of one view, unless one of the last comparisons was the same.

    Parameters
    ----------
    frames : FramesInView
    parts : PerformerParts
    caches : EvidenceCaches

    Returns
    -------
    FrameComparison
    dict of float
        Time spent, by stage.
    """
    begin = time.perf_counter()
    if (kept := caches.comparisons.kept(frames, parts)) is not None:
        return kept, {"label images": time.perf_counter() - begin, "gradients": 0.0, "outlines": 0.0}
    drawing = Drawing.of(frames, parts, caches.still)
    drawn = time.perf_counter()
    foreground = frames.foreground()
    compared = compare(labelled_frames(frames, drawing.labels, foreground, caches.images))
    seen = time.perf_counter()
    if foreground is None:
        outlines = OutlineSums(np.zeros((*frames.shape, 6, 6)), np.zeros((*frames.shape, 6)), np.zeros(len(frames)))
        explained, agreeing = np.zeros(drawing.areas.shape[1:]), np.ones(frames.shape)
    else:
        outlines = _outlines(frames, drawing.labels, foreground)
        explained, agreeing = _explained(frames, drawing, foreground), _agreeing(frames, drawing.labels, foreground)
    comparison = FrameComparison(
        frames=frames,
        parts=parts,
        drawing=drawing,
        compared=compared,
        outlines=outlines,
        explained=explained,
        agreeing=agreeing,
    )
    caches.comparisons.keep(comparison)
    return comparison, {
        "label images": drawn - begin,
        "gradients": seen - drawn,
        "outlines": time.perf_counter() - seen,
    }


def labelled_frames(
    frames: FramesInView, labels: LabelImages, foreground: NDArray[np.uint8] | None, images: GradientImageCache
) -> LabelledFrames:
    """Join frames and their label images with the gradient images around these."""
    view, first, sampling = frames.view, frames.first, frames.sampling
    left, top, right, bottom = (sampling.stride * edge for edge in labels.box())
    shown = images.images(view, range(first, first + len(frames)), sampling.sigma, (left, top, right, bottom))
    return LabelledFrames(
        camera=view.camera,
        images=shown,
        labels=labels,
        poses=frames.poses,
        first=first,
        stride=sampling.stride,
        foreground=foreground,
    )


def _outlines(frames: FramesInView, labels: LabelImages, foreground: NDArray[np.uint8]) -> OutlineSums:
    view, first, sampling = frames.view, frames.first, frames.sampling
    reach = max(4, round(sampling.reach * view.camera.pixels_per_metre(frames.poses[1].mean(axis=(0, 1)), first)))
    search = LineSearch(sampling.stride, reach, sampling.tolerance)
    coloured = view.part_colours(first, len(frames))
    lines = outline_lines(view.camera, foreground, labels, search, halo=view.halo, coloured=coloured)
    n, P = labels.share.shape
    return outline_sums(lines, view.camera, first, (n, P))


def _explained(frames: FramesInView, drawing: Drawing, foreground: NDArray[np.uint8]) -> Array:
    """Log likelihood ratios of the pixels that all performers cover, summed by part and frame, (P, n)."""
    sums = partial(explained_by_part, frames.view, foreground, stride=frames.sampling.stride, first=frames.first)
    explained = sums(drawing.labels, np.arange(frames.shape[1]))
    if drawing.still is not None and drawing.hidden is not None:
        parts = drawing.still.still.parts
        explained[parts] = drawing.still.explained - sums(drawing.hidden, parts)
    return explained


def _agreeing(frames: FramesInView, labels: LabelImages, foreground: NDArray[np.uint8]) -> Array:
    """Share of the pixels that show a part which look like some performer, shape (n, P)."""
    count = np.diff(labels.ends)
    place = labels.places_in(frames.sampling.stride, (foreground.shape[2], foreground.shape[3]))
    likest = np.max([images.reshape(-1).take(place) for images in foreground], axis=0)
    nobody = background_share(log_ratio(likest))
    unlike = np.bincount(np.repeat(np.arange(len(count)), count), nobody, len(count))
    return np.asarray(1.0 - unlike / np.maximum(count, 1), float).reshape(frames.shape)
