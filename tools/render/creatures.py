"""Characters whose skeletons are unlike the tracker's own body: a person's, a dog's and a hammer's. Needs no Blender.

Each is a skin over bones and a movement of about one second's period, so that key poses every 24 frames say little of
what is between them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from kfmocap.core.body import Body, Part, human, part_poses
from kfmocap.core.body.motion import Motion
from kfmocap.core.cameras.camera import Camera
from kfmocap.core.numerics import rotations
from numpy.typing import NDArray

from .benchmark_shots import ring
from .figure import Figure, make_figure
from .movement_phrases import Movement, Phrase
from .shapes import Shape
from .takes import camera_looking_at
from .textures import noise

Array = NDArray[np.float64]
Point = tuple[float, float, float]
FPS = 30.0
FRAMES = 73
KEY_EVERY = 24


@dataclass(frozen=True, eq=False)
class HeldProp:
    """A prop that a character holds all the time.

    Attributes
    ----------
    figure : Figure
        Of one part.
    part : str
        The character's part that holds it.
    turn, place : ndarray, shape (3, 3) and (3,)
        The prop's pose in the axes of that part, metres.
    """

    figure: Figure
    part: str
    turn: Array
    place: Array

    def poses(self, body: Body, motion: Motion) -> tuple[Array, Array]:
        """World rotations (F, 1, 3, 3) and joints (F, 1, 3), as the character moves."""
        R, T = (values[:, [body.index(self.part)]] for values in part_poses(body, motion))
        return R @ self.turn, T + R @ self.place


@dataclass(frozen=True, eq=False)
class Creature:
    """A character or a thing, how it moves, how it is filmed, and how its rig is built.

    Attributes
    ----------
    figure : Figure
        Skin, weights and colours.
    motion : callable
        From times, seconds, shape (F,), to F poses.
    bones : mapping of str to str
        Name of the rig's bone by the name of the part.
    spare : mapping of str to (str, Point, Point)
        Bones that lead no skin and are not moved: the part above, head and tail in the stance, metres.
    scale : float
        Of the armature object.
    upright : bool
        If not, the armature object is turned by 90 degrees about x, as importers of FBX leave it.
    modes : tuple of str
        Rotation modes that the bones have in turn.
    prop : HeldProp, optional
    """

    name: str
    figure: Figure
    motion: Callable[[Array], Motion]
    cameras: tuple[Camera, ...]
    bones: Mapping[str, str]
    spare: Mapping[str, tuple[str, Point, Point]]
    scale: float = 1.0
    upright: bool = True
    modes: tuple[str, ...] = ("QUATERNION",)
    prop: HeldProp | None = None

    @property
    def key_frames(self) -> tuple[int, ...]:
        """Frames with key poses, from 0."""
        return tuple(range(0, FRAMES, KEY_EVERY))


def _goals(**goals: float) -> dict[str, float]:
    return {name.replace("_", "."): value for name, value in goals.items()}


EXERCISES = Movement(
    _goals(drop_L=75, drop_R=75, elbow_L=15, elbow_R=15, heading=-85),
    (
        Phrase(0.05, 0.45, "swing", _goals(drop_L=-40, elbow_L=30, side=14, twist=18, look=-15)),
        Phrase(0.10, 0.45, "swing", _goals(flex_R=70, knee_R=85, drop_R=40, swing_R=55, elbow_R=80)),
        Phrase(0.55, 0.40, "swing", _goals(drop_L=65, swing_L=60, elbow_L=90, side=-8, twist=-20, look=12)),
        Phrase(0.55, 0.40, "swing", _goals(flex_R=-12, knee_R=35, drop_R=-30, swing_R=0, elbow_R=20, z=-0.06)),
        Phrase(1.00, 0.45, "swing", _goals(drop_L=-30, swing_L=10, elbow_L=15, bend=22, nod=12, twist=10, heading=-60)),
        Phrase(1.00, 0.45, "swing", _goals(flex_R=55, spread_R=25, knee_R=40, drop_R=60, elbow_R=105, z=-0.02)),
        Phrase(1.50, 0.40, "swing", _goals(drop_L=70, elbow_L=95, swing_L=45, bend=0, nod=0, twist=-15, side=10)),
        Phrase(1.50, 0.42, "swing", _goals(flex_R=5, spread_R=0, knee_R=80, drop_R=-20, elbow_R=30, heading=-95)),
        Phrase(1.95, 0.45, "swing", _goals(drop_L=20, elbow_L=20, swing_L=0, twist=10, side=0, look=-10)),
        Phrase(1.95, 0.45, "swing", _goals(flex_R=2, knee_R=6, drop_R=75, elbow_R=20, swing_R=20, z=0.0)),
    ),
    free="R",
    seed=31,
)
"""A person on one leg who swings arms, trunk and the other leg."""


def person(voxel: float = 0.012) -> Creature:
    """A person, as importers of FBX leave one: an armature of scale 0.01, bones beside the limbs' directions."""
    body = human(1.68, {"thigh": 0.43, "forearm": 0.26}, collar_bones=False)
    names = {
        "pelvis": "J_Root", "spine": "J_Waist", "chest": "J_Thorax", "head": "J_Skull",
        "upper_arm": "Ude_1", "forearm": "Ude_2", "hand": "Te", "thigh": "Momo", "shin": "Sune", "foot": "Ashi",
    }  # fmt: skip
    bones = {p.name: names[p.name.split(".")[0]] + {"L": "_l", "R": "_r"}.get(p.name[-1], "") for p in body.parts}
    figure = make_figure(body, voxel)
    spare: dict[str, tuple[str, Point, Point]] = {}
    for side in "LR":
        i = body.index(f"hand.{side}")
        tip = figure.T_stance[i] + 0.2 * figure.R_stance[i][:, 1]
        start = figure.T_stance[i] + 0.1 * figure.R_stance[i][:, 1]
        spare[f"Yubi_{side.lower()}_end"] = (f"hand.{side}", _point(start), _point(tip))
    return Creature(
        "person", figure, lambda t: EXERCISES.motion(body, t), ring(3, 3.9, 560, -125, 60), bones, spare,
        scale=0.01, upright=False,
    )  # fmt: skip


