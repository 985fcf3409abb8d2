"""Fixtures of random calls of the add-on's tools: what takes long is stood in for, and files of all kinds are there."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest
from addon_shots import camera, shot
from kfmocap.core.calibration import api, calibration_report
from kfmocap.core.calibration.performer import performer_cameras
from kfmocap.core.fitting import body_fit, shot_cameras
from kfmocap.core.tracking import prepare
from random_calls import CAPTURE, WALK
from ready_scenes import by_performer, fitted, refined, solution


@pytest.fixture
def quick(tracker, monkeypatch):
    """What takes long is stood in for."""

    def standing_in(found: Callable[[Any], Any]) -> Callable[..., Any]:
        def work(given: object, *_others: object, **_named: object) -> Any:
            if tracker.error is not None:
                raise tracker.error
            return found(given)

        return work

    monkeypatch.setattr(shot_cameras, "refine_shot_cameras", standing_in(refined))
    monkeypatch.setattr(body_fit, "fit_bodies", standing_in(fitted))
    monkeypatch.setattr(api, "calibrate", standing_in(lambda _capture: solution([camera(1), camera(2)])))
    monkeypatch.setattr(performer_cameras, "cameras_of_views", standing_in(by_performer))
    monkeypatch.setattr(calibration_report, "sheet", lambda _solved: np.full((40, 60, 3), 200, np.uint8))
    monkeypatch.setattr(calibration_report, "write_report", lambda _folder, _solved: None)
    monkeypatch.setattr(prepare, "load_shot", cache(prepare.load_shot))  # it fits bodies
    return tracker


@pytest.fixture
def files(tmp_path, monkeypatch):
    shot(tmp_path)
    (tmp_path / "broken.toml").write_text("[shot\n")
    (tmp_path / "empty.toml").write_text("")
    names = ["cam01.mp4", "broken.toml", "empty.toml", "missing.toml", "missing.mp4", "."]
    shutil.copytree(WALK, tmp_path / "walk")
    people = [{"image_id": i, "keypoints": [100.0 + i, 80.0, 0.9] * 17, "score": 1.0} for i in range(30)]
    (tmp_path / "keypoints.json").write_text(json.dumps(people))
    (tmp_path / "bones.json").write_text(json.dumps({"preset": "", "bones": {"hips": ["spine"]}}))
    (tmp_path / "capture.toml").write_text(CAPTURE)
    names += ["keypoints.json", "bones.json", "capture.toml"]
    names += [f"walk/{name}" for name in ("shot.toml", "calibration.toml", "landmarks.trc", "cam01.mp4", "cam02.mp4")]
    monkeypatch.chdir(tmp_path)  # what is written without a path goes there
    return ["", *(str(tmp_path / name) for name in names)]
