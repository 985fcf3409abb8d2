"""The pieces of the model's outlines that can be compared with the images: those in front of something that differs."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from ...numerics.arrays import Array, Bools
from ..rendering.label_images import LabelImages

Indices = NDArray[np.intp]

PIECE_SPACING = 1.5
"""Distance between pieces along an outline, in strides of pixels."""


@dataclass(frozen=True, eq=False)
class OutlineSamples:
    """Arrays with a row for each of N places on the outlines of the parts in n frames, sorted by frame and part.

    Attributes
    ----------
    frame, part : ndarray of int, shape (N,)
    uv : ndarray, shape (N, 2)
        Positions on the model's outlines, pixels of the view's frames.
    normal : ndarray, shape (N, 2)
        Unit normals of the outlines, pointing outward.
    length : ndarray, shape (N,)
        Length of outline that each stands for.
    """

    frame: Indices
    part: Indices
    uv: Array
    normal: Array
    length: Array

    def where(self, kept: Bools) -> Self:
        """Return some of the rows."""
        return replace(self, **{item.name: getattr(self, item.name)[kept] for item in fields(self)})


@dataclass(frozen=True, eq=False)
class OutlinePieces(OutlineSamples):
    """N visible pieces of outlines; lengths in pixels.

    Attributes
    ----------
    depth : ndarray, shape (N,)
        Distance along the camera's axis, metres.
    behind : ndarray of int, shape (N,)
        The part that is seen just outside, or -1 for the background.
    """

    depth: Array
    behind: Indices


def seen_pieces(labels: LabelImages, stride: int, distinct: Bools | None) -> OutlinePieces:
    """Find the pieces of outline with their part on the inner side and, on the outer one, the background or a part
    behind it that has distinct colours.
    """
    outlines, after = labels.outlines, labels.outlines.following
    group = outlines.group
    a, z_a = stride * outlines.uv, outlines.depth
    step, z_b = a[after] - a, z_a[after]
    length = np.hypot(*step.T)
    spacing = PIECE_SPACING * stride
    pieces = np.where(length > 0.1 * spacing, np.ceil(length / spacing), 0).astype(np.intp)
    edge = np.repeat(np.arange(len(a)), pieces)
    t = (np.arange(len(edge)) - np.repeat(np.cumsum(pieces) - pieces, pieces) + 0.5) / pieces[edge]
    along = step[edge]
    uv, z = a[edge] + along * t[:, None], 1 / ((1 - t) / z_a[edge] + t / z_b[edge])
    # Outlines go clockwise as the picture is seen: outward lies to the left.
    normal = np.stack([along[:, 1], -along[:, 0]], axis=1) / length[edge, None]
    frame, part = np.divmod(group[edge], labels.share.shape[1])
    each = (length / np.maximum(pieces, 1))[edge]
    kept = np.flatnonzero(labels.part_at(frame, *(uv - 0.75 * stride * normal).T / stride) == part)
    frame, part, uv, normal, z, each = (values[kept] for values in (frame, part, uv, normal, z, each))
    beyond = labels.part_at(frame, *(uv + stride * normal).T / stride).astype(np.intp)
    seen = beyond == -1
    if distinct is not None:
        nearness = np.argsort(labels.far_to_near, axis=1)
        others = np.flatnonzero(beyond >= 0)
        f, own, other = frame[others], part[others], beyond[others]
        seen[others] = distinct[own, other] & (nearness[f, own] > nearness[f, other])
    return OutlinePieces(frame=frame, part=part, uv=uv, normal=normal, length=each, depth=z, behind=beyond).where(seen)