def _point(values: Array) -> Point:
    x, y, z = (float(v) for v in values)
    return x, y, z


_DOG: dict[str, tuple[str, Point, Point]] = {
    "hips": ("", (0, 0.30, 0.60), (0, 0.10, 0.62)),
    "back": ("hips", (0, 0.10, 0.62), (0, -0.12, 0.60)),
    "ribs": ("back", (0, -0.12, 0.60), (0, -0.36, 0.62)),
    "neck": ("ribs", (0, -0.36, 0.65), (0, -0.52, 0.82)),
    "head": ("neck", (0, -0.52, 0.82), (0, -0.76, 0.78)),
    "tail_1": ("hips", (0, 0.36, 0.62), (0, 0.50, 0.60)),
    "tail_2": ("tail_1", (0, 0.50, 0.60), (0, 0.64, 0.63)),
    "tail_3": ("tail_2", (0, 0.64, 0.63), (0, 0.78, 0.70)),
}
for _side, _sign in (("L", 1.0), ("R", -1.0)):
    _x = 0.10 * _sign
    _DOG |= {
        f"thigh.{_side}": ("hips", (_x, 0.27, 0.56), (_x, 0.19, 0.36)),
        f"shank.{_side}": (f"thigh.{_side}", (_x, 0.19, 0.36), (_x, 0.36, 0.19)),
        f"hock.{_side}": (f"shank.{_side}", (_x, 0.36, 0.19), (_x, 0.30, 0.02)),
        f"shoulder.{_side}": ("ribs", (_x, -0.32, 0.56), (_x, -0.22, 0.38)),
        f"foreleg.{_side}": (f"shoulder.{_side}", (_x, -0.22, 0.38), (_x, -0.27, 0.17)),
        f"paw.{_side}": (f"foreleg.{_side}", (_x, -0.27, 0.17), (_x, -0.30, 0.02)),
    }
_DOG_GIRTH: Mapping[str, tuple[float, float]] = {
    "hips": (0.115, 0.105), "back": (0.11, 0.10), "ribs": (0.125, 0.145), "neck": (0.085, 0.075),
    "head": (0.085, 0.042), "tail_1": (0.035, 0.032), "tail_2": (0.032, 0.028), "tail_3": (0.028, 0.012),
    "thigh": (0.085, 0.06), "shank": (0.05, 0.032), "hock": (0.032, 0.036), "shoulder": (0.07, 0.048),
    "foreleg": (0.046, 0.032), "paw": (0.034, 0.04),
}  # fmt: skip
"""Radius at the head and at the tail of a bone, metres."""
_STRIDE = 0.9
"""Seconds of a dog's step."""
_LEGS = ("thigh.L", "thigh.R", "shoulder.L", "shoulder.R")


