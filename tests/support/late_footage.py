"""A swinging figure filmed by three cameras, of which the one at the side lost a frame, or stored one twice."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import cv2
import numpy as np
from kfmocap.core.shot.settings import Settings
from kfmocap.core.shot.shot import Shot, View
from synthetic import figure, look_at, picture, poses_of, shot_of, swing

BODY, LENGTH, PLACE = figure(), 19, 12
TRUTH = swing(BODY, LENGTH + 1, size=1.2)
FRAMES = np.arange(LENGTH)
CAMERAS = {
    "front": look_at("front", (0.5, -2.8, 1.5)),
    "side": look_at("side", (-2.4, -1.4, 1.3)),
    "back": look_at("back", (1.5, 2.4, 1.4)),
}
SHIFTS = {"whole": 0, "missing": 1, "twice": -1}


@cache
def pictures(name: str) -> tuple[np.ndarray, ...]:
    """What a camera shows on all frames, and on the one after the last, grey; nobody changes it."""
    poses = poses_of([BODY], [TRUTH])
    return tuple(picture([BODY], poses, f, CAMERAS[name]) for f in range(len(TRUTH)))


def late_film(home: Path, shift: int, settings: Settings) -> Shot:
    """Film the figure; what the camera at the side shows is ahead by some frames from `PLACE` on."""
    shown, views = FRAMES + np.where(FRAMES >= PLACE, shift, 0), []
    for name, camera in CAMERAS.items():
        (home / name).mkdir(parents=True)
        for f, own in zip(FRAMES.tolist(), shown.tolist(), strict=True):
            cv2.imwrite(str(home / name / f"{f:03d}.png"), pictures(name)[own if name == "side" else f])
        views.append(View(camera, home / name / "%03d.png"))
    return shot_of(views, [BODY], [TRUTH[FRAMES]], (0, 6, LENGTH - 1), settings)
