"""Key poses that are added at random, to see whether they make other frames worse."""

from __future__ import annotations

from pathlib import Path

import pytest
from kfmocap.benchmarks.studies.added_keys import MOST, additions, given_keys
from kfmocap.core.errors import ShotError
from kfmocap.core.shot.shot_spec import PerformerSpec, ShotSpec

KEYS = ((10, 40), (15, 25, 35))
FRAMES = (10, 40)


def test_key_frames_are_added_and_none_is_taken_away() -> None:
    drawn = additions(KEYS, FRAMES, 12, seed=0)
    assert len(drawn) == 12
    for keys in drawn:
        assert keys != KEYS
        for own, before in zip(keys, KEYS, strict=True):
            assert set(before) <= set(own)
            assert len(before) <= len(own) <= len(before) + MOST
            assert list(own) == sorted(set(own))
            assert min(own) >= FRAMES[0]
            assert max(own) <= FRAMES[1]


def test_a_seed_gives_the_same_additions_again_and_another_gives_others() -> None:
    assert additions(KEYS, FRAMES, 5, seed=3) == additions(KEYS, FRAMES, 5, seed=3)
    assert additions(KEYS, FRAMES, 5, seed=3) != additions(KEYS, FRAMES, 5, seed=4)


def test_a_shot_that_is_full_of_key_poses_gets_no_more_than_its_frames() -> None:
    ((own,),) = additions(((0, 1, 2),), (0, 3), 1, seed=0)
    assert own == (0, 1, 2, 3)


def test_performers_without_a_list_of_key_frames_are_refused() -> None:
    def spec(performer: PerformerSpec) -> ShotSpec:
        return ShotSpec(Path("shot.toml"), "shot", 30.0, FRAMES, Path("c.toml"), (), (performer,))

    truth = Path("landmarks.trc")
    assert given_keys(spec(PerformerSpec("A", keyframes=(10, 40), landmarks=truth))) == ((10, 40),)
    for performer in (PerformerSpec("A", keyframes="auto", landmarks=truth), PerformerSpec("A", keyframes=(10, 40))):
        with pytest.raises(ShotError, match="key poses cannot be added"):
            given_keys(spec(performer))
