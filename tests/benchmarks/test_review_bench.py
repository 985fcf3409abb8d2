"""The benchmark of the review measures what it says."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from kfmocap.benchmarks.rows import Row
from kfmocap.benchmarks.studies import review_study


def test_the_middle_of_the_longest_gap_is_between_the_two_key_frames_farthest_apart() -> None:
    assert review_study.middle_of_longest_gap([0, 20, 50, 60]) == 35
    assert review_study.middle_of_longest_gap([0, 20, 40]) == 10


def test_ranks_count_and_not_values() -> None:
    values = np.array([0.1, 0.5, 0.2, 3.0])
    assert review_study.rank_correlation(values, values**3) == pytest.approx(1)
    assert review_study.rank_correlation(values, -values) == pytest.approx(-1)


def test_expected_errors_rank_frames_better_than_the_distance_to_the_nearest_key_pose(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a walk that one camera sees from the side, where it is hard: an arm and a leg go out of sight, and are not
    looked for. They take less than a tenth of the time of all else that is usual.
    """
    folder = shutil.copytree(ROOT / "examples" / "walk", tmp_path / "walk")
    shot = folder / "shot.toml"
    shot.write_text(shot.read_text() + "\n[track]\nlimb_search = false\n")
    monkeypatch.setattr(review_study, "example_folder", lambda _name: folder)
    cells = review_study._cells(Row("walk", ("cam01",), (0, 20, 39, 59)), add=False)
    expected, distance, share = map(float, cells[-3:])
    assert expected > distance + 0.2
    assert expected > 0.5
    assert share < 10
