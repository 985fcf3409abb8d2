"""Movements written as phrases: rests, swings, strikes that end abruptly, flights. Needs no Blender.

A movement is a function of time, so that one is filmed at any frame rate and through an exposure. Nothing in it follows
the tracker's own idea of smoothness: velocities leap where something is hit or the floor is met.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from kfmocap.core.body import Body, part_poses
from kfmocap.core.body.motion import Motion
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from .figure_pose import HEADING, posed_rotations, turn
from .footwork import Foot, reaching_legs

Array = NDArray[np.float64]

STRETCH = 0.997
"""Longest leg as a share of thigh and shin together: the hips are lowered where a foot would be out of reach."""
TREMOR = {
    "tilt": 0.8, "roll": 0.6, "bend": 1.0, "twist": 1.0, "look": 2.0, "nod": 1.5, "x": 0.008, "y": 0.006,
    "swing": 1.5, "drop": 1.2, "turn": 2.0, "elbow": 2.0, "wrist": 3.0,
}  # fmt: skip
"""Size of the small movements that never stop, by channel: degrees, metres."""


def _swing(u: Array) -> Array:
    return u**3 * (10 - 15 * u + 6 * u**2)


def _strike(u: Array) -> Array:
    return u**1.8


def _settle(u: Array) -> Array:
    return 1 - np.exp(-4 * u) * (np.cos(4 * u) + np.sin(4 * u)) * (1 - u**2)


PROFILES: dict[str, Callable[[Array], Array]] = {
    "swing": _swing,
    "snap": lambda u: _swing(u**0.6),
    "strike": _strike,
    "settle": _settle,
    "even": lambda u: u,
    "flight": lambda u: 4 * u * (1 - u),
    "there and back": lambda u: np.sin(np.pi * u) ** 2,
}
"""How a phrase goes from 0 to 1. The last two return to 0: they leave where they began."""
_RETURNING = ("flight", "there and back")


@dataclass(frozen=True)
class Phrase:
    """Channels that move to new values.

    Attributes
    ----------
    start, duration : float
        Seconds.
    profile : str
        One of `PROFILES`.
    goals : mapping
        Values by channel: degrees and metres.
    """

    start: float
    duration: float
    profile: str
    goals: Mapping[str, float]


@dataclass(frozen=True)
class Movement:
    """A person's movement.

    The channels are `heading`, `tilt`, `roll` of the pelvis and its place `x`, `y`, `z`; `bend`, `side`, `twist` of
    the trunk; `look`, `nod` of the head; and of each side, as `elbow.L`: `swing`, `drop`, `turn` of the upper arm,
    `elbow`, `wrist`, `ahead`, `out`, `lift`, `toes` of a standing foot relative to the place where it began to stand,
    and `flex`, `spread`, `knee`, `ankle` of a leg in the air. Degrees and metres.

    Attributes
    ----------
    start : mapping
        Values at the beginning by channel; the others are 0.
    free : str
        Sides, "L" and "R", whose legs follow their own angles; the other legs stand on the floor.
    seed : int
        Of the small movements that never stop.
    tremor : float
        Size of these, relative to `TREMOR`.
    """

    start: Mapping[str, float]
    phrases: tuple[Phrase, ...]
    free: str = ""
    seed: int = 0
    tremor: float = 1.0
    half_width: float = field(default=0.11)

    def channel(self, name: str, t: Array) -> Array:
        """Values of a channel at times, seconds, shape (F,)."""
        value = np.full(len(t), float(self.start.get(name, 0.0)))
        base = float(self.start.get(name, 0.0))
        for phrase in sorted(self.phrases, key=lambda p: p.start):
            if name not in phrase.goals:
                continue
            u = np.clip((t - phrase.start) / phrase.duration, 0, 1)
            value += PROFILES[phrase.profile](u) * (phrase.goals[name] - base)
            base = base if phrase.profile in _RETURNING else float(phrase.goals[name])
        return value + self._trembling(name, t)

    def _trembling(self, name: str, t: Array) -> Array:
        size = self.tremor * TREMOR.get(name.partition(".")[0], 0.0)
        rng = np.random.default_rng([self.seed, *name.encode()])
        rates, phases = np.array([0.35, 0.83, 1.9, 3.7]) * rng.uniform(0.8, 1.25, 4), rng.uniform(0, 2 * np.pi, 4)
        shares = np.array([1.0, 0.5, 0.2, 0.08])
        return size * np.sin(2 * np.pi * rates * t[:, None] + phases) @ shares

    def motion(self, body: Body, t: Array) -> Motion:
        """The motion of a body at times, seconds, shape (F,)."""
        a = {n: np.radians(self.channel(n, t)) for n in ("heading", "tilt", "roll", "bend", "side", "twist")}
        a |= {n: np.radians(self.channel(n, t)) for n in ("look", "nod")}
        turns = {
            "pelvis": turn("yzx", HEADING + a["heading"], a["roll"], a["tilt"]),
            "spine": turn("yzx", 0.5 * a["twist"], 0.5 * a["side"], 0.5 * a["bend"]),
            "chest": turn("yzx", 0.5 * a["twist"], 0.5 * a["side"], 0.5 * a["bend"]),
            "head": turn("yx", a["look"], a["nod"]),
        }
        for side, sign in (("L", 1.0), ("R", -1.0)):
            turns |= self._arm(side, sign, t)
            if side in self.free:
                turns |= self._leg_in_the_air(side, sign, t)
        hips = sum(np.linalg.norm(body.offsets[body.index(f"{name}.L")]) for name in ("shin", "foot"))
        height = float(hips) + body.parts[body.index("foot.L")].head_world[2] - 0.012
        path = np.stack([self.channel("x", t), self.channel("y", t), height + self.channel("z", t)], axis=1)
        standing = {s: self._foot(s, sign, t) for s, sign in (("L", 1.0), ("R", -1.0)) if s not in self.free}
        upright = Motion(path, posed_rotations(body, turns, len(t)))
        lowered = within_reach(body, upright, standing)
        return Motion(
            lowered.translations, posed_rotations(body, turns | reaching_legs(body, lowered, standing), len(t))
        )

    def _angles(self, side: str, t: Array, *names: str) -> list[Array]:
        return [np.radians(self.channel(f"{name}.{side}", t)) for name in names]

    def _arm(self, side: str, sign: float, t: Array) -> dict[str, Rotation]:
        swing, drop, twist, elbow, wrist = self._angles(side, t, "swing", "drop", "turn", "elbow", "wrist")
        return {
            f"upper_arm.{side}": turn("yzy", -sign * swing, -sign * drop, sign * twist),
            f"forearm.{side}": turn("yx", 0.26 * sign + 0 * elbow, elbow),
            f"hand.{side}": turn("x", wrist),
        }

    def _leg_in_the_air(self, side: str, sign: float, t: Array) -> dict[str, Rotation]:
        flex, spread, knee, ankle = self._angles(side, t, "flex", "spread", "knee", "ankle")
        return {
            f"thigh.{side}": turn("zx", sign * spread, flex),
            f"shin.{side}": turn("x", -knee),
            f"foot.{side}": turn("x", ankle),
        }

    def _foot(self, side: str, sign: float, t: Array) -> Foot:
        ahead, out, lift = (self.channel(f"{name}.{side}", t) for name in ("ahead", "out", "lift"))
        first = np.radians(float(self.start.get("heading", 0.0)))
        c, s = np.cos(first), np.sin(first)
        left = sign * (self.half_width + out)
        begin = [float(self.start.get(name, 0.0)) for name in "xy"]
        place = np.stack([begin[0] + c * ahead - s * left, begin[1] + s * ahead + c * left], axis=1)
        (toes,) = self._angles(side, t, "toes")
        return Foot(place, first + sign * 0.12 + toes, np.clip(lift, 0, 0.27))


def within_reach(body: Body, motion: Motion, feet: Mapping[str, Foot]) -> Motion:
    """The motion with its hips lowered where a leg would be too short for its foot."""
    _, T = part_poses(body, motion)
    lower = np.zeros(len(motion))
    for side, foot in feet.items():
        thigh, shin, sole = (body.index(f"{name}.{side}") for name in ("thigh", "shin", "foot"))
        reach = STRETCH * np.linalg.norm(body.offsets[[shin, sole]], axis=1).sum()
        aside = np.linalg.norm(T[:, thigh, :2] - foot.place, axis=1)
        highest = body.parts[sole].head_world[2] + foot.lift + np.sqrt(np.maximum(reach**2 - aside**2, 0.01))
        lower = np.maximum(lower, T[:, thigh, 2] - highest)
    return Motion(motion.translations - lower[:, None] * [0, 0, 1], motion.rotations)
