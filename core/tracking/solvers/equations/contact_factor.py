"""Contact: the bodies of different performers do not pass through each other.

Where a part of one performer penetrates a part of another, the residual is the depth of its deepest point, along the
normal of the nearest face. The constraint is soft, as clothes and flesh give way a little.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np
from scipy.spatial import ConvexHull

from ....body import Body
from ....body.joint_blocks import joint_blocks
from ....body.kinematics import Poses, scene_poses
from ....body.motion import Motion
from ....evidence.rendering.part_geometry import Geometry
from ....numerics.arrays import Array, Ints, slices_of
from ....numerics.banded_blocks import BandedBlocks
from ....numerics.robust_kernels import Huber

FREE_DEPTH = 0.02
"""Depth up to which parts may penetrate each other at no cost, metres: flesh and clothes give way, and polyhedra are
simple shapes. Hands are thinner than twice this, so they can hold each other."""
DEPTH_SIGMA = 0.01
"""Standard deviation of the depth beyond that, metres."""
HUBER_LIMIT = 3.0
"""Depth, in standard deviations, beyond which the cost grows linearly (Huber)."""
POINT_SPACING = 0.04  # metres: largest distance between points on the edges of a polyhedron


@dataclass(frozen=True, eq=False)
class ContactFactor:
    """The shapes of the parts of M performers, for contact between them.

    Attributes
    ----------
    spans : tuple of slice
        Indices of the parts of each performer, P in all.
    points : tuple of ndarray, shape (K, 3)
        Per part: points on its surface, in the part's frame, metres.
    planes : tuple of ndarray, shape (N, 4)
        Per part: planes of its faces, see `core.body.body.Part.planes`.
    centres : ndarray, shape (P, 3)
        Centres of bounding spheres and boxes, in the parts' frames, metres.
    radii : ndarray, shape (P,)
        Radii of the bounding spheres, metres.
    half : ndarray, shape (P, 3)
        Half the sides of the bounding boxes, along the axes of the parts' frames, metres.
    touching : frozenset of (int, int)
        Pairs of parts, in both orders, that may penetrate each other, such as a hand and what it holds.
    """

    spans: tuple[slice, ...]
    points: tuple[Array, ...]
    planes: tuple[Array, ...]
    centres: Array
    radii: Array
    half: Array
    touching: frozenset[tuple[int, int]] = frozenset()

    @classmethod
    def of(
        cls, geometry: Geometry, bodies: Sequence[Body], touching: frozenset[tuple[int, int]] = frozenset()
    ) -> ContactFactor:
        """Build the factor of all performers; pairs of parts in `touching` may penetrate each other."""
        vertices = [geometry.vertices[span] for span in geometry.spans]
        centres = np.array([(v.min(axis=0) + v.max(axis=0)) / 2 for v in vertices])
        return cls(
            spans=tuple(slices_of(len(body) for body in bodies)),
            points=tuple(surface_points(v) for v in vertices),
            planes=tuple(geometry.planes[geometry.face_owner == part] for part in range(len(vertices))),
            centres=centres,
            radii=np.array([np.linalg.norm(v - c, axis=1).max() for v, c in zip(vertices, centres, strict=True)]),
            half=np.array([np.ptp(v, axis=0) / 2 for v in vertices]),
            touching=touching,
        )

    def blocks(self, bodies: Sequence[Body], poses: Poses, sought: Sequence[int] | None = None) -> list[BandedBlocks]:
        """Build the normal equations of every performer around world poses of all parts on F frames.

        Performers in contact are solved independently, and each would move out by the whole depth. So each gets twice
        its own normal matrix: the steps of both together then add up to the depth.

        Parameters
        ----------
        bodies : sequence of Body
        poses : tuple of ndarray, shapes (F, P, 3, 3) and (F, P, 3)
        sought : sequence of int, optional
            Indices of the performers that are solved for, by default all; contact among the others is left out.

        Returns
        -------
        list of BandedBlocks
            One per performer; zero for those whose motion is given.
        """
        R, T = poses
        F, P = T.shape[:2]
        moving = range(len(bodies)) if sought is None else sought
        H, g, energy = np.zeros((F, P, 6, 6)), np.zeros((F, P, 6)), np.zeros(len(bodies))
        kernel = Huber(HUBER_LIMIT)
        for i, j in permutations(range(len(bodies)), 2):
            if i not in moving and j not in moving:
                continue
            for part, other, near in self._near(poses, i, j):
                frames, depth, rows = self._deepest(poses, part, other, near)
                r = np.maximum(depth - FREE_DEPTH, 0.0) / DEPTH_SIGMA
                weight = np.where(r > 0, kernel.weight(r**2), 0.0)
                rows = rows / DEPTH_SIGMA
                both = 2 * weight[:, None, None] * rows[:, :, None] * rows[:, None, :]
                pull = (weight * r)[:, None] * rows
                for where, sign in ((part, 1.0), (other, -1.0)):
                    H[frames, where] += both
                    g[frames, where] += sign * pull
                energy[[i, j]] += 0.5 * float(kernel.cost(r**2).sum())
        return [
            joint_blocks(bodies[i], (R[:, span], T[:, span]), H[:, span], g[:, span], float(energy[i]))
            if i in moving
            else BandedBlocks.zeros(F, bodies[i].dof)
            for i, span in enumerate(self.spans)
        ]

    def _near(self, poses: Poses, performer: int, other: int) -> Iterator[tuple[int, int, Ints]]:
        """Generate the pairs of parts of two performers whose bounding spheres meet, with the frames on which they
        do.
        """
        R, T = poses
        centres = np.einsum("fpab,pb->fpa", R, self.centres) + T
        a, b = self.spans[performer], self.spans[other]
        apart = np.linalg.norm(centres[:, a, None] - centres[:, None, b], axis=-1)
        meeting = apart < self.radii[a, None] + self.radii[None, b]
        for p, q in np.argwhere(meeting.any(axis=0)):
            if (part := (int(p) + a.start, int(q) + b.start)) not in self.touching:
                yield *part, np.flatnonzero(meeting[:, p, q])

    def _deepest(self, poses: Poses, part: int, other: int, frames: Ints) -> tuple[Ints, Array, Array]:
        """Find the deepest point of a part inside another one.

        Returns
        -------
        frames : ndarray of int, shape (n,)
            Those of the given frames on which points of the part are in the other's bounding box.
        depth : ndarray, shape (n,)
            Depth of the deepest of them, metres; negative outside.
        rows : ndarray, shape (n, 6)
            Derivative of the depth by the twist of the part; that by the twist of the other one is the negative.
        """
        R, T = poses
        world = self.points[part] @ np.swapaxes(R[frames, part], -1, -2) + T[frames, part, None]
        there = (world - T[frames, other, None]) @ R[frames, other]
        f, k = np.nonzero((np.abs(there - self.centres[other]) < self.half[other]).all(axis=2))
        if not len(f):
            return frames[:0], np.zeros(0), np.zeros((0, 6))
        planes = self.planes[other]
        outside = there[f, k] @ planes[:, :3].T + planes[:, 3]
        height = outside.max(axis=1)
        begin = np.flatnonzero(np.diff(f, prepend=-1))
        order = np.lexsort((height, f))[begin]  # the lowest of every frame
        f, k, face = f[order], k[order], outside[order].argmax(axis=1)
        normal = (R[frames[f], other] @ planes[face, :3, None])[..., 0]
        return frames[f], -height[order], -np.concatenate([normal, np.cross(world[f, k], normal)], axis=1)


def surface_points(vertices: Array) -> Array:
    """Return the vertices of a convex polyhedron, (V, 3), with points along its edges between them, (K, 3)."""
    hull = ConvexHull(vertices)
    edges = np.unique(np.sort(np.concatenate([hull.simplices[:, [a, b]] for a, b in ((0, 1), (1, 2), (2, 0))])), axis=0)
    a, b = vertices[edges[:, 0]], vertices[edges[:, 1]]
    count = (np.linalg.norm(b - a, axis=1) / POINT_SPACING).astype(np.intp)
    edge = np.repeat(np.arange(len(edges)), count)
    share = ((1 + np.arange(len(edge)) - (np.cumsum(count) - count)[edge]) / (count + 1)[edge])[:, None]
    return np.concatenate([vertices[hull.vertices], (1 - share) * a[edge] + share * b[edge]])


def with_contact(
    systems: Sequence[BandedBlocks],
    contact: ContactFactor | None,
    bodies: Sequence[Body],
    motions: Sequence[Motion],
    sought: Sequence[int] | None = None,
) -> list[BandedBlocks]:
    """Add contact to the normal equations of every performer; see `ContactFactor.blocks`."""
    if contact is None:
        return list(systems)
    blocks = contact.blocks(bodies, scene_poses(bodies, motions), sought)
    return [system + own for system, own in zip(systems, blocks, strict=True)]
