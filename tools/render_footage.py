#!/usr/bin/env python3
"""Render footage of a synthetic person with exact ground truth: the example shot `walk`, or a take of the experiments.

    .venv/bin/python tools/render_footage.py walk --out examples/walk

The person of an experiment is painted, with motion blur; the example's figure is traced by Blender.

Writes one video per camera, calibration.toml, landmarks.trc and shot.toml; a README there is left alone. An interrupted
run continues where it stopped, and a finished take is not rendered again. `--preview 0 30 59` writes PNG
pictures of those frames instead, with the joints marked.
"""

from __future__ import annotations

import argparse
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from render.takes import PLANS, Take, is_written, make_take, write_shot

Image = NDArray[np.uint8]

PAINTED_VOXEL = 0.012
"""Voxel size of a painted figure's mesh, metres."""


def render_take(take: Take, frames: list[int], folder: Path, marks: bool = False) -> None:
    """Render frames, as the cameras record them, into PNG files in a folder."""
    import cv2

    truth = take.truth()
    by_name = {camera.name: camera for camera in take.cameras}
    for name, frame, image in (traced if take.person is None else painted)(take, frames, folder):
        if marks:
            for u, v in by_name[name].project(truth[frame]):
                cv2.circle(image, (round(u * 16), round(v * 16)), 32, (0, 255, 0), 1, cv2.LINE_AA, 4)
        part = folder / "part.png"
        cv2.imwrite(str(part), image)
        os.replace(part, picture(folder, name, frame))


def painted(take: Take, frames: list[int], _folder: Path) -> Iterator[tuple[str, int, Image]]:
    """Paint a take's person in frames; yields camera, frame and picture."""
    from render.drawing import linear
    from render.painted_scene import PaintedView, Sensor, exposures
    from render.people import posed_parts

    assert take.person is not None
    figure = take.person.figure(take.body, PAINTED_VOXEL)
    colours = linear(figure.colours[:, ::-1])
    views = [PaintedView(camera, None) for camera in take.cameras]
    for frame in frames:
        skins = figure.skinned(*posed_parts(take.body, take.exposed(frame)))
        for view, exposure in zip(views, exposures(views, skins, figure.triangles, colours), strict=True):
            rng = np.random.default_rng([frame, *view.camera.name.encode()])
            yield view.camera.name, frame, Sensor().recorded(exposure.light, rng)


def traced(take: Take, frames: list[int], folder: Path) -> Iterator[tuple[str, int, Image]]:
    """Trace frames of a take's figure with Blender; yields camera, frame and picture."""
    from render import camera_lens, figure, render_scene

    skin = figure.make_figure(take.body)
    mesh, vertices = render_scene.build(skin), skin.posed(take.motion)
    pinholes = {camera.name: camera_lens.padded_pinhole(camera) for camera in take.cameras}
    by_name = {camera.name: camera for camera in take.cameras}
    for name, frame, pinhole_image in render_scene.render(
        mesh, vertices, list(pinholes.values()), folder, frames, board_path=take.board
    ):
        image = camera_lens.through_lens(pinhole_image, pinholes[name], by_name[name])
        yield name, frame, camera_lens.with_noise(image, seed=[frame, *name.encode()])


def picture(folder: Path, camera: str, frame: int) -> Path:
    """Path of the picture of a camera and frame."""
    return folder / f"{camera}_{frame:04d}.png"


def woven(pictures: list[Path], fields: str, folder: Path) -> list[Path]:
    """Interlace pictures, two to a frame, for a field order; progressive ones are returned unchanged."""
    if fields == "progressive":
        return pictures
    import cv2

    first = ("top-first", "bottom-first").index(fields)
    frames = []
    for k, (early, late) in enumerate(zip(pictures[::2], pictures[1::2], strict=True)):
        frame = np.empty_like(cv2.imread(str(early)))
        for order, field in enumerate((early, late)):
            parity = (first + order) % 2
            frame[parity::2] = cv2.imread(str(field))[parity::2]
        frames.append(folder / f"woven_{k:04d}.png")
        cv2.imwrite(str(frames[-1]), frame)
    return frames


def render_shot(take: Take, out: Path) -> None:
    """Render a take into a folder that does not hold it yet."""
    if is_written(take, out):
        return
    scratch = out / f".pictures-{take.digest()}"
    scratch.mkdir(exist_ok=True)
    frames = list(range(len(take.motion)))
    missing = [f for f in frames if not all(picture(scratch, c.name, f).exists() for c in take.cameras)]
    if missing:
        render_take(take, missing, scratch)
    from render import video_encoding

    rate = take.fps if take.fields == "progressive" else take.fps / 2
    for camera in take.cameras:
        pictures = woven([picture(scratch, camera.name, f) for f in frames], take.fields, scratch)
        video_encoding.encode(pictures, camera.size, rate, scratch / f"{camera.name}.mp4")
        os.replace(scratch / f"{camera.name}.mp4", out / f"{camera.name}.mp4")
    write_shot(take, out)
    shutil.rmtree(scratch)


def arguments() -> argparse.ArgumentParser:
    """Build the parser of the command line."""
    form = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=form)
    parser.add_argument("take", choices=PLANS)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--board", action="store_true", help="let a board pass in front of the figure")
    parser.add_argument("--frames", type=int, help="another number of frames")
    parser.add_argument("--preview", type=int, nargs="+", metavar="FRAME", help="these frames only")
    return parser


def main() -> None:
    """Render the footage, or previews of some frames."""
    args = arguments().parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    take = make_take(args.take, args.frames, args.board)
    if args.preview:
        render_take(take, args.preview, args.out, marks=True)
    else:
        render_shot(take, args.out)


if __name__ == "__main__":
    main()
