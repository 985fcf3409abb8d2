"""Smoothness and the spline: exact where motion is uniform, and normal equations that are derivatives."""

from __future__ import annotations

import numpy as np
import pytest
from kfmocap.core.body.motion import Motion
from kfmocap.core.body.smoothness import acceleration, smoothness
from kfmocap.core.numerics import rotations
from kfmocap.core.numerics.banded_blocks import BandedBlocks
from kfmocap.core.shot.keypose_spline import spline
from kfmocap.core.shot.shot import KeyPoses
from synthetic import at_rest, figure, numeric_jacobian, random_motion, swing

BODY = figure()
WEIGHTS = np.random.default_rng(0).uniform(0.5, 2.0, BODY.dof)


def dense(blocks: BandedBlocks) -> np.ndarray:
    F, D = blocks.gradient.shape
    A = np.zeros((F, D, F, D))
    for j in range(F):
        A[j, :, j] = blocks.diagonal[j]
    for k, block in ((1, blocks.first), (2, blocks.second)):
        for j in range(F - k):
            A[j + k, :, j], A[j, :, j + k] = block[j], block[j].T
    return A.reshape(F * D, F * D)


def wild(frames: int = 6) -> Motion:
    return random_motion(BODY, frames, turn=0.5)


def moved(motion: Motion, x: np.ndarray) -> Motion:
    return motion.moved(x.reshape(len(motion), -1))


def test_uniform_motion_has_no_acceleration() -> None:
    rng = np.random.default_rng(1)
    step, start = rng.normal(0, 0.4, BODY.dof), random_motion(BODY, 1)
    poses = [start]
    for _ in range(7):
        poses.append(poses[-1].moved(step[None]))
    motion = Motion(np.concatenate([p.translations for p in poses]), np.concatenate([p.rotations for p in poses]))
    np.testing.assert_allclose(acceleration(motion), 0, atol=1e-12)
    blocks = smoothness(motion, WEIGHTS)
    assert blocks.energy == pytest.approx(0, abs=1e-20)
    np.testing.assert_allclose(blocks.gradient, 0, atol=1e-12)


def test_acceleration_about_one_axis_is_the_second_difference_of_the_angle() -> None:
    angle = np.random.default_rng(2).uniform(-1, 1, 8)
    motion = at_rest(BODY, 8)
    motion.rotations[:, 2] = rotations.exp(angle[:, None] * np.array([0.0, 0.6, 0.8]))
    motion.translations[:, 1] += angle
    found = acceleration(motion)
    second = np.diff(angle, 2)
    np.testing.assert_allclose(found[:, 9:12], second[:, None] * [0.0, 0.6, 0.8], atol=1e-12)
    np.testing.assert_allclose(found[:, 1], second, atol=1e-12)
    rest = np.delete(found, [1, 10, 11], axis=1)
    np.testing.assert_allclose(rest, 0, atol=1e-12)


def test_smoothness_energy_and_gradient_are_those_of_the_accelerations() -> None:
    motion = wild()

    def energy(x: np.ndarray) -> float:
        return float(np.sum(WEIGHTS * acceleration(moved(motion, x)) ** 2))

    blocks = smoothness(motion, WEIGHTS)
    assert blocks.energy == pytest.approx(energy(np.zeros(6 * BODY.dof)))
    numeric = numeric_jacobian(energy, np.zeros(6 * BODY.dof)) / 2
    assert np.abs(blocks.gradient.ravel() - numeric).max() < 1e-6 * np.abs(numeric).max()


def test_smoothness_blocks_are_the_product_of_its_jacobians() -> None:
    motion = wild()
    J = numeric_jacobian(lambda x: acceleration(moved(motion, x)).ravel(), np.zeros(6 * BODY.dof))
    numeric = J.T @ (np.tile(WEIGHTS, 4)[:, None] * J)
    assert np.abs(dense(smoothness(motion, WEIGHTS)) - numeric).max() < 1e-6 * np.abs(numeric).max()


def test_smoothness_does_not_know_the_direction_of_time() -> None:
    motion = wild()
    ahead, back = smoothness(motion, WEIGHTS), smoothness(motion[::-1], WEIGHTS)
    assert back.energy == pytest.approx(ahead.energy)
    np.testing.assert_allclose(back.gradient[::-1], ahead.gradient, atol=1e-9)
    np.testing.assert_allclose(back.diagonal[::-1], ahead.diagonal, atol=1e-9)
    np.testing.assert_allclose(np.swapaxes(back.first, 1, 2)[::-1], ahead.first, atol=1e-9)
    np.testing.assert_allclose(np.swapaxes(back.second, 1, 2)[::-1], ahead.second, atol=1e-9)


