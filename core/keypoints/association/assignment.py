"""Assigning detections to performers: several people, in several views, over time.

First, the people who are seen by two views or more are located in space (`located_people`). A performer with key poses
is the person who stands where these put it. Performers without key poses are given people in the order in which these
appear; if there are more people than performers, those who take up most of the pictures are chosen. With a single view
nobody can be located in space; there, key poses are compared with the tracks of that view.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy  # its parts are loaded when they are used

from ...errors import KeypointError
from ...numerics.arrays import Array
from ..keypoint_rays import Keypoints
from ..left_and_right.left_right import swap_sides
from ..triangulation import triangulate
from .located_people import MAX_TRACK_DISTANCE, find_people
from .person import LocatedPerson, distance_to, prominence
from .person_detections import detections_of
from .tracks import Track, ViewDetections, detection_tracks, doubles, without_sides

Reason = Literal["number", "key poses", "order of appearance", "nobody else"]
MAX_PERSON_DISTANCE = 0.5
"""A person is the performer if the median distance of its points from the performer's key poses is below this, metres.
"""


@dataclass(frozen=True)
class Identity:
    """Which of the people that detectors found a performer is.

    Attributes
    ----------
    person : int or None
        The number of the person, from 1 in the order in which people appear; None where nobody was found in space.
    people : int
        How many were found.
    reason : str
        What decided it, in words that follow "by", such as "order of appearance".
    """

    person: int | None
    people: int
    reason: Reason

    def __str__(self) -> str:
        """Return the text of a label, such as "person 2 of 3, by ..."; empty if there was no choice."""
        if self.person is None or self.people < 2:
            return ""
        return f"person {self.person} of {self.people}, by {self.reason}"


NOT_LOOKED_FOR = Identity(None, 0, "nobody else")
"""That of a body without any of a detector's keypoints, such as a prop or an animal."""


@dataclass(frozen=True, eq=False)
class PerformerClues:
    """What is known of a performer before detections are assigned to it.

    Attributes
    ----------
    name : str
    places : ndarray, shape (F, L, 3), or None
        Positions of the L keypoints by the key poses, metres, world; NaN on frames without one.
    person : int, optional
        The number of the person whom the user chose for it.
    proposed : bool
        Whether the key poses are proposals, which were themselves made from keypoints.
    """

    name: str
    places: Array | None = None
    person: int | None = None
    proposed: bool = False

    @property
    def is_posed(self) -> bool:
        """Whether key poses show where the performer is."""
        return self.places is not None and bool(np.isfinite(self.places).any())


def assign_detections(
    detections: Sequence[ViewDetections], empty: Keypoints, clues: Sequence[PerformerClues], fps: float
) -> tuple[list[Keypoints], list[Identity]]:
    """Assign the detections of all views to performers.

    Parameters
    ----------
    detections, empty, fps
        See `core.keypoints.association.located_people.find_people`.
    clues : sequence of PerformerClues
        Per performer.

    Returns
    -------
    keypoints : list of Keypoints
        Per performer.
    identities : list of Identity
        Who each was found to be.

    Raises
    ------
    KeypointError
        A chosen number is higher than the number of people found, or two performers have the same number.
    """
    tracks = [track for v, found in enumerate(detections) for track in detection_tracks(empty.names, found, v, fps)]
    if len(clues) == 1 and all(len(np.unique(found.frames)) == len(found.frames) for found in detections):
        return [_filled(detections, empty, tracks)], [Identity(1, 1, "nobody else")]
    people = find_people(detections, empty, tracks, fps)
    persons, reasons = _matched(detections, empty.names, people, clues)
    every = detections_of(detections, empty, people, fps)
    owned: list[list[Track]] = []
    taken = {(t.view, int(row)) for own in every for t in own for row in t.rows}
    free = [t for t in tracks if not any((t.view, int(row)) in taken for row in t.rows)]
    for person, performer in zip(persons, clues, strict=True):
        own = every[person] if person is not None else _by_key_poses(detections, empty, free, performer.places)
        owned.append(own)
        free = [t for t in free if not any(t is mine for mine in own)]
    found = [_filled(detections, empty, own) for own in owned]
    numbers = [None if person is None else person + 1 for person in persons]
    return found, [Identity(number, len(people), reason) for number, reason in zip(numbers, reasons, strict=True)]


