"""Which detections show each of the people who were located."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import scipy  # its parts are loaded when they are used

from ...numerics.arrays import Array
from ..keypoint_rays import Keypoints
from .detected_points import DetectedPoints
from .located_people import MAX_TRACK_DISTANCE
from .person import LocatedPerson
from .tracks import MAX_GAP, Track, ViewDetections


def detections_of(
    detections: Sequence[ViewDetections], empty: Keypoints, people: Sequence[LocatedPerson], fps: float
) -> list[list[Track]]:
    """Return the detections of every person: on each frame those nearest to where the other views put the person.

    A track may change from one person to another where they meet. Therefore, once people are located, every frame is
    decided by itself.

    Parameters
    ----------
    detections : sequence of ViewDetections
        One per view.
    empty : Keypoints
        Keypoints on F frames of which none is found; they carry the names and the cameras.
    people : sequence of LocatedPerson
        As located.
    fps : float
        Frames per second.

    Returns
    -------
    list of list of Track
        One list per person.
    """
    detected = DetectedPoints.of(detections, empty)
    places = [_filled_in(person.places, round(MAX_GAP * fps)) for person in people]
    owned: list[list[Track]] = [[] for _ in people]
    for v, found in enumerate(detections):
        rows_of = np.full((len(people), len(empty)), -1)
        for p, person in enumerate(people):
            for track in person.tracks:
                if track.view == v:
                    rows_of[p, track.frames] = track.rows
        for frame in np.unique(found.frames):
            rows = np.flatnonzero(found.frames == frame)
            known = [p for p in range(len(people)) if np.isfinite(places[p][frame]).any()]
            cost = np.array([[detected.apart(v, row, frame, places[p][frame]) for row in rows] for p in known])
            chosen = zip(*scipy.optimize.linear_sum_assignment(np.minimum(cost, 1e3)), strict=True) if known else ()
            given = {known[i]: int(rows[j]) for i, j in chosen if cost[i, j] < MAX_TRACK_DISTANCE}
            for p in known:
                rows_of[p, frame] = given.get(p, -1)
            for p in set(range(len(people))) - set(known):
                if rows_of[p, frame] in given.values():
                    rows_of[p, frame] = -1
        for p, row in enumerate(rows_of):
            frames = np.flatnonzero(row >= 0)
            owned[p].append(Track(v, frames, row[frames]))
    return owned


def _filled_in(places: Array, most: int) -> Array:
    """Positions (F, K, 3) in which gaps of at most `most` frames are interpolated linearly."""
    out = places.copy()
    for k in range(places.shape[1]):
        known = np.flatnonzero(np.isfinite(places[:, k, 0]))
        for a, b in pairwise(known):
            if 1 < b - a <= most:
                share = (np.arange(a + 1, b) - a)[:, None] / (b - a)
                out[a + 1 : b, k] = (1 - share) * places[a, k] + share * places[b, k]
    return out
