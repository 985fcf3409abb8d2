"""Occlusion: which parts no camera sees."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from kfmocap.core.body import Body
from kfmocap.core.body.motion import Motion
from kfmocap.core.cameras.camera import Camera
from kfmocap.core.evidence.occlusion import OCCLUDED_BELOW, intervals, occluded, unseen
from kfmocap.core.evidence.rendering.label_images import render_labels
from kfmocap.core.evidence.rendering.part_geometry import Geometry
from synthetic import at_rest, figure, look_at, poses_of, swing

FRONT, SIDE = look_at("front", (0, -4, 1.2)), look_at("side", (4, 0, 1.2))


def visible_share(cameras: list[Camera], bodies: list[Body], motions: list[Motion]) -> np.ndarray:
    """Visible share of every part, shape (V, F, P)."""
    R, T = poses_of(bodies, motions)
    return np.stack([render_labels(Geometry.of(bodies), camera, 0, R, T).share for camera in cameras])


@given(st.lists(st.booleans(), max_size=30), st.integers(0, 50))
def test_intervals_cover_the_true_frames_and_no_others(mask: list[bool], first: int) -> None:
    spans = intervals(np.array(mask, dtype=bool), first)
    covered = {f for a, b in spans for f in range(a, b + 1)}
    assert covered == {first + i for i, value in enumerate(mask) if value}
    assert all(b + 1 < a for (_, b), (a, _) in pairwise(spans))


def test_a_part_is_seen_where_nothing_is_before_it() -> None:
    body = figure()
    front, side = visible_share([FRONT, SIDE], [body], [at_rest(body, 2)])
    right, left = body.index("arm.R"), body.index("forearm.L")
    assert front[0, right] > 0.8 and front[0, left] > 0.8
    assert side[0, right] < OCCLUDED_BELOW  # the trunk stands before it
    np.testing.assert_array_equal(side[0], side[1])


def test_another_performer_hides_a_part() -> None:
    body = figure()
    before = Motion(at_rest(body).translations + [0, -0.6, 0], at_rest(body).rotations)
    share = visible_share([FRONT], [body, body], [at_rest(body), before])[0, 0]
    assert share[: len(body)].max() < OCCLUDED_BELOW < share[len(body) :].min()


def test_a_part_that_leaves_the_picture_is_hidden() -> None:
    body = figure()
    aside = Motion(at_rest(body).translations + [-1.4, 0, 0], at_rest(body).rotations)
    share = visible_share([FRONT], [body], [aside])[0, 0]
    assert share[body.index("arm.R")] < OCCLUDED_BELOW < share[body.index("upper_arm.L")]


def test_each_frame_is_seen_from_where_a_moving_camera_is() -> None:
    body, motion = figure(), swing(figure(), 2)
    R, t = (np.stack([getattr(c, name)[0] for c in (FRONT, SIDE)]) for name in ("R_cam_world", "t_cam_world"))
    moving = Camera.create("moving", FRONT.size, FRONT.matrix, R, t)
    fixed = visible_share([FRONT, SIDE], [body], [motion])
    np.testing.assert_array_equal(visible_share([moving], [body], [motion])[0], [fixed[0, 0], fixed[1, 1]])


def test_a_part_is_occluded_in_its_current_or_its_predicted_pose() -> None:
    share, predicted = np.array([0.9, 0.1, 0.9, 0.1]), np.array([0.9, 0.9, 0.1, 0.1])
    assert occluded(share, predicted).tolist() == [False, True, True, True]
    assert occluded(share).tolist() == [False, True, False, True]
    assert not occluded(np.array(OCCLUDED_BELOW))


def test_a_part_is_unseen_where_every_view_has_lost_it() -> None:
    share = np.ones((2, 3, 1))
    share[0, 1:], share[1, 2] = 0.1, 0.2
    assert unseen(share)[:, 0].tolist() == [False, False, True]
    predicted = np.ones((2, 3, 1))
    predicted[1, 1] = 0.0
    assert unseen(share, predicted)[:, 0].tolist() == [False, True, True]
