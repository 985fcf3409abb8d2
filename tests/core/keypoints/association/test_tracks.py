"""Detections are linked from frame to frame as long as it is clear who they are."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from kfmocap.core.keypoints.association.tracks import MAX_GAP, Track, ViewDetections, detection_tracks

FPS = 30.0
PATIENCE = round(MAX_GAP * FPS)
SIZE = 0.4
"""Distance of the two keypoints of a person."""


def linked(frames: Sequence[int], places: Sequence[float], numbers: Sequence[int] = ()) -> list[Track]:
    """Tracks of people that stand at places along x on frames, with the numbers that the detector gave them."""
    rays = np.array([[[x, 0.0], [x, SIZE]] for x in places])
    given = np.array(numbers if len(numbers) else [-1] * len(frames))
    found = ViewDetections(np.array(frames), rays, np.ones(rays.shape[:2]), given)
    return detection_tracks(("Nose", "Hip"), found, 0, FPS)


@pytest.mark.parametrize(("gap", "tracks"), [(PATIENCE, 1), (PATIENCE + 1, 2)])
def test_a_track_goes_on_after_a_short_time_without_detections(gap: int, tracks: int) -> None:
    assert len(linked([0, 1, 1 + gap], [0.0, 0.0, 0.0])) == tracks


def test_who_moves_too_far_is_another() -> None:
    assert len(linked([0, 1], [0.0, 0.4 * SIZE])) == 1
    assert len(linked([0, 1], [0.0, 0.6 * SIZE])) == 2


def test_numbers_of_the_detector_keep_people_apart_only_where_both_have_one() -> None:
    assert len(linked([0, 1], [0.0, 0.0], [1, 2])) == 2
    assert len(linked([0, 1], [0.0, 0.0], [1, 1])) == 1
    assert len(linked([0, 1], [0.0, 0.0], [1, -1])) == 1


def test_where_it_is_unclear_who_is_who_tracks_end() -> None:
    """Two stand beside each other, and one who is seen next is as near to either."""
    assert len(linked([0, 0, 1], [-0.1 * SIZE, 0.1 * SIZE, 0.0])) == 3
    assert len(linked([0, 0, 1], [-0.1 * SIZE, 0.9 * SIZE, -0.1 * SIZE])) == 2
