"""People: detections of several views, over time, are grouped by the person that they show.

Detectors confuse left and right, so people are compared by points that have no side, such as the middle of both hips.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...numerics.arrays import Array
from ..keypoint_rays import Keypoints
from ..triangulation import triangulate
from .detected_points import DetectedPoints, median_known
from .person import LocatedPerson
from .track_pairs import agreement, overlapping_tracks
from .tracks import MAX_GAP, Track, ViewDetections

MAX_TRACK_DISTANCE = 0.25
"""A track belongs to a person if its median distance from the person's points is below this, metres."""
MIN_DURATION = 0.2
"""A person counts if two views agree on it for at least this long, seconds."""
MAX_SPEED = 2.0
"""Greatest speed of a person while it is not seen, m/s."""


def find_people(
    detections: Sequence[ViewDetections], empty: Keypoints, tracks: Sequence[Track], fps: float
) -> list[LocatedPerson]:
    """Group tracks by person, in the order in which people appear.

    People who are there at the beginning, or who appear within `tracks.MAX_GAP` of each other, are ordered from left to
    right as seen by the first view.

    Parameters
    ----------
    detections : sequence of ViewDetections
        Per view.
    empty : Keypoints
        Keypoints on F frames of which none is found; they carry the names and the cameras.
    tracks : sequence of Track
    fps : float

    Returns
    -------
    list of LocatedPerson
        Everybody on whom two views agree for `MIN_DURATION` seconds.
    """
    detected = DetectedPoints.of(detections, empty)
    rays, together = [detected.directions(track) for track in tracks], overlapping_tracks(tracks)
    seeds = sorted(
        (
            (score, int(a), int(b))
            for a, b in np.argwhere(np.triu(together))
            if (score := agreement(detected, tracks, rays, (a, b), np.flatnonzero(together[a] & together[b])))
            > MIN_DURATION * fps
        ),
        reverse=True,
    )
    people: list[LocatedPerson] = []
    free = set(range(len(tracks)))
    for _, a, b in seeds:
        if {a, b} <= free:
            person, own = _grown(detected, tracks, {a, b}, free)
            if len(person.frames) >= MIN_DURATION * fps:
                people.append(person)
                free -= own
    people = _joined(detected, people, fps)
    return sorted(people, key=lambda person: _appearance(detected, person, fps))


def _grown(
    detected: DetectedPoints, tracks: Sequence[Track], own: set[int], free: set[int]
) -> tuple[LocatedPerson, set[int]]:
    """Return a person with its `own` tracks and every free one that agrees with it, and the set of all these."""
    own = set(own)
    while True:
        person = LocatedPerson(
            tuple(tracks[k] for k in sorted(own)), triangulate(detected.keypoints([tracks[k] for k in own]))[0]
        )
        offers = sorted(
            (distance, k)
            for k in free - own
            if (distance := _track_distance(detected, tracks[k], person.places)) < MAX_TRACK_DISTANCE
        )
        added = False
        for _, k in offers:
            if not person.doubled_by(tracks[k]):
                own.add(k)
                person = replace(person, tracks=(*person.tracks, tracks[k]))
                added = True
        if not added:
            return person, own


def _track_distance(detected: DetectedPoints, track: Track, places: Array) -> float:
    """Median distance of a track from points (F, K, 3), metres; infinite if none of them is known."""
    away = np.linalg.norm(detected.keypoints([track]).residuals(places)[track.view, track.frames], axis=-1)
    by_frame = median_known(away)
    return float(np.median(by_frame[np.isfinite(by_frame)])) if np.isfinite(by_frame).any() else np.inf


def _joined(detected: DetectedPoints, people: Sequence[LocatedPerson], fps: float) -> list[LocatedPerson]:
    """Return the people, with two joined into one where the second appears where the first has disappeared."""
    left = list(people)
    while True:
        pairs = [
            (a, b)
            for a in left
            for b in left
            if a is not b and _may_continue(a, b, fps) and not any(b.doubled_by(track) for track in a.tracks)
        ]
        if not pairs:
            return left
        a, b = min(pairs, key=lambda pair: int(pair[1].frames[0] - pair[0].frames[-1]))
        tracks = (*a.tracks, *b.tracks)
        left = [p for p in left if p is not a and p is not b]
        left.append(LocatedPerson(tracks, triangulate(detected.keypoints(tracks))[0]))


def _may_continue(before: LocatedPerson, after: LocatedPerson, fps: float) -> bool:
    """Whether a person may be the continuation of another."""
    last, first = before.frames[-1], after.frames[0]
    seconds = (first - last) / fps
    away = np.linalg.norm(_middle(after.places[first]) - _middle(before.places[last]))
    return bool(0 < seconds <= 2 * MAX_GAP and away < MAX_TRACK_DISTANCE + MAX_SPEED * seconds)


def _appearance(detected: DetectedPoints, person: LocatedPerson, fps: float) -> tuple[int, int, float]:
    """Return the key that people are sorted by: when they appear, and where in the first view that sees them."""
    begin = int(person.frames[0])
    view = min(track.view for track in person.tracks)
    track = min((t for t in person.tracks if t.view == view), key=lambda t: int(t.frames[0]))
    return round(begin / max(MAX_GAP * fps, 1)), view, float(np.nanmedian(detected.points[view][track.rows[0], :, 0]))


def _middle(points: Array) -> Array:
    return np.asarray(np.nanmean(points, axis=0))