def dog(voxel: float = 0.012) -> Creature:
    """A dog that trots and turns, with a spine, a neck and a tail; its bones turn by Euler angles of several orders."""
    parts: list[Part] = []
    for name, (above, head, tail) in _DOG.items():
        parent = [p.name for p in parts].index(above) if above else -1
        parts.append(Part(name, parent, np.array(head, float), np.array(tail, float), np.eye(3), np.zeros((0, 3))))
    body = Body(tuple(parts), {})
    shapes = []
    for part in body.parts:
        along = part.tail_world - part.head_world
        a, b = _DOG_GIRTH[part.name.split(".")[0]]
        deep = (0.0, 0.0, 1.0) if abs(along[1]) > abs(along[2]) else (0.0, 1.0, 0.0)
        stations = ((0.0, a, a, 0.0), (0.5, (a + b) / 2, (a + b) / 2, 0.0), (1.0, b, b, 0.0))
        shapes.append(Shape(part.name, (0, 0, 0), _point(along), stations, deep))
    for sign in (1.0, -1.0):  # ears
        shapes.append(Shape("head", (0.06 * sign, 0.02, 0.05), (0.1 * sign, 0.05, 0.12),
                            ((0.0, 0.03, 0.015, 0.0), (1.0, 0.02, 0.01, 0.0))))  # fmt: skip
    figure = make_figure(body, voxel, shapes, _coat, pose=resting(body))
    bones = {name: "b_" + name.replace(".", "_").upper() for name in body.names}
    spare = {"b_TAIL_nub": ("tail_3", (0.0, 0.78, 0.70), (0.0, 0.82, 0.72))}
    return Creature(
        "dog", figure, lambda t: _trot(body, t), ring(3, 3.6, 620, -150, 65, at=(0.0, 0.0, 0.5)), bones, spare,
        modes=("XYZ", "ZXY", "QUATERNION", "YZX"),
    )  # fmt: skip


def resting(body: Body) -> Motion:
    """The rest pose of a body."""
    return Motion(np.array([body.parts[0].head_world]), np.eye(3)[None, None].repeat(len(body), axis=1))


def _trot(body: Body, t: Array) -> Motion:
    phase = 2 * np.pi * t / _STRIDE
    zero = np.zeros_like(t)
    yaw = 0.5 * np.sin(2 * np.pi * t / 2.6)
    angles = {
        "hips": (0.06 * np.sin(2 * phase), 0.05 * np.sin(phase), yaw),
        "back": (0.10 * np.sin(2 * phase + 1), zero, 0.10 * np.sin(phase)),
        "ribs": (-0.08 * np.sin(2 * phase), zero, 0.12 * np.sin(phase + 0.5)),
        "neck": (0.22 * np.sin(phase + 0.4), zero, 0.30 * np.sin(0.9 * phase)),
        "head": (0.25 * np.sin(1.1 * phase), zero, 0.35 * np.sin(0.8 * phase + 1)),
        "tail_1": (-0.3 + 0.1 * np.sin(phase), zero, 0.5 * np.sin(1.2 * phase)),
        "tail_2": (zero, zero, 0.5 * np.sin(1.2 * phase - 0.7)),
        "tail_3": (zero, zero, 0.5 * np.sin(1.2 * phase - 1.4)),
    }
    for leg, shift in zip(_LEGS, (0.0, np.pi, np.pi + 0.3, 0.3), strict=True):
        kind, side = leg.split(".")
        swing, lift = np.sin(phase + shift), np.clip(np.cos(phase + shift), 0, 1)
        lower, foot = ("shank", "hock") if kind == "thigh" else ("foreleg", "paw")
        bend = 0.75 if kind == "thigh" else -0.9
        angles[leg] = (0.5 * swing - 0.3 * bend * lift, zero, zero)
        angles[f"{lower}.{side}"] = (bend * lift, zero, zero)
        angles[f"{foot}.{side}"] = (-0.8 * bend * lift, zero, zero)
    # The path is summed from the beginning on, so that it does not depend on which times are asked for.
    fine = np.arange(0, max(t.max(), 0) + 0.1, 0.002)
    turn = 0.5 * np.sin(2 * np.pi * fine / 2.6)
    ways = np.cumsum(np.stack([np.sin(turn), -np.cos(turn)], axis=1), axis=0) * 0.002 * 0.55
    path = np.stack([np.interp(t, fine, ways[:, k]) for k in (0, 1)], axis=1)
    rise = 0.02 * np.sin(2 * phase)
    root = body.parts[0].head_world + [0, 0.45, 0] + np.column_stack([path, rise])
    turns = [angles[name] for name in body.names]
    Q = [
        rotations.exp(np.stack([zero, zero, aside], axis=1)) @ rotations.exp(np.stack([up, roll, zero], axis=1))
        for up, roll, aside in turns
    ]
    return Motion(root, np.stack(Q, axis=1))


