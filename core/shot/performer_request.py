"""Requests for performers: they are in the footage, and nothing else is known of them yet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..body.human import human
from ..body.motion import Motion
from .shot import KeyPoses, Performer


@dataclass(frozen=True)
class PerformerRequest:
    """A performer whose key poses are still to be found from keypoints.

    Attributes
    ----------
    name : str
    height : float or None
        Metres; None to estimate it from the keypoints.
    frames : tuple of int or None
        Shot frames for the key poses; None to choose them automatically.
    person : int, optional
        See `Performer`.
    """

    name: str
    height: float | None = None
    frames: tuple[int, ...] | None = None
    person: int | None = None

    def placeholder(self) -> Performer:
        """Return the performer with a default body and no key poses."""
        body = human() if self.height is None else human(self.height)
        nowhere = Motion(np.zeros((0, 3)), np.zeros((0, len(body), 3, 3)))
        return Performer(self.name, body, KeyPoses.proposed([], nowhere), self.person)
