"""Bodies of other proportions: every part may be stretched along its own axes, with everything attached to it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...numerics.arrays import Array
from ..body import Body


def shaped(body: Body, stretch: Array, shift: Array) -> Body:
    """Return the body with its parts stretched and their solids shifted; the root's joint and all orientations stay.

    The stretch of a part applies to its solid, its landmarks and the joints of its children. Along the bone it changes
    the length of a limb, across the bone the width of the part, and for the trunk also that between the shoulders or
    hips.

    Parameters
    ----------
    stretch : ndarray, shape (P, 3)
        Relative stretch along the axes of each part; 0 leaves it unchanged.
    shift : ndarray, shape (P, 3)
        Shift of each part's vertices along its axes, metres.
    """
    scale = 1 + np.asarray(stretch, float)
    heads: list[Array] = []
    parts = []
    for i, part in enumerate(body.parts):
        p, R = part.parent, part.R_world_rest
        head = part.head_world if p < 0 else heads[p] + body.parts[p].R_world_rest @ (scale[p] * body.offsets[i])
        heads.append(head)
        tail = head + R @ (scale[i] * (R.T @ (part.tail_world - part.head_world)))
        parts.append(replace(part, head_world=head, tail_world=tail, vertices=part.vertices * scale[i] + shift[i]))
    landmarks = {name: (i, point * scale[i]) for name, (i, point) in body.landmarks.items()}
    return Body(tuple(parts), landmarks)


def joint_jacobian(body: Body, R: Array) -> Array:
    """Derivatives of every joint's world position by the stretches of all parts, shape (F, P, 3, P, 3).

    Parameters
    ----------
    R : ndarray, shape (F, P, 3, 3)
        From `part_poses`.
    """
    F, P = R.shape[:2]
    J = np.zeros((F, P, 3, P, 3))
    for i, p in enumerate(body.parents):
        if p >= 0:
            J[:, i] = J[:, p]
            J[:, i, :, p] = R[:, p] * body.offsets[i]
    return J


def mirrored_parts(body: Body) -> list[tuple[int, int]]:
    """Pairs of parts that are each other's mirror image by their names, as Blender names sides."""
    index = {part.name: i for i, part in enumerate(body.parts)}
    pairs = ((i, index.get(f"{name[:-2]}.R")) for name, i in index.items() if name.endswith(".L"))
    return [(left, right) for left, right in pairs if right is not None]
