"""Occlusion: which parts no camera sees, and the key frames that would help."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from kfmocap.core.body import Body
from kfmocap.core.body.motion import Motion
from kfmocap.core.cameras.camera import Camera
from kfmocap.core.evidence.occlusion import (
    LONG_GAP,
    OCCLUDED_BELOW,
    intervals,
    occluded,
    unseen,
)
from kfmocap.core.evidence.rendering.label_images import render_labels
from kfmocap.core.evidence.rendering.part_geometry import Geometry
from kfmocap.core.review.suggestions import (
    MAX_FRAME_DISTANCE,
    MAX_HIDDEN_SUGGESTIONS,
    MIN_SPACING,
    MIN_VISIBLE_FRAMES,
    suggest_keys_beside_hidden,
)
from kfmocap.core.shot.shot import KeyPoses
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


FRAMES, PARTS = 80, 4


def hidden(*spans: tuple[int, int, int]) -> np.ndarray:
    mask = np.zeros((FRAMES, PARTS), dtype=bool)
    for part, first, last in spans:
        mask[first : last + 1, part] = True
    return mask


def keys(*frames: int) -> KeyPoses:
    poses = Motion(np.zeros((len(frames), 3)), np.tile(np.eye(3), (len(frames), PARTS, 1, 1)))
    return KeyPoses.whole(list(frames), poses)


def test_key_poses_are_suggested_beside_what_is_hidden() -> None:
    found = suggest_keys_beside_hidden(hidden((2, 30, 41)), keys(0, 79))
    assert [(s.frame, s.parts, s.hidden) for s in found] == [(29, (2,), (30, 41)), (42, (2,), (30, 41))]


def test_the_frame_with_the_fewest_hidden_parts_is_taken() -> None:
    mask = hidden((2, 30, 41), (0, 24, 29), (1, 28, 29), (3, 42, 44))
    frames = [s.frame for s in suggest_keys_beside_hidden(mask, keys(0, 79)) if s.hidden == (30, 41)]
    assert frames == [27, 45]


def test_limbs_that_are_hidden_together_share_a_suggestion() -> None:
    found = suggest_keys_beside_hidden(hidden((1, 30, 41), (2, 31, 39), (3, 60, 67)), keys(0, 79))
    assert [(s.frame, s.parts) for s in found] == [(29, (1, 2)), (42, (1, 2)), (59, (3,)), (68, (3,))]


def test_there_is_nothing_to_suggest_for_what_is_hidden_shortly() -> None:
    assert not suggest_keys_beside_hidden(hidden((1, 30, 29 + LONG_GAP - 1)), keys(0, 79))
    assert suggest_keys_beside_hidden(hidden((1, 30, 29 + LONG_GAP)), keys(0, 79))


def test_a_glimpse_is_too_short_for_a_key_pose() -> None:
    found = suggest_keys_beside_hidden(hidden((1, 20, 29), (1, 29 + MIN_VISIBLE_FRAMES, 40)), keys(0, 79))
    assert [(s.frame, s.hidden) for s in found] == [(19, (20, 40)), (41, (20, 40))]
    longer = suggest_keys_beside_hidden(hidden((1, 20, 29), (1, 30 + MIN_VISIBLE_FRAMES, 45)), keys(0, 79))
    assert {30, 32} & {s.frame for s in longer}


def test_near_a_key_pose_of_the_part_no_other_is_suggested() -> None:
    found = suggest_keys_beside_hidden(hidden((1, 30, 41)), keys(0, 27, 79))
    assert [s.frame for s in found] == [42]
    poses = keys(0, 27, 79)
    poses.fixed[1, 3 + 3 * 1 : 6 + 3 * 1] = False  # at frame 27 the other parts alone are keyed
    assert [s.frame for s in suggest_keys_beside_hidden(hidden((1, 30, 41)), poses)] == [29, 42]


def test_a_key_pose_within_a_hidden_interval_divides_it() -> None:
    found = suggest_keys_beside_hidden(hidden((1, 20, 59)), keys(0, 45, 79))
    assert [(s.frame, s.hidden) for s in found] == [(19, (20, 44)), (60, (46, 59))]


def test_the_longest_hidden_come_first_and_the_list_is_short() -> None:
    mask = hidden((0, 8, 15), (1, 22, 30), (2, 40, 49), (3, 60, 70))
    found = suggest_keys_beside_hidden(mask, keys(0, 79))
    lengths = [b - a for a, b in (s.hidden for s in found)]
    assert lengths == sorted(lengths, reverse=True)
    assert len(found) == MAX_HIDDEN_SUGGESTIONS < 8


def test_at_the_ends_of_the_shot_there_is_one_side() -> None:
    found = suggest_keys_beside_hidden(hidden((1, 0, 10), (2, 60, FRAMES - 1)), keys(30))
    assert sorted(s.frame for s in found) == [11, 59]


@pytest.mark.parametrize("seed", range(5))
def test_suggestions_keep_their_distance_and_are_seen(seed: int) -> None:
    rng = np.random.default_rng(seed)
    mask = np.repeat(rng.random((FRAMES // 4, PARTS)) < 0.5, 4, axis=0)
    poses = keys(0, 33, 79)
    found = suggest_keys_beside_hidden(mask, poses)
    assert found
    frames = [s.frame for s in found]
    for i, suggestion in enumerate(found):
        others = frames[:i] + frames[i + 1 :] + poses.frames.tolist()
        assert min(abs(suggestion.frame - f) for f in others) >= MIN_SPACING
        assert not mask[suggestion.frame, list(suggestion.parts)].any()
        a, b = suggestion.hidden
        assert 0 < a - suggestion.frame <= MAX_FRAME_DISTANCE or 0 < suggestion.frame - b <= MAX_FRAME_DISTANCE
