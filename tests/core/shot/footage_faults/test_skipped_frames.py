"""Missing frames are told by what moves, and by the other views."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from kfmocap.core.shot.footage_faults.continuity import block_change, block_means, most_changed
from kfmocap.core.shot.footage_faults.skipped_frames import PairChanges, PointsFollowed, skipped_pairs
from walking_film import FRAMES, film

LOST = FRAMES // 2 - 1


def changes_of(frames: np.ndarray) -> PairChanges:
    points, blocks = PointsFollowed(), [block_means(frame) for frame in frames]
    changes = [block_change(a, b) for a, b in pairwise(blocks)]
    for frame, change in zip(frames, [0.0, *map(most_changed, changes)], strict=True):
        points.add(frame, change)
    return PairChanges.of(changes, points.between(0, len(changes)))


def changes_by(most: np.ndarray) -> PairChanges:
    """Those of pairs of which a tenth of the blocks changes by a number of grey levels, the others hardly."""
    changes = [np.where(np.arange(200) < 20, change, 0.2).reshape(10, 20) for change in most]
    return PairChanges.of(changes, np.zeros(len(most), bool))


def skipped(*views: np.ndarray) -> list[list[int]]:
    return [np.flatnonzero(pairs).tolist() for pairs in skipped_pairs([changes_of(frames) for frames in views])]


@pytest.mark.parametrize("speed", [1, 2, 3, 6])
def test_a_single_missing_frame_is_told_where_motion_is_even(speed: float) -> None:
    """Everything moves once as far as in two frames."""
    assert skipped(film(speed)) == [[]]
    assert skipped(film(speed, moved=1)) == [[LOST]]


def test_a_missing_frame_is_told_where_motion_gets_faster_and_slower() -> None:
    steps = [1, 2, 3, 4, 5, 6, 7, 8, 7, 6, 5, 4, 3, 2, 1, 1]
    assert skipped(film(steps=steps)) == [[]]
    lost = [*steps[:6], steps[6] + steps[7], *steps[8:]]
    assert skipped(film(steps=lost)) == [[5]]


def test_somebody_who_starts_or_strikes_once_has_skipped_no_frame() -> None:
    rest = [0.0] * 6
    for steps in ([*rest, 6, 12, 8, 3, *rest], [*rest, 3, 9, 6, *rest], [*rest, *[5.0] * 10]):
        assert skipped(film(steps=steps)) == [[]]


def test_a_limb_that_is_faster_once_does_not_double_the_speed_of_the_others() -> None:
    limb = film(3.0)
    limb[:, 30:60] = film(steps=[3.0 * (1 + (f == FRAMES // 2)) for f in range(FRAMES)])[:, 30:60]
    assert skipped(limb) == [[]]


def test_light_and_noise_are_no_motion() -> None:
    still = film(0)
    assert skipped(still) == [[]]
    brighter = np.clip(still + 3 * np.arange(FRAMES)[:, None, None] ** 1.5, 0, 255).astype(np.uint8)
    assert skipped(brighter) == [[]]


def test_a_frame_that_is_missing_in_one_view_is_told_by_the_others() -> None:
    whole, lost = film(3.0), film(3.0, moved=1, seed=2)
    assert skipped(whole, lost) == [[], [LOST]]
    assert skipped(whole, lost, film(3.0, seed=3)) == [[], [LOST], []]


def test_what_all_views_see_at_once_is_the_performers_motion() -> None:
    leap, other = film(3.0, moved=1), film(3.0, moved=1, seed=2)
    assert skipped(leap) == skipped(other) == [[LOST]]
    assert skipped(leap, other) == [[], []]


@pytest.mark.parametrize("backwards", [False, True])
def test_a_walk_that_starts_or_ends_sooner_in_one_view_has_skipped_no_frame(backwards: bool) -> None:
    """The codec leaves out of one view what the first steps change."""
    most = np.array([[0.7, 0.7, 0.7, 0.7, 5.4, 10.0, *[10.2] * 8], [0.7, 0.7, 0.7, 0.7, 2.4, 4.8, *[5.0] * 8]])
    assert not np.any(skipped_pairs([changes_by(own[:: -1 if backwards else 1]) for own in most]))
    most[0, 9] *= 1.7
    found = np.flatnonzero(skipped_pairs([changes_by(own) for own in most])[0])
    assert found.tolist() == [9]


def test_views_that_are_not_taken_at_once_see_a_motion_one_pair_later() -> None:
    early, late = np.zeros((2, 20))
    early[9] = late[10] = 0.6
    for delay, found in ((0.0, [[9], [10]]), (0.4, [[], []])):
        views = [PairChanges(bends, np.ones(20, bool), bends > 0.5, of) for bends, of in ((early, 0.0), (late, delay))]
        assert [np.flatnonzero(pairs).tolist() for pairs in skipped_pairs(views)] == found


def test_a_pair_that_stands_out_in_one_view_alone_is_told_without_following_points() -> None:
    """Fast motion cannot be followed, and among much acceleration a change tells nothing by itself."""
    rng = np.random.default_rng(4)
    common = rng.normal(0, 0.3, 30)
    views = [PairChanges(common + rng.normal(0, 0.05, 30), np.ones(30, bool), np.zeros(30, bool)) for _ in range(3)]
    assert not np.any(skipped_pairs(views))
    views[1].bends[17] += 0.6
    assert [np.flatnonzero(pairs).tolist() for pairs in skipped_pairs(views)] == [[], [17], []]
    views[1].moving[17] = False
    assert not np.any(skipped_pairs(views))
