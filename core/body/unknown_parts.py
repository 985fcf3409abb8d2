"""Parts of a body that nothing shows, because the person is not wholly in the picture.

A part is known if there are landmarks on it or beyond it. A landmark at a joint lies on the part that ends there: an
ankle shows the shin, not the foot. Most detectors do not find hands and feet; therefore the last part of a limb is left
to the images if the joint where it begins is known.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .body import Body

INVISIBLE_HALF_SIZE = 2e-3
"""Half the size of the solid of a part that should be invisible, metres."""


def unknown_parts(body: Body, shown: Collection[str]) -> tuple[str, ...]:
    """Return the names of the parts that landmarks do not show, in the body's order; see the module.

    Parameters
    ----------
    body : Body
    shown : collection of str
        Landmarks whose positions are known on at least one frame. If none of them is the body's, no part is unknown.
    """
    joints = {body.landmarks[name][0] for name in shown if name in body.landmarks}
    hidden = unshown_parts(body, shown)
    left_to_pictures = {
        part
        for part, parent in enumerate(body.parents)
        if part in joints and part not in body.parents and parent >= 0 and body.names[parent] not in hidden
    }
    return tuple(name for name in hidden if body.index(name) not in left_to_pictures)


def unshown_parts(body: Body, shown: Collection[str]) -> tuple[str, ...]:
    """Return the names of all parts that landmarks do not show, including the last parts of limbs."""
    carrying = {_carrier(body, name) for name in shown if name in body.landmarks}
    if not carrying:
        return ()
    known = body.ancestry[sorted(carrying)].any(axis=0)
    known[_leading_parts(body, carrying, known)] = False
    return tuple(name for name, is_known in zip(body.names, known, strict=True) if not is_known)


def resting_parts(body: Body, unknown: Collection[str]) -> list[int]:
    """Return the parts that keep their rest orientation relative to their parents.

    These are the unknown parts except the root. If the root is unknown, the first known part is one of them too,
    because its own rotation cannot be distinguished from the root's.
    """
    hidden = [name in unknown for name in body.names]
    return [p for p, parent in enumerate(body.parents) if parent >= 0 and (hidden[p] or hidden[parent])]


def without_hidden_solids(body: Body, unknown: Collection[str]) -> Body:
    """Return the body with its unknown parts too small to be seen, so that the images do not affect them.

    Unknown parts between the root and the first known part keep their size, because they move with it.
    """
    hidden = np.array([name in unknown for name in body.names])
    parts = [
        replace(part, vertices=INVISIBLE_HALF_SIZE * part.vertices / np.abs(part.vertices).max())
        if hidden[body.ancestry[:, i]].all()
        else part
        for i, part in enumerate(body.parts)
    ]
    return replace(body, parts=tuple(parts)) if hidden.any() else body


def known_landmarks(body: Body, unknown: Collection[str]) -> list[str]:
    """Return the landmarks of a body whose positions do not depend on unknown parts, in their order."""
    return [name for name in body.landmarks if body.names[_carrier(body, name)] not in unknown]


def unknown_reach(body: Body, unknown: Collection[str]) -> dict[int, float]:
    """Return the distance of the tips of unknown parts from the nearest known joint, metres, by part.

    This is by how much their positions may be wrong. Unknown parts between the root and the known ones are left out.
    """
    hidden, reach = np.array([name in unknown for name in body.names]), dict[int, float]()
    for i, part in enumerate(body.parts):
        if hidden[body.ancestry[:, i]].all():
            own = float(np.linalg.norm(part.tail_world - part.head_world))
            reach[i] = own + reach.get(part.parent, 0.0)
    return reach


def _carrier(body: Body, name: str) -> int:
    """Return the part that determines the position of a landmark; at a joint, this is the part that ends there."""
    part, point = body.landmarks[name]
    return part if point.any() or body.parents[part] < 0 else body.parents[part]


def _leading_parts(body: Body, carrying: Collection[int], known: NDArray[np.bool_]) -> list[int]:
    """Return the unknown parts from the root on whose known descendants all hang on a single child."""
    part, found = 0, []
    while part not in carrying:
        branches = [child for child, parent in enumerate(body.parents) if parent == part and known[child]]
        if len(branches) != 1:
            break
        found.append(part)
        part = branches[0]
    return found
