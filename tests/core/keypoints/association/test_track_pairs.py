"""Whether tracks of two views show one person: their rays meet at points of a body's size, and further views agree."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from keypoint_shots import NAMES, cameras, keypoints_of, seen_places, strolling
from kfmocap.core.body import human
from kfmocap.core.keypoints.association.detected_points import DetectedPoints, median_known
from kfmocap.core.keypoints.association.track_pairs import agreement, overlapping_tracks
from kfmocap.core.keypoints.association.tracks import Track, ViewDetections
from kfmocap.core.keypoints.keypoint_rays import Keypoints

FRAMES = 10
HERE, THERE = (0.0, 0.0, 0.0), (0.6, 0.9, 0.0)


def agreed(places: Sequence[Sequence[float]], others: Sequence[int], size: float = 1.0) -> float:
    """How strongly it is confirmed that the first two views show one person, by some of the other views.

    Every view finds one person, who stands at its place; all are larger than people by a factor.
    """
    body, frames = human(), np.arange(FRAMES)
    motion = strolling(body, FRAMES)
    views = cameras(len(places))
    each = [
        keypoints_of(views, size * seen_places(body, motion) + np.asarray(place)).rays[v]
        for v, place in enumerate(places)
    ]
    whole = keypoints_of(views, seen_places(body, motion))
    empty = Keypoints(
        NAMES, np.full_like(whole.rays, np.nan), np.zeros_like(whole.confidence), whole.R_cam_world, whole.t_cam_world
    )
    nobody = np.full(FRAMES, -1)
    detected = DetectedPoints.of(
        [ViewDetections(frames, rays, np.ones((FRAMES, len(NAMES))), nobody) for rays in each], empty
    )
    tracks = [Track(v, frames, frames) for v in range(len(places))]
    rays = [detected.directions(track) for track in tracks]
    return agreement(detected, tracks, rays, (0, 1), np.array(others, int))


def test_rays_to_one_person_agree_on_every_frame() -> None:
    assert agreed([HERE, HERE], []) == pytest.approx(FRAMES, rel=1e-3)


def test_every_further_view_of_the_person_confirms_it_once_more() -> None:
    assert agreed([HERE, HERE, HERE], [2]) == pytest.approx(2 * FRAMES, rel=0.02)
    assert agreed([HERE, HERE, HERE, HERE], [2, 3]) == pytest.approx(3 * FRAMES, rel=0.02)


def test_a_view_of_somebody_else_confirms_nothing() -> None:
    assert agreed([HERE, HERE, THERE], [2]) == pytest.approx(FRAMES, rel=1e-3)


@pytest.mark.parametrize("size", [0.3, 2.0])
def test_what_is_not_of_a_bodys_size_is_nobody(size: float) -> None:
    assert agreed([HERE, HERE], [], size) == 0


def test_tracks_overlap_that_are_of_two_views_and_last_at_one_time() -> None:
    tracks = [
        Track(view, np.arange(first, last), np.arange(last - first))
        for view, first, last in ((0, 0, 5), (0, 3, 9), (1, 4, 9), (1, 9, 12))
    ]
    assert np.argwhere(overlapping_tracks(tracks)).tolist() == [[0, 2], [1, 2], [2, 0], [2, 1]]


def test_the_median_of_nothing_known_is_infinite() -> None:
    values = np.array([[3.0, np.nan, 1.0], [np.nan, 4.0, np.nan], [np.nan, np.nan, np.nan]])
    assert median_known(values).tolist() == [1.0, 4.0, np.inf]
