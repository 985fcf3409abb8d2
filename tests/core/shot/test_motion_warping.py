"""A motion that was tracked before is bent onto the key poses as they are now."""

from __future__ import annotations

import numpy as np
from kfmocap.core.body.motion import Motion
from kfmocap.core.shot.motion_warping import bent, carried
from kfmocap.core.shot.shot import KeyPoses
from synthetic import at_rest, figure, swing

BODY = figure()
LENGTH = 9


def keys_of(motion: Motion, frames: list[int]) -> KeyPoses:
    return KeyPoses.whole(np.array(frames), motion[frames])


def test_a_motion_that_passes_its_key_poses_stays() -> None:
    still = at_rest(BODY, LENGTH)
    found = carried(still, keys_of(still, [0, 4, 8]))
    np.testing.assert_allclose(still.difference(found), 0, atol=1e-12)


def test_a_key_pose_that_moved_takes_the_frames_beside_it_along() -> None:
    """All the way beside it, ever less towards the next key poses, whatever the old motion has on its frame."""
    still = at_rest(BODY, LENGTH)
    away = np.zeros((LENGTH, BODY.dof))
    away[4, 0] = 0.1
    keys = keys_of(still.moved(away), [0, 4, 8])
    for before in (still, still.moved(away)):
        shift = carried(before, keys).translations[:, 0] - still.translations[:, 0]
        np.testing.assert_allclose(shift, [0, 0.025, 0.05, 0.075, 0.1, 0.075, 0.05, 0.025, 0], atol=1e-9)


def test_key_poses_at_the_ends_are_compared_with_where_the_motion_beside_them_leads() -> None:
    away = np.zeros((LENGTH, BODY.dof))
    away[:, 0] = 0.05 * np.arange(LENGTH)
    steady = at_rest(BODY, LENGTH).moved(away)
    away[[0, -1], 1] = 3.0
    found = carried(at_rest(BODY, LENGTH).moved(away), keys_of(steady, [0, LENGTH - 1]))
    np.testing.assert_allclose(steady.difference(found), 0, atol=1e-12)


def test_key_poses_are_met_to_the_last_bit() -> None:
    keys = keys_of(swing(BODY, LENGTH), [0, 3, 8])
    found = carried(swing(BODY, LENGTH, 0.3), keys)
    np.testing.assert_array_equal(found.rotations[[0, 3, 8]], keys.poses.rotations)
    np.testing.assert_array_equal(found.translations[[0, 3, 8]], keys.poses.translations)


def test_a_motion_is_bent_to_key_poses_and_follows_its_own_way_between_them() -> None:
    before = swing(BODY, LENGTH, 0.3)
    moved = before.translations.copy()
    moved[:, 0] += 0.2 * np.arange(LENGTH) / (LENGTH - 1)
    keys = keys_of(Motion(moved, before.rotations), [0, LENGTH - 1])
    found = bent(before, keys)
    np.testing.assert_allclose(found.translations, moved, atol=1e-12)
    np.testing.assert_allclose(found.rotations, before.rotations, atol=1e-9)
