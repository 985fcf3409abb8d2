#!/usr/bin/env python3
"""Render the example shot `walk`: footage of a made person with exact truth.

    .venv/bin/python tools/render_walk.py --out examples/walk

Writes one video per camera, calibration.toml, landmarks.trc and shot.toml; the README there is not touched.
`--preview 0 30 59` writes PNG pictures of those frames instead, with the joints marked.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from kfmocap.core.body import Body, human, landmark_positions
from kfmocap.core.cameras import Camera
from kfmocap.core.motion import Motion
from numpy.typing import ArrayLike
from render.motions import MOTIONS

FPS = 30.0
SIZE = (640, 360)
KEY_STEP = 20


@dataclass(frozen=True, eq=False)
class Take:
    """What is rendered: a body, its motion, the cameras on it, and the path of a board in front, if any."""

    name: str
    body: Body
    motion: Motion
    cameras: tuple[Camera, ...]
    board: np.ndarray | None = None

    @property
    def landmarks(self) -> list[str]:
        return list(self.body.landmarks)

    def truth(self) -> np.ndarray:
        """Landmarks in the world, metres, shape (F, L, 3)."""
        return landmark_positions(self.body, self.motion, self.landmarks)


def make_take(name: str, frames: int, board: bool = False) -> Take:
    """The take of a motion by name; a board may pass between cam01 and the figure, against its way."""
    body = human(1.78, {"shoulder_width": 0.375, "upper_arm": 0.298, "torso": 0.52, "head": 0.32396})
    x = np.linspace(1.2, -1.2, frames)
    path = np.stack([x, np.full(frames, -1.3), np.full(frames, 0.75)], axis=1) if board else None
    return Take(name, body, MOTIONS[name](body, frames, FPS), cameras(), path)


def cameras() -> tuple[Camera, ...]:
    """From the right side, oblique from the front, oblique from behind (through a lens with distortion)."""
    return (
        _looking("cam01", (0.0, -4.7, 1.05), (0.0, 0.0, 0.93), 780.0),
        _looking("cam02", (4.1, -3.2, 1.5), (0.05, 0.05, 0.86), 700.0),
        _looking("cam03", (-4.0, 3.1, 1.6), (0.05, -0.05, 0.86), 690.0, (-0.16, 0.06, 0.0005, -0.0007)),
    )


def _looking(
    name: str, place: ArrayLike, at: ArrayLike, focal: float, distortions: ArrayLike = (0.0, 0.0, 0.0, 0.0)
) -> Camera:
    forward = np.subtract(at, place)
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    R = np.stack([right, np.cross(forward, right), forward])
    matrix = [[focal, 0, (SIZE[0] - 1) / 2], [0, focal, (SIZE[1] - 1) / 2], [0, 0, 1]]
    return Camera.create(name, SIZE, matrix, R, -R @ np.asarray(place, float), distortions)


def key_frames(frames: int) -> list[int]:
    """A key about every `KEY_STEP` frames, both ends among them."""
    return [int(k) for k in np.linspace(0, frames - 1, round(frames / KEY_STEP) + 1).round()]


def render_take(take: Take, frames: list[int], folder: Path, marks: bool = False) -> dict[str, list[Path]]:
    """Render frames into PNG files as the cameras record them, by camera."""
    import cv2
    from render import figure, lens, scene

    skin = figure.make_figure(take.body)
    mesh, vertices = scene.build(skin), skin.posed(take.motion)
    pinholes = {camera.name: lens.padded_pinhole(camera) for camera in take.cameras}
    by_name = {camera.name: camera for camera in take.cameras}
    files: dict[str, list[Path]] = {name: [] for name in by_name}
    truth = take.truth()
    pictures = scene.render(mesh, vertices, list(pinholes.values()), folder, frames, take.board)
    for name, frame, image in pictures:
        image = lens.through_lens(image, pinholes[name], by_name[name])
        image = lens.with_noise(image, seed=[frame, *name.encode()])
        if marks:
            for u, v in by_name[name].project(truth[frame]):
                cv2.circle(image, (round(u * 16), round(v * 16)), 32, (0, 255, 0), 1, cv2.LINE_AA, 4)
        path = folder / f"{name}_{frame:04d}.png"
        cv2.imwrite(str(path), image)
        files[name].append(path)
    return files


def write_shot(take: Take, out: Path) -> None:
    """Write the calibration, the truth and the shot file of a take."""
    from kfmocap.core.formats.calibration import save_cameras
    from kfmocap.core.formats.trc import write_trc

    save_cameras(out / "calibration.toml", {camera.name: camera for camera in take.cameras})
    write_trc(out / "landmarks.trc", take.landmarks, take.truth(), FPS)
    frames = len(take.motion)
    views = "".join(f'\n[[view]]\ncamera = "{c.name}"\nfootage = "{c.name}.mp4"\n' for c in take.cameras)
    (out / "shot.toml").write_text(
        f'[shot]\nname = "{take.name}"\nfps = {FPS}\nframes = [0, {frames - 1}]\n\n'
        f'[calibration]\nfile = "calibration.toml"\n{views}\n'
        f'[[performer]]\nname = "person"\nlandmarks = "landmarks.trc"\nkeyframes = {key_frames(frames)}\n'
    )


def main() -> None:
    form = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=form)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--motion", choices=sorted(MOTIONS), default="walk")
    parser.add_argument("--board", action="store_true", help="let a board pass in front of the figure")
    parser.add_argument("--frames", type=int, default=60, help="number of frames")
    parser.add_argument("--preview", type=int, nargs="+", metavar="FRAME", help="these frames only")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    take = make_take(args.motion, args.frames, args.board)
    if args.preview:
        render_take(take, args.preview, args.out, marks=True)
        return
    from render import video

    with tempfile.TemporaryDirectory(dir=args.out) as scratch:
        files = render_take(take, list(range(args.frames)), Path(scratch))
        for camera in take.cameras:
            video.encode(files[camera.name], camera.size, FPS, Path(scratch) / f"{camera.name}.mp4")
            os.replace(Path(scratch) / f"{camera.name}.mp4", args.out / f"{camera.name}.mp4")
    write_shot(take, args.out)


if __name__ == "__main__":
    main()
