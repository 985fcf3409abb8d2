#!/usr/bin/env python3
"""Render videos for a calibration: an L-frame on the floor and a waved wand, with exact ground truth.

    .venv/bin/python tools/render_wand.py --out build/wand
    .venv/bin/kfmocap calibrate build/wand/wand.toml --out build/wand/calibration.toml --report build/wand/report

Four cameras with lens distortion that were not started together; motion blur, noise, compression; other objects of
the balls' colours lie and move about. Writes the videos, wand.toml, and the true cameras as truth.toml.
"""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np
from kfmocap.core.formats import save_cameras
from render.drawn_takes import HARDSHIPS, drawn_take, vga_take
from render.waving import WandTake, lframe_pictures, wand_pictures


def write_take(take: WandTake, out: Path) -> Path:
    """Render a take into a folder; returns the path of its wand.toml."""
    out.mkdir(parents=True, exist_ok=True)
    for k, camera in enumerate(take.cameras):
        write_video(out / f"{camera.name}_lframe.avi", lframe_pictures(take, k), take.fps, camera.size)
        write_video(out / f"{camera.name}_wand.avi", wand_pictures(take, k), take.fps, camera.size)
    save_cameras(out / "truth.toml", take.cameras)
    path = out / "wand.toml"
    path.write_text(description(take))
    return path


def write_video(path: Path, pictures: Iterable[np.ndarray], fps: float, size: tuple[int, int]) -> None:
    """Write pictures as a Motion JPEG video."""
    writer = cv2.VideoWriter(str(path), cv2.CAP_OPENCV_MJPEG, cv2.VideoWriter_fourcc(*"MJPG"), fps, size)
    for picture in pictures:
        writer.write(picture)
    writer.release()


def description(take: WandTake) -> str:
    """The capture file that `kfmocap calibrate` reads."""
    views = "".join(
        f'\n[[view]]\ncamera = "{c.name}"\nlframe = "{c.name}_lframe.avi"\nwand = "{c.name}_wand.avi"\n'
        for c in take.cameras
    )
    offsets = ", ".join(f"{offset:g}" for offset in take.offsets)
    return (
        f"# frame f of the take is the cameras' video frames f + {offsets}\n\n"
        f'[lframe]\ncolour = "red"\npoints = {take.lframe_points.tolist()}\n'
        f"diameter = {take.lframe_diameter or take.diameter}\n\n"
        f"[wand]\ncolours = {list(take.colours)}\nlength = {take.length}\ndiameter = {take.diameter}\n{views}"
    )


def arguments() -> argparse.ArgumentParser:
    """Build the parser of the command line."""
    form = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=form)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--vga", action="store_true", help="640 x 480 pixels, balls of 4 to 5 pixels, red books about")
    parser.add_argument(
        "--seed", type=int, help="as --vga, with cameras, lenses, furniture, light and waving drawn at random"
    )
    parser.add_argument("--hardship", choices=HARDSHIPS, default="usual", help="what makes a drawn take hard")
    parser.add_argument("--frames", type=int)
    parser.add_argument(
        "--colours", default=",".join(WandTake.colours), help="colours of the wand's balls: two, or one for both"
    )
    parser.add_argument("--plain", action="store_true", help="no distracting objects of the balls' colours")
    return parser


def main() -> None:
    """Render the take and print the path of its capture file."""
    args = arguments().parse_args()
    if args.seed is not None:
        take = drawn_take(args.seed, HARDSHIPS[args.hardship])
    else:
        take = vga_take() if args.vga else WandTake()
    take = dataclasses.replace(
        take,
        frames=args.frames or take.frames,
        colours=tuple(args.colours.split(",")),
        distractors=take.distractors and not args.plain,
    )
    print(write_take(take, args.out))


if __name__ == "__main__":
    main()
