"""A limb as the search for it needs it: its parts, points inside them, and where it hangs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from ....body import Body, part_poses
from ....body.limbs import without_end
from ....body.motion import Motion
from ....evidence.limb_sides import PartSides
from ....evidence.rendering.part_geometry import Geometry
from ....numerics import rotations
from ....numerics.arrays import Array
from ..equations.problem import SegmentProblem
from .limb_images import PartPoses, axis_areas, shown_areas, shown_widths
from .raised_shoulder import RaisedShoulder

LimbOfPerformer = tuple[int, list[int]]
"""Index of a performer, and a limb of it as a chain of its parts."""
MIN_HELD_WEIGHT = 0.02
"""Weight with which a limb that is not seen is kept where it is: among poses that the images cannot distinguish, the
present one is preferred."""
POINTS_PER_PART = 16
"""Points of each part whose pixels are looked at."""
FINE_POINTS = 48
"""Points of each part where both limbs of a pair are searched for, and to tell how clearly limbs of several performers
are shown: which of their pixels are looked at must not decide whether they are searched for."""
_MIN_RANGE = 0.05


@dataclass(frozen=True, eq=False)
class LimbModel:
    """A limb of n parts on F frames, as the search needs it.

    Attributes
    ----------
    body : Body
    chain : list of int
        The limb's parts, from the trunk outward.
    range : ndarray, shape (n, 3)
        Range of each joint's rotation vector in half circles.
    points : ndarray, shape (n, points, 3)
        Points inside each part, in its frame, metres.
    areas : ndarray, shape (n, 3)
        Projected area of each part along the axes of its frame, square metres.
    radii : ndarray, shape (n,)
        Half the mean projected width of each part, metres; 0 where pixels that it covers count for other parts, too.
    parent : tuple of ndarray, shapes (F, 3, 3) and (F, 3)
        World poses of the part that the limb hangs on.
    begin : ndarray, shape (F, n, 3)
        Present rotation vectors of the limb.
    fixed : ndarray of bool, shape (F, n, 3)
        Degrees of freedom that stay as they are.
    held : ndarray, shape (F, n)
        How clearly each part is seen where it is, 0 to 1.
    sides : tuple of PartSides
        Sides of the limb's parts but the last, see `without_end`.
    shoulder : RaisedShoulder, optional
        The collar bone that rises with an arm.
    """

    body: Body
    chain: list[int]
    range: Array
    points: Array
    areas: Array
    radii: Array
    parent: tuple[Array, Array]
    begin: Array
    fixed: NDArray[np.bool_]
    held: Array
    sides: tuple[PartSides, ...]
    shoulder: RaisedShoulder | None = None


def limb_of(
    problem: SegmentProblem,
    motions: Sequence[Motion],
    place: LimbOfPerformer,
    rng: Generator,
    points: int = POINTS_PER_PART,
    *,
    evenly: bool = False,
) -> tuple[LimbModel, list[int]]:
    """Return a limb as motions have it, with the least `held`, and the indices of its parts among all performers'.

    If it is shown evenly, its parts count by their mean areas in every pose, and each for itself.
    """
    i, chain = place
    body, span = problem.bodies[i], problem.spans()[i]
    parts = [span.start + part for part in chain]
    R, T = part_poses(body, motions[i])
    geometry = problem.geometry()
    if evenly:
        areas, radii = np.repeat(shown_areas(geometry, parts)[:, None], 3, axis=1), np.zeros(len(parts))
    else:
        areas, radii = np.array([axis_areas(geometry, part) for part in parts]), shown_widths(geometry, parts) / 2
    limb = LimbModel(
        body,
        chain,
        np.clip(np.ptp(body.limits[chain], axis=2) / np.pi, _MIN_RANGE, 1.0),
        _samples(geometry, parts, rng, points),
        areas,
        radii,
        (R[:, body.parents[chain[0]]], T[:, body.parents[chain[0]]]),
        rotations.log(motions[i].rotations[:, chain]),
        problem.fixed_axes(i)[:, chain],
        np.full((problem.length, len(chain)), MIN_HELD_WEIGHT),
        tuple(PartSides.of(body.parts[part]) for part in without_end(chain)),
        RaisedShoulder.of(problem, i, chain, R),
    )
    return limb, parts


def posed(limb: LimbModel, frames: slice, drawn: Array) -> Iterator[PartPoses]:
    """Generate the world poses of the limb's parts on m frames from rotation vectors (m or 1, K, n, 3)."""
    R, T = limb.parent[0][frames, None], limb.parent[1][frames, None]
    Q = rotations.exp(drawn)
    for k, part in enumerate(limb.chain):
        hung, offset = R, limb.body.offsets[part]
        R = hung @ (limb.body.R_parent_rest[part] @ Q[:, :, k])
        if k == 0 and limb.shoulder is not None:
            offset = np.einsum("fkab,b->fka", limb.shoulder.turns(frames, R[..., 1]), offset)
            T = T + np.einsum("fkab,fkb->fka", np.broadcast_to(hung, R.shape), offset)
        else:
            T = T + hung @ offset
        yield R, T


def _samples(geometry: Geometry, parts: Sequence[int], rng: Generator, count: int) -> Array:
    """Random points inside the parts, (n, points, 3)."""
    vertices = [geometry.vertices[geometry.spans[part]] for part in parts]
    return np.array([rng.dirichlet(np.full(len(v), 0.3), count) @ v for v in vertices])
