#!/usr/bin/env python3
"""Render two or four people who walk past each other and hide each other; needs no Blender.

    .venv/bin/python tools/render_crossing.py --out build/crossing [--people 4] [--clothes equal] [--only A B]

Writes footage, calibration.toml, landmarks_A.trc, landmarks_B.trc, ..., and shot files with all performers (shot.toml,
shot_staggered.toml) and with one of them (shot_A.toml, ...), while the others are in the picture. With --only, nobody
but these people is in the picture: what the others cost them is the difference.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from kfmocap.core.body import Body
from kfmocap.core.body.motion import Motion
from kfmocap.core.cameras.camera import Camera
from kfmocap.core.formats import save_cameras, write_trc
from kfmocap.core.numerics.arrays import Array
from render.benchmark_movements import STROLL
from render.benchmark_shots import SPORTS, STRIPED, ring
from render.drawing import linear
from render.movement_phrases import Movement
from render.painted_scene import Floor, PaintedView, Sensor, Surface, joined, lit
from render.people import Person, Wardrobe, skin_at, true_landmarks

VOXEL = 0.014
"""Size of the cells in which the surface of a person is found, metres."""
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


@dataclass(frozen=True)
class Crossing:
    """A shot of people who cross.

    Attributes
    ----------
    cast : mapping of str to (Person, Route)
        Who walks, and where, by name.
    cameras : tuple of Camera
    fps : float
    frames : int
    keys : tuple of int
        Key frames of everybody.
    staggered : tuple of int
        Those of every second person in the shot whose key frames are staggered.
    """

    cast: dict[str, tuple[Person, Route]]
    cameras: tuple[Camera, ...]
    fps: float
    frames: int
    keys: tuple[int, ...]
    staggered: tuple[int, ...]

    def only(self, names: Sequence[str]) -> Crossing:
        """The shot with nobody but these people in the picture."""
        return replace(self, cast={name: self.cast[name] for name in names})


def two_people(equal: bool) -> Crossing:
    """Two who pass each other, each more than half hidden by the other in every view for some frames."""
    man, woman = Person(1.8, BLUE, MAN), Person(1.68, BLUE if equal else RED, WOMAN)
    cast = {
        "A": (man, Route.of(STROLL, 0.0, (0.0, -0.32, 0.0))),
        "B": (woman, Route.of(STROLL, 180.0, (0.05, 0.32, 0.0))),
    }
    return Crossing(cast, ring(3, 4.1, 540, -115, 25), 25.0, 49, (0, 24, 48), (10, 36))


def four_people(equal: bool) -> Crossing:
    """Four who walk side by side, every second one against the others."""
    clothes = (BLUE,) * 4 if equal else (BLUE, RED, SPORTS, STRIPED)
    builds = ((1.8, MAN), (1.68, WOMAN), (1.86, {}), (1.6, {}))
    places = ((0.1, -0.8), (-0.1, -0.25), (0.0, 0.3), (0.1, 0.85))
    cast = {
        name: (Person(height, worn, build), Route.of(replace(STROLL, seed=seed), turn, (*place, 0.0)))
        for name, (height, build), worn, seed, turn, place in zip(
            "ABCD", builds, clothes, (9, 21, 31, 41), (0.0, 180.0, 0.0, 180.0), places, strict=True
        )
    }
    return Crossing(cast, ring(4, 4.6, 480, -150, 40), 30.0, 41, (0, 20, 40), (10, 30))


SHOTS = {2: two_people, 4: four_people}


def render(out: Path, shot: Crossing) -> None:
    """Render the shot into a folder."""
    cast = list(shot.cast.values())
    bodies = [person.body() for person, _ in cast]
    figures = [person.figure(body, VOXEL) for (person, _), body in zip(cast, bodies, strict=True)]
    views = [PaintedView(camera, None) for camera in shot.cameras]
    for camera in shot.cameras:
        (out / camera.name).mkdir(parents=True, exist_ok=True)
    for frame in range(shot.frames):
        times = (frame + 0.4 * (np.arange(2) / 2 - 0.25)) / shot.fps
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
    save_cameras(out / "calibration.toml", {camera.name: camera for camera in shot.cameras})
    seconds = np.arange(shot.frames) / shot.fps
    for name, (_, route), body in zip(shot.cast, cast, bodies, strict=True):
        points = true_landmarks(body, route.motion(body, seconds))
        write_trc(out / f"landmarks_{name}.trc", list(body.landmarks), points, shot.fps)
    for file, keys in shot_files(shot).items():
        (out / f"{file}.toml").write_text(shot_file(shot, keys), encoding="utf-8")


def shot_files(shot: Crossing) -> dict[str, dict[str, Sequence[int]]]:
    """Key frames of the performers by the names of the shot files that are written."""
    names = list(shot.cast)
    files: dict[str, dict[str, Sequence[int]]] = {f"shot_{name}": {name: shot.keys} for name in names}
    if len(names) > 1:
        files["shot"] = dict.fromkeys(names, shot.keys)
        files["shot_staggered"] = {n: shot.staggered if k % 2 else shot.keys for k, n in enumerate(names)}
    return files


def shot_file(shot: Crossing, keys: dict[str, Sequence[int]]) -> str:
    """The text of the shot file of the performers with these key frames."""
    views = "".join(f'\n[[view]]\ncamera = "{c.name}"\nfootage = "{c.name}/%04d.jpg"\n' for c in shot.cameras)
    performers = "".join(
        f'\n[[performer]]\nname = "{name}"\nlandmarks = "landmarks_{name}.trc"\nkeyframes = {list(frames)}\n'
        for name, frames in keys.items()
    )
    return (
        f'[shot]\nname = "crossing"\nfps = {shot.fps}\nframes = [0, {shot.frames - 1}]\n\n'
        f'[calibration]\nfile = "calibration.toml"\n{views}{performers}'
    )


def main() -> None:
    """Render the shot."""
    form = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=form)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--people", type=int, choices=tuple(SHOTS), default=2)
    parser.add_argument("--clothes", choices=("different", "equal"), default="different")
    parser.add_argument("--only", nargs="+", metavar="NAME", help="those in the picture, of A, B, ... (default: all)")
    args = parser.parse_args()
    shot = SHOTS[args.people](args.clothes == "equal")
    only = args.only if args.only is not None else list(shot.cast)
    if unknown := [name for name in only if name not in shot.cast]:
        parser.error(f"--only {unknown[0]}: nobody has that name; choose from {', '.join(shot.cast)}")
    render(args.out, shot.only(only))


if __name__ == "__main__":
    main()
