"""Somebody whom several views see: where, by which detections, and how large."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...numerics.arrays import Array, Ints
from .tracks import Track, ViewDetections, doubles


@dataclass(frozen=True, eq=False)
class LocatedPerson:
    """Somebody who is seen by at least two views.

    Attributes
    ----------
    tracks : tuple of Track
    places : ndarray, shape (F, K, 3)
        World positions of the points without sides, metres; NaN where no two views agree.
    """

    tracks: tuple[Track, ...]
    places: Array

    @property
    def frames(self) -> Ints:
        """Frames on which two views agree, increasing, shape (n,)."""
        return np.flatnonzero(np.isfinite(self.places).all(axis=-1).any(axis=1))

    def doubled_by(self, track: Track) -> bool:
        """Whether the person would be seen twice in one view on the same frame if the track were added to its own."""
        return doubles(self.tracks, track)


def prominence(detections: Sequence[ViewDetections], person: LocatedPerson) -> float:
    """Return how much of the pictures a person takes up: the sum of its sizes over the frames, in the median view.

    Sizes are in normalized image coordinates. By the median, somebody who is close to one camera only does not count
    for much.
    """
    sizes = np.zeros(len(detections))
    for track in person.tracks:
        rays = _seen(detections[track.view].rays[track.rows])
        sizes[track.view] += np.linalg.norm(np.nanmax(rays, axis=1) - np.nanmin(rays, axis=1), axis=1).sum()
    return float(np.median(sizes))


def distance_to(person: LocatedPerson, places: Array) -> float:
    """Median distance of a person from known positions (F, K, 3) of the points without sides, metres."""
    each = np.linalg.norm(person.places - places, axis=-1)
    known = each[np.isfinite(each)]
    return float(np.median(known)) if len(known) else np.inf


def _seen(rays: Array) -> Array:
    """Return those of the detections (n, L, 2) that have any keypoint."""
    return rays[np.isfinite(rays).any(axis=(1, 2))]
