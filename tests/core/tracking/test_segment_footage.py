"""Pairs of frames that do not continue each other are named in whichever segment and view they are."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from kfmocap.core.runtime.timing import Seconds
from kfmocap.core.shot.shot import View
from kfmocap.core.tracking.segment_footage import SegmentFootage
from kfmocap.core.tracking.solvers.registry import solver_named
from synthetic import figure, look_at, shot_of, swing
from walking_film import FRAMES, film

SIZE = (320, 184)
BODY = figure()
TRUTH = swing(BODY, FRAMES)


def view(folder: Path, name: str, frames: np.ndarray) -> View:
    (folder / name).mkdir()
    for f, grey in enumerate(frames):
        cv2.imwrite(str(folder / name / f"{f:03d}.png"), cv2.merge([grey] * 3))
    return View(look_at(name, (0.5, -2.8, 1.5), size=SIZE), folder / name / "%03d.png")


@pytest.mark.parametrize("keys", [(0, FRAMES - 1), (0, 6, FRAMES - 1), (0, 7, FRAMES - 1), (0, 8, FRAMES - 1)])
def test_a_frame_that_is_missing_in_one_view_gets_no_weight_there(tmp_path: Path, keys: tuple[int, ...]) -> None:
    views = [view(tmp_path, "left", film(3.0)), view(tmp_path, "right", film(3.0, moved=1, seed=2))]
    shot = shot_of(views, [BODY], [TRUTH], keys)
    footage = SegmentFootage(shot, solver_named("relaxation"), ())
    parts = list(footage.by_segment([TRUTH], (), Seconds()))
    assert footage.torn == ([], [FRAMES // 2])
    torn = np.concatenate([part[1].opened().torn if hasattr(part[1], "opened") else part[1].torn for part in parts])
    assert np.flatnonzero(torn).tolist() == [FRAMES // 2 - 1]
