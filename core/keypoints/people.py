"""People: the detections of several views, over time, that show one person.

Detectors confuse left and right, so people are compared by points that have no side, such as the middle between both
hips. Views side by side see every two people at the same heights, so rays of two people often meet nearly as well as
those of one: what counts is how well a third view confirms the points, and whether they are as far apart as a body's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import scipy  # its parts are loaded when they are used

from ..numerics.arrays import Array, Bools, Ints
from .keypoint_factor import Keypoints
from .tracks import GAP, Track, ViewDetections, without_sides
from .triangulation import triangulate

NEAR = 0.25
"""A person's track lies within this of where the person is, metres (median)."""
MEETING = 0.15
"""Rays of one person's points pass each other within this, metres."""
TRUNK = (0.2, 0.9)
"""How far the middle of the shoulders is from that of the hips, metres."""
LONGEST_BONE = 0.8
"""No middle of two joints is farther from that of the next two, metres."""
LEAST = 0.2
"""A person is confirmed by two views for this long, seconds."""
SPEED = 2.0
"""How fast a person may have gone where it was not seen, m/s."""
_CHAIN = ("Shoulder", "Hip", "Knee", "Ankle")


@dataclass(frozen=True, eq=False)
class Person:
    """Somebody whom two views or more see.

    Attributes
    ----------
    tracks : tuple of Track
    places : ndarray, shape (F, K, 3)
        Of the points without sides, metres; NaN where no two views agree.
    """

    tracks: tuple[Track, ...]
    places: Array

    @property
    def frames(self) -> Ints:
        """Frames on which two views agree."""
        return np.flatnonzero(np.isfinite(self.places).all(axis=-1).any(axis=1))

    def doubled_by(self, track: Track) -> bool:
        """Whether it would be seen twice at a time in a view if a track were its own."""
        return any(t.view == track.view and np.intersect1d(t.frames, track.frames).size for t in self.tracks)


def find_people(
    detections: Sequence[ViewDetections], empty: Keypoints, tracks: Sequence[Track], fps: float
) -> list[Person]:
    """Group tracks by person, in the order in which people appear.

    Those who are there at the beginning, or come within `tracks.GAP` of each other, are counted from left to right as
    the first view sees them.

    Parameters
    ----------
    detections : sequence of ViewDetections
        Per view.
    empty : Keypoints
        On F frames, without a keypoint: the names and the cameras.
    tracks : sequence of Track
    fps : float

    Returns
    -------
    list of Person
        Those whom two views show for `LEAST` seconds.
    """
    scene = _Scene.of(detections, empty)
    rays, together = [scene.directions(track) for track in tracks], _overlapping(tracks)
    seeds = sorted(
        (
            (score, int(a), int(b))
            for a, b in np.argwhere(np.triu(together))
            if (score := _score(scene, tracks, rays, (a, b), np.flatnonzero(together[a] & together[b]))) > LEAST * fps
        ),
        reverse=True,
    )
    people: list[Person] = []
    free = set(range(len(tracks)))
    for _, a, b in seeds:
        if {a, b} <= free:
            person, own = _grown(scene, tracks, {a, b}, free)
            if len(person.frames) >= LEAST * fps:
                people.append(person)
                free -= own
    people = _joined(scene, people, fps)
    return sorted(people, key=lambda person: _appearance(scene, person, fps))


def prominence(detections: Sequence[ViewDetections], person: Person) -> float:
    """How much of the pictures a person takes up: its sizes, as seen at a distance of one, over the frames of the
    median view. Somebody who is close to one camera alone does not take up much.
    """
    sizes = np.zeros(len(detections))
    for track in person.tracks:
        rays = _seen(detections[track.view].rays[track.rows])
        sizes[track.view] += np.linalg.norm(np.nanmax(rays, axis=1) - np.nanmin(rays, axis=1), axis=1).sum()
    return float(np.median(sizes))


def distance_to(person: Person, places: Array) -> float:
    """Median distance of a person from known places of the points without sides (F, K, 3), metres."""
    each = np.linalg.norm(person.places - places, axis=-1)
    known = each[np.isfinite(each)]
    return float(np.median(known)) if len(known) else np.inf


def detections_of(
    detections: Sequence[ViewDetections], empty: Keypoints, people: Sequence[Person], fps: float
) -> list[list[Track]]:
    """The detections of every person, frame by frame: those nearest to where the others' views put it.

    Tracks may go over from one person to another where they meet; where a person is known each frame is judged alone.
    """
    scene = _Scene.of(detections, empty)
    places = [_filled_in(person.places, round(GAP * fps)) for person in people]
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
            cost = np.array([[scene.apart(v, row, frame, places[p][frame]) for row in rows] for p in known])
            chosen = zip(*scipy.optimize.linear_sum_assignment(np.minimum(cost, 1e3)), strict=True) if known else ()
            given = {known[i]: int(rows[j]) for i, j in chosen if cost[i, j] < NEAR}
            for p in known:
                rows_of[p, frame] = given.get(p, -1)
            for p in set(range(len(people))) - set(known):
                if rows_of[p, frame] in given.values():
                    rows_of[p, frame] = -1
        for p, row in enumerate(rows_of):
            frames = np.flatnonzero(row >= 0)
            owned[p].append(Track(v, frames, row[frames]))
    return owned


