"""The beginning of the walk that the repository ships, for tests that need a real shot and not a long one."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from pathlib import Path

import numpy as np
from bvh_files import bvh_text
from conftest import ROOT
from kfmocap.core.body import Body
from kfmocap.core.body.motion import Motion
from kfmocap.core.formats import read_trc, write_trc
from kfmocap.core.tracking.prepare import load_shot

WALK = ROOT / "examples" / "walk"


def short_walk(
    folder: Path,
    frames: int,
    *,
    name: str = "walk",
    keyframes: Sequence[int] = (),
    views: int = 3,
    settings: Sequence[str] = (),
    posed: bool = False,
) -> Path:
    """Write a shot of the walk's first frames and views into a new folder, by default with key poses at both ends and
    in the middle; settings are lines of its section [track].

    With `posed` the body and the key poses are in a file, and need not be fitted to landmarks: where a command runs
    many times, that takes a third of its time.
    """
    folder.mkdir()
    for file in ("calibration.toml", "cam01.mp4", "cam02.mp4", "cam03.mp4"):
        (folder / file).symlink_to(WALK / file)
    text = (WALK / "shot.toml").read_text()
    if posed:
        body, motion = first_pose()
        rows = np.zeros(frames, int)
        (folder / "keyposes.bvh").write_text(bvh_text(body, motion[rows]))
        # With a height the body is fitted once instead of twice.
        text = text.replace('landmarks = "landmarks.trc"', 'keyposes = "keyposes.bvh"\nheight = 1.75')
    else:
        landmarks = read_trc(WALK / "landmarks.trc")
        write_trc(folder / "landmarks.trc", landmarks.names, landmarks.points_world[:frames], landmarks.fps)
    text = text.replace("frames = [0, 59]", f"frames = [0, {frames - 1}]")
    text = text.replace("[0, 20, 39, 59]", str(list(keyframes) or [0, frames // 2, frames - 1]))
    text = text.replace('name = "walk"', f'name = "{name}"', 1)
    for camera in ("cam02", "cam03")[views - 1 :]:
        text = text.replace(f'[[view]]\ncamera = "{camera}"\nfootage = "{camera}.mp4"\n', "")
    if settings:
        text = "\n".join([text, "[track]", *settings, ""])
    (folder / "shot.toml").write_text(text)
    return folder


@cache
def first_pose() -> tuple[Body, Motion]:
    """The walker's body and pose on the first frame, which differ little from those on the next few."""
    [performer] = load_shot(WALK / "shot.toml").performers
    return performer.body, performer.key_poses.poses[[0]]
