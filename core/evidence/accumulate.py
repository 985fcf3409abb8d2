"""Evidence of a whole segment: label images, gradients and outlines of every view and frame, summed per part."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields, replace
from itertools import pairwise
from operator import attrgetter

import numpy as np
from numpy.typing import NDArray

from ..body.kinematics import Poses
from ..numerics.arrays import Array, Bools
from .contours import OutlineSums
from .frame_evidence import FrameEvidence, FramesInView, frame_evidence
from .gradients import GradientSums
from .part_geometry import Geometry
from .sampling import Sampling
from .still_evidence import StillPartsCache
from .view_frames import GradientImageCache, ViewFrames

RUN = 32
"""Pairs of frames that are worked on at a time, about: enough to keep NumPy busy, few enough to stay in the cache."""


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

    def run(span: tuple[int, int, int]) -> FrameEvidence:
        v, a, b = span
        R, T = poses[views[v].delay]
        frames = FramesInView(views[v], first + a, (R[a : b + 1], T[a : b + 1]), sampling)
        given = None if noise is None else noise[v, a:b]
        return frame_evidence(frames, geometry, noise=given, caches=(cache, still), sought=sought)

    if threads == 1:
        done = [run(span) for span in spans]
    else:
        with ThreadPoolExecutor(threads) as pool:
            done = list(pool.map(run, spans))
    return _joined([done[i : i + runs] for i in range(0, len(done), runs)], geometry, sampling, threads)


def _joined(
    rows: Sequence[Sequence[FrameEvidence]], geometry: Geometry, sampling: Sampling, threads: int
) -> SegmentEvidence:
    """The evidence of a segment from that of its runs of frames, a row per view; two runs share the frame at which they
    meet.
    """

    def by_pair(of: Callable[[FrameEvidence], Array]) -> Array:
        return np.stack([np.concatenate([of(run) for run in row]) for row in rows])

    def by_frame(of: Callable[[FrameEvidence], Array], axis: int = 0) -> Array:
        each = [[np.split(of(run), [1], axis) for run in row] for row in rows]
        return np.stack([np.concatenate([row[0][0], *(rest for _, rest in row)], axis) for row in each])

    done = [run for row in rows for run in row]
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
