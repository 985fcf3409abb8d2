"""The calibration take: an L-frame on the floor, a waved wand, and distracting objects of the same colours.

Needs no Blender.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import cv2
import numpy as np
from kfmocap.core.cameras.camera import Camera
from kfmocap.core.numerics.arrays import Array
from numpy.typing import NDArray

from .drawing import GAMMA, Ball, Canvas, Rod, linear
from .takes import camera_looking_at

SIZE = (960, 540)
CAMERAS = (
    camera_looking_at(
        "cam01", (-3.4, -3.6, 1.9), (0.1, 0.0, 0.85), 860.0, distortions=(-0.17, 0.04, 0.0, 0.0), size=SIZE
    ),
    camera_looking_at(
        "cam02", (3.5, -3.3, 1.6), (-0.1, 0.1, 0.9), 905.0, distortions=(-0.11, 0.0, 0.0, 0.0), size=SIZE
    ),
    camera_looking_at("cam03", (3.2, 3.4, 2.1), (0.0, -0.1, 0.8), 780.0, distortions=(-0.2, 0.06, 0.0, 0.0), size=SIZE),
    camera_looking_at("cam04", (-3.3, 3.2, 1.7), (0.0, 0.1, 0.85), 835.0, distortions=(0.06, 0.0, 0.0, 0.0), size=SIZE),
)
"""Around the centre of the room, each with its own lens."""
OFFSETS = (0.0, 3.4, -2.75, 6.2)
"""Frame f of the take is the camera's video frame f + offset: the cameras were not started together."""
LFRAME = np.array([[0, 0, 0], [0.4, 0, 0], [0.9, 0, 0], [0, 0.6, 0]], float)
PAINT = {
    "red": linear([0.08, 0.05, 0.80]),
    "green": linear([0.16, 0.66, 0.12]),
    "blue": linear([0.78, 0.25, 0.06]),
    "yellow": linear([0.08, 0.76, 0.86]),
    "shirt": linear([0.20, 0.56, 0.16]),
    "skin": linear([0.52, 0.63, 0.80]),
    "cloth": linear([0.30, 0.24, 0.22]),
    "wood": linear([0.20, 0.22, 0.24]),
}
"""Blue, green, red."""
NOISE = 1.5
"""Standard deviation of the sensor noise, grey levels of 255."""