@pytest.mark.parametrize("frames", [1, 2])
def test_too_few_frames_are_always_smooth(frames: int) -> None:
    blocks = smoothness(wild(frames), WEIGHTS)
    assert blocks.energy == 0 and not blocks.diagonal.any() and not blocks.gradient.any()
    assert len(blocks.first) == frames - 1 and len(blocks.second) == 0


@pytest.mark.parametrize(("start", "stop"), [(0, 6), (1, 5), (1, 6), (0, 2), (2, 4), (2, 3)])
def test_cut_holds_the_frames_around(start: int, stop: int) -> None:
    blocks, D = smoothness(wild(), WEIGHTS), BODY.dof
    part, whole = blocks.cut(start, stop), dense(blocks).reshape(6, D, 6, D)
    n = (stop - start) * D
    np.testing.assert_array_equal(dense(part), whole[start:stop, :, start:stop].reshape(n, n))
    np.testing.assert_array_equal(part.gradient, blocks.gradient[start:stop])
    assert (len(part.first), len(part.second)) == (max(stop - start - 1, 0), max(stop - start - 2, 0))
    assert part.energy == blocks.energy


@pytest.mark.parametrize(("start", "stop"), [(0, 6), (1, 5), (2, 4), (2, 3), (4, 6)])
def test_a_system_among_more_frames_says_the_same_of_its_own_and_nothing_of_the_others(start: int, stop: int) -> None:
    part, D = smoothness(wild(), WEIGHTS).cut(start, stop), BODY.dof
    whole = part.among(6, start)
    expected, rows = np.zeros((6 * D, 6 * D)), slice(start * D, stop * D)
    expected[rows, rows] = dense(part)
    np.testing.assert_array_equal(dense(whole), expected)
    np.testing.assert_array_equal(whole.cut(start, stop).gradient, part.gradient)
    assert np.abs(whole.gradient).sum() == np.abs(part.gradient).sum() and whole.energy == part.energy


def test_systems_add_up() -> None:
    a, b = smoothness(wild(), WEIGHTS), smoothness(swing(BODY, 6), 2 * WEIGHTS)
    total = a + b
    np.testing.assert_allclose(dense(total), dense(a) + dense(b))
    np.testing.assert_allclose(total.gradient, a.gradient + b.gradient)
    assert total.energy == pytest.approx(a.energy + b.energy)


def test_spline_meets_key_poses_and_is_held_beyond_them() -> None:
    truth = swing(BODY, 20)
    keys = KeyPoses.whole([3, 9, 15], truth[[3, 9, 15]])
    found = spline(keys, 20)
    assert len(found) == 20
    np.testing.assert_allclose(found[[3, 9, 15]].difference(truth[[3, 9, 15]]), 0, atol=1e-9)
    for f, key in ((0, 3), (2, 3), (16, 15), (19, 15)):
        np.testing.assert_allclose(found[[f]].difference(truth[[key]]), 0, atol=1e-9)


def test_spline_is_smooth_between_key_poses() -> None:
    keys = KeyPoses.whole([0, 10, 20], swing(BODY, 21)[[0, 10, 20]])
    assert np.abs(acceleration(spline(keys, 21))).max() < 0.02


def test_spline_of_one_key_pose_stands_still() -> None:
    pose = random_motion(BODY, 1)
    np.testing.assert_allclose(np.diff(spline(KeyPoses.whole([4], pose), 9).rotations, axis=0), 0, atol=1e-12)


def test_a_key_pose_of_one_part_bends_that_part_alone() -> None:
    truth = random_motion(BODY, 3, turn=0.3)
    fixed = np.ones((3, BODY.dof), bool)
    fixed[1] = False
    fixed[1, 6:9] = True
    partial = spline(KeyPoses(np.array([0, 5, 10]), truth, fixed), 11)
    ends = spline(KeyPoses.whole([0, 10], truth[[0, 2]]), 11)
    np.testing.assert_allclose(partial.translations, ends.translations, atol=1e-12)
    np.testing.assert_allclose(partial.rotations[:, [0, 2, 3]], ends.rotations[:, [0, 2, 3]], atol=1e-12)
    np.testing.assert_allclose(partial.rotations[5, 1], truth.rotations[1, 1], atol=1e-12)
