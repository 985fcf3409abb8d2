"""How images are sampled for evidence."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Sampling:
    """How the images are sampled.

    Attributes
    ----------
    sigma : float
        Smoothing of the images, pixels of the reduced frames.
    tolerance : float
        Factor on the limits of the robust weights: far from the solution large residuals still have to pull.
    stride : int
        Every how many pixels, each way, the evidence is taken: neighbours say nearly the same.
    reach : float
        How far from the model's outlines the body's are looked for, metres; 0 leaves outlines and foreground images
        out.
    """

    sigma: float
    tolerance: float
    stride: int
    reach: float = 0.0
