"""Evidence of performers whose motion is given, kept while another performer is solved for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..body.kinematics import Poses
from ..numerics.arrays import Array, Ints
from .foreground_likelihood import explained_by_part
from .gradient_evidence.compared_pixels import LabelledFrames
from .gradient_evidence.pixel_gains import PixelGains
from .rendering.part_geometry import Geometry
from .rendering.static_parts import StaticParts
from .sampling import Sampling
from .view_frames import MAX_CACHED_BYTES, ViewFrames, is_cached


@dataclass(frozen=True, eq=False)
class StaticEvidence:
    """Parts that do not move, with what they explain by part and frame, (S, n), and what they were drawn from."""

    still: StaticParts
    explained: Array
    stride: int
    geometry: Geometry
    poses: Poses
    kept_gains: dict[tuple[float, float, bytes], PixelGains] = field(default_factory=dict)

    def gains(self, frames: LabelledFrames, sampling: Sampling, noise: Array) -> PixelGains:
        """Compute the gain (`GradientSums.gain`) of their pixels, under a noise for each pair of frames."""
        key = sampling.sigma, sampling.tolerance, noise.tobytes()
        found = self.kept_gains.get(key)
        if found is None:
            shown = replace(frames, labels=self.still.labels, poses=self.poses)
            found = PixelGains.of(shown, sampling.tolerance, noise)
            self.kept_gains.clear()
            self.kept_gains[key] = found
        return found

    def matches(self, stride: int, geometry: Geometry, poses: Sequence[Array]) -> bool:
        """Whether it was computed for the same parts in these poses."""
        return (
            self.stride == stride
            and self.geometry is geometry
            and all(np.array_equal(a, b) for a, b in zip(self.poses, poses, strict=True))
        )


class StaticPartsCache:
    """Label images of the performers whose motion is given, kept from one evaluation of the evidence to the next.

    Threads may share a cache; what it returns does not depend on their order.
    """

    def __init__(self) -> None:
        self._kept: dict[ViewFrames, dict[tuple[int, int], StaticEvidence]] = {}

    def drawn(
        self, view: ViewFrames, geometry: Geometry, poses: Poses, parts: Ints, *, stride: int, first: int
    ) -> StaticEvidence:
        """Return the evidence of some parts on F consecutive shot frames.

        Parameters
        ----------
        view : ViewFrames
        geometry : Geometry
            Of all P parts.
        poses : tuple of ndarray, shapes (F, P, 3, 3) and (F, P, 3)
            World poses of all parts, metres.
        parts : ndarray of int
            Indices of the parts that are drawn.
        stride : int
            Every stride-th pixel of each row and column is drawn.
        first : int
            The first shot frame.
        """
        count = len(poses[0])
        own = tuple(a[:, parts] for a in poses)
        kept = self._kept.setdefault(view, {})
        found = kept.get((first, count))
        if found is not None and found.matches(stride, geometry, own):
            return found
        camera = view.camera.subsampled(stride)
        still = StaticParts.drawn(geometry, parts, camera, first, poses)
        explained = np.zeros((len(parts), count))
        if view.foreground is not None:
            foreground = view.foreground_at(first, count)
            explained = explained_by_part(view, foreground, still.labels, parts, stride=stride, first=first)
        found = StaticEvidence(still, explained, stride, geometry, (own[0], own[1]))
        for begin, length in list(kept):
            if min(begin + length, first + count) - max(begin, first) > 1:
                kept.pop((begin, length), None)  # another thread may have done it
        if is_cached(view, range(first, first + count), still.nbytes, MAX_CACHED_BYTES):
            kept[first, count] = found
        return found
