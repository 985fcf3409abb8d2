"""What is tracked again after a key pose was corrected is what lies beside it."""

from __future__ import annotations

import numpy as np
import pytest
from kfmocap.benchmarks import corrections
from kfmocap.benchmarks.corrections import MOVED, TURNED, Correction
from kfmocap.core.body import human
from kfmocap.core.errors import ShotError
from kfmocap.core.shot.settings import Settings
from kfmocap.core.shot.shot import KeyPoses, Performer, Shot
from kfmocap.core.tracking.retracking import excerpt_at
from synthetic import random_motion

BODY, KEYS = human(1.75), [0, 4, 7, 9]


@pytest.fixture
def shot() -> Shot:
    poses = random_motion(BODY, 10, seed=1)[KEYS]
    performer = Performer("man", BODY, KeyPoses.whole(KEYS, poses))
    return Shot("shot", 30.0, (0, 9), (), (performer,), Settings())


def test_one_key_pose_is_moved_and_every_joint_of_it_turned(shot: Shot) -> None:
    before, after = (s.performers[0].key_poses.poses for s in (shot, corrections.with_key_moved(shot, 4)))
    step = before.difference(after)
    np.testing.assert_allclose(step[[0, 2, 3]], 0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(step[1].reshape(-1, 3), axis=1), [MOVED] + [TURNED] * len(BODY))


@pytest.mark.parametrize(("key", "first", "last"), [(0, 0, 4), (4, 0, 7), (9, 7, 9)])
def test_the_segments_beside_it_are_tracked_between_what_is_known(shot: Shot, key: int, first: int, last: int) -> None:
    motion = random_motion(BODY, 10, seed=2)
    excerpt = excerpt_at(shot, key, [motion], 0.25)
    assert (excerpt.first, excerpt.last, excerpt.footage_offset) == (first, last, 0.25)
    for known, frame in zip(excerpt.around, (first - 1, last + 1), strict=True):
        assert (known is None) == (frame in (-1, 10))
        if known is not None:
            np.testing.assert_array_equal(known[0].rotations[0], motion.rotations[frame])
    np.testing.assert_array_equal(excerpt.earlier[0].rotations, motion.rotations[first : last + 1])


def test_a_frame_outside_the_shot_is_refused(shot: Shot) -> None:
    with pytest.raises(ShotError, match=r"there is no frame 10 \(give 0 to 9\)"):
        excerpt_at(shot, 10, [random_motion(BODY, 10, seed=2)], None)


def test_the_table_has_shares_of_tracking_all() -> None:
    found = [
        Correction("all, footage not read yet", None, 9.0),
        Correction("all", None, 4.0),
        Correction("two", 33, 1.0),
    ]
    assert [line.split("|")[4].strip() for line in corrections.table(found).splitlines()[2:]] == ["225%", "100%", "25%"]
