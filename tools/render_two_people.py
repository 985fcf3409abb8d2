#!/usr/bin/env python3
"""Render two people who walk past each other, one half hidden by the other in every view; needs no Blender.

    .venv/bin/python tools/render_two_people.py --out build/crossing [--clothes equal]

Writes footage, calibration.toml, landmarks_A.trc, landmarks_B.trc, and shot files with both performers (shot.toml,
shot_staggered.toml) and with one of them (shot_A.toml, shot_B.toml): what the other costs it is the difference.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from kfmocap.core.body import Body
from kfmocap.core.body.motion import Motion
from kfmocap.core.formats import save_cameras, write_trc
from kfmocap.core.numerics.arrays import Array
from render.benchmark_movements import STROLL
from render.benchmark_shots import ring
from render.drawing import linear
from render.movement_phrases import Movement
from render.painted_scene import Floor, PaintedView, Sensor, Surface, joined, lit
from render.people import Person, Wardrobe, skin_at, true_landmarks

FPS, FRAMES, KEYS, STAGGERED = 25.0, 49, (0, 24, 48), (10, 36)
CAMERAS = ring(3, 4.1, 540, -115, 25)
VOXEL = 0.014
BLUE = Wardrobe(((0.24, 0.33, 0.56),), (0.22, 0.22, 0.25), pattern=0.06)
RED = Wardrobe(((0.62, 0.22, 0.2), (0.5, 0.16, 0.16)), (0.42, 0.36, 0.28), hair=(0.5, 0.36, 0.2))
MAN, WOMAN = {"thigh": 1.04, "shoulder_width": 1.05}, {"shoulder_width": 0.95, "torso": 1.03}


@dataclass(frozen=True)
class Route(Movement):
    """A movement in another direction, elsewhere.

    Attributes
    ----------
    heading : float
        Turn about the vertical, degrees.
    place : tuple of float
        What was at the origin is there, metres.
    """

    heading: float = 0.0
    place: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @classmethod
    def of(cls, movement: Movement, heading: float, place: tuple[float, float, float]) -> Route:
        """Take a movement there."""
        fields = (movement.start, movement.phrases, movement.free, movement.seed, movement.tremor, movement.half_width)
        return cls(*fields, heading, place)

    def motion(self, body: Body, t: Array) -> Motion:
        """The motion of a body at times, seconds, shape (F,)."""
        own = super().motion(body, t)
        c, s = np.cos(np.radians(self.heading)), np.sin(np.radians(self.heading))
        turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        rotations, rest = own.rotations.copy(), body.R_parent_rest[0]
        rotations[:, 0] = rest.T @ turn @ rest @ rotations[:, 0]
        return Motion(own.translations @ turn.T + self.place, rotations)


def people(equal: bool) -> tuple[tuple[Person, Route], ...]:
    """Who walks, and where."""
    man, woman = Person(1.8, BLUE, MAN), Person(1.68, BLUE if equal else RED, WOMAN)
    return (
        (man, Route.of(STROLL, 0.0, (0.0, -0.32, 0.0))),
        (woman, Route.of(STROLL, 180.0, (0.05, 0.32, 0.0))),
    )


def render(out: Path, equal: bool) -> None:
    """Render the shot into a folder."""
    cast = people(equal)
    bodies = [person.body() for person, _ in cast]
    figures = [person.figure(body, VOXEL) for (person, _), body in zip(cast, bodies, strict=True)]
    views = [PaintedView(camera, None) for camera in CAMERAS]
    for camera in CAMERAS:
        (out / camera.name).mkdir(parents=True, exist_ok=True)
    for frame in range(FRAMES):
        times = (frame + 0.4 * (np.arange(2) / 2 - 0.25)) / FPS
        skins = [skin_at(person, figure, route, times) for (person, route), figure in zip(cast, figures, strict=True)]
        moments = [
            joined(
                [
                    Surface(skin[m], figure.triangles, linear(figure.colours[:, ::-1]))
                    for skin, figure in zip(skins, figures, strict=True)
                ]
            )
            for m in range(len(times))
        ]
        light, floor = lit(moments[0]), Floor(moments[0].vertices)
        for v, view in enumerate(views):
            rng = np.random.default_rng([frame, v])
            image = Sensor().recorded(view.exposed(moments, light, floor).light, rng)
            cv2.imwrite(str(out / view.camera.name / f"{frame:04d}.jpg"), image, [cv2.IMWRITE_JPEG_QUALITY, 90])
    save_cameras(out / "calibration.toml", {camera.name: camera for camera in CAMERAS})
    seconds = np.arange(FRAMES) / FPS
    for name, (_, route), body in zip("AB", cast, bodies, strict=True):
        points = true_landmarks(body, route.motion(body, seconds))
        write_trc(out / f"landmarks_{name}.trc", list(body.landmarks), points, FPS)
    staggered = {"A": KEYS, "B": STAGGERED}
    for file, keys in (("shot", {"A": KEYS, "B": KEYS}), ("shot_staggered", staggered), ("shot_A", {"A": KEYS}),
                       ("shot_B", {"B": KEYS})):  # fmt: skip
        (out / f"{file}.toml").write_text(shot_file(keys), encoding="utf-8")


def shot_file(keys: dict[str, Sequence[int]]) -> str:
    """The shot file of the performers with these key frames."""
    views = "".join(f'\n[[view]]\ncamera = "{c.name}"\nfootage = "{c.name}/%04d.jpg"\n' for c in CAMERAS)
    performers = "".join(
        f'\n[[performer]]\nname = "{name}"\nlandmarks = "landmarks_{name}.trc"\nkeyframes = {list(frames)}\n'
        for name, frames in keys.items()
    )
    return (
        f'[shot]\nname = "crossing"\nfps = {FPS}\nframes = [0, {FRAMES - 1}]\n\n'
        f'[calibration]\nfile = "calibration.toml"\n{views}{performers}'
    )


def main() -> None:
    """Render the shot."""
    form = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=form)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--clothes", choices=("different", "equal"), default="different")
    args = parser.parse_args()
    render(args.out, args.clothes == "equal")


if __name__ == "__main__":
    main()
