"""Reading the vertices of Wavefront OBJ files."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..errors import BodyError
from ..numerics.arrays import Array
from .reading import NUMBER_LIMIT, read_text, reading

MIN_VERTICES = 4
"""Number of vertices of the simplest solid, a tetrahedron."""


def read_obj_vertices(path: Path) -> Array:
    """Read the vertices of an OBJ file, in its own axes and unit, shape (V, 3).

    Raises
    ------
    BodyError
        The file cannot be read, is not an OBJ file or has too few vertices; names the file.
    """
    text = read_text(path, "the mesh", BodyError)
    with reading(path, "an OBJ file", BodyError):
        lines = [line.split() for line in text.splitlines() if line.startswith(("v ", "v\t"))]
        vertices = np.array([[float(value) for value in words[1:4]] for words in lines])
        if len(vertices) < MIN_VERTICES or vertices.shape[1] != 3:
            raise ValueError(f"it has {len(vertices)} vertices of three coordinates")
        if not (np.abs(vertices) < NUMBER_LIMIT).all():
            raise ValueError("a vertex is not finite, or too large to be true")
    return vertices
