"""Evidence of a few frames of one view: label images, gradients and outlines, summed per part."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ..body.kinematics import Poses
from ..numerics.arrays import Array
from ..shot.footage_faults.continuity import single_frames
from .explained import explained_by_part
from .foreground_images.foreground import background_share, log_ratio
from .gradient_evidence.compared_pixels import LabelledFrames
from .gradient_evidence.gradients import GradientSums, brightness_constancy
from .outline_evidence.outline_lines import outline_lines
from .outline_evidence.outline_sums import OutlineSums, outline_sums
from .rendering.label_images import LabelImages, render_labels
from .rendering.part_geometry import Geometry
from .sampling import Sampling
from .still_evidence import StillEvidence, StillPartsCache
from .view_frames import GradientImageCache, ViewFrames


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
class FrameEvidence:
    """Evidence of n consecutive frames of one view on P parts.

    Attributes
    ----------
    gradients : GradientSums
        Of the n - 1 pairs of neighbouring frames.
    outlines : OutlineSums
    explained : ndarray, shape (P, n)
        See `explained_by_part`.
    areas : ndarray of int, shape (2, P, n)
        Pixels that show each part, and those that would without the other performers.
    share, agreeing : ndarray, shape (n, P)
        See `core.evidence.segment_evidence.SegmentEvidence`.
    seconds : dict
        Time spent, by stage.
    """

    gradients: GradientSums
    outlines: OutlineSums
    explained: Array
    areas: NDArray[np.int64]
    share: Array
    agreeing: Array
    seconds: dict[str, float]

    def of_whole_frames(self, view: ViewFrames, first: int) -> FrameEvidence:
        """Return the evidence without that of damaged frames (`ViewFrames.torn`); the first is shot frame `first`."""
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


@dataclass(frozen=True, eq=False)
class _Drawing:
    """Label images of all performers, with those whose motion is given drawn only once.

    Attributes
    ----------
    labels : LabelImages
    areas : ndarray of int, shape (2, P, n)
        Pixels of every part with the other performers and without them.
    still : StillEvidence or None
        The performers whose motion is given, if there are any.
    hidden : LabelImages or None
        Pixels of these that are hidden by the performers that are solved for.
    """

    labels: LabelImages
    areas: NDArray[np.int64]
    still: StillEvidence | None = None
    hidden: LabelImages | None = None

    @classmethod
    def of(
        cls, frames: FramesInView, geometry: Geometry, cache: StillPartsCache, sought: Sequence[int] | None
    ) -> _Drawing:
        (R, T), stride = frames.poses, frames.sampling.stride
        camera = frames.view.camera.subsampled(stride)
        if sought is None or len(sought) > geometry.performer.max():
            labels = render_labels(geometry, camera, frames.first, R, T)
            return cls(labels, labels.areas())
        own, moving = cache.moving(geometry, sought)
        rest = np.setdiff1d(np.arange(T.shape[1]), own)
        others = cache.drawn(frames.view, geometry, frames.poses, rest, stride=stride, first=frames.first)
        alone = render_labels(moving, camera, frames.first, R[:, own], T[:, own])
        labels = others.still.among(alone, own)
        hidden = others.still.hidden(labels)
        return cls(labels, others.still.areas(labels, hidden, alone, own), others, hidden)


def frame_evidence(
    frames: FramesInView,
    geometry: Geometry,
    *,
    noise: Array | None,
    caches: tuple[GradientImageCache, StillPartsCache],
    sought: Sequence[int] | None,
) -> FrameEvidence:
    """Measure the evidence of some frames of one view.

    Parameters
    ----------
    frames : FramesInView
    geometry : Geometry
        The parts of all performers.
    noise : ndarray, shape (n - 1, 1 + P), optional
        Standard deviation of the residuals of each pair of frames, under which costs are computed; by default it is
        estimated from the residuals.
    caches : tuple of GradientImageCache and StillPartsCache
    sought : sequence of int, optional
        Indices of the performers that are solved for, by default all; the others get no gradients and outlines.
    """
    begin = time.perf_counter()
    images, still = caches
    drawing = _Drawing.of(frames, geometry, still, sought)
    drawn = time.perf_counter()
    foreground = frames.foreground()
    gradients = _gradients(frames, drawing, images, foreground, noise)
    summed = time.perf_counter()
    if foreground is None:
        outlines = OutlineSums(np.zeros((*frames.shape, 6, 6)), np.zeros((*frames.shape, 6)), np.zeros(len(frames)))
        explained, agreeing = np.zeros(drawing.areas.shape[1:]), np.ones(frames.shape)
    else:
        outlines = _outlines(frames, drawing.labels, foreground)
        explained, agreeing = _explained(frames, drawing, foreground), _agreeing(frames, drawing.labels, foreground)
    seconds = {
        "label images": drawn - begin,
        "gradients": summed - drawn,
        "outlines": time.perf_counter() - summed,
    }
    run = FrameEvidence(gradients, outlines, explained, drawing.areas, drawing.labels.share, agreeing, seconds)
    return run.of_whole_frames(frames.view, frames.first)


def _gradients(
    frames: FramesInView,
    drawing: _Drawing,
    cache: GradientImageCache,
    foreground: NDArray[np.uint8] | None,
    noise: Array | None,
) -> GradientSums:
    """Sum brightness constancy over the pairs of frames; with a given noise, add the gain of the other performers."""
    view, first, sampling, labels = frames.view, frames.first, frames.sampling, drawing.labels
    left, top, right, bottom = (sampling.stride * edge for edge in labels.box())
    images = cache.images(view, range(first, first + len(frames)), sampling.sigma, (left, top, right, bottom))
    labelled = LabelledFrames(view.camera, images, labels, frames.poses, first, sampling.stride, foreground)
    gradients = brightness_constancy(labelled, sampling.tolerance, noise, by_part=sampling.by_part)
    if drawing.still is None or noise is None or not view.camera.stands_still:
        return gradients
    gains = drawing.still.gains(labelled, sampling, noise)
    added = gains.visible(labels.part, drawing.still.still.parts, len(noise))
    return replace(gradients, gain=gradients.gain + added)


def _outlines(frames: FramesInView, labels: LabelImages, foreground: NDArray[np.uint8]) -> OutlineSums:
    view, first, sampling = frames.view, frames.first, frames.sampling
    lines = outline_lines(
        view.camera,
        foreground,
        labels,
        stride=sampling.stride,
        reach=max(4, round(sampling.reach * view.pixels_per_metre(frames.poses[1].mean(axis=(0, 1)), first))),
        tolerance=sampling.tolerance,
        halo=view.halo,
        coloured=view.part_colours(first, len(frames)),
    )
    n, P = labels.share.shape
    return outline_sums(lines, view.camera, first, (n, P))


def _explained(frames: FramesInView, drawing: _Drawing, foreground: NDArray[np.uint8]) -> Array:
    """Log likelihood ratios of the pixels that all performers cover, summed by part and frame, (P, n)."""
    sums = partial(explained_by_part, frames.view, foreground, stride=frames.sampling.stride, first=frames.first)
    explained = sums(drawing.labels, np.arange(frames.shape[1]))
    if drawing.still is not None and drawing.hidden is not None:
        parts = drawing.still.still.parts
        explained[parts] = drawing.still.explained - sums(drawing.hidden, parts)
    return explained


def _agreeing(frames: FramesInView, labels: LabelImages, foreground: NDArray[np.uint8]) -> Array:
    """Share of the pixels that show a part which look like some performer, shape (n, P)."""
    frame, u, v = labels.places
    stride, count = frames.sampling.stride, np.diff(labels.ends)
    nobody = background_share(log_ratio(foreground[:, frame, stride * v, stride * u].max(axis=0)))
    unlike = np.bincount(np.repeat(np.arange(len(count)), count), nobody, len(count))
    return np.asarray(1.0 - unlike / np.maximum(count, 1), float).reshape(frames.shape)