@dataclass(frozen=True, eq=False)
class WandTake:
    """The cameras, the calibration objects and how they are filmed.

    Attributes
    ----------
    cameras : tuple of Camera
    offsets : tuple of float
        Time offset of each camera's video, frames.
    frames : int
        Length of each video of the wand.
    fps : float
    exposure : float
        Seconds.
    colours : tuple of str
        Colours of the wand's balls: one for both, or two.
    length : float
        Length of the wand, metres.
    diameter : float
        Diameter of the wand's balls, metres.
    lframe_diameter : float, optional
        Diameter of the L-frame's balls, metres; by default that of the wand's.
    distractors : bool
        Objects of the balls' colours: balls that lie about or roll by, discs on the wall, the shirt of whoever waves.
    books : bool
        Red books on a shelf, on the floor and in front of a wall, in all videos.
    speed : float
        Of the wand, as a multiple of walking about calmly.
    phases : tuple of float
        Where the wand begins.
    light : tuple of float
        How bright the room is, in blue, green and red.
    noise : float
        Standard deviation of the sensor noise, grey levels of 255.
    furniture : tuple of Ball or Rod
        What else stands in the room, in all videos.
    covered : tuple of int, optional
        A camera that does not see one ball of the L-frame: its index and the ball's.
    """

    cameras: tuple[Camera, ...] = CAMERAS
    offsets: tuple[float, ...] = OFFSETS
    frames: int = 480
    fps: float = 30.0
    exposure: float = 1 / 60
    colours: tuple[str, ...] = ("green", "blue")
    length: float = 0.5
    diameter: float = 0.075
    distractors: bool = True
    books: bool = False
    lframe_diameter: float | None = None
    lframe_points: Array = field(default_factory=LFRAME.copy)
    lframe_frames: int = 12
    speed: float = 1.0
    phases: tuple[float, float, float] = (0.3, 1.7, 0.9)
    light: tuple[float, float, float] = (1.0, 1.0, 1.0)
    noise: float = NOISE
    furniture: tuple[Ball | Rod, ...] = ()
    covered: tuple[int, int] | None = None

    def wand(self, seconds: Array) -> Array:
        """The centres of the wand's balls, shape (..., 2, 3), metres."""
        t = self.speed * np.asarray(seconds, float)[..., None]
        rates, phases = np.array([1.21, 0.93, 1.57]), np.array(self.phases)
        middle = np.array([0.0, 0.0, 1.15]) + [1.6, 1.5, 0.7] * np.sin(rates * t + phases)
        turn = np.concatenate([np.sin(1.61 * t), np.cos(1.27 * t + 0.4), 1.1 * np.sin(0.93 * t + 1.1)], axis=-1)
        along = self.length / 2 * turn / np.linalg.norm(turn, axis=-1, keepdims=True)
        return np.stack([middle - along, middle + along], axis=-2)

    def moments(self, camera: int, frame: int) -> Array:
        """Times, seconds of the take, spread evenly over the exposure of a video's frame."""
        middle = (frame - self.offsets[camera]) / self.fps
        steps = 8 if self.exposure else 1
        return middle + self.exposure * ((np.arange(steps) + 0.5) / steps - 0.5)

    def truth(self, camera: int) -> Array:
        """Pixels of the wand's ball centres at the middle of each exposure, shape (frames, 2, 2)."""
        seconds = (np.arange(self.frames) - self.offsets[camera]) / self.fps
        return self.cameras[camera].project(self.wand(seconds))

    def wand_things(self, seconds: Array) -> list[Ball | Rod]:
        """Everything that moves during an exposure while the wand is waved."""
        first, second = np.moveaxis(self.wand(seconds), 1, 0)
        along = (second - first) / self.length
        radius, paint = self.diameter / 2, [PAINT[name] for name in self.colours]
        things: list[Ball | Rod] = [
            Ball(first, radius, paint[0]),
            Ball(second, radius, paint[-1]),
            Rod(first + 0.9 * radius * along, second - 0.9 * radius * along, 0.24 * radius, PAINT["wood"]),
        ]
        return things + (self._passing(seconds[:, None]) if self.distractors else [])

    def still_things(self) -> list[Ball | Rod]:
        """Distracting objects that stand still while the wand is waved."""
        first, last = PAINT[self.colours[0]], PAINT[self.colours[-1]]
        things: list[Ball | Rod] = [
            Ball(_at(1.3, 1.4, 0.03), self.diameter / 2, first),  # looks like a ball of the wand, but lies still
            Ball(_at(-1.7, -0.6, 0.09), 0.09, last),
            Rod(_at(-1.5, 4.55, 1.7), _at(-1.4, 4.55, 1.75), 0.06, last),
            Rod(_at(4.5, 0.6, 1.2), _at(4.5, 1.2, 1.2), 0.05, first),
        ]
        return (things if self.distractors else []) + self._room_things()

    def _room_things(self) -> list[Ball | Rod]:
        return (_books() if self.books else []) + list(self.furniture)

    def _cover(self) -> list[Ball | Rod]:
        """Something grey right before a ball of the L-frame."""
        if self.covered is None:
            return []
        camera, ball = self.covered
        way = self.cameras[camera].centre_world() - self.lframe_points[ball]
        return [Ball((self.lframe_points[ball] + 0.2 * way / np.linalg.norm(way))[None], 0.05, PAINT["cloth"])]

    def _passing(self, t: Array) -> list[Ball | Rod]:
        rolling = np.concatenate([-1.5 + 0.5 * t, 1.6 + 0.2 * np.sin(t), np.full_like(t, 0.05)], axis=1)
        return [Ball(rolling, 0.05, PAINT[self.colours[0]]), *self._waver(t)]

    def _waver(self, t: Array) -> list[Ball | Rod]:
        """A person behind the wand, in a shirt of nearly the colour of its first ball."""
        hand = self.wand(t[:, 0]).mean(axis=1)
        feet = hand * [0.4, 0.4, 0]
        shoulder = feet + [0.0, 0.0, 1.35]
        reach = hand - shoulder
        reach *= np.minimum(1, 0.6 / np.linalg.norm(reach, axis=1, keepdims=True))
        return [
            Rod(feet + [0, 0, 0.1], feet + [0, 0, 0.8], 0.13, PAINT["cloth"]),
            Rod(feet + [0, 0, 0.95], shoulder, 0.17, PAINT["shirt"]),
            Ball(feet + [0, 0, 1.68], 0.12, PAINT["skin"]),
            Rod(shoulder, shoulder + reach, 0.045, PAINT["skin"]),
        ]

    def lframe_things(self) -> list[Ball | Rod]:
        """Everything in view while the L-frame lies on the floor."""
        p, radius = self.lframe_points, (self.lframe_diameter or self.diameter) / 2
        things: list[Ball | Rod] = [Ball(ball[None], radius, PAINT["red"]) for ball in p]
        for a, b in ((0, 1), (1, 2), (0, 3)):
            trim = 0.9 * radius * (p[b] - p[a]) / np.linalg.norm(p[b] - p[a])
            things.append(Rod((p[a] + trim)[None], (p[b] - trim)[None], 0.27 * radius, PAINT["wood"]))
        if self.distractors:
            things += [
                Ball(_at(-0.9, 0.5, 0.0), self.diameter / 2, PAINT["red"]),
                Ball(_at(1.8, 0.7, 0.05), 0.08, PAINT["red"]),
                Rod(_at(-4.5, 0.0, 1.4), _at(-4.5, 0.5, 1.4), 0.07, PAINT["red"]),
            ]
        return things + self._room_things() + self._cover()


