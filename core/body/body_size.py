"""How large a body is, compared with people."""

from __future__ import annotations

import numpy as np

from .body import Body

HEIGHT_RATIO = 3.84
"""Height of a person who stands upright, in radii of gyration."""


def body_size(body: Body) -> float:
    """Return the height of a person who is as large as a body, metres.

    It is measured by the radius of gyration of the parts' volumes at rest. Whether the body stands or lies does not
    matter, and thin wings, tails and manes count little.
    """
    corners = np.concatenate(
        [part.head_world + part.vertices[part.faces] @ part.R_world_rest.T for part in body.parts]
    )  # of tetrahedra whose fourth corner is the origin, (N, 3, 3)
    volume = np.linalg.det(corners) / 6
    total, sums = volume.sum(), corners.sum(axis=1)
    centre = volume @ sums / (4 * total)
    squares = volume @ ((corners**2).sum(axis=(1, 2)) + (sums**2).sum(axis=1)) / (20 * total)
    return HEIGHT_RATIO * float(np.sqrt(max(squares - centre @ centre, 0.0)))
