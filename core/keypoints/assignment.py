"""Assigning detections to performers: several people, in several views, over time.

People whom two views or more see are found first (`people`). Who of them a performer is, its key poses say; without
any, people are taken in the order in which they appear, those who take up the most of the pictures. What key poses say
of a single view, where nobody is found in space, is compared with the tracks of that view.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy  # its parts are loaded when they are used

from ..errors import KeypointError
from ..numerics.arrays import Array
from .keypoint_factor import Keypoints
from .left_right import swap_sides
from .people import NEAR, Person, detections_of, distance_to, find_people, prominence
from .tracks import Track, ViewDetections, detection_tracks, without_sides
from .triangulation import triangulate

Reason = Literal["number", "key poses", "order of appearance", "nobody else"]
SAME = 0.5
"""A person whose points lie within this of where key poses put a performer is that performer, metres (median)."""


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
        What it was decided by.
    """

    person: int | None
    people: int
    reason: Reason

    def __str__(self) -> str:
        """Return it as a label says it; nothing where there is no choice."""
        if self.person is None or self.people < 2:
            return ""
        return f"person {self.person} of {self.people}, by {self.reason}"


@dataclass(frozen=True, eq=False)
class PerformerClues:
    """What is known of a performer before its keypoints are.

    Attributes
    ----------
    name : str
    places : ndarray, shape (F, L, 3), or None
        Where key poses put the keypoints; NaN on other frames.
    person : int, optional
        The number of the person that it was said to be.
    proposed : bool
        The key poses were made of keypoints themselves.
    """

    name: str
    places: Array | None = None
    person: int | None = None
    proposed: bool = False

    @property
    def is_posed(self) -> bool:
        """Whether key poses say where it is."""
        return self.places is not None and bool(np.isfinite(self.places).any())


def assign_detections(
    detections: Sequence[ViewDetections], empty: Keypoints, clues: Sequence[PerformerClues], fps: float
) -> tuple[list[Keypoints], list[Identity]]:
    """Give detections to performers.

    Parameters
    ----------
    detections, empty, fps
        See `core.keypoints.people.find_people`.
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
        There is no person of a number that was chosen, or two performers were said to be one.
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
    people: Sequence[Person],
    clues: Sequence[PerformerClues],
) -> tuple[list[int | None], list[Reason]]:
    """Which of the people every performer is, and why."""
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
        if cost[row, column] < SAME:
            persons[posed[row]] = left[column]
    nobody = [i for i in range(len(clues)) if persons[i] is None and i not in posed]
    left = [p for p in range(len(people)) if p not in persons]
    largest = sorted(left, key=lambda p: -prominence(detections, people[p]))[: len(nobody)]
    for i, person in zip(nobody, sorted(largest), strict=False):
        persons[i] = person
    return persons, reasons


def _chosen(name: str, number: int, count: int, taken: Sequence[int | None]) -> int:
    """The index of a person by its number.

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
    """The tracks that key poses lie on, and those that lie where these are; without key poses the longest of one
    view.
    """
    if known is None or not np.isfinite(known).any():
        one_view = len({track.view for track in free}) == 1
        return [max(free, key=lambda track: len(track.frames))] if one_view else []
    own = [t for t in free if _distance(detections, empty, t, known) < NEAR]
    while True:
        places = _places(detections, empty, own, known)
        offers = [
            (distance, k)
            for k, track in enumerate(free)
            if not any(track is t for t in own)
            and not _doubled(own, track)
            and (distance := _distance(detections, empty, track, places)) < NEAR
        ]
        if not offers:
            return own
        own.append(free[min(offers)[1]])


def _doubled(owned: Sequence[Track], track: Track) -> bool:
    """Whether this person would be seen twice at a time in a view with that track."""
    return any(own.view == track.view and np.intersect1d(own.frames, track.frames).size for own in owned)


def _distance(detections: Sequence[ViewDetections], empty: Keypoints, track: Track, places: Array) -> float:
    """Median distance of a track's keypoints from known places, whichever side is which, metres."""
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
    """Where a performer is known to be: by triangulation, else by key poses and, near in time, by either."""
    points, _ = triangulate(_filled(detections, empty, owned))
    if known is not None:
        points = np.where(np.isfinite(points), points, known)
    return points


def _filled(detections: Sequence[ViewDetections], empty: Keypoints, tracks: Sequence[Track]) -> Keypoints:
    """The keypoints of some tracks."""
    rays, confidence = empty.rays.copy(), empty.confidence.copy()
    for track in tracks:
        rays[track.view, track.frames] = detections[track.view].rays[track.rows]
        confidence[track.view, track.frames] = detections[track.view].confidence[track.rows]
    return Keypoints(empty.names, rays, confidence, empty.R_cam_world, empty.t_cam_world)
