"""Turns of a camera whose lens may zoom."""

from __future__ import annotations

import numpy as np
from kfmocap.core.cameras.lens_turns import interpolated, since, split, zooming
from kfmocap.core.numerics import rotations

ANGLES, ZOOMS = np.array([0.0, 0.1, 0.2]), np.array([1.0, 1.2, 1.44])
TURNS = zooming(ZOOMS) @ rotations.exp(ANGLES[:, None] * [0.0, 1.0, 0.0])


def test_a_turn_is_a_rotation_and_a_zoom() -> None:
    R, zooms = split(TURNS)
    np.testing.assert_allclose(rotations.log(R), ANGLES[:, None] * [0.0, 1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(zooms, ZOOMS, rtol=1e-12)


def test_turns_between_known_ones_turn_and_zoom_evenly() -> None:
    found = interpolated(np.array([0, 2]), TURNS[[0, 2]], np.array([0, 1, 2]))
    np.testing.assert_allclose(found, TURNS, atol=1e-12)


def test_of_a_single_known_turn_all_frames_have_it() -> None:
    found = interpolated(np.array([1]), TURNS[[1]], np.array([1, 1]))
    np.testing.assert_array_equal(found, TURNS[[1, 1]])


def test_turns_since_another_frame_are_none_on_that_frame() -> None:
    found = since(TURNS, TURNS[[1]])
    np.testing.assert_allclose(found[1], np.eye(3), atol=1e-12)
    np.testing.assert_allclose(split(found)[1], ZOOMS / 1.2, rtol=1e-12)
