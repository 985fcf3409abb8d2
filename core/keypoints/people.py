"""People: detections of several views, over time, are grouped by the person that they show.

Detectors confuse left and right, so people are compared by points that have no side, such as the middle of both hips.
In views from similar heights, everybody is seen at the same height, so that rays to two different people often meet
almost as well as rays to one. Therefore a third view must confirm the points, and the distances between them must be
those of a body.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import scipy  # its parts are loaded when they are used

from ..numerics.arrays import Array, Bools, Ints
from .keypoint_rays import Keypoints
from .tracks import GAP, Track, ViewDetections, without_sides
from .triangulation import triangulate

NEAR = 0.25
"""A track belongs to a person if its median distance from the person's points is below this, metres."""
MEETING = 0.15
"""Largest distance between two rays to the same point of one person, metres."""
TRUNK = (0.2, 0.9)
"""Least and greatest distance between the middle of the shoulders and the middle of the hips, metres."""
LONGEST_BONE = 0.8
"""Greatest distance between the middle of two joints and the middle of the next two along the body, metres."""
LEAST = 0.2
"""A person counts if two views agree on it for at least this long, seconds."""
SPEED = 2.0
"""Greatest speed of a person while it is not seen, m/s."""
_CHAIN = ("Shoulder", "Hip", "Knee", "Ankle")


@dataclass(frozen=True, eq=False)
class Person:
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
        """Frames on which two views agree."""
        return np.flatnonzero(np.isfinite(self.places).all(axis=-1).any(axis=1))

    def doubled_by(self, track: Track) -> bool:
        """Whether the person would be seen twice in one view on the same frame if the track were added to its own."""
        return any(t.view == track.view and np.intersect1d(t.frames, track.frames).size for t in self.tracks)


def find_people(
    detections: Sequence[ViewDetections], empty: Keypoints, tracks: Sequence[Track], fps: float
) -> list[Person]:
    """Group tracks by person, in the order in which people appear.

    People who are there at the beginning, or who appear within `tracks.GAP` of each other, are ordered from left to
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
    list of Person
        Everybody on whom two views agree for `LEAST` seconds.
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
    """Return how much of the pictures a person takes up: the sum of its sizes over the frames, in the median view.

    Sizes are in normalized image coordinates. By the median, somebody who is close to one camera only does not count
    for much.
    """
    sizes = np.zeros(len(detections))
    for track in person.tracks:
        rays = _seen(detections[track.view].rays[track.rows])
        sizes[track.view] += np.linalg.norm(np.nanmax(rays, axis=1) - np.nanmin(rays, axis=1), axis=1).sum()
    return float(np.median(sizes))


def distance_to(person: Person, places: Array) -> float:
    """Median distance of a person from known positions (F, K, 3) of the points without sides, metres."""
    each = np.linalg.norm(person.places - places, axis=-1)
    known = each[np.isfinite(each)]
    return float(np.median(known)) if len(known) else np.inf


def detections_of(
    detections: Sequence[ViewDetections], empty: Keypoints, people: Sequence[Person], fps: float
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
    people : sequence of Person
        As located.
    fps : float
        Frames per second.

    Returns
    -------
    list of list of Track
        One list per person.
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
    """The points without sides of all detections, and the cameras. `points[v]` has the shape (N, K, 2)."""

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
        """Return the points of some tracks as one person's keypoints."""
        rays = self.empty.rays.copy()
        for track in tracks:
            rays[track.view, track.frames] = self.points[track.view][track.rows]
        return replace(self.empty, rays=rays, confidence=np.isfinite(rays).all(axis=-1).astype(float))

    def origins(self, view: int, frames: Ints) -> Array:
        """Positions of a camera on n frames, metres, world, shape (n, 3)."""
        R, t = self.empty.R_cam_world[view, frames], self.empty.t_cam_world[view, frames]
        return -np.einsum("fba,fb->fa", R, t)

    def directions(self, track: Track) -> Array:
        """Directions of a track's rays in the world, shape (n, K, 3)."""
        rays = self.points[track.view][track.rows]
        rays = np.concatenate([rays, np.ones((*rays.shape[:2], 1))], axis=-1)
        world = np.einsum("fba,fkb->fka", self.empty.R_cam_world[track.view, track.frames], rays)
        return np.asarray(world / np.linalg.norm(world, axis=-1, keepdims=True))

    def apart(self, view: int, row: int, frame: int, places: Array) -> float:
        """Median distance of a detection's rays from points (K, 3), metres."""
        R, t = self.empty.R_cam_world[view, frame], self.empty.t_cam_world[view, frame]
        x = places @ R.T + t
        away = np.linalg.norm(x[:, :2] - self.points[view][row] * x[:, 2:], axis=1)
        return float(_median(np.where(x[:, 2] > 0, away, np.nan)))