def _coat(body: Body, nearest: NDArray[np.int64], local: Array) -> Array:
    """Brown with pale patches."""
    pale = noise(local / 0.09 + nearest[:, None] * 1.3) > 0.25
    dark = np.isin(np.array(body.names), ["head", "tail_3", "shank.L", "foreleg.R", "paw.R", "hock.L"])[nearest]
    colours = np.where(pale[:, None], [0.78, 0.70, 0.58], [0.45, 0.28, 0.16])
    colours = np.where(dark[:, None], 0.55 * colours, colours)
    return np.clip(colours * (1 + 0.12 * noise(local / 0.02))[:, None], 0.02, 0.95)


def hammer(voxel: float = 0.005) -> Creature:
    """A hammer of 32 cm that is swung and turned over: one bone."""
    part = Part("hammer", -1, np.array([0.0, 0.0, 0.8]), np.array([0.0, 0.0, 1.12]), np.eye(3), np.zeros((0, 3)))
    body = Body((part,), {})
    shapes = [
        Shape("hammer", (0, 0, 0), (0, 0, 0.30), ((0.0, 0.018, 0.022, 0.0), (1.0, 0.014, 0.018, 0.0)), (0, 1, 0)),
        Shape("hammer", (0, -0.06, 0.29), (0, 0.07, 0.29), ((0.0, 0.03, 0.03, 0.0), (1.0, 0.018, 0.022, 0.0))),
    ]
    figure = make_figure(body, voxel, shapes, _painted_hammer, pose=resting(body))

    def motion(t: Array) -> Motion:
        phase = 2 * np.pi * t
        place = np.stack([0.22 * np.sin(1.1 * phase), 0.12 * np.sin(0.7 * phase), 0.15 * np.cos(phase)], axis=1)
        turn = np.stack([1.1 * np.sin(phase), 0.7 * np.sin(0.8 * phase + 1), 1.3 * np.sin(0.9 * phase + 2)], axis=1)
        return Motion(place + [0, 0, 0.75], rotations.exp(turn)[:, None])

    places = ((1.7, -0.9, 1.0), (-0.3, -1.9, 1.2), (-1.8, -0.4, 0.8))
    cameras = tuple(
        camera_looking_at(f"cam{k + 1:02d}", place, (0, 0, 0.9), 560.0, size=(640, 360))
        for k, place in enumerate(places)
    )
    return Creature("hammer", figure, motion, cameras, {"hammer": "hammer"}, {})


def _painted_hammer(_body: Body, _nearest: NDArray[np.int64], local: Array) -> Array:
    steel = local[:, 2] > 0.255
    rings = np.mod(local[:, 2], 0.08) < 0.03
    colours = np.where(rings[:, None], [0.75, 0.2, 0.15], [0.72, 0.55, 0.33])
    colours[steel] = np.where(local[steel, 1:2] > 0.0, [0.2, 0.24, 0.3], [0.55, 0.58, 0.62])
    return np.clip(colours * (1 + 0.1 * noise(local / 0.012))[:, None], 0.02, 0.95)


def worker(voxel: float = 0.012) -> Creature:
    """The person with the hammer in the right hand, the handle across the palm."""
    base, tool = person(voxel), hammer()
    body = base.figure.body
    hand = body.parts[body.index("hand.R")]
    across = int(np.ptp(hand.vertices[:, [0, 2]], axis=0).argmax()) * 2  # the wider axis beside the bone's
    handle = np.zeros(3)
    handle[across] = 1.0
    forward = np.array([0.0, 1.0, 0.0])
    turn = np.stack([np.cross(forward, handle), forward, handle], axis=1)
    palm = np.zeros(3)
    palm[1], palm[2 - across] = 0.09, 0.02
    return replace(
        base, name="worker", prop=HeldProp(tool.figure, "hand.R", turn, palm - 0.08 * handle),
        cameras=ring(3, 3.9, 560, -100, 60),
    )  # fmt: skip


CREATURES: Mapping[str, Callable[[], Creature]] = {"person": person, "dog": dog, "hammer": hammer, "worker": worker}
