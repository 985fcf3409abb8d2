"""Keypoints that are numbered otherwise than the pictures that they were found in are told from those that are not."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from kfmocap.core.keypoints.keypoint_delay import KeypointMovements, frames_off, frames_off_by_view, keypoint_movements

SIZE, FRAMES, JOINTS = (320, 240), 40, 8
RNG = np.random.default_rng(5)


def places() -> np.ndarray:
    """Joints that swing at different speeds, shape (F, L, 2)."""
    t = np.arange(-3, FRAMES + 3)[:, None]
    middle = np.stack(np.meshgrid([60, 130, 200, 270], [70, 170]), axis=-1).reshape(JOINTS, 2)
    angle = t / 5 + np.arange(JOINTS)
    size = np.linspace(10, 24, JOINTS)
    return middle + size[:, None] * np.stack([np.sin(angle), np.cos(1.3 * angle)], axis=-1)


def pictures() -> np.ndarray:
    """Patches with a pattern of their own at these joints, on a wall."""
    wall = cv2.GaussianBlur(RNG.uniform(0, 255, SIZE[::-1]), (0, 0), 1.5).astype(np.uint8)
    patches = [cv2.GaussianBlur(RNG.uniform(0, 255, (25, 25)), (0, 0), 1.2) for _ in range(JOINTS)]
    shown = []
    for own in places()[3:-3]:
        picture = wall.copy()
        for (x, y), patch in zip(own, patches, strict=True):
            moved = np.array([[1.0, 0.0, x - 12], [0.0, 1.0, y - 12]])
            cv2.warpAffine(patch.astype(np.uint8), moved, SIZE, picture, borderMode=cv2.BORDER_TRANSPARENT)
        shown.append(picture)
    return np.stack(shown)


SHOWN = pictures()


def compared(late: int) -> KeypointMovements:
    noisy = places()[3 - late : 3 - late + FRAMES] + RNG.normal(0, 0.5, (FRAMES, JOINTS, 2))
    noisy[RNG.uniform(size=noisy.shape[:2]) < 0.1] = np.nan
    return keypoint_movements(SHOWN, noisy)


@pytest.mark.parametrize("late", [-2, -1, 1, 2])
def test_how_many_frames_keypoints_are_late_is_measured(late: int) -> None:
    assert frames_off([compared(late)]) == pytest.approx(-late, abs=0.2)


def test_keypoints_of_the_same_frames_are_not_off() -> None:
    assert frames_off([compared(0)]) is None


def test_keypoints_that_stand_or_were_not_found_say_nothing() -> None:
    still = np.repeat(places()[:1], FRAMES, axis=0)
    assert frames_off([keypoint_movements(SHOWN, still)]) is None
    assert frames_off([keypoint_movements(SHOWN, np.full((FRAMES, JOINTS, 2), np.nan))]) is None
    assert frames_off([]) is None


def test_one_view_is_named_and_all_where_they_agree() -> None:
    right, wrong = compared(0), compared(1)
    assert frames_off_by_view([[right], [], [right], [wrong]])[:3] == (None, None, None)
    all_wrong = frames_off_by_view([[compared(1)], [], [wrong]])
    assert all_wrong[1] is None and all_wrong[0] == all_wrong[2] == pytest.approx(-1, abs=0.2)
