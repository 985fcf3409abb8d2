"""The evidence of all views with its weights in the normal equations, summed per pair of frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ....evidence.segment_evidence import SegmentEvidence
from ....numerics.arrays import Array, Bools
from ....shot.settings import Settings
from .problem import SegmentProblem


@dataclass(frozen=True, eq=False)
class WeightedEvidence:
    """Evidence with its weights in the normal equations.

    Attributes
    ----------
    evidence : SegmentEvidence
    hidden : ndarray of bool, shape (F, P), optional
        Parts that no view sees, which are left out.
    precision : ndarray, shape (V, F - 1)
        Weight of the pixels of each pair of frames.
    outlines : float
        Weight of outlines.
    """

    evidence: SegmentEvidence
    hidden: Bools | None
    precision: Array
    outlines: float

    @classmethod
    def of(cls, problem: SegmentProblem, evidence: SegmentEvidence, hidden: Sequence[Bools] = ()) -> WeightedEvidence:
        """Weight evidence; `hidden` as in `evidence_equations`."""
        precision = pixel_precision(evidence, problem.settings)
        outlines = 1 / outline_variance(evidence, problem.settings)
        return cls(evidence, np.concatenate(hidden, axis=1) if hidden else None, precision, outlines)

    def energy(self, views: Sequence[int], pair_weights: Array) -> float:
        """Energy of some views; `pair_weights` (V, F - 1) are those of the gradients, see `SegmentNoise.weight`."""
        gradients, outlines, own = self.evidence.gradients, self.evidence.outlines, list(views)
        energy = float(np.sum(pair_weights[own] * gradients.cost[own]))
        return energy + self.outlines * float(outlines.energy[own].sum())

    def paired_sums(self, views: Sequence[int], first: int = 0, stop: int | None = None) -> tuple[Array, Array]:
        """Weighted sums of some views on the twists of P parts in n pairs of frames, from pair `first` to the one
        before `stop`; by default in all of them.

        Returns
        -------
        H : ndarray, shape (n, P, 12, 12)
        g : ndarray, shape (n, P, 12)
            The gradient of half the energy.
        """
        own, F = list(views), self.evidence.share.shape[1]
        last = F - 1 if stop is None else stop
        gradients, outlines = self.evidence.gradients, self.evidence.outlines
        by_pair = [a[own, first:last] for a in (gradients.H, gradients.g)]
        by_frame = [a[own, first : last + 1] for a in (outlines.H, outlines.g)]
        if self.hidden is not None:
            seen = ~self.hidden[first : last + 1, :, None]
            both = seen[:-1] & seen[1:]
            by_pair = [by_pair[0] * both[..., None], by_pair[1] * both]
            by_frame = [by_frame[0] * seen[..., None], by_frame[1] * seen]
        precision = self.precision[own, first:last]
        H = np.einsum("vf,vfpij->fpij", precision, by_pair[0])
        g = np.einsum("vf,vfpi->fpi", precision, by_pair[1])
        outline_H, outline_g = (self.outlines * a.sum(axis=0) for a in by_frame)
        # Outlines belong to single frames: each is added to the pair that its frame begins, the last to that it ends.
        H[..., :6, :6] += outline_H[:-1]
        g[..., :6] += outline_g[:-1]
        if last == F - 1:
            H[-1, :, 6:, 6:] += outline_H[-1]
            g[-1, :, 6:] += outline_g[-1]
        return H, g


def outline_variance(evidence: SegmentEvidence, settings: Settings) -> float:
    """Variance by which the outlines' energy is divided, less the correlation of neighbouring pieces of an outline.

    Far from the solution, where the tolerance is large, the lines across the outline are long and meet outlines of
    other limbs: outlines weigh little there.
    """
    return settings.lengths[1] * evidence.sampling.tolerance**2


def pixel_precision(evidence: SegmentEvidence, settings: Settings) -> Array:
    """Inverse variance of a pixel's residual, less the correlation of neighbouring pixels, shape (V, F - 1).

    The noise is that of each pair of frames. Far from the solution it is the median of the view: there the residuals of
    a pair are large where its poses are wrong, which must not make it count less.
    """
    noise = evidence.gradients.noise[..., 0]
    if evidence.sampling.tolerance > 1:
        used = evidence.gradients.weight > 0
        usual = [np.median(own[some] if some.any() else own) for own, some in zip(noise, used, strict=True)]
        noise = np.broadcast_to(np.array(usual)[:, None], noise.shape)
    return np.asarray(evidence.pixel_share(settings.lengths[0])[:, None] / np.maximum(noise, 1e-3) ** 2)
