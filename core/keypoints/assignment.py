"""Assigning detections to performers: several people, in several views, over time.

Detections of a view are strung together to tracks where they hardly move from one frame to the next. A track belongs
to the performer whose known places it meets: his key poses, projected, and what was triangulated from tracks that are
his already. Where there are no key poses, performers begin with the two tracks of different views that agree best.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from ..numerics.arrays import Array
from .keypoint_factor import Keypoints
from .left_right import swap_sides
from .triangulation import triangulate

LEAP = 0.5
"""From one frame to the next a person moves less than this share of its size."""
GAP = 0.5
"""A track goes on after this long without detections, at most, seconds."""
NEAR = 0.25
"""A performer's track lies within this of where he is known to be, metres (median)."""


@dataclass(frozen=True, eq=False)
class Track:
    """One person in one view over some frames.

    Attributes
    ----------
    view : int
    frames : ndarray of int, shape (n,)
    rows : ndarray of int, shape (n,)
        Which of the view's detections.
    """

    view: int
    frames: NDArray[np.int64]
    rows: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class ViewDetections:
    """Detections of one view on the shot's frames.

    Attributes
    ----------
    frames : ndarray of int, shape (N,)
        Shot frames, not decreasing.
    rays : ndarray, shape (N, L, 2)
        See `Keypoints`.
    confidence : ndarray, shape (N, L)
    tracks : ndarray of int, shape (N,)
        The detector's own numbers of people, -1 where there are none.
    """

    frames: NDArray[np.int64]
    rays: Array
    confidence: Array
    tracks: NDArray[np.int64]


def detection_tracks(found: ViewDetections, view: int, fps: float) -> list[Track]:
    """String the detections of a view together, frame by frame: the least movement in all (Hungarian method)."""
    open_tracks: list[list[int]] = []
    done: list[list[int]] = []
    patience = max(1, round(GAP * fps))
    for frame in np.unique(found.frames):
        rows = np.flatnonzero(found.frames == frame)
        done += [t for t in open_tracks if frame - found.frames[t[-1]] > patience]
        open_tracks = [t for t in open_tracks if frame - found.frames[t[-1]] <= patience]
        taken = set()
        if open_tracks:
            cost = np.array([[_movement(found, track[-1], row) for row in rows] for track in open_tracks])
            for i, j in zip(*linear_sum_assignment(cost), strict=True):
                if cost[i, j] < 1:
                    open_tracks[i].append(int(rows[j]))
                    taken.add(j)
        open_tracks += [[int(row)] for j, row in enumerate(rows) if j not in taken]
    return [Track(view, found.frames[t], np.array(t)) for t in done + open_tracks]


def _movement(found: ViewDetections, before: int, after: int) -> float:
    """Median movement of the keypoints that both have, in `LEAP`s of the person's size, at most 2."""
    same = found.tracks[before] == found.tracks[after]
    if not same and min(found.tracks[before], found.tracks[after]) >= 0:
        return 2.0
    a, b = found.rays[before], found.rays[after]
    both = np.isfinite(a).all(axis=-1) & np.isfinite(b).all(axis=-1)
    if not both.any():
        return 2.0
    steps = max(1, int(found.frames[after] - found.frames[before]))
    size = float(np.linalg.norm(np.ptp(a[np.isfinite(a).all(axis=-1)], axis=0)))
    moved = np.median(np.linalg.norm(a[both] - b[both], axis=-1))
    return float(min(moved / (LEAP * max(size, 1e-9) * np.sqrt(steps)), 2.0))


