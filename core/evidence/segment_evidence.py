"""Evidence of a whole segment: label images, gradients and outlines of every view and frame, summed per part."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..body.kinematics import Poses
from ..numerics.arrays import Array, Bools
from .frame_comparison import EvidenceCaches, FramesInView, SegmentInViews
from .frame_evidence import FrameEvidence, frame_evidence
from .gradient_evidence.gradients import GradientSums
from .outline_evidence.outline_sums import OutlineSums
from .rendering.part_geometry import Geometry, PerformerParts
from .sampling import Sampling
from .view_frames import ViewFrames
from .view_work import IN_THIS_THREAD, ViewWork

PAIRS_PER_BATCH = 32
"""Approximate number of pairs of frames that are processed at a time: large enough for NumPy, small enough for the
processor's cache."""
BY_PART_SHARE = 2.0
"""How many pixels count as independent where each part has a noise and a change of brightness of its own, relative to
where it has not. What the pixels of a part have in common is then taken out, which accounts for 1.1 to 1.35; the rest
was chosen by the errors of 24 shots (docs/evidence.md)."""


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
        Per performer (M): sum of the log likelihood ratios (performer against background) of the pixels that it covers,
        including those of the colours of its parts.
    unhidden : ndarray, shape (M, F)
        Per performer: visible area over the area without the other performers, summed over views and parts and weighted
        by the mean log likelihood ratio of the pixels; 1 for performers whose motion is given.
    share : ndarray, shape (V, F, P)
        Visible share of every part, see `LabelImages`.
    agreeing : ndarray, shape (V, F, P)
        Share of a part's pixels that look like its performer, or like another one who may stand in front of it; 1 where
        the part is not seen or there are no foreground images.
    sampling : Sampling
        How the images were sampled.
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
        """Weight of a sampled pixel if all pixels within a square of side `correlation_length`, metres, count as one
        observation, shape (V,).

        Weighted sums over pixels then depend neither on the size of the footage nor on the stride. Pairs of frames on
        which a view sees nobody say nothing of how dense its pixels are. Where parts have
        noise and changes of brightness of their own, neighbouring pixels have less in common (`BY_PART_SHARE`).
        """
        dense = [own[own > 0] for own in self.gradients.density]
        density = np.array([max(float(np.median(own)), 1.0) if len(own) else 1.0 for own in dense])
        count = BY_PART_SHARE if self.sampling.by_part else 1.0
        return np.asarray(count * self.sampling.stride**2 / (density * correlation_length**2))

    def without_equations(self) -> SegmentEvidence:
        """Return the evidence without the normal equations, which are nearly all of its memory: enough to judge it."""
        return replace(self, gradients=self.gradients.without_equations(), outlines=self.outlines.without_equations())

    def without(self, hidden: NDArray[np.bool_]) -> SegmentEvidence:
        """Return the evidence without the normal equations of hidden parts, (F, P); paper 1, equation (38)."""
        return replace(
            self,
            gradients=self.gradients.of_parts(~(hidden[:-1] | hidden[1:])),
            outlines=self.outlines.of_parts(~hidden),
        )


