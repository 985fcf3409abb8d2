"""Left and right of all views at once: exchanged in one view throughout, in all at once, and where nothing decides."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from keypoint_shots import NAMES, cameras, keypoints_of, seen_places, strolling
from kfmocap.core.body import human
from kfmocap.core.cameras.camera import Camera
from kfmocap.core.keypoints.keypoint_rays import Keypoints
from kfmocap.core.keypoints.left_and_right.image_side_paths import likeliest_image_sides
from kfmocap.core.keypoints.left_and_right.left_right import EXCHANGED_GROUPS, swap_sides
from kfmocap.core.keypoints.left_and_right.side_paths import likeliest_sides
from kfmocap.core.keypoints.view_agreement import ViewAgreement
from synthetic import look_at

FPS = 30.0
LIMBS = [i for i, n in enumerate(NAMES) if n[1:] in {*EXCHANGED_GROUPS[0], *EXCHANGED_GROUPS[1]}]
ALL = slice(None)


def seen_by(views: Sequence[Camera], frames: int = 40, seed: int = 0) -> Keypoints:
    return keypoints_of(views, seen_places(human(), strolling(human(), frames)), noise=0.015, seed=seed)


def exchanged(seen: Keypoints, views: slice | list[int], frames: slice | list[int]) -> Keypoints:
    rays = seen.rays.copy()
    rays[views, frames] = swap_sides(seen).rays[views, frames]
    return replace(seen, rays=rays)


def wrong_share(found: Keypoints, seen: Keypoints) -> float:
    return float((np.abs(found.rays - seen.rays)[:, :, LIMBS].max(axis=-1) > 0).mean())


def around(count: int) -> list[Camera]:
    angles = np.radians(20 + np.arange(count) * 360 / count)
    return [
        look_at(f"cam{i + 1:02d}", (5 * np.cos(a), 5 * np.sin(a), 1.0 + 0.3 * (i % 3)), (0, 0, 0.95), (640, 480), 560)
        for i, a in enumerate(angles)
    ]


@pytest.mark.parametrize("count", [3, 4, 6])
def test_a_view_that_exchanges_sides_throughout_is_found_by_the_others(count: int) -> None:
    views = cameras(count) if count <= 4 else around(count)
    seen = seen_by(views)
    found = ViewAgreement.of(exchanged(seen, [1], ALL), FPS)
    assert wrong_share(found.keypoints, seen) < 0.005  # limbs that pass each other may be taken for each other
    assert found.changed[1][:, LIMBS].all()


def test_sides_that_all_views_exchange_at_once_leap_there_and_back() -> None:
    """No view contradicts another, and neither face nor toes are found."""
    seen = seen_by(cameras(3))
    seen.confidence[..., [i for i, n in enumerate(NAMES) if n == "Nose" or n[1:] in ("Eye", "Ear", "BigToe")]] = 0.0
    found = ViewAgreement.of(exchanged(seen, ALL, slice(14, 22)), FPS)
    np.testing.assert_array_equal(found.keypoints.rays[:, :, LIMBS], seen.rays[:, :, LIMBS])


def test_face_and_feet_decide_where_sides_are_exchanged_on_most_frames() -> None:
    seen = seen_by(cameras(3))
    found = ViewAgreement.of(exchanged(seen, ALL, slice(0, 26)), FPS)
    np.testing.assert_array_equal(found.keypoints.rays[:, :, LIMBS], seen.rays[:, :, LIMBS])


def test_spells_of_every_view_at_its_own_times_are_put_right() -> None:
    seen = seen_by(cameras(3), frames=60)
    spoilt = exchanged(seen, [0], slice(5, 25))
    spoilt = exchanged(spoilt, [1], slice(15, 35))
    spoilt = exchanged(spoilt, [2], slice(28, 50))
    found = ViewAgreement.of(spoilt, FPS)
    assert wrong_share(found.keypoints, seen) < 0.02  # limbs may change over a frame early or late


def test_sides_that_are_right_stay_as_they_are() -> None:
    for seed in range(4):
        assert not likeliest_sides(seen_by(cameras(4), seed=seed), FPS)[..., LIMBS].any()


def test_one_of_two_views_is_put_right_by_its_own_leaps() -> None:
    seen = seen_by(cameras(2))
    assert not likeliest_sides(seen, FPS)[..., LIMBS].any()
    found = likeliest_sides(exchanged(seen, [1], slice(10, 20)), FPS)[..., LIMBS]
    assert found[1, 10:20].all() and not found[0].any() and not found[1, :10].any() and not found[1, 20:].any()


def test_face_and_feet_decide_where_one_of_two_views_exchanges_sides_on_most_frames() -> None:
    """Its leaps alone would have it the other way round."""
    seen = seen_by(cameras(2))
    spoilt = exchanged(seen, [0], slice(6, 40))
    alone = likeliest_image_sides(spoilt, FPS)[..., LIMBS]
    assert alone[0, :6].all() and not alone[0, 6:].any()
    found = likeliest_sides(spoilt, FPS)[..., LIMBS]
    assert found[0, 6:].all() and not found[0, :6].any() and not found[1].any()


def test_a_single_view_stays_as_it_is() -> None:
    assert not likeliest_sides(exchanged(seen_by(cameras(1)), [0], slice(10, 20)), FPS).any()


def test_frames_on_which_nothing_is_found_do_no_harm() -> None:
    seen = exchanged(seen_by(cameras(3)), [2], ALL)
    seen.rays[:, 10:16], seen.confidence[:, 10:16] = np.nan, 0.0
    found = ViewAgreement.of(seen, FPS)
    known = [f for f in range(40) if not 10 <= f < 16]
    assert found.changed[2][known][:, LIMBS].all()
    assert not found.changed[:2][:, known][..., LIMBS].any()
