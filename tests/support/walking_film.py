"""Film of a figure that walks past a wall, for tests of what does not continue in it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

FRAMES = 16


def film(speed: float = 4.0, moved: int = 0, steps: Sequence[float] | None = None, seed: int = 1) -> np.ndarray:
    """A textured figure that walks past a textured wall before a noisy camera, `moved` frames missing at the middle; or
    by `steps`, pixels. Another seed is another view.
    """
    places = [speed * (f + moved * (f >= FRAMES // 2)) for f in range(FRAMES)] if steps is None else np.cumsum(steps)
    chance = np.random.default_rng(seed)
    wall = np.kron(chance.uniform(60, 180, (23, 40)), np.ones((8, 8)))
    figure = np.kron(chance.uniform(20, 230, (12, 4)), np.ones((10, 10)))
    out = []
    for place in places:
        picture = wall.copy()
        left = round(40 + place)
        picture[30:150, left : left + 40] = figure
        out.append(picture + chance.normal(0, 2, picture.shape))
    return np.clip(out, 0, 255).astype(np.uint8)