def _books() -> list[Ball | Rod]:
    """Red books: a row on a shelf, a pile on the floor, single ones that are as small in the picture as a ball."""
    spines = [(4.6, 0.4 + 0.09 * k, 1.3) for k in range(5)] + [(0.7 + 0.11 * k, 4.7, 0.9) for k in range(4)]
    upright = [Rod(_at(x, y, z), _at(x, y, z + 0.22), 0.02, PAINT["red"]) for x, y, z in spines]
    lying = [Rod(_at(-1.6, 1.1, 0.02 + 0.04 * k), _at(-1.4, 1.25, 0.02 + 0.04 * k), 0.02, PAINT["red"]) for k in (0, 1)]
    single = [(1.1, -0.9, 0.02), (-4.7, -0.6, 0.7), (-0.4, -4.8, 1.1)]
    return [
        *upright,
        *lying,
        *(Rod(_at(x, y, z), _at(x + 0.05, y + 0.04, z), 0.018, PAINT["red"]) for x, y, z in single),
    ]


def _at(x: float, y: float, z: float) -> Array:
    return np.array([[x, y, z]])


def wand_pictures(take: WandTake, camera: int) -> Iterator[NDArray[np.uint8]]:
    """Draw the frames of a camera's video of the wand."""
    canvas = Canvas(take.cameras[camera], take.still_things())
    sensor = SensorNoise(take.cameras[camera].size, camera, take.noise)
    light = np.array(take.light, np.float32)
    for frame in range(take.frames):
        yield sensor.record(light * canvas.drawn(take.wand_things(take.moments(camera, frame))))


def lframe_pictures(take: WandTake, camera: int) -> Iterator[NDArray[np.uint8]]:
    """Draw the frames of a camera's video of the L-frame."""
    sensor = SensorNoise(take.cameras[camera].size, 100 + camera, take.noise)
    picture = np.array(take.light, np.float32) * Canvas(take.cameras[camera]).drawn(take.lframe_things())
    for _ in range(take.lframe_frames):
        yield sensor.record(picture)


class SensorNoise:
    """A camera sensor: slight blur, gamma, and noise that is generated once and shifted at random."""

    def __init__(self, size: tuple[int, int], seed: int, noise: float = NOISE) -> None:
        self.rng = np.random.default_rng(seed)
        self.noise = self.rng.normal(0, noise, (2 * size[1], 2 * size[0], 3)).astype(np.float32)

    def record(self, light: NDArray[np.float32]) -> NDArray[np.uint8]:
        """Record linear light as a picture of grey levels."""
        height, width = light.shape[:2]
        levels = cv2.pow(cv2.GaussianBlur(light, (5, 5), 0.55), 1 / GAMMA)
        row, column = self.rng.integers(0, [height, width])
        noise = self.noise[row : row + height, column : column + width]
        return cv2.convertScaleAbs(cv2.scaleAdd(levels, 255, noise))
