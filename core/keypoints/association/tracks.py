"""Tracks: detections of one view that are linked from frame to frame where they hardly move."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy  # its parts are loaded when they are used

from ...formats.keypoint_layouts import is_sided, mirrored_name
from ...numerics.arrays import Array, Ints

MAX_STEP = 0.5
"""Greatest movement of a person from one frame to the next, as a share of its size."""
MAX_GAP = 0.5
"""Longest time without detections after which a track is continued, seconds."""
AMBIGUOUS_DIFFERENCE = 0.1
"""Tracks end where it is unclear who is who: where two possible continuations differ by less than this, in units of
`MAX_STEP`, and by less than half of the worse one."""


@dataclass(frozen=True, eq=False)
class Track:
    """One person in one view over some frames.

    Attributes
    ----------
    view : int
    frames : ndarray of int, shape (n,)
    rows : ndarray of int, shape (n,)
        The rows of its detections in the view's `ViewDetections`.
    """

    view: int
    frames: Ints
    rows: Ints


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
        The numbers that the detector itself gave to people, -1 if it gave none.
    """

    frames: Ints
    rays: Array
    confidence: Array
    tracks: Ints


def doubles(owned: Sequence[Track], track: Track) -> bool:
    """Whether a person would be seen twice in one view on the same frame if a track were added to its own."""
    return any(own.view == track.view and np.intersect1d(own.frames, track.frames).size for own in owned)


def without_sides(names: Sequence[str], points: Array) -> tuple[tuple[str, ...], Array]:
    """Return the names and positions of points without a side: middles of left and right ones, and those that have no
    side anyway.

    Parameters
    ----------
    names : sequence of str, length L
    points : ndarray, shape (..., L, n)
        In space, or in an image, where the middle of two points is close to the image of their middle in space.
    """
    found: dict[str, Array] = {}
    for i, name in enumerate(names):
        if not is_sided(name):
            found[name] = points[..., i, :]
        elif name.startswith("L") and mirrored_name(name) in names:
            found[name[1:]] = (points[..., i, :] + points[..., names.index(mirrored_name(name)), :]) / 2
    return tuple(found), np.stack(list(found.values()), axis=-2) if found else points[..., :0, :]


def detection_tracks(names: Sequence[str], found: ViewDetections, view: int, fps: float) -> list[Track]:
    """Link the detections of a view from frame to frame with the least total movement (Hungarian method).

    Where two people are so close to each other that it is unclear who is who, their tracks end.

    Parameters
    ----------
    names : sequence of str
        Of the keypoints.
    found : ViewDetections
    view : int
        Index of the view, as the tracks are to state it.
    fps : float
        Frames per second.
    """
    _, points = without_sides(names, found.rays)
    open_tracks: list[list[int]] = []
    done: list[list[int]] = []
    patience = max(1, round(MAX_GAP * fps))
    for frame in np.unique(found.frames):
        rows = np.flatnonzero(found.frames == frame)
        done += [t for t in open_tracks if frame - found.frames[t[-1]] > patience]
        open_tracks = [t for t in open_tracks if frame - found.frames[t[-1]] <= patience]
        taken, ended = set(), []
        if open_tracks:
            cost = np.array([[_movement(found, points, track[-1], row) for row in rows] for track in open_tracks])
            for i, j in zip(*scipy.optimize.linear_sum_assignment(cost), strict=True):
                if cost[i, j] < 1:
                    if _is_ambiguous(cost, i, j):
                        ended.append(i)
                    else:
                        open_tracks[i].append(int(rows[j]))
                        taken.add(j)
        done += [open_tracks[i] for i in ended]
        open_tracks = [t for i, t in enumerate(open_tracks) if i not in ended]
        open_tracks += [[int(row)] for j, row in enumerate(rows) if j not in taken]
    return [Track(view, found.frames[t], np.array(t)) for t in done + open_tracks]


def _is_ambiguous(cost: Array, track: int, row: int) -> bool:
    """Whether the track might as well continue with another detection, or the detection belong to another track."""
    others = np.concatenate([np.delete(cost[track], row), np.delete(cost[:, row], track)])
    least = others.min(initial=np.inf)
    return bool(least - cost[track, row] < AMBIGUOUS_DIFFERENCE and cost[track, row] > 0.5 * least)


def _movement(found: ViewDetections, points: Array, before: int, after: int) -> float:
    """Median movement of the points that two detections share, in units of `MAX_STEP` times the person's size; at most
    2.
    """
    same = found.tracks[before] == found.tracks[after]
    if not same and min(found.tracks[before], found.tracks[after]) >= 0:
        return 2.0
    a, b = points[before], points[after]
    both = np.isfinite(a).all(axis=-1) & np.isfinite(b).all(axis=-1)
    if not both.any():
        return 2.0
    steps = max(1, int(found.frames[after] - found.frames[before]))
    every = found.rays[before]
    size = float(np.linalg.norm(np.ptp(every[np.isfinite(every).all(axis=-1)], axis=0)))
    moved = np.median(np.linalg.norm(a[both] - b[both], axis=-1))
    return float(min(moved / (MAX_STEP * max(size, 1e-9) * np.sqrt(steps)), 2.0))