def _overlapping(tracks: Sequence[Track]) -> Bools:
    """Return which tracks are of different views and have frames in common, or may have, shape (n, n)."""
    ends = np.array([(t.view, t.frames[0], t.frames[-1]) for t in tracks]).reshape(-1, 3)
    views, first, last = (column[:, None] for column in ends.T)
    return np.asarray((views != views.T) & (first <= last.T) & (last >= first.T))


def _score(scene: _Scene, tracks: Sequence[Track], rays: Sequence[Array], pair: tuple[int, int], others: Ints) -> float:
    """Return how strongly it is confirmed that two tracks of different views show one person: the number of frames on
    which they agree, and of further views that agree there. `others` are the tracks of other views at that time.
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
    """Return the point where two rays are nearest to each other, and their distance there; NaN if it is behind a
    camera.
    """
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
    """Whether the distances between points are those of a body, for each of n sets (n, K, 3)."""
    fine = np.ones(len(points), bool)
    for upper, lower in pairwise(_CHAIN):
        if upper in names and lower in names:
            length = np.linalg.norm(points[:, names.index(upper)] - points[:, names.index(lower)], axis=-1)
            low, high = TRUNK if upper == "Shoulder" else (0.0, LONGEST_BONE)
            fine &= ~((length < low) | (length > high))
    return fine


def _grown(scene: _Scene, tracks: Sequence[Track], own: set[int], free: set[int]) -> tuple[Person, set[int]]:
    """Return a person with its `own` tracks and every free one that agrees with it, and the set of all these."""
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
    """Median distance of a track from points (F, K, 3), metres; infinite if none of them is known."""
    away = np.linalg.norm(scene.keypoints([track]).residuals(places)[track.view, track.frames], axis=-1)
    by_frame = _median(away)
    return float(np.median(by_frame[np.isfinite(by_frame)])) if np.isfinite(by_frame).any() else np.inf


def _joined(scene: _Scene, people: Sequence[Person], fps: float) -> list[Person]:
    """Return the people, with two joined into one where the second appears where the first has disappeared."""
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
    """Whether a person may be the continuation of another."""
    last, first = before.frames[-1], after.frames[0]
    seconds = (first - last) / fps
    away = np.linalg.norm(_middle(after.places[first]) - _middle(before.places[last]))
    return bool(0 < seconds <= 2 * GAP and away < NEAR + SPEED * seconds)


def _appearance(scene: _Scene, person: Person, fps: float) -> tuple[int, int, float]:
    """Return the key that people are sorted by: when they appear, and where in the first view that sees them."""
    begin = int(person.frames[0])
    view = min(track.view for track in person.tracks)
    track = min((t for t in person.tracks if t.view == view), key=lambda t: int(t.frames[0]))
    return round(begin / max(GAP * fps, 1)), view, float(np.nanmedian(scene.points[view][track.rows[0], :, 0]))


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


def _middle(points: Array) -> Array:
    return np.asarray(np.nanmean(points, axis=0))


def _seen(rays: Array) -> Array:
    """Return which of n detections (n, L, 2) have any keypoint."""
    return rays[np.isfinite(rays).any(axis=(1, 2))]


def _median(values: Array) -> Array:
    """Median of the known values along the last axis; infinite if there are none."""
    ordered = np.sort(values, axis=-1)  # NaN comes last
    count = np.isfinite(ordered).sum(axis=-1)
    middle = np.take_along_axis(ordered, np.maximum(count - 1, 0)[..., None] // 2, axis=-1)[..., 0]
    return np.where(count > 0, middle, np.inf)
