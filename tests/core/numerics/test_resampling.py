"""Curves at another rate: at the right times, rotations by slerp."""

from __future__ import annotations

import numpy as np
import pytest
from kfmocap.core.numerics.resampling import places_between, sample_times, slerped
from scipy.spatial.transform import Rotation


@pytest.mark.parametrize(
    ("rate", "wanted", "expected"),
    [
        (30, 30, [10, 11, 12, 13, 14]),
        (30, 60, [10, 10.5, 11, 11.5, 12, 12.5, 13, 13.5, 14]),
        (60, 30, [10, 12, 14]),
        (30, 24, [10, 11.25, 12.5, 13.75]),
        (30, 1, [10]),
        (29.97, 29.97, [10, 11, 12, 13, 14]),
    ],
)
def test_times_begin_with_the_first_frame_and_end_by_the_last(rate, wanted, expected):
    np.testing.assert_allclose(sample_times(10, 14, rate, wanted), expected)


@pytest.mark.parametrize(("last", "rate", "wanted"), [(43, 23.976, 23.976), (125, 25, 24), (1001, 24, 30000 / 1001)])
def test_rounding_neither_loses_the_last_frame_nor_goes_beyond_it(last: int, rate: float, wanted: float) -> None:
    times = sample_times(0, last, rate, wanted)
    assert len(times) == round(last * wanted / rate) + 1
    assert times[-1] == last, "not by a rounding error more: nothing is known beyond the last frame"


def quaternions(angles: list[float]) -> np.ndarray:
    return Rotation.from_rotvec(np.outer(angles, [0, 0.6, 0.8])).as_quat()[:, [3, 0, 1, 2]]


def test_between_frames_the_angle_goes_at_a_constant_rate() -> None:
    found = slerped(quaternions([0.0, 1.0, 3.0]), np.arange(3), np.array([0, 0.25, 1.0, 1.5, 2.0]))
    angles = 2 * np.arctan2(found[:, 1:] @ [0, 0.6, 0.8], found[:, 0])
    np.testing.assert_allclose(angles, [0, 0.25, 1.0, 2.0, 3.0], atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1)


def test_signs_do_not_jump_and_begin_as_given() -> None:
    given = -quaternions([0.1, 0.4, 0.9, 1.5])
    given[2] *= -1
    found = slerped(given, np.arange(4), np.linspace(0, 3, 13))
    assert (np.sum(found[1:] * found[:-1], axis=1) > 0.9).all()
    np.testing.assert_allclose(found[0], given[0], atol=1e-12)


def test_one_frame_alone_is_held() -> None:
    np.testing.assert_allclose(
        slerped(2 * quaternions([0.3]), np.array([4]), np.array([4, 4])), quaternions([0.3, 0.3])
    )


def test_on_its_own_frames_a_curve_is_as_between_them() -> None:
    given = -quaternions([0.1, 0.4, 0.9, 1.5])
    given[2] *= -1
    frames = np.arange(4.0)
    found = slerped(given, frames, np.array([0, 1, 2, 2.5, 3]))
    np.testing.assert_allclose(slerped(2 * given, frames, frames), found[[0, 1, 2, 4]], atol=1e-12)


def test_places_are_found_between_knots_and_beyond_them() -> None:
    left, share = places_between(np.array([0, 2, 6]), np.array([-1, 0, 1, 2, 3, 6, 8]))
    assert left.tolist() == [0, 0, 0, 1, 1, 1, 1]
    np.testing.assert_allclose(share, [-0.5, 0, 0.5, 0, 0.25, 1, 1.5])
