"""A rigid prop as a body of one part."""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from ..errors import BodyError
from ..numerics.arrays import Array
from .body import Body, Part
from .skeleton_motion import RestSkeleton


def body_of_prop(rest: RestSkeleton, vertices: Array) -> Body:
    """Return the body of a prop whose skeleton is one joint.

    Parameters
    ----------
    rest : RestSkeleton
        Metres.
    vertices : ndarray, shape (V, 3)
        The prop's shape with the joint at the origin, unturned, metres. Its convex hull is what is tracked.

    Raises
    ------
    BodyError
        There is more than one joint, or the shape is flat.
    """
    if len(rest.names) != 1:
        todo = "a prop is one rigid part"
        raise BodyError(f"it has {len(rest.names)} joints: {', '.join(rest.names[:4])}", todo=todo)
    try:
        hull = ConvexHull(vertices)
    except (QhullError, ValueError) as error:
        raise BodyError("the prop's mesh is flat: it encloses no volume", todo="give it a thickness") from error
    tail = np.array([0.0, float(np.ptp(vertices, axis=0).max()), 0.0])
    head = rest.heads[0]
    return Body((Part(rest.names[0], -1, head, head + tail, np.eye(3), vertices[hull.vertices]),), {})
