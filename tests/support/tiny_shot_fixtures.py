"""Fixtures of the tests of the command line, which load them by `pytest_plugins`: a shot, its tracker a stand-in."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from kfmocap.cli import tracked_files
from kfmocap.core.body import Body, human, landmark_positions
from kfmocap.core.body.measures.measures_from_landmarks import fit_body
from kfmocap.core.cameras.camera import Camera
from kfmocap.core.formats import save_cameras, write_trc
from kfmocap.core.numerics import rotations
from kfmocap.core.tracking import spec_performers
from tiny_shot import FRAMES, SHOT, SIZE, made_result, motion_of


@cache
def _fitted(names: tuple[str, ...], points: bytes, height: float | None) -> Body:
    return fit_body(names, np.frombuffer(points).reshape(-1, len(names), 3), height)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A shot that loads, beside an output folder that holds somebody's file; the tracker is a stand-in."""
    body = human(1.8)
    names = list(body.landmarks)
    write_trc(tmp_path / "landmarks.trc", names, landmark_positions(body, motion_of(body), names), 30)
    K = [[70, 0, 47.5], [0, 70, 35.5], [0, 0, 1]]
    camera = Camera.create("cam01", SIZE, K, rotations.exp(np.array([np.pi / 2, 0, 0])), [0, 1, 3])
    save_cameras(tmp_path / "calibration.toml", [camera])
    for f in range(FRAMES):
        image = np.full((SIZE[1], SIZE[0], 3), 40 + 20 * f, np.uint8)
        cv2.imwrite(str(tmp_path / f"footage_{f:02d}.png"), image)
    (tmp_path / "shot.toml").write_text(SHOT)
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "notes.txt").write_text("mine")
    # The same landmarks in nearly every test, which takes half of its time.
    monkeypatch.setattr(
        spec_performers, "fit_body", lambda names, points, height: _fitted((*names,), points.tobytes(), height)
    )
    monkeypatch.setattr(tracked_files, "track", lambda shot, progress=None, **_: made_result(shot))
    return tmp_path
