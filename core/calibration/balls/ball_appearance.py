"""How a ball looks in one view: as it is expected to, and as it was found to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ...numerics.arrays import Array


@dataclass(frozen=True, eq=False)
class BallAppearance:
    """How a ball and its rods look in one view: the balls of an L-frame have this in common.

    Attributes
    ----------
    light : ndarray, shape (3,)
        The ball's colour, logarithms of linear light.
    shade : ndarray, shape (2,)
        How much brighter than in its middle it is at the outline, to the right and below, as a share.
    width : float
        Half the rods' width, as a share of the ball's radius.
    rod_light : ndarray, shape (3,)
        The rods' colour, logarithms of linear light; NaN where no rod is seen, and so is their width.
    """

    light: Array
    shade: Array
    width: float
    rod_light: Array

    @classmethod
    def common(cls, several: Sequence[BallAppearance]) -> BallAppearance:
        """What some balls have in common: the median of each number."""
        with_rods = [own for own in several if np.isfinite(own.width)] or several[:1]
        return cls(
            np.median([own.light for own in several], axis=0),
            np.median([own.shade for own in several], axis=0),
            float(np.median([own.width for own in with_rods])),
            np.median([own.rod_light for own in with_rods], axis=0),
        )


@dataclass(frozen=True, eq=False)
class BallGuess:
    """Where a ball is expected, and how it should look.

    Attributes
    ----------
    centre : ndarray, shape (2,)
        Pixels.
    radius : float
        Pixels.
    radius_sigma : float
        Its standard deviation, as a share.
    path : ndarray, shape (2,)
        How far it moves during the exposure, pixels; zero if the ball is known to rest.
    path_sigma : float
        Standard deviation of the path, as a share of its length; 0.2 pixels come in addition.
    rods : ndarray, shape (m, 2)
        Unit vectors along the rods that lead away from it, at most two.
    starts : ndarray, shape (m,)
        How far from the ball's centre each is seen to begin, as a share of the radius: a rod that comes towards the
        camera hides a part of the ball; one that leads away, from 1 on, is hidden by it.
    light : ndarray, shape (3,), optional
        Its colour in linear light, if it is known.
    appearance : BallAppearance, optional
        How it and its rods look, if that is known from other balls of the same view.
    """

    centre: Array
    radius: float
    radius_sigma: float = 0.03
    path: Array = field(default_factory=lambda: np.zeros(2))
    path_sigma: float = 0.3
    rods: Array = field(default_factory=lambda: np.zeros((0, 2)))
    starts: Array = field(default_factory=lambda: np.zeros(0))
    light: Array | None = None
    appearance: BallAppearance | None = None

    @property
    def reach(self) -> float:
        """Return the radius around the centre that the ball covers during the exposure, pixels."""
        return self.radius + float(np.linalg.norm(self.path)) / 2


@dataclass(frozen=True, eq=False)
class BallImage:
    """The image of a ball, as fitted.

    Attributes
    ----------
    centre : ndarray, shape (2,)
        Of its outline in the middle of the exposure, pixels.
    radius : float
        Pixels.
    path : ndarray, shape (2,)
        How far it moved during the exposure, pixels.
    appearance : BallAppearance
    sigma : float
        Standard deviation of each coordinate of the centre, pixels.
    elongation : ndarray, shape (2,)
        See `Markers.elongation`.
    explained : float
        Share of the squared difference from the background that the ball explains.
    """

    centre: Array
    radius: float
    path: Array
    appearance: BallAppearance
    sigma: float
    elongation: Array
    explained: float

    @property
    def light(self) -> Array:
        """Return the ball's colour in linear light, shape (3,)."""
        return np.exp(self.appearance.light)
