"""The body: a tree of rigid polyhedral parts (paper 1, section 2.2).

World pose of part i with parent p: R_i = R_p R0_i Q_i, T_i = T_p + R_p o_i, where R0 is the rest orientation of the
bone relative to its parent and Q is Blender's pose-bone rotation. The root has no parent: R_1 = R0_1 Q_1, and T_1 is
free. A part's frame has its origin at the joint and its y axis along the bone, as Blender's bones have.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from ..errors import BodyError, LandmarkError
from ..numerics.arrays import Array

UNLIMITED = ((-np.pi, np.pi),) * 3
"""Limits of a joint that turns as it likes, radians: lowest and highest about each axis."""
REST_SIGMA = 2.0
"""Standard deviation of a free joint's rotation from its rest orientation, radians."""


class _Caching:
    """What has cached properties, and can be pickled while another thread stores them."""

    def __getstate__(self) -> dict[str, Any]:
        return dict(vars(self))


@dataclass(frozen=True, eq=False)
class Part(_Caching):
    """A rigid part: a bone and the closed convex polyhedron that it carries.

    Attributes
    ----------
    name : str
        The bone's name, as Blender names bones (`upper_arm.L`).
    parent : int
        Index of the parent part, -1 for the root. Parents come before their children.
    head_world, tail_world : ndarray, shape (3,)
        The bone in the rest pose, metres; the head is the joint.
    R_world_rest : ndarray, shape (3, 3)
        Rest orientation: the columns are the bone's x, y (head to tail) and z axes in the world.
    vertices : ndarray, shape (V, 3)
        The polyhedron's vertices in the part's frame, metres. Their convex hull is what is projected.
    limits : ndarray, shape (3, 2)
        Smallest and largest value of each component of Q's rotation vector, radians.
    departure : float
        Standard deviation of the rotation from the rest orientation, radians. It decides what landmarks and images do
        not show.
    """

    name: str
    parent: int
    head_world: Array
    tail_world: Array
    R_world_rest: Array
    vertices: Array
    limits: Array = field(default_factory=lambda: np.array(UNLIMITED))
    departure: float = REST_SIGMA

    @cached_property
    def _hull(self) -> tuple[NDArray[np.int64], Array]:
        """Triangles of the hull as vertex indices, (N, 3), and their planes, (N, 4)."""
        hull = ConvexHull(self.vertices)
        return hull.simplices.astype(np.int64), np.asarray(hull.equations)

    @cached_property
    def faces(self) -> NDArray[np.int64]:
        """Triangles of the hull as vertex indices, shape (N, 3), counter-clockwise seen from outside."""
        triangles, planes = self._hull
        a, b, c = (self.vertices[triangles[:, k]] for k in range(3))
        inward = np.einsum("nk,nk->n", np.cross(b - a, c - a), planes[:, :3]) < 0
        return np.where(inward[:, None], triangles[:, ::-1], triangles)

    @cached_property
    def planes(self) -> Array:
        """Outward unit normal n and offset d of each face in the part's frame, n.x + d <= 0 inside, shape (N, 4)."""
        return self._hull[1]

    @cached_property
    def distinct_planes(self) -> Array:
        """The same, with faces in one plane listed once."""
        return np.unique(self.planes.round(9), axis=0)


@dataclass(frozen=True, eq=False)
class Body(_Caching):
    """A tree of parts and the landmarks on them.

    Attributes
    ----------
    parts : tuple of Part
    landmarks : mapping of str to (int, ndarray of shape (3,))
        Landmark name to the index of the part that carries it and its position in that part's frame, metres. Joint
        centres are landmarks too.
    """

    parts: tuple[Part, ...]
    landmarks: Mapping[str, tuple[int, Array]]

    def __post_init__(self) -> None:
        for i, part in enumerate(self.parts):
            if (part.parent >= i) or (i == 0) != (part.parent < 0):
                raise BodyError("parts must form one tree, parents before children", where=f"part {part.name}")

    def __len__(self) -> int:
        return len(self.parts)

    @property
    def dof(self) -> int:
        """Degrees of freedom: three of the root's translation, then three of each part's rotation."""
        return 3 + 3 * len(self.parts)

    @cached_property
    def names(self) -> list[str]:
        """Names of the parts."""
        return [part.name for part in self.parts]

    def index(self, name: str) -> int:
        """Return the index of the part of that name."""
        if name not in self.names:
            raise BodyError(f"the body has no part '{name}'", todo=f"its parts are {', '.join(self.names)}")
        return self.names.index(name)

    @cached_property
    def parents(self) -> list[int]:
        """Index of each part's parent, -1 for the root."""
        return [part.parent for part in self.parts]

    @cached_property
    def R_parent_rest(self) -> Array:
        """R0: rest orientation of each part relative to its parent (the root: to the world), shape (P, 3, 3)."""
        R = np.stack([part.R_world_rest for part in self.parts])
        return np.stack([R[i] if p < 0 else R[p].T @ R[i] for i, p in enumerate(self.parents)])

    @cached_property
    def offsets(self) -> Array:
        """o: position of each part's joint in its parent's frame (the root: in the world), metres, shape (P, 3)."""
        heads = [part.head_world for part in self.parts]
        R = [part.R_world_rest for part in self.parts]
        return np.stack([heads[i] if p < 0 else R[p].T @ (heads[i] - heads[p]) for i, p in enumerate(self.parents)])

    @cached_property
    def ancestry(self) -> NDArray[np.bool_]:
        """ancestry[i, k] is true where part k is part i or an ancestor of it, shape (P, P)."""
        A = np.eye(len(self), dtype=bool)
        for i, p in enumerate(self.parents):
            if p >= 0:
                A[i] |= A[p]
        return A

    @cached_property
    def limits(self) -> Array:
        """Limits of all rotation vectors, radians, shape (P, 3, 2)."""
        return np.stack([part.limits for part in self.parts])

    @cached_property
    def departures(self) -> Array:
        """Standard deviations of all parts' rotations from their rest orientations, radians, shape (P,)."""
        return np.array([part.departure for part in self.parts])

    @cached_property
    def is_stiff(self) -> NDArray[np.bool_]:
        """Which parts usually stay near their rest orientation, as trunk and collar bones do, shape (P,)."""
        return np.asarray(self.departures < REST_SIGMA)

    def landmark_arrays(self, names: list[str]) -> tuple[NDArray[np.int64], Array]:
        """Part indices (L,) of the named landmarks, and their positions in the frames of these parts, metres, (L,
        3).

        Raises
        ------
        LandmarkError
            The body lacks one.
        """
        for name in names:
            if name not in self.landmarks:
                raise LandmarkError(f"the body has no landmark '{name}'", todo=f"it has {', '.join(self.landmarks)}")
        parts = np.array([self.landmarks[n][0] for n in names], dtype=np.int64)
        points = np.array([self.landmarks[n][1] for n in names], dtype=float).reshape(-1, 3)
        return parts, points