@dataclass(frozen=True, eq=False)
class _Scene:
    """Detections by their points without sides, and the cameras; `points[v]` is (N, K, 2)."""

    empty: Keypoints
    points: tuple[Array, ...]

    @classmethod
    def of(cls, detections: Sequence[ViewDetections], empty: Keypoints) -> _Scene:
        names, _ = without_sides(empty.names, np.zeros((0, len(empty.names), 2)))
        V, F = empty.confidence.shape[:2]
        rays, confidence = np.full((V, F, len(names), 2), np.nan), np.zeros((V, F, len(names)))
        middles = tuple(without_sides(empty.names, found.rays)[1] for found in detections)
        return cls(Keypoints(names, rays, confidence, empty.R_cam_world, empty.t_cam_world), middles)

    def keypoints(self, tracks: Sequence[Track]) -> Keypoints:
        """The points of some tracks together."""
        rays = self.empty.rays.copy()
        for track in tracks:
            rays[track.view, track.frames] = self.points[track.view][track.rows]
        return replace(self.empty, rays=rays, confidence=np.isfinite(rays).all(axis=-1).astype(float))

    def origins(self, view: int, frames: Ints) -> Array:
        """Places of a camera, shape (n, 3)."""
        R, t = self.empty.R_cam_world[view, frames], self.empty.t_cam_world[view, frames]
        return -np.einsum("fba,fb->fa", R, t)

    def directions(self, track: Track) -> Array:
        """Directions of a track's rays in the world, shape (n, K, 3)."""
        rays = self.points[track.view][track.rows]
        rays = np.concatenate([rays, np.ones((*rays.shape[:2], 1))], axis=-1)
        world = np.einsum("fba,fkb->fka", self.empty.R_cam_world[track.view, track.frames], rays)
        return np.asarray(world / np.linalg.norm(world, axis=-1, keepdims=True))

    def apart(self, view: int, row: int, frame: int, places: Array) -> float:
        """Median distance of a detection's rays from places (K, 3), metres."""
        R, t = self.empty.R_cam_world[view, frame], self.empty.t_cam_world[view, frame]
        x = places @ R.T + t
        away = np.linalg.norm(x[:, :2] - self.points[view][row] * x[:, 2:], axis=1)
        return float(_median(np.where(x[:, 2] > 0, away, np.nan)))


def _overlapping(tracks: Sequence[Track]) -> Bools:
    """Which tracks are of different views and have frames in common, or may have, shape (n, n)."""
    ends = np.array([(t.view, t.frames[0], t.frames[-1]) for t in tracks]).reshape(-1, 3)
    views, first, last = (column[:, None] for column in ends.T)
    return np.asarray((views != views.T) & (first <= last.T) & (last >= first.T))


def _score(scene: _Scene, tracks: Sequence[Track], rays: Sequence[Array], pair: tuple[int, int], others: Ints) -> float:
    """How many frames, and views besides, confirm that two tracks of different views show one person; `others` are
    those of other views at that time.
    """
    first, second = tracks[pair[0]], tracks[pair[1]]
    frames, rows_a, rows_b = np.intersect1d(first.frames, second.frames, assume_unique=True, return_indices=True)
    if not len(frames):
        return 0.0
    points, gap = _nearest(
        scene.origins(first.view, frames)[:, None],
        rays[pair[0]][rows_a],
        scene.origins(second.view, frames)[:, None],
        rays[pair[1]][rows_b],
    )
    agreed = np.maximum(1 - _median(gap) / MEETING, 0) * _bodily(scene.empty.names, points)
    if not agreed.any():
        return 0.0
    best: dict[int, Array] = {}
    for k in others:
        other = tracks[k]
        shared, here, there = np.intersect1d(frames, other.frames, assume_unique=True, return_indices=True)
        if len(shared):
            from_camera = points[here] - scene.origins(other.view, shared)[:, None]
            away = np.linalg.norm(np.cross(from_camera, rays[k][there]), axis=-1)
            confirmed = best.setdefault(other.view, np.zeros(len(frames)))
            confirmed[here] = np.maximum(confirmed[here], np.maximum(1 - _median(away) / MEETING, 0))
    return float((agreed * (1 + sum(best.values(), np.zeros(len(frames))))).sum())


