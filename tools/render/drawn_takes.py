"""Takes like those of the papers' cameras: one of them, and others that are drawn at random. Needs no Blender."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from kfmocap.core.cameras.camera import Camera

from .drawing import Ball, Rod, linear
from .takes import camera_looking_at
from .waving import NOISE, PAINT, WandTake

VGA_CAMERAS = tuple(
    camera_looking_at(name, place, at, focal, distortions=(*lens, 0.0, 0.0), size=(640, 480))
    for name, place, at, focal, lens in (
        ("cam01", (-2.7, -2.9, 1.9), (0.1, 0.0, 0.75), 610.0, (-0.16, 0.04)),
        ("cam02", (2.9, -2.7, 1.7), (-0.1, 0.1, 0.8), 640.0, (-0.10, 0.0)),
        ("cam03", (2.7, 2.8, 2.1), (0.0, -0.1, 0.75), 575.0, (-0.19, 0.05)),
        ("cam04", (-2.8, 2.7, 1.8), (0.0, 0.1, 0.8), 600.0, (0.05, 0.0)),
    )
)
"""Video cameras of the nineties, some four metres from the centre of the room."""


def vga_take() -> WandTake:
    """A take as the papers' cameras filmed it: 640 x 480 pixels, balls four to five pixels across."""
    points = np.array([[0, 0, 0], [0.3, 0, 0], [0.6, 0, 0], [0, 0.2, 0]], float)
    return WandTake(
        cameras=VGA_CAMERAS,
        frames=300,
        diameter=0.03,
        lframe_diameter=0.035,
        distractors=False,
        books=True,
        lframe_points=points,
    )


@dataclass(frozen=True)
class Hardship:
    """What makes a take hard to calibrate from.

    Attributes
    ----------
    dimmed : float
        Share of the usual light.
    covered : bool
        Whether one camera does not see one ball of the L-frame.
    crowded : bool
        Whether somebody in a shirt of almost the wand's colour waves it, among other things of the balls' colours.
    speed, exposure, noise : float
        As of `WandTake`.
    """

    speed: float = 1.0
    exposure: float = 1 / 60
    dimmed: float = 1.0
    noise: float = NOISE
    covered: bool = False
    crowded: bool = False


HARDSHIPS = {
    "usual": Hardship(),
    "fast": Hardship(speed=1.6, covered=True),
    "crowded": Hardship(crowded=True),
    "dim": Hardship(dimmed=0.55, noise=4.0),
    "hard": Hardship(speed=1.6, exposure=1 / 40, dimmed=0.55, noise=4.0, covered=True),
}


def drawn_take(seed: int, hardship: Hardship) -> WandTake:
    """A take like `vga_take` with cameras, lenses, furniture, light and waving that are drawn at random."""
    rng = np.random.default_rng([seed, 22])
    ball = (int(rng.integers(4)), int(rng.integers(4)))
    return replace(
        vga_take(),
        cameras=tuple(_drawn_camera(k, rng) for k in range(4)),
        offsets=(0.0, *rng.uniform(-8, 8, 3).round(2).tolist()),
        phases=tuple(rng.uniform(0, 2 * np.pi, 3).tolist()),
        speed=hardship.speed * rng.uniform(0.9, 1.1),
        exposure=hardship.exposure,
        light=tuple((hardship.dimmed * rng.uniform([0.75, 0.9, 0.95], [1.0, 1.0, 1.1])).tolist()),
        noise=hardship.noise,
        covered=ball if hardship.covered else None,
        distractors=hardship.crowded,
        books=False,
        furniture=tuple(_drawn_furniture(rng)),
    )


def _drawn_camera(k: int, rng: np.random.Generator) -> Camera:
    """One of four cameras around the room, some four metres from its middle."""
    angle = np.pi / 2 * k + np.radians(225) + rng.uniform(-0.25, 0.25)
    away = rng.uniform(3.7, 4.3)
    place = (away * np.cos(angle), away * np.sin(angle), rng.uniform(1.5, 2.3))
    k1 = rng.uniform(-0.22, 0.06)
    lens = (k1, max(-0.25 * k1, 0.0), 0.0, 0.0)
    middle = rng.normal(0, 0.1, 2)
    return camera_looking_at(
        f"cam{k + 1:02d}",
        place,
        (middle[0], middle[1], rng.uniform(0.7, 0.9)),
        rng.uniform(560, 670),
        distortions=lens,
        size=(640, 480),
    )


def _drawn_furniture(rng: np.random.Generator) -> list[Ball | Rod]:
    """Red books and a few other things along the walls and on the floor."""
    things: list[Ball | Rod] = []
    for _ in range(14):
        along, height = rng.uniform(-4, 4), rng.uniform(0.6, 1.8)
        x, y = ((4.5, along), (-4.5, along), (along, 4.5), (along, -5.0))[rng.integers(4)]
        for n in range(rng.integers(1, 5)):
            foot = np.array([x + 0.06 * n * (abs(x) < 4.4), y + 0.06 * n * (abs(x) > 4.4), height])
            things.append(Rod(foot[None], (foot + [0, 0, rng.uniform(0.12, 0.24)])[None], 0.02, PAINT["red"]))
    for _ in range(5):
        angle, away, turn = rng.uniform(0, 2 * np.pi), rng.uniform(1.2, 2.6), rng.uniform(0, 2 * np.pi)
        foot = np.array([away * np.cos(angle), away * np.sin(angle), 0.02])
        tip = foot + rng.uniform(0.05, 0.2) * np.array([np.cos(turn), np.sin(turn), 0])
        things.append(Rod(foot[None], tip[None], rng.uniform(0.015, 0.03), PAINT["red"]))
    for _ in range(6):
        angle, away = rng.uniform(0, 2 * np.pi), rng.uniform(3.0, 4.2)
        foot = np.array([away * np.cos(angle), away * np.sin(angle), 0.1])
        paint = linear(rng.uniform(0.1, 0.8, 3))
        things.append(Rod(foot[None], (foot + [0, 0, rng.uniform(0.3, 1.0)])[None], rng.uniform(0.04, 0.15), paint))
    return things
