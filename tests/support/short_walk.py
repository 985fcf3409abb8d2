"""The beginning of the walk that the repository ships, for tests that need a real shot and not a long one."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from conftest import ROOT
from kfmocap.core.formats import read_trc, write_trc

WALK = ROOT / "examples" / "walk"


def short_walk(
    folder: Path,
    frames: int,
    *,
    name: str = "walk",
    keyframes: Sequence[int] = (),
    views: int = 3,
    settings: Sequence[str] = (),
) -> Path:
    """Write a shot of the walk's first frames and views into a new folder, by default with key poses at both ends and
    in the middle; settings are lines of its section [track].
    """
    folder.mkdir()
    for file in ("calibration.toml", "cam01.mp4", "cam02.mp4", "cam03.mp4"):
        (folder / file).symlink_to(WALK / file)
    landmarks = read_trc(WALK / "landmarks.trc")
    write_trc(folder / "landmarks.trc", landmarks.names, landmarks.points_world[:frames], landmarks.fps)
    text = (WALK / "shot.toml").read_text()
    text = text.replace("frames = [0, 59]", f"frames = [0, {frames - 1}]")
    text = text.replace("[0, 20, 39, 59]", str(list(keyframes) or [0, frames // 2, frames - 1]))
    text = text.replace('name = "walk"', f'name = "{name}"', 1)
    for camera in ("cam02", "cam03")[views - 1 :]:
        text = text.replace(f'[[view]]\ncamera = "{camera}"\nfootage = "{camera}.mp4"\n', "")
    if settings:
        text = "\n".join([text, "[track]", *settings, ""])
    (folder / "shot.toml").write_text(text)
    return folder