def assign_detections(
    founds: Sequence[ViewDetections], empty: Keypoints, known: Sequence[Array | None], count: int, fps: float
) -> list[Keypoints]:
    """Give detections to performers.

    Parameters
    ----------
    founds : sequence of ViewDetections
        Per view.
    empty : Keypoints
        On F frames, without a keypoint: the names and the cameras.
    known : sequence of ndarray, shape (F, L, 3), or None
        Per performer: where key poses put the keypoints; NaN on other frames.
    count : int
        How many performers there are.
    fps : float

    Returns
    -------
    list of Keypoints
        Per performer.
    """
    tracks = [track for v, found in enumerate(founds) for track in detection_tracks(found, v, fps)]
    if count == 1 and all(len(np.unique(found.frames)) == len(found.frames) for found in founds):
        return [_filled(founds, empty, tracks)]  # nobody else is there
    owned: list[list[Track]] = [[] for _ in range(count)]
    free = list(tracks)
    for person in range(count):
        where = known[person]
        if where is not None and np.isfinite(where).any():
            owned[person] = [t for t in free if _distance(founds, empty, t, where) < NEAR]
            free = [t for t in free if not any(t is own for own in owned[person])]
    for person in range(count):
        if not owned[person]:
            owned[person] = _agreeing(founds, empty, free)
            free = [t for t in free if not any(t is own for own in owned[person])]
    while True:
        places = [_places(founds, empty, own, where) for own, where in zip(owned, known, strict=True)]
        offers = [
            (distance, i, person)
            for i, track in enumerate(free)
            for person in range(count)
            if not _doubled(owned[person], track)
            and (distance := _distance(founds, empty, track, places[person])) < NEAR
        ]
        if not offers:
            return [_filled(founds, empty, own) for own in owned]
        _, i, person = min(offers)
        owned[person].append(free.pop(i))


def _doubled(owned: Sequence[Track], track: Track) -> bool:
    """Whether somebody is seen twice at a time in a view if that track is his."""
    return any(own.view == track.view and np.intersect1d(own.frames, track.frames).size for own in owned)


def _distance(founds: Sequence[ViewDetections], empty: Keypoints, track: Track, places: Array) -> float:
    """Median distance of a track's keypoints from known places, whichever side is which, metres."""
    one = _filled(founds, empty, [track])
    sizes = [np.linalg.norm(k.residuals(places), axis=-1)[track.view] for k in (one, swap_sides(one))]
    by_frame = [
        [float(np.median(row[np.isfinite(row)])) for row in size[track.frames] if np.isfinite(row).any()]
        for size in sizes
    ]
    return float(np.median(np.min(by_frame, axis=0))) if by_frame[0] else np.inf


def _agreeing(founds: Sequence[ViewDetections], empty: Keypoints, free: Sequence[Track]) -> list[Track]:
    """The two tracks of different views that agree on the most points; of one view, its longest track."""
    best: tuple[float, list[Track]] = (0.0, [])
    for a, b in combinations(free, 2):
        if a.view != b.view and np.intersect1d(a.frames, b.frames).size:
            _, inliers = triangulate(_filled(founds, empty, [a, b]))
            agreed = float(inliers.sum())
            if agreed > best[0]:
                best = agreed, [a, b]
    if not best[1] and free:
        return [max(free, key=lambda track: len(track.frames))]
    return best[1]


def _places(founds: Sequence[ViewDetections], empty: Keypoints, owned: Sequence[Track], known: Array | None) -> Array:
    """Where a performer is known to be: by triangulation, else by key poses and, near in time, by either."""
    points, _ = triangulate(_filled(founds, empty, owned))
    if known is not None:
        points = np.where(np.isfinite(points), points, known)
    return points


def _filled(founds: Sequence[ViewDetections], empty: Keypoints, tracks: Sequence[Track]) -> Keypoints:
    """The keypoints of some tracks."""
    rays, confidence = empty.rays.copy(), empty.confidence.copy()
    for track in tracks:
        rays[track.view, track.frames] = founds[track.view].rays[track.rows]
        confidence[track.view, track.frames] = founds[track.view].confidence[track.rows]
    return Keypoints(empty.names, rays, confidence, empty.R_cam_world, empty.t_cam_world)