def _nearest(origin_a: Array, ray_a: Array, origin_b: Array, ray_b: Array) -> tuple[Array, Array]:
    """Where two rays come nearest to each other before both cameras, and how near; NaN where they do not."""
    between = origin_b - origin_a
    cosine = (ray_a * ray_b).sum(axis=-1)
    along_a, along_b = (ray_a * between).sum(axis=-1), (ray_b * between).sum(axis=-1)
    sine = 1 - cosine**2
    with np.errstate(invalid="ignore", divide="ignore"):
        s, t = (along_a - cosine * along_b) / sine, (cosine * along_a - along_b) / sine
    met = (s > 0) & (t > 0) & (sine > 1e-3)
    a, b = origin_a + s[..., None] * ray_a, origin_b + t[..., None] * ray_b
    return np.where(met[..., None], (a + b) / 2, np.nan), np.where(met, np.linalg.norm(a - b, axis=-1), np.nan)


def _bodily(names: Sequence[str], points: Array) -> Bools:
    """Where points (n, K, 3) are as far apart as those of a body."""
    fine = np.ones(len(points), bool)
    for upper, lower in pairwise(_CHAIN):
        if upper in names and lower in names:
            length = np.linalg.norm(points[:, names.index(upper)] - points[:, names.index(lower)], axis=-1)
            low, high = TRUNK if upper == "Shoulder" else (0.0, LONGEST_BONE)
            fine &= ~((length < low) | (length > high))
    return fine


def _grown(scene: _Scene, tracks: Sequence[Track], own: set[int], free: set[int]) -> tuple[Person, set[int]]:
    """A person with all free tracks that lie where it is, and which these are; it begins with some of them."""
    own = set(own)
    while True:
        person = Person(
            tuple(tracks[k] for k in sorted(own)), triangulate(scene.keypoints([tracks[k] for k in own]))[0]
        )
        offers = sorted(
            (distance, k) for k in free - own if (distance := _track_distance(scene, tracks[k], person.places)) < NEAR
        )
        added = False
        for _, k in offers:
            if not person.doubled_by(tracks[k]):
                own.add(k)
                person = replace(person, tracks=(*person.tracks, tracks[k]))
                added = True
        if not added:
            return person, own


def _track_distance(scene: _Scene, track: Track, places: Array) -> float:
    """Median distance of a track from places (F, K, 3), metres; infinite where none are known."""
    away = np.linalg.norm(scene.keypoints([track]).residuals(places)[track.view, track.frames], axis=-1)
    by_frame = _median(away)
    return float(np.median(by_frame[np.isfinite(by_frame)])) if np.isfinite(by_frame).any() else np.inf


def _joined(scene: _Scene, people: Sequence[Person], fps: float) -> list[Person]:
    """People of whom one goes on where another ended, as one."""
    left = list(people)
    while True:
        pairs = [
            (a, b)
            for a in left
            for b in left
            if a is not b and _goes_on(a, b, fps) and not any(b.doubled_by(track) for track in a.tracks)
        ]
        if not pairs:
            return left
        a, b = min(pairs, key=lambda pair: int(pair[1].frames[0] - pair[0].frames[-1]))
        tracks = (*a.tracks, *b.tracks)
        left = [p for p in left if p is not a and p is not b]
        left.append(Person(tracks, triangulate(scene.keypoints(tracks))[0]))


def _goes_on(before: Person, after: Person, fps: float) -> bool:
    """Whether a person may be who another was."""
    last, first = before.frames[-1], after.frames[0]
    seconds = (first - last) / fps
    away = np.linalg.norm(_middle(after.places[first]) - _middle(before.places[last]))
    return bool(0 < seconds <= 2 * GAP and away < NEAR + SPEED * seconds)


def _appearance(scene: _Scene, person: Person, fps: float) -> tuple[int, int, float]:
    """What people are ordered by: when they appear, and where in the first view that sees them."""
    begin = int(person.frames[0])
    view = min(track.view for track in person.tracks)
    track = min((t for t in person.tracks if t.view == view), key=lambda t: int(t.frames[0]))
    return round(begin / max(GAP * fps, 1)), view, float(np.nanmedian(scene.points[view][track.rows[0], :, 0]))


def _filled_in(places: Array, most: int) -> Array:
    """Places (F, K, 3) with gaps of at most so many frames bridged, straight and at a constant speed."""
    out = places.copy()
    for k in range(places.shape[1]):
        known = np.flatnonzero(np.isfinite(places[:, k, 0]))
        for a, b in pairwise(known):
            if 1 < b - a <= most:
                share = (np.arange(a + 1, b) - a)[:, None] / (b - a)
                out[a + 1 : b, k] = (1 - share) * places[a, k] + share * places[b, k]
    return out


def _middle(points: Array) -> Array:
    return np.asarray(np.nanmean(points, axis=0))


def _seen(rays: Array) -> Array:
    """Which of some detections (n, L, 2) have a keypoint at all."""
    return rays[np.isfinite(rays).any(axis=(1, 2))]


def _median(values: Array) -> Array:
    """Median along the last axis of what is known; infinite of nothing."""
    ordered = np.sort(values, axis=-1)  # what is no number comes last
    count = np.isfinite(ordered).sum(axis=-1)
    middle = np.take_along_axis(ordered, np.maximum(count - 1, 0)[..., None] // 2, axis=-1)[..., 0]
    return np.where(count > 0, middle, np.inf)
