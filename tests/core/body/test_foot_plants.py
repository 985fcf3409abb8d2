"""Plants are found from the motion of the sole alone, whatever the noise, the frame rate and the size."""

from __future__ import annotations

import numpy as np
import pytest
from kfmocap.core.body import human, part_poses
from kfmocap.core.body.foot_plants import find_plants, with_ends
from kfmocap.core.body.kinematics import Poses
from kfmocap.core.body.motion import Motion
from kfmocap.core.body.soles import Soles
from scipy.ndimage import gaussian_filter1d

LEG = 0.9
STEP = 0.7


def stepping(fps, seconds=6.0):
    """Heel and ball of a foot that stands for 0.5 s and steps for 0.5 s, and when it stands, (F,)."""
    t = np.arange(round(seconds * fps)) / fps
    phase = t % 1.0
    swing = np.clip((phase - 0.5) / 0.5, 0, 1)
    ahead = STEP * (np.floor(t) + swing**2 * (3 - 2 * swing))
    heel = np.stack([ahead, 0 * t, 0.14 * np.sin(np.pi * swing) ** 2], axis=1)
    points = np.stack([heel, heel + [0.2, 0.0, 0.0]], axis=1)
    return points, phase <= 0.5


def shaken(points, size, fps, seed=0):
    """Noise as a tracker leaves it: smooth over a tenth of a second."""
    noise = gaussian_filter1d(np.random.default_rng(seed).normal(size=points.shape), 0.1 * fps, axis=0)
    return points + size * noise / noise.std()


@pytest.mark.parametrize("fps", [24.0, 30.0, 60.0, 120.0])
@pytest.mark.parametrize("noise", [0.0, 0.003, 0.008])
def test_frames_are_classified_correctly_except_next_to_a_change(fps, noise):
    points, stands = stepping(fps)
    found = find_plants(shaken(points, noise, fps), fps, LEG)
    sure = np.abs((np.arange(len(stands)) / fps) % 0.5 - 0.25) < 0.19
    assert (found.planted == stands[:, None])[sure].mean() > 0.99
    assert abs(found.floor) < 0.005 + noise


