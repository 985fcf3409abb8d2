"""Where one more key pose would help most: beside what no camera sees, and where the expected error is largest."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from kfmocap.core.body.motion import Motion
from kfmocap.core.evidence.occlusion import LONG_GAP
from kfmocap.core.review import suggestions
from kfmocap.core.review.suggestions import (
    MAX_ERROR_SUGGESTIONS,
    MAX_FRAME_DISTANCE,
    MAX_HIDDEN_SUGGESTIONS,
    MIN_SPACING,
    MIN_VISIBLE_FRAMES,
    KeySuggestion,
    suggest_keys_beside_hidden,
)
from kfmocap.core.shot.shot import KeyPoses
from kfmocap.core.tracking.expected_errors.uncertainty import expected_errors
from synthetic import at_rest, figure

Array = np.ndarray
BODY = figure()
P = len(BODY)


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


def suggest_keys_by_error(deviation: Array, keys: KeyPoses) -> list[KeySuggestion]:
    return suggestions.suggest_keys_by_error(deviation, keys, BODY.parents)


def keys_at(*frames: int) -> KeyPoses:
    return KeyPoses.whole(list(frames), at_rest(BODY, len(frames)))


def bump(centre: int, length: int = 40, height: float = 0.05, width: float = 4.0) -> Array:
    return height * np.exp(-(((np.arange(length) - centre) / width) ** 2))[:, None] * np.ones(P)


def test_the_first_suggestion_is_where_most_is_wrong() -> None:
    deviation = bump(27) + bump(9, height=0.02)
    first, second, *_ = suggest_keys_by_error(deviation, keys_at(0, 18, 39))
    assert abs(first.frame - 27) <= 2 and abs(second.frame - 9) <= 2
    assert first.deviation == pytest.approx(deviation[first.frame].mean())
    assert first.worst == deviation[first.frame, first.parts[0]] == deviation[first.frame].max()


def test_the_ends_of_limbs_do_not_count() -> None:
    deviation = bump(27)
    deviation[:, [2, 3]] += bump(9, height=1.0)[:, [2, 3]]  # the forearm's and the right arm's tips are no joints
    first, *_ = suggest_keys_by_error(deviation, keys_at(0, 18, 39))
    assert abs(first.frame - 27) <= 2 and set(first.parts) == {0, 1}
    np.testing.assert_allclose(expected_errors(deviation, BODY.parents), deviation[:, [0, 1]].mean(axis=1))


def test_suggestions_lose_in_gain_and_keep_apart() -> None:
    keys = keys_at(0, 20, 39)
    found = suggest_keys_by_error(bump(10) + bump(30) + 0.01, keys)
    assert 1 < len(found) <= MAX_ERROR_SUGGESTIONS
    assert all(a.gain >= b.gain > 0 for a, b in itertools.pairwise(found))
    frames = [key.frame for key in found]
    assert all(abs(f - k) >= MIN_SPACING for f in frames for k in [0, 20, 39])
    assert all(abs(a - b) >= MIN_SPACING for i, a in enumerate(frames) for b in frames[:i])


def walk_errors(length: int, known: Sequence[int]) -> Array:
    """Return the standard deviation on every frame of a random walk that is zero on some frames, and one shot's length
    before and after the shot.
    """
    at = np.arange(length) + length
    covariance = np.minimum.outer(at, at)
    seen = length + np.array([*known, 2 * length])
    towards = np.minimum.outer(at, seen)
    explained = towards @ np.linalg.solve(np.minimum.outer(seen, seen), towards.T)
    return np.sqrt(np.maximum(np.diagonal(covariance - explained), 0))


@pytest.mark.parametrize("known", [(0, 30), (12,), (20, 30), ()])
def test_the_gain_is_what_a_key_pose_takes_from_errors_that_drift_like_a_random_walk(known: tuple[int, ...]) -> None:
    before = walk_errors(31, known)
    allowed = [f for f in range(31) if all(abs(f - k) >= MIN_SPACING for k in known)]
    after = {f: walk_errors(31, [*known, f]).mean() for f in allowed}
    (best, *_) = suggest_keys_by_error(0.001 * before[:, None] * np.ones(P), keys_at(*known))
    assert best.frame in allowed and after[best.frame] == pytest.approx(min(after.values()))
    assert best.gain == pytest.approx(0.001 * (before.mean() - after[best.frame]))


def test_the_parts_that_are_farthest_off_are_named() -> None:
    deviation = bump(20)
    deviation[:, 0] *= 3
    deviation[:, 1] *= 2.5
    assert suggest_keys_by_error(deviation, keys_at(0, 39))[0].parts == (0, 1)


def test_a_partial_key_pose_does_not_end_the_need_of_a_whole_one() -> None:
    keys = keys_at(0, 20, 39)
    fixed = keys.fixed.copy()
    fixed[1, 6:] = False
    found = suggest_keys_by_error(bump(20), replace(keys, fixed=fixed))
    assert abs(found[0].frame - 20) <= 1


def test_nothing_is_suggested_where_nothing_is_wrong_or_no_frame_is_free() -> None:
    assert suggest_keys_by_error(np.zeros((40, P)), keys_at(0, 39)) == []
    assert suggest_keys_by_error(bump(2, 5), keys_at(0, 4)) == []
