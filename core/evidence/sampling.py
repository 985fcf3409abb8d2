"""The settings by which images are sampled for evidence."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Sampling:
    """How the images are sampled.

    Attributes
    ----------
    sigma : float
        Standard deviation of the Gaussian that smooths the images, pixels of the reduced frames.
    tolerance : float
        Factor on the limits of robust kernels: far from the solution, large residuals must keep their influence.
    stride : int
        Distance between the pixels that are used, in rows and in columns; neighbouring pixels are correlated.
    reach : float
        Distance from the model's outlines within which those of the performer are searched for, metres; 0 leaves
        outlines and foreground images out.
    by_part : bool
        Whether each part has a noise of its own and may get brighter or darker: near the solution, where residuals are
        not those of its place.
    """

    sigma: float
    tolerance: float
    stride: int
    reach: float = 0.0
    by_part: bool = False