@pytest.mark.parametrize("fps", [24.0, 30.0, 60.0])
def test_with_their_ends_plants_have_every_frame_on_which_a_foot_stands(fps):
    """A foot that leaves at once, at 1.5 m/s: speeds across two frames tell the swing from its last frame on."""
    frames = np.arange(round(3 * fps))
    swings = (frames // round(0.5 * fps)) % 2 == 1
    ahead = np.cumsum(swings) * 1.5 / fps
    points = np.stack([ahead, 0 * ahead, 0.05 * swings], axis=1)[:, None]
    stands = np.r_[True, ~swings[1:]]
    found = find_plants(points, fps, LEG)
    whole = with_ends(found.planted, points, found.speed, fps)
    assert not np.array_equal(found.planted[:, 0], stands)
    assert np.array_equal(whole[:, 0], stands)


def test_plants_do_not_grow_into_frames_that_the_foot_moves_to():
    planted = np.array([False, True, True, False, False])[:, None]
    x = np.array([-0.2, 0.0, 0.0, 0.2, 0.4])
    points = np.stack([x, 0 * x, 0 * x], axis=1)[:, None]
    assert np.array_equal(with_ends(planted, points, 0.02, 30.0), planted)
    x[[0, 3]] = 0.0
    points = np.stack([x, 0 * x, 0 * x], axis=1)[:, None]
    assert with_ends(planted, points, 0.02, 30.0)[:, 0].tolist() == [True, True, True, True, False]


def test_a_foot_that_only_stands_is_planted_on_every_frame():
    points = shaken(np.zeros((90, 2, 3)), 0.004, 30.0)
    assert find_plants(points, 30.0, LEG).planted.all()


def test_a_foot_that_runs_through_the_air_is_never_planted():
    t = np.arange(90) / 30
    points = np.stack([3 * t, 0 * t, 0.5 + 0.1 * np.sin(9 * t)], axis=1)[:, None]
    assert not find_plants(points, 30.0, LEG).planted.any()


def test_plants_on_stairs_are_found():
    points, stands = stepping(30.0)
    points = points + np.stack([0 * points[..., 0], 0 * points[..., 0], 0.25 * points[..., 0]], axis=-1)
    found = find_plants(points, 30.0, LEG).planted
    assert (found == stands[:, None]).mean() > 0.9


def test_the_unit_does_not_matter():
    points, _ = stepping(30.0)
    given = shaken(points, 0.003, 30.0)
    assert np.array_equal(find_plants(given, 30.0, LEG).planted, find_plants(100 * given, 30.0, 100 * LEG).planted)


def test_frames_that_are_in_doubt_do_not_break_a_plant():
    points, stands = stepping(30.0)
    doubt = np.full(points.shape[:2], 0.001)
    points = points.copy()
    points[5:8] += 0.15  # lost for three frames of the first stance, and known to be
    doubt[4:9] = 0.2
    assert find_plants(points, 30.0, LEG, doubt).planted[:14].all()
    assert stands[:14].all()


def test_doubt_that_is_the_same_on_all_frames_does_not_matter():
    points, _ = stepping(30.0)
    doubt = np.full(points.shape[:2], 0.03)
    assert np.array_equal(find_plants(points, 30.0, LEG, doubt).planted, find_plants(points, 30.0, LEG).planted)


def test_the_soles_of_a_body_stand_from_the_frame_on_which_they_come_to_rest_to_the_one_on_which_they_leave():
    body, frames, fps = human(1.75), np.arange(60), 30.0
    soles = Soles.of(body)
    slid = np.clip(frames - 20, 0, 20) * 1.5 / fps
    motion = Motion(
        body.offsets[0] + slid[:, None] * [1.0, 0.0, 0.0], np.tile(np.eye(3), (len(frames), len(body), 1, 1))
    )
    poses = part_poses(body, motion)
    stands = np.tile(((frames <= 20) | (frames >= 40))[:, None], len(soles.names))
    found = soles.planted(poses, fps)
    assert not found[20].any() and not found[40].any()
    assert np.array_equal(soles.standing(found, poses, fps), stands)


def ahead(steps: list[float]) -> tuple[Soles, Poses]:
    """The soles of a body that moves forward by these steps, metres."""
    body = human(1.75)
    way = np.concatenate([[0.0], np.cumsum(steps)])[:, None] * [0.0, -1.0, 0.0]
    motion = Motion(body.offsets[0] + way, np.tile(np.eye(3), (len(way), len(body), 1, 1)))
    return Soles.of(body), part_poses(body, motion)


def test_a_point_that_is_held_stands_as_long_as_it_hardly_moves():
    """At 30 frames per second by 1.83 mm a frame, and at 20 by 2 mm."""
    soles, poses = ahead([0.0, 0.0, 0.0, 0.0, 0.001, 0.0018, 0.0019, 0.0022, 0.003, 0.02])
    held = np.ones((11, 4), bool)
    assert soles.standing(held, poses, 30.0)[:, 1].tolist() == 7 * [True] + 4 * [False]
    assert soles.standing(held, poses, 20.0)[:, 1].tolist() == 8 * [True] + 3 * [False]


def test_a_point_that_is_held_and_stands_for_a_moment_only_does_not_count_as_standing():
    soles, poses = ahead([0.02, 0.02, 0.0, 0.0, 0.02, 0.02, 0.0, 0.0, 0.0, 0.02, 0.02])
    stands = soles.standing(np.ones((12, 4), bool), poses, 30.0)
    assert np.flatnonzero(stands[:, 1]).tolist() == [6, 7, 8, 9]


@pytest.mark.parametrize(
    ("step", "stays", "stands"), [(0.0019, True, True), (0.0021, True, False), (0.0019, False, False)]
)
def test_a_held_point_stands_on_across_a_brief_step_of_less_than_two_millimetres(step, stays, stands):
    """A key pose is where it is, and tracking may miss it by that much."""
    soles, poses = ahead([0.0, 0.0, 0.0, 0.0, step, 0.0, 0.0, 0.0, 0.0])
    held = np.ones((10, 4), bool)
    held[5] = stays
    assert soles.standing(held, poses, 30.0)[:, 0].tolist() == 5 * [True] + [stands] + 4 * [True]


def test_two_plants_are_not_told_as_one_where_the_point_moves_between_them():
    soles, poses = ahead([0.0, 0.0, 0.0, 0.01, 0.0, 0.0, 0.0])
    stands = soles.standing(np.ones((8, 4), bool), poses, 30.0)
    assert np.flatnonzero(~stands[:, 0]).tolist() == [4]


def test_balls_are_placed_on_the_line_from_heel_to_toes():
    body = human(1.75)
    soles = Soles.of(body)
    tips = soles.with_balls_at(1.0).local
    np.testing.assert_allclose(tips[1], body.landmarks["LBigToe"][1], atol=1e-12)
    np.testing.assert_allclose(soles.with_balls_at(0.5).local[1], (soles.local[0] + tips[1]) / 2, atol=1e-12)
    assert np.array_equal(tips[::2], soles.local[::2])
