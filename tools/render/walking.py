"""Walks of many kinds, from sneaking to a run, as functions of time. Needs no Blender."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from kfmocap.core.body import Body, part_poses
from kfmocap.core.body.motion import Motion
from kfmocap.core.numerics.arrays import Array
from scipy.ndimage import minimum_filter1d, uniform_filter1d
from scipy.spatial.transform import Rotation

from .figure_pose import HEADING, hanging_arm, posed_rotations, turn
from .footwork import legs_to
from .movement_phrases import Movement
from .walking_feet import Footfalls

REACH = 0.985
"""Longest leg on which the hips are carried, as a share of thigh and shin together."""
LONGEST = 0.999
"""The same of a leg that reaches for its foot: what is farther stays out of reach."""
RATE, BLUR = 400, 0.12
"""Samples per second of the height of the hips, and half of the time over which it is smoothed, seconds."""
SECONDS = (-0.6, 6.0)
"""When the height of the hips is known."""


@dataclass(frozen=True)
class Walk:
    """A person's walk; can be filmed like a `Movement`.

    Attributes
    ----------
    steps : Footfalls
    crouch : float
        How much lower the hips are than straight legs would allow, metres.
    lean, arms, elbow : float
        Forward lean of the trunk, swing of the arms and bend of the elbows, degrees.
    carries : bool
        Whether both arms carry something instead of swinging.
    """

    steps: Footfalls
    crouch: float = 0.0
    lean: float = 3.0
    arms: float = 24.0
    elbow: float = 20.0
    carries: bool = False

    def motion(self, body: Body, t: Array) -> Motion:
        """The motion of a body at times, seconds, shape (F,)."""
        t = np.asarray(t, float)
        sampled, heights = _hip_heights(self, body)
        turns, upright = self._trunk(body, t, np.interp(t, sampled, heights) - self.crouch)
        _, T = part_poses(body, upright)
        feet = {}
        for side in "LR":
            thigh, shin, sole = (body.index(f"{name}.{side}") for name in ("thigh", "shin", "foot"))
            ankle, down, toes = self.steps.foot(body, side, self.steps.own_time(t))
            longest, leg = LONGEST * np.linalg.norm(body.offsets[[shin, sole]], axis=1).sum(), ankle - T[:, thigh]
            leg *= np.minimum(1, longest / np.linalg.norm(leg, axis=1))[:, None]
            feet[side] = T[:, thigh] + leg, toes, down
        turns |= legs_to(body, upright, feet)
        return Motion(upright.translations, posed_rotations(body, turns, len(t)))

    def _trunk(self, body: Body, t: Array, height: Array) -> tuple[dict[str, Rotation], Motion]:
        """Turns of all parts but the legs, and the motion with legs at rest and hips at these heights."""
        steps, time = self.steps, self.steps.own_time(t)
        phase = steps.phase("R", time)

        def wave(size: float, peak: float = 0.0) -> Array:
            return size * np.cos(2 * np.pi * (phase - peak))

        xy, heading = steps.way(time)
        big = min(abs(steps.speed), 1.5) / 1.5
        yaw, roll, shoulders = wave(np.radians(5 * big)), wave(np.radians(3), 0.22), wave(np.radians(-7 * big), 0.03)
        half, lean, still = (shoulders - yaw) / 2, np.radians(self.lean), 0 * phase
        shake = {n: np.radians(self._trembling(n, t)) for n in ("tilt", "roll", "bend", "twist", "look", "nod")}
        turns = {
            "pelvis": turn("yzx", HEADING + heading + yaw, -roll + shake["roll"], lean + shake["tilt"]),
            "spine": turn("yzx", half, 0.6 * roll, still + lean * 0.5 + shake["bend"]),
            "chest": turn("yzx", half + shake["twist"], 0.4 * roll, still + lean * 0.3),
            "head": turn("yx", -0.8 * shoulders + shake["look"], still - lean + shake["nod"]),
        }
        for side, sign in (("L", 1.0), ("R", -1.0)):
            turns |= self._arm(side, sign, t)
        left = np.stack([-np.sin(heading), np.cos(heading)], axis=-1)
        path = np.column_stack([xy - wave(0.02, 0.3)[:, None] * left, height])
        return turns, Motion(path, posed_rotations(body, turns, len(t)))

    def _arm(self, side: str, sign: float, t: Array) -> dict[str, Rotation]:
        phase = self.steps.phase(side, self.steps.own_time(t))
        shake, shake_elbow = (np.radians(self._trembling(name, t)) for name in ("swing", "elbow"))
        swing = -np.radians(2) - np.radians(self.arms) * np.cos(2 * np.pi * (phase - 0.02)) + shake
        bend = np.radians(self.elbow) - np.radians(self.arms * 0.4) * np.cos(2 * np.pi * (phase - 0.08)) + shake_elbow
        if self.carries:
            swing, bend = np.radians(32) + 0.1 * swing, np.radians(70) + 0.1 * bend
        return {
            f"upper_arm.{side}": hanging_arm(sign, swing, np.full_like(phase, np.radians(78))),
            f"forearm.{side}": turn("yx", np.full_like(phase, sign * np.radians(15)), bend),
            f"hand.{side}": turn("x", np.full_like(phase, np.radians(8))),
        }

    def _trembling(self, name: str, t: Array) -> Array:
        return Movement({}, (), seed=self.steps.seed).channel(name, t)


@cache
def _hip_heights(walk: Walk, body: Body) -> tuple[Array, Array]:
    """Times and heights of the hips, smooth, at which both legs reach their feet, (N,) each."""
    t = np.linspace(*SECONDS, int((SECONDS[1] - SECONDS[0]) * RATE) + 1)
    _, flat = walk._trunk(body, t, np.zeros(len(t)))
    _, T = part_poses(body, flat)
    limit = np.full(len(t), 10.0)
    for side in "LR":
        thigh, shin, sole = (body.index(f"{name}.{side}") for name in ("thigh", "shin", "foot"))
        reach = REACH * np.linalg.norm(body.offsets[[shin, sole]], axis=1).sum()
        ankle, _, _ = walk.steps.foot(body, side, walk.steps.own_time(t))
        aside = np.linalg.norm(T[:, thigh, :2] - ankle[:, :2], axis=1)
        limit = np.minimum(limit, ankle[:, 2] + np.sqrt(np.maximum(reach**2 - aside**2, 0.01)) - T[:, thigh, 2])
    width = 2 * int(BLUR * RATE) + 1
    low = minimum_filter1d(np.minimum(limit, np.quantile(limit, 0.75)), width)
    return t, np.asarray(uniform_filter1d(low, width))
