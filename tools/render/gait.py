"""A walk made from textbook gait curves. Needs no Blender."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from kfmocap.core.body import Body
from kfmocap.core.body.motion import Motion
from kfmocap.core.numerics.arrays import Array
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from .figure_pose import HEADING, faced_about, hanging_arm, posed_rotations, turn

# Degrees at percent of the stride from one heel strike to the next: flexion and dorsiflexion are positive.
# After the shape of the curves of natural walking in D. A. Winter, Biomechanics and Motor Control of Human
# Movement, adjusted by least squares so that a foot of `core.body.human` stays where it stands and clears the
# floor when it swings.
HIP = ((0, 20), (10, 16), (20, 9), (30, -1), (40, -11), (50, -14), (60, -12), (70, 4), (80, 22), (90, 26))
KNEE = ((0, 4), (8, 9), (15, 13), (25, 12), (40, 7), (50, 15), (60, 32), (73, 66), (84, 45), (94, 8))
ANKLE = ((0, -2), (8, -6), (15, 0), (25, 7), (40, 15), (49, 17), (62, 1), (72, -12), (82, 10), (94, 3))

STRIDE_TIME, STRIDE, HIP_HEIGHT, BOB = 1.0, 1.30, 0.927, 0.009
"""Seconds and metres of a stride, mean height of the hips and how far they rise and fall, metres."""
LEG = 0.874
"""Length of thigh and shin together for which these values hold, metres; they are scaled for other legs."""
SWAY = 0.022
"""How far the hips sway over the supporting leg, metres."""
TILT = np.radians(4)
"""Forward tilt of the pelvis. The thighs compensate for it: the hip curve is relative to the vertical."""


@dataclass(frozen=True)
class Gait:
    """Phases of the stride, in revolutions: 0 is the heel strike of the right foot."""

    right: Array

    def leg(self, side: str) -> Array:
        """Phases of one leg; 0 is the heel strike of its foot."""
        return (self.right + (0.5 if side == "L" else 0.0)) % 1.0

    def wave(self, amplitude: float, peak: float = 0.0) -> Array:
        """A cosine over the stride of the right leg with its maximum at phase `peak`."""
        return amplitude * np.cos(2 * np.pi * (self.right - peak))


def walk(body: Body, frames: int, fps: float) -> Motion:
    """Walk along +X at about 1.3 m/s and pass the origin halfway, glancing to the right."""
    seconds = (np.arange(frames) - (frames - 1) / 2) / fps
    gait = Gait(seconds / STRIDE_TIME)
    turns = _stride_turns(gait)
    turns["head"] = turn("y", np.radians(-16) * np.exp(-((seconds / 0.6) ** 2))) * turns["head"]
    return Motion(_pelvis_path(body, gait), posed_rotations(body, turns, frames))


def crossing(body: Body, frames: int, fps: float) -> Motion:
    """The same walk along -X: past a camera at -Y from right to left, the right arm and leg hidden by the body."""
    return faced_about(body, walk(body, frames, fps))


def _stride_turns(gait: Gait) -> dict[str, Rotation]:
    """Rotation Q of every part that moves in the stride, by angles about the part's own axes."""
    yaw = gait.wave(np.radians(5))  # right side forward
    roll = gait.wave(np.radians(3.5), peak=0.22)  # left side down
    shoulders, still = gait.wave(np.radians(-6), peak=0.03), np.zeros_like(yaw)
    half = (shoulders - yaw) / 2
    turns = {
        "pelvis": turn("yzx", HEADING + yaw, -roll, still + TILT),
        "spine": turn("yzx", half, 0.6 * roll, still - np.radians(1)),
        "chest": turn("yzx", half, 0.4 * roll, still + np.radians(1)),
        "head": turn("yx", -0.8 * shoulders, still - np.radians(5)),
    }
    for side, sign in (("L", 1.0), ("R", -1.0)):
        phase = gait.leg(side)
        hip, knee, ankle = (np.radians(_periodic(curve)(phase)) for curve in (HIP, KNEE, ANKLE))
        # The thigh undoes the rotation of the pelvis: the foot keeps its direction, toes slightly outwards.
        toes_out, inward = sign * np.radians(5), sign * np.radians(2)
        turns[f"thigh.{side}"] = turn("yzx", yaw - toes_out, roll - inward, hip + TILT)
        turns[f"shin.{side}"] = turn("x", -knee)
        turns[f"foot.{side}"] = turn("x", ankle)
        swing = np.radians(-2) - np.radians(24) * np.cos(2 * np.pi * (phase - 0.02))
        bend = np.radians(20) - np.radians(11) * np.cos(2 * np.pi * (phase - 0.08))
        turns[f"upper_arm.{side}"] = hanging_arm(sign, swing, np.radians(79) + 0 * swing)
        turns[f"forearm.{side}"] = turn("yx", still + sign * np.radians(15), bend)
        turns[f"hand.{side}"] = turn("x", still + np.radians(8))
    return turns


def _periodic(curve: tuple[tuple[float, float], ...]) -> CubicSpline:
    """A smooth, periodic curve over phase 0..1."""
    x, y = np.array([*curve, (100, curve[0][1])], float).T
    return CubicSpline(x / 100, y, bc_type="periodic")


def _pelvis_path(body: Body, gait: Gait) -> Array:
    """Positions of the hip centre at the gait's phases, shape (F, 3), metres; +Y is left."""
    scale = np.linalg.norm(body.offsets[[body.index("shin.L"), body.index("foot.L")]], axis=1).sum() / LEG
    height = HIP_HEIGHT - BOB * np.cos(4 * np.pi * gait.right)
    return np.stack([scale * STRIDE * gait.right, -gait.wave(SWAY, peak=0.3), scale * height], axis=1)
