"""A swinging figure filmed by three cameras, of which the one at the side lost a frame, or stored one twice."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from kfmocap.core.shot.shot import Settings, Shot
from synthetic import figure, film, look_at, shot_of, swing

BODY, LENGTH, PLACE = figure(), 19, 12
TRUTH = swing(BODY, LENGTH + 1, size=1.2)
FRAMES = np.arange(LENGTH)
CAMERAS = {
    "front": look_at("front", (0.5, -2.8, 1.5)),
    "side": look_at("side", (-2.4, -1.4, 1.3)),
    "back": look_at("back", (1.5, 2.4, 1.4)),
}
SHIFTS = {"whole": 0, "missing": 1, "twice": -1}


def late_film(home: Path, shift: int, settings: Settings) -> Shot:
    """Film the figure; what the camera at the side shows is ahead by some frames from `PLACE` on."""
    shown = FRAMES + np.where(FRAMES >= PLACE, shift, 0)
    views = [
        view
        for name, camera in CAMERAS.items()
        for view in film(home / name, [BODY], [TRUTH[shown if name == "side" else FRAMES]], [camera])
    ]
    return shot_of(views, [BODY], [TRUTH[FRAMES]], (0, 6, LENGTH - 1), settings)
