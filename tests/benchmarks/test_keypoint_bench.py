"""The keypoint benchmark spoils what it says it spoils, and nothing else."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("kfmocap.benchmarks")

from keypoint_shots import cameras, seen_places, strolling, write_openpose
from kfmocap.benchmarks.studies.keypoint_noise import LEAP, as_coco, worse, worse_shot
from kfmocap.core.body import human
from kfmocap.core.formats.keypoint_files import read_keypoints
from kfmocap.core.formats.keypoint_layouts import mirrored_name


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    body = human()
    write_openpose(tmp_path / "pose" / "cam01", cameras(1)[0], [seen_places(body, strolling(body, 60))])
    return tmp_path


def test_as_much_is_spoiled_as_is_said(folder: Path) -> None:
    found = read_keypoints(folder / "pose" / "cam01")
    bad = worse(found, np.random.default_rng(0))
    assert len(bad) == 48 and set(bad.frames) <= set(found.frames)
    before = found.points[np.isin(found.frames, bad.frames)]
    order = [found.names.index(mirrored_name(name)) for name in found.names]
    moved, turned = (np.linalg.norm(bad.points - p, axis=-1) for p in (before, before[:, order]))
    is_turned = np.median(turned, axis=1) < np.median(moved, axis=1)
    assert is_turned.sum() == 5
    leaps = np.where(is_turned[:, None], turned, moved)
    np.testing.assert_allclose(leaps[leaps > 1], LEAP)
    assert 0.03 < (leaps > 1).mean() < 0.07


def test_a_copy_of_a_shot_names_spoiled_keypoints_and_the_same_files(folder: Path, tmp_path: Path) -> None:
    text = '[calibration]\nfile = "calibration.toml"\n[[view]]\ncamera = "cam01"\nkeypoints = "pose/cam01"\n'
    (folder / "shot.toml").write_text(text)
    (tmp_path / "worse").mkdir()
    copy = worse_shot(folder / "shot.toml", tmp_path / "worse", 3).read_text()
    assert f'file = "{(folder / "calibration.toml").as_posix()}"' in copy and 'camera = "cam01"' in copy
    assert len(read_keypoints(tmp_path / "worse" / "keypoints1.json")) == 48


def test_what_is_written_is_read_again(folder: Path) -> None:
    found = read_keypoints(folder / "pose" / "cam01")
    path = folder / "again.json"
    path.write_text(json.dumps(as_coco(found)))
    again = read_keypoints(path)
    for name in ("LHip", "RWrist", "LBigToe", "Neck"):
        column, other = found.names.index(name), again.names.index(name)
        np.testing.assert_allclose(again.points[:, other], found.points[:, column])