def _matched(
    detections: Sequence[ViewDetections],
    names: Sequence[str],
    people: Sequence[LocatedPerson],
    clues: Sequence[PerformerClues],
) -> tuple[list[int | None], list[Reason]]:
    """Return the index of the person that each performer is, if any, and the reason."""
    persons: list[int | None] = [None] * len(clues)
    reasons: list[Reason] = ["order of appearance"] * len(clues)
    for i, performer in enumerate(clues):
        if performer.person is not None:
            persons[i], reasons[i] = _chosen(performer.name, performer.person, len(people), persons), "number"
    posed = [i for i, performer in enumerate(clues) if persons[i] is None and performer.is_posed]
    left = [p for p in range(len(people)) if p not in persons]
    cost = np.full((len(posed), len(left)), np.inf)
    for row, i in enumerate(posed):
        places = clues[i].places
        assert places is not None
        reasons[i] = "order of appearance" if clues[i].proposed else "key poses"
        cost[row] = [distance_to(people[p], without_sides(names, places)[1]) for p in left]
    for row, column in zip(*scipy.optimize.linear_sum_assignment(np.minimum(cost, 1e3)), strict=True):
        if cost[row, column] < MAX_PERSON_DISTANCE:
            persons[posed[row]] = left[column]
    nobody = [i for i in range(len(clues)) if persons[i] is None and i not in posed]
    left = [p for p in range(len(people)) if p not in persons]
    largest = sorted(left, key=lambda p: -prominence(detections, people[p]))[: len(nobody)]
    for i, person in zip(nobody, sorted(largest), strict=False):
        persons[i] = person
    return persons, reasons


def _chosen(name: str, number: int, count: int, taken: Sequence[int | None]) -> int:
    """Return the index of the person with a number that the user chose.

    Raises
    ------
    KeypointError
    """
    where = f"performer '{name}' person"
    if not 1 <= number <= count:
        what = f"there is no person {number}: {count} were found" if count else "no two views agree on a person"
        raise KeypointError(what, where=where, todo="give one of the numbers found, or leave 'person' out")
    if number - 1 in taken:
        raise KeypointError(f"person {number} is another performer already", where=where, todo="give each its own")
    return number - 1


def _by_key_poses(
    detections: Sequence[ViewDetections], empty: Keypoints, free: Sequence[Track], known: Array | None
) -> list[Track]:
    """Return the tracks that lie on the key poses, and further ones that agree with these.

    Without key poses this is the longest track if all tracks are of one view, else none.
    """
    if known is None or not np.isfinite(known).any():
        one_view = len({track.view for track in free}) == 1
        return [max(free, key=lambda track: len(track.frames))] if one_view else []
    own = [t for t in free if _distance(detections, empty, t, known) < MAX_TRACK_DISTANCE]
    while True:
        places = _places(detections, empty, own, known)
        offers = [
            (distance, k)
            for k, track in enumerate(free)
            if not any(track is t for t in own)
            and not doubles(own, track)
            and (distance := _distance(detections, empty, track, places)) < MAX_TRACK_DISTANCE
        ]
        if not offers:
            return own
        own.append(free[min(offers)[1]])


def _distance(detections: Sequence[ViewDetections], empty: Keypoints, track: Track, places: Array) -> float:
    """Median distance of a track's keypoints from known positions, metres; left and right may be exchanged."""
    one = _filled(detections, empty, [track])
    sizes = [np.linalg.norm(k.residuals(places), axis=-1)[track.view] for k in (one, swap_sides(one))]
    by_frame = [
        [float(np.median(row[np.isfinite(row)])) for row in size[track.frames] if np.isfinite(row).any()]
        for size in sizes
    ]
    return float(np.median(np.min(by_frame, axis=0))) if by_frame[0] else np.inf


def _places(
    detections: Sequence[ViewDetections], empty: Keypoints, owned: Sequence[Track], known: Array | None
) -> Array:
    """Known positions of a performer (F, L, 3): triangulated from its tracks, else those of its key poses."""
    points, _ = triangulate(_filled(detections, empty, owned))
    if known is not None:
        points = np.where(np.isfinite(points), points, known)
    return points


def _filled(detections: Sequence[ViewDetections], empty: Keypoints, tracks: Sequence[Track]) -> Keypoints:
    """Return the keypoints of some tracks as one performer's."""
    rays, confidence = empty.rays.copy(), empty.confidence.copy()
    for track in tracks:
        rays[track.view, track.frames] = detections[track.view].rays[track.rows]
        confidence[track.view, track.frames] = detections[track.view].confidence[track.rows]
    return Keypoints(empty.names, rays, confidence, empty.R_cam_world, empty.t_cam_world)
