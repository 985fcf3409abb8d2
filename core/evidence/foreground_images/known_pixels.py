"""Which pixels of a view surely show a performer or the background."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ...numerics.arrays import Bools
from .masks import interior, outside

CLOTHES_MARGIN = 0.05
"""Distance from the model's outline beyond which pixels surely show background, metres, as the model has no clothes."""


@dataclass(frozen=True, eq=False)
class KnownPixels:
    """Which pixels of some frames of a view surely show a performer or the background.

    Attributes
    ----------
    shown : tuple of mapping of int to ndarray of bool, shape (h, w)
        Per performer, by frame: pixels that show it.
    behind : mapping of int to ndarray of bool, shape (h, w)
        By frame: pixels that show the background.
    pixels_per_metre : float
        Scale at the performers.
    parts : mapping of int to ndarray of int, shape (h, w)
        By frame: index of the part, among those of all performers, that a pixel shows; -1 where it is not known.
    """

    shown: tuple[Mapping[int, Bools], ...]
    behind: Mapping[int, Bools]
    pixels_per_metre: float
    parts: Mapping[int, NDArray[np.int16]] = field(default_factory=dict)

    @classmethod
    def of_masks(
        cls,
        masks: Mapping[int, Bools],
        pixels_per_metre: float,
        sure: Mapping[int, Bools] | None = None,
    ) -> KnownPixels:
        """Derive it from masks of all performers together; see `foreground_images`."""
        return cls(
            ({f: interior(mask) for f, mask in (sure or masks).items()},),
            {f: outside(mask, CLOTHES_MARGIN * pixels_per_metre) for f, mask in masks.items()},
            pixels_per_metre,
        )
