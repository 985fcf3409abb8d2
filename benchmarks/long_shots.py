"""Shots of any length, made of an example that is played forwards and backwards."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..core.errors import OutputError
from ..core.formats import read_trc
from ..core.formats.calibrations.toml_cameras import save_cameras
from ..core.formats.trc import write_trc
from ..core.shot.footage import frames_at, working_factor
from ..core.shot.shot import Shot
from ..core.tracking.prepare import load_shot

KEY_EVERY = 33
"""Largest number of frames between key poses."""
TURN_MARGIN = 5
"""Frames at either end of the example that a longer shot leaves out: what turns back on a key frame, as it would on
frame 99 of 100, passes for limbs that were lost beside it, which are searched for."""


def write_shot(example: Path, folder: Path, frames: int) -> Path:
    """Write a shot with a number of frames, from an example played forwards and backwards; returns its file.

    Raises
    ------
    OutputError
        The footage cannot be written.
    """
    folder.mkdir()
    shot = load_shot(example / "shot.toml")
    order = np.arange(frames) if frames <= shot.length else back_and_forth(shot.length, frames, TURN_MARGIN)
    views = []
    for view in shot.views:
        factor = working_factor(view, shot.settings.working_size)
        pictures = list(frames_at(view, range(shot.frames[0], shot.frames[1] + 1), factor, grey=False))
        file = folder / f"{view.camera.name}.avi"
        _write_video(file, [pictures[f] for f in order], shot.fps)
        views.append(view.camera.reduced(factor).rectified())
    save_cameras(folder / "cameras.toml", views)
    truth = read_trc(example / "landmarks.trc")
    write_trc(folder / "landmarks.trc", truth.names, truth.points_world[order], truth.fps)
    file = folder / "shot.toml"
    file.write_text(_shot_text(shot, frames), encoding="utf-8")
    return file


def back_and_forth(length: int, count: int, margin: int = 0) -> NDArray[np.int64]:
    """Return `count` frame numbers that play a shot forwards and backwards, without showing any twice in a row.

    `margin` frames at either end of the shot are left out.
    """
    played = np.arange(margin, length - margin)
    return np.asarray(np.resize(np.concatenate([played, played[-2:0:-1]]), count))


def _write_video(file: Path, pictures: Sequence[NDArray[Any]], fps: float) -> None:
    height, width = pictures[0].shape[:2]
    video = cv2.VideoWriter(str(file), cv2.VideoWriter_fourcc(*"MJPG"), fps, (width, height))
    if not video.isOpened():
        raise OutputError("OpenCV cannot write the footage", where=str(file))
    for picture in pictures:
        video.write(picture)
    video.release()


def _shot_text(shot: Shot, frames: int) -> str:
    keys = sorted({*range(0, frames - KEY_EVERY // 2, KEY_EVERY), frames - 1})
    views = "".join(f'[[view]]\ncamera = "{v.camera.name}"\nfootage = "{v.camera.name}.avi"\n\n' for v in shot.views)
    return (
        f'[shot]\nname = "speed"\nfps = {shot.fps}\nframes = [0, {frames - 1}]\n\n'
        f'[calibration]\nfile = "cameras.toml"\n\n{views}'
        f'[[performer]]\nname = "man"\nlandmarks = "landmarks.trc"\nkeyframes = {keys}\n'
    )


def threads_text(shot: Path, threads: int, *, ends: bool = False) -> Path:
    """Write a copy of a shot file with a number of threads; returns its path.

    Gaps are not corrected: a view that is a little late is early where its footage is played backwards, which passes
    for a missing frame, and the shot would be tracked twice.
    """
    file, text = shot.with_name(f"cores{threads}.toml"), shot.read_text(encoding="utf-8")
    if ends:
        text = re.sub(r"keyframes = \[(\d+),.* (\d+)\]", r"keyframes = [\1, \2]", text)
    file.write_text(f"{text}\n[track]\nthreads = {threads}\ncorrect_gaps = false\n", encoding="utf-8")
    return file
