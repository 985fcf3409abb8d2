"""The polyhedra of performers' parts, for rendering and for collisions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse

from ...body import Body
from ...numerics.arrays import Array, Ints, slices_of

PLANE_TOLERANCE = 1e-6
"""Largest distance of a point on a plane, metres."""


@dataclass(frozen=True, eq=False)
class Geometry:
    """The polyhedra of all performers' parts, one after the other.

    Attributes
    ----------
    vertices : ndarray, shape (V, 3)
        In the part's frame, metres.
    owner : ndarray of int, shape (V,)
        The part that each vertex belongs to, counted over all performers.
    spans : tuple of slice
        The vertices of each part.
    planes : ndarray, shape (N, 4)
        The parts' face planes, see `Part.distinct_planes`.
    face_owner : ndarray of int, shape (N,)
        The part that each plane belongs to.
    meeting : sparse array of int, shape (V, N)
        1 if a plane goes through a vertex of its part.
    performer : ndarray of int, shape (P,)
        The performer to whom each part belongs.
    """

    vertices: Array
    owner: Ints
    spans: tuple[slice, ...]
    planes: Array
    face_owner: Ints
    meeting: sparse.csr_array
    performer: Ints

    @property
    def counts(self) -> Ints:
        """Number of vertices of each part, shape (P,)."""
        return np.array([span.stop - span.start for span in self.spans])

    @classmethod
    def of(cls, bodies: Sequence[Body]) -> Geometry:
        """Return the geometry of some bodies."""
        parts = [part for body in bodies for part in body.parts]
        planes = [part.distinct_planes for part in parts]
        performer = np.repeat(np.arange(len(bodies)), [len(body) for body in bodies])
        return cls.joined([part.vertices for part in parts], planes, performer)

    @classmethod
    def joined(cls, vertices: Sequence[Array], planes: Sequence[Array], performer: Ints | None = None) -> Geometry:
        """Join vertices and planes of parts; by default all parts belong to one performer."""
        count = np.arange(len(vertices))
        ends = np.cumsum([(0, 0), *((len(v), len(p)) for v, p in zip(vertices, planes, strict=True))], axis=0)
        touching = [
            np.argwhere(v @ p[:, :3].T + p[:, 3] > -PLANE_TOLERANCE) + first
            for v, p, first in zip(vertices, planes, ends, strict=False)
        ]
        places = np.concatenate(touching).T
        return cls(
            vertices=np.concatenate(vertices),
            owner=np.repeat(count, [len(v) for v in vertices]),
            spans=tuple(slices_of(len(v) for v in vertices)),
            planes=np.concatenate(planes),
            face_owner=np.repeat(count, [len(p) for p in planes]),
            meeting=sparse.csr_array((np.ones(places.shape[1], np.int64), tuple(places)), tuple(ends[-1])),
            performer=np.zeros(len(vertices), np.int64) if performer is None else performer,
        )

    def subset(self, parts: Sequence[int]) -> Geometry:
        """Return the geometry of some of the parts, in that order; it is built once."""
        found = self._subsets.get(tuple(parts))
        if found is None:
            vertices = [self.vertices[self.spans[part]] for part in parts]
            planes = [self.planes[self.face_owner == part] for part in parts]
            found = self._subsets[tuple(parts)] = Geometry.joined(vertices, planes, self.performer[list(parts)])
        return found

    @cached_property
    def _subsets(self) -> dict[tuple[int, ...], Geometry]:
        return {}


@dataclass(frozen=True)
class PerformerParts:
    """The parts that footage is compared with, and whose they are.

    Attributes
    ----------
    geometry : Geometry
        The parts of all performers.
    sought : tuple of int, optional
        Indices of the performers that are solved for, by default all; the others get no gradients and outlines.
    """

    geometry: Geometry
    sought: tuple[int, ...] | None = None
