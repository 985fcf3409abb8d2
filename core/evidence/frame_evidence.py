"""Evidence of a few frames of one view: label images, gradients and outlines, summed per part."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..numerics.arrays import Array
from .frame_comparison import EvidenceCaches, FrameComparison, FramesInView, labelled_frames, render_and_compare
from .gradient_evidence.gradients import GradientSums, brightness_constancy
from .outline_evidence.outline_sums import OutlineSums
from .rendering.part_geometry import PerformerParts
from .view_frames import ViewFrames


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
        """Return the evidence without that of damaged frames, and of pairs that do not continue each other; the first
        is shot frame `first`.
        """
        sound, together = view.sound(first, len(self.share))
        if sound.all() and together.all():
            return self
        frames, pairs = sound.astype(float), together.astype(float)
        return replace(
            self,
            gradients=self.gradients.of_pairs(pairs),
            outlines=self.outlines.of_frames(frames),
            explained=self.explained * frames,
            agreeing=np.where(frames[:, None] > 0, self.agreeing, 1.0),
        )


def frame_evidence(
    frames: FramesInView, parts: PerformerParts, *, noise: Array | None, caches: EvidenceCaches
) -> FrameEvidence:
    """Measure the evidence of some frames of one view.

    Parameters
    ----------
    frames : FramesInView
    parts : PerformerParts
    noise : ndarray, shape (n - 1, 1 + P), optional
        Standard deviation of the residuals of each pair of frames, under which costs are computed; by default it is
        estimated from the residuals.
    caches : EvidenceCaches
    """
    comparison, seconds = render_and_compare(frames, parts, caches)
    begin = time.perf_counter()
    gradients = _gradients(frames, comparison, caches, noise)
    seconds["gradients"] += time.perf_counter() - begin
    areas, share = comparison.drawing.areas, comparison.drawing.labels.share
    run = FrameEvidence(
        gradients=gradients,
        outlines=comparison.outlines,
        explained=comparison.explained,
        areas=areas,
        share=share,
        agreeing=comparison.agreeing,
        seconds=seconds,
    )
    return run.of_whole_frames(frames.view, frames.first)


def _gradients(
    frames: FramesInView, comparison: FrameComparison, caches: EvidenceCaches, noise: Array | None
) -> GradientSums:
    """Sum brightness constancy over the pairs of frames; with a given noise, add the gain of the other performers."""
    sampling, drawing = frames.sampling, comparison.drawing
    gradients = brightness_constancy(comparison.compared, sampling.tolerance, noise, by_part=sampling.by_part)
    if drawing.still is None or noise is None or not frames.view.camera.stands_still:
        return gradients
    labelled = labelled_frames(frames, drawing.labels, frames.foreground(), caches.images)
    gains = drawing.still.gains(labelled, sampling, noise)
    added = gains.visible(drawing.labels.part, drawing.still.still.parts, len(noise))
    return replace(gradients, gain=gradients.gain + added)