def accumulate_evidence(
    frames: SegmentInViews,
    parts: PerformerParts,
    *,
    noise: Array | None = None,
    caches: EvidenceCaches | None = None,
    by: ViewWork = IN_THIS_THREAD,
) -> SegmentEvidence:
    """Measure the evidence of F frames in all views.

    Parameters
    ----------
    frames : SegmentInViews
    parts : PerformerParts
    noise : ndarray, shape (V, F - 1, 1 + P), optional
        Standard deviation of the residuals of each pair of frames, under which costs are computed; by default it is
        estimated from the residuals.
    caches : EvidenceCaches, optional
        Shared with the next call.
    by : ViewWork, optional
    """
    caches, pairs = caches or EvidenceCaches(), len(frames) - 1
    runs = max(round(pairs / PAIRS_PER_BATCH), 1)
    bounds = [pairs * k // runs for k in range(runs + 1)]
    spans = [(v, a, b) for v in range(len(frames.views)) for a, b in pairwise(bounds)]
    tasks = []
    for v, a, b in spans:
        some = frames.some(v, a, b)
        tasks.append(
            (some.view, (some.first, some.poses, some.sampling, parts, None if noise is None else noise[v, a:b]))
        )
    joined, seconds = _JoinedRuns(len(frames.views), pairs), []
    for (v, a, _), found in zip(spans, by.of_each(_evidence_of_some, tasks, caches), strict=True):
        joined.add(v, a, found)
        seconds.append(found.seconds)
    spent = {stage: sum(one[stage] for one in seconds) / min(by.parallel, len(spans)) for stage in seconds[0]}
    return joined.evidence(parts.geometry, frames.sampling, spent)


def _evidence_of_some(
    view: ViewFrames, caches: EvidenceCaches, asked: tuple[int, Poses, Sampling, PerformerParts, Array | None]
) -> FrameEvidence:
    """Measure the evidence of some frames of a view, from a shot frame on; see `frame_evidence`."""
    first, poses, sampling, parts, noise = asked
    return frame_evidence(FramesInView(view, first, poses, sampling), parts, noise=noise, caches=caches)


class _JoinedRuns:
    """The evidence of runs of frames in V views, joined as it is measured: that of a long segment is large."""

    def __init__(self, views: int, pairs: int) -> None:
        self._views, self._pairs = views, pairs
        self._arrays: dict[str, NDArray[Any]] = {}

    def add(self, view: int, first: int, run: FrameEvidence) -> None:
        """Add a run of a view from the frame with index `first` on; adjacent runs share a frame, which is that of the
        earlier one.
        """
        later = 1 if first else 0
        by_pair = _arrays_of("gradients", run.gradients)
        by_frame = _arrays_of("outlines", run.outlines)
        by_frame |= {"share": run.share, "agreeing": run.agreeing, "explained": run.explained.T}
        by_frame["areas"] = np.moveaxis(run.areas, 2, 0)
        for name, values in by_pair.items():
            self._put(name, (view, first), values, self._pairs)
        for name, values in by_frame.items():
            self._put(name, (view, first + later), values[later:], self._pairs + 1)

    def _put(self, name: str, place: tuple[int, int], values: NDArray[Any], count: int) -> None:
        whole = self._arrays.get(name)
        if whole is None:
            whole = self._arrays[name] = np.empty((self._views, count, *values.shape[1:]), values.dtype)
        view, first = place
        whole[view, first : first + len(values)] = values

    def _sums(self, name: str) -> dict[str, NDArray[Any]]:
        """Return the joined arrays of the sums of a name by the names of their fields."""
        return {key.removeprefix(f"{name}."): a for key, a in self._arrays.items() if key.startswith(f"{name}.")}

    def evidence(self, geometry: Geometry, sampling: Sampling, seconds: dict[str, float]) -> SegmentEvidence:
        """Return the evidence of all runs."""
        found = self._arrays
        whose = geometry.performer == np.arange(int(geometry.performer.max()) + 1)[:, None]
        explained = np.ascontiguousarray(np.moveaxis(found["explained"], 1, 2))
        areas = np.ascontiguousarray(np.moveaxis(found["areas"], 1, 3))
        return SegmentEvidence(
            gradients=GradientSums(**self._sums("gradients")),
            outlines=OutlineSums(**self._sums("outlines")),
            explained=np.asarray(whose @ explained),
            unhidden=_unhidden(areas, explained, whose),
            share=found["share"],
            agreeing=found["agreeing"],
            sampling=sampling,
            seconds=seconds,
        )


def _arrays_of(name: str, sums: GradientSums | OutlineSums) -> dict[str, NDArray[Any]]:
    """Return the arrays of sums, called "name.field"."""
    return {f"{name}.{field.name}": getattr(sums, field.name) for field in fields(sums)}


def _unhidden(areas: Array, explained: Array, whose: Bools) -> Array:
    """Compute `SegmentEvidence.unhidden`, (M, F).

    Parameters
    ----------
    areas : ndarray, shape (V, 2, P, F)
        Pixels of each part with the other performers and without them.
    explained : ndarray, shape (V, P, F)
        Log likelihood ratios that each part explains. Their mean per pixel is the part's weight in a view; a part that
        a view never sees gets that of the performer's other parts.
    whose : ndarray of bool, shape (M, P)
        The parts of each performer.
    """
    seen, found = areas[:, 0].sum(axis=2), explained.sum(axis=2)
    others = (found @ whose.T / np.maximum(seen @ whose.T, 1)) @ whose
    each = np.maximum(np.where(seen > 0, found / np.maximum(seen, 1), others), 0.0)
    shown, alone = whose @ np.einsum("vp,vkpf->kpf", each, areas)
    return np.asarray(np.where(alone > 0, shown / np.where(alone > 0, alone, 1.0), 1.0))
