"""Label images of parts that do not move, merged with those of parts that do."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ...body.kinematics import Poses
from ...cameras.camera import Camera
from ...numerics.arrays import Array, Bools, Ints
from .label_images import Faces, LabelImages, in_depth_steps, render_labels
from .part_geometry import Geometry


@dataclass(frozen=True, eq=False)
class StaticParts:
    """Some of P parts that do not move: they are drawn once, while others move in front of and behind them.

    Attributes
    ----------
    parts : ndarray of int, shape (S,)
        Indices of these parts.
    labels : LabelImages
        Label images of these parts alone.
    performer : ndarray of int, shape (P,)
        Index of the performer of every part.
    """

    parts: Ints
    labels: LabelImages
    performer: Ints

    @classmethod
    def drawn(cls, geometry: Geometry, parts: Ints, camera: Camera, first: int, poses: Poses) -> StaticParts:
        """Draw some of the parts of a geometry; other parameters as in `render_labels`, with the poses of all parts."""
        R, T = poses
        alone = render_labels(geometry.subset(parts.tolist()), camera, first, R[:, parts], T[:, parts])
        return cls(parts, alone, geometry.performer)

    @cached_property
    def depth(self) -> NDArray[np.float32]:
        """Depth images of these parts, metres, shape (n, h, w)."""
        return self.labels.depth_images()

    @cached_property
    def depth_steps(self) -> NDArray[np.uint16]:
        """The same in units of `DEPTH_STEP`."""
        return in_depth_steps(self.depth)

    @cached_property
    def _numbered(self) -> NDArray[np.int16]:
        """Label images with the indices of all parts."""
        return np.append(self.parts, -1).astype(np.int16)[self.labels.part]  # -1 is the last

    @cached_property
    def _filled(self) -> Array:
        return self.labels.outlines.areas

    def among(self, moving: LabelImages, parts: Ints) -> LabelImages:
        """Merge these parts with label images of moving parts, whose indices (ascending) are `parts`."""
        n, P = len(moving.part), len(self.performer)
        distance = np.full((n, P), np.inf)
        distance[:, self.parts], distance[:, parts] = self.labels.distance, moving.distance
        counts = np.diff(moving.ends)
        number = np.repeat(np.tile(parts, n), counts)
        frame = np.repeat(np.arange(n), counts.reshape(n, -1).sum(axis=1))
        there = self.labels.part.ravel()[moving.index].astype(np.intp)
        seen = ~self._is_nearer(distance, frame, there, number)
        index = moving.index[seen]
        part = self._numbered.copy()
        part.ravel()[index] = number[seen]
        count = np.zeros((n, P), np.intp)
        count[:, parts] = np.bincount((frame * P + number)[seen], minlength=n * P).reshape(n, P)[:, parts]
        covered = seen & (there >= 0)
        lost = np.bincount(frame[covered] * len(self.parts) + there[covered], minlength=n * len(self.parts))
        left = (np.diff(self.labels.ends) - lost).reshape(n, -1)
        share = np.zeros((n, P))
        share[:, self.parts] = np.minimum(left / self._filled.reshape(left.shape), 1.0)
        share[:, parts] = np.minimum(count[:, parts] / moving.outlines.areas.reshape(n, -1), 1.0)
        farthest = np.zeros((n, P), np.float32)
        farthest[:, parts] = moving.faces.farthest.reshape(n, -1)

        def spread(ends: NDArray[np.intp]) -> NDArray[np.intp]:
            each = np.zeros((n, P), np.intp)
            each[:, parts] = np.diff(ends).reshape(n, -1)
            return np.concatenate([[0], np.cumsum(each)])

        return LabelImages(
            part=part,
            index=index,
            ends=np.concatenate([[0], np.cumsum(count)]),
            share=share,
            outlines=replace(moving.outlines, ends=spread(moving.outlines.ends)),
            faces=Faces(moving.faces.planes, spread(moving.faces.ends), farthest.ravel()),
            performer=self.performer,
            distance=distance,
            still=self,
        )

    def _is_nearer(self, distance: Array, frame: Ints, there: Ints, number: Ints) -> Bools:
        """Whether one of these parts lies before a moving one in N pixels of the latter, shape (N,).

        Parameters
        ----------
        distance : ndarray, shape (n, P)
            Distance of every part from the camera on every frame, metres.
        frame : ndarray of int, shape (N,)
        there : ndarray of int, shape (N,)
            Which of these parts is in the pixel; -1 for none.
        number : ndarray of int, shape (N,)
            Index of the moving part.
        """
        nearness = np.empty(distance.shape, np.int64)
        np.put_along_axis(nearness, np.argsort(-distance, axis=1), np.arange(distance.shape[1])[None], axis=1)
        nearer = there >= 0
        own, other = self.parts[there[nearer]], number[nearer]
        nearer[nearer] = nearness[frame[nearer], own] > nearness[frame[nearer], other]
        return nearer

    def hidden(self, seen: LabelImages) -> LabelImages:
        """List the pixels of these parts that others hide in label images of all parts (`among`), by part."""
        n = len(seen.part)
        there = self.labels.part.ravel()[seen.index]
        covered = np.flatnonzero(there >= 0)
        group = seen.index[covered] // seen.part[0].size * len(self.parts) + there[covered]
        order = np.argsort(group, kind="stable")
        ends = np.searchsorted(group[order], np.arange(n * len(self.parts) + 1))
        return replace(self.labels, index=seen.index[covered[order]], ends=ends)

    def areas(self, seen: LabelImages, hidden: LabelImages, moving: LabelImages, parts: Ints) -> Ints:
        """Compute `LabelImages.areas` of all parts, shape (2, P, n), without drawing them again.

        Parameters
        ----------
        seen, hidden : LabelImages
            Label images of all parts (`among`), and the pixels hidden there (`hidden`).
        moving : LabelImages
            Label images of the moving parts alone.
        parts : ndarray of int
            Indices of the moving parts.
        """
        n, P = seen.share.shape
        shown, alone = np.zeros((2, P, n), np.intp)
        left = np.diff(self.labels.ends) - np.diff(hidden.ends)
        shown[self.parts] = alone[self.parts] = left.reshape(n, -1).T
        shown[parts] = np.diff(seen.ends).reshape(n, P).T[parts]
        alone[parts] = np.diff(moving.ends).reshape(n, -1).T
        return np.stack([shown, alone])

    @property
    def nbytes(self) -> int:
        """Approximate size in memory, bytes."""
        return self.labels.part.nbytes + self.labels.index.nbytes
