"""Motions on the spot, made of a few poses with smooth curves between them; no Blender here."""

from __future__ import annotations

import numpy as np
from kfmocap.core.body import Body
from kfmocap.core.motion import Motion
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator
from scipy.spatial.transform import Rotation

from .posing import HEADING, hanging_arm, posed_rotations, turn

Array = NDArray[np.float64]

BENT_KNEES = 12.0
"""Degrees at hip and ankle of somebody who stands at ease; twice that at the knee."""


def throw(body: Body, frames: int, fps: float) -> Motion:
    """Stand sideways, wind up and throw overhand with the right arm: the wrist at 7 m/s and more."""
    t = _seconds(frames, fps)
    yaw = _curve(t, (-0.8, 0), (-0.25, -45), (0.02, 25), (0.35, 40), (0.9, 5))
    lean = _curve(t, (-0.8, 2), (-0.25, -6), (0.05, 14), (0.35, 18), (0.9, 4))
    turns = _standing(t)
    turns["spine"], turns["chest"] = turn("yx", 0.4 * yaw, 0.4 * lean), turn("yx", 0.6 * yaw, 0.6 * lean)
    turns["head"] = turn("yx", -0.8 * yaw, -0.8 * lean)
    raised = _curve(t, (-0.9, 75), (-0.3, 12), (0.0, 10), (0.25, 40), (0.6, 70))
    across = _curve(t, (-0.9, 0), (-0.25, -35), (0.0, 30), (0.25, 60), (0.8, 5))
    spin = _curve(t, (-0.7, 0), (-0.25, 70), (-0.08, 60), (0.04, -20), (0.3, -30), (0.8, 0))
    turns["upper_arm.R"] = turn("zxy", raised, across, spin)
    turns["forearm.R"] = turn("x", _curve(t, (-0.9, 20), (-0.25, 95), (-0.06, 80), (0.04, 12), (0.5, 30)))
    balance = _curve(t, (-0.8, 0), (-0.2, 60), (0.2, -20), (0.8, 0))
    turns["upper_arm.L"] = hanging_arm(1.0, balance, np.full_like(t, 1.2))
    return _on_the_spot(body, turns, t)


def whirl(body: Body, frames: int, fps: float) -> Motion:
    """Turn once round on the spot in 1.6 s and wave both arms."""
    t = _seconds(frames, fps)
    turns = _standing(t)
    heading = HEADING + _curve(t, (-0.8, -20), (0.8, 340))
    turns["pelvis"] = turn("y", heading)
    turns["head"] = turn("y", _curve(t, (-1, 0), (-0.5, 25), (0.5, 25), (1, 0)))
    for side, sign, beat in (("L", 1.0, 0.0), ("R", -1.0, 0.35)):
        wave = np.sin(2 * np.pi * (1.6 * t + beat))
        turns[f"upper_arm.{side}"] = hanging_arm(sign, 0.5 * wave, np.radians(22 - 32 * wave))
        turns[f"forearm.{side}"] = turn("x", np.radians(45 + 35 * np.sin(2 * np.pi * (1.6 * t + beat - 0.2))))
    return _on_the_spot(body, turns, t)


def _seconds(frames: int, fps: float) -> Array:
    return (np.arange(frames) - (frames - 1) / 2) / fps


def _curve(t: Array, *knots: tuple[float, float]) -> Array:
    """Radians at t of a curve through (second, degrees), constant beyond its ends."""
    x, y = np.array(knots, float).T
    return np.radians(PchipInterpolator(x, y)(np.clip(t, x[0], x[-1])))


def _standing(t: Array) -> dict[str, Rotation]:
    """Somebody who stands at ease and faces +X."""
    still, bend = np.zeros_like(t), np.full_like(t, np.radians(BENT_KNEES))
    turns = {"pelvis": turn("y", still + HEADING)}
    for side, sign in (("L", 1.0), ("R", -1.0)):
        turns[f"thigh.{side}"] = turn("yzx", still - 0.1 * sign, still + 0.08 * sign, bend)
        turns[f"shin.{side}"] = turn("x", -2 * bend)
        turns[f"foot.{side}"] = turn("x", bend)
        turns[f"upper_arm.{side}"] = hanging_arm(sign, still, still + np.radians(76))
        turns[f"forearm.{side}"] = turn("x", still + np.radians(20))
    return turns


def _on_the_spot(body: Body, turns: dict[str, Rotation], t: Array) -> Motion:
    """The hips above the origin, the soles on the floor."""
    legs = np.linalg.norm(body.offsets[[body.index("shin.L"), body.index("foot.L")]], axis=1)
    height = body.parts[0].head_world[2] - legs.sum() * (1 - np.cos(np.radians(BENT_KNEES)))
    return Motion(np.tile([0.0, 0.0, height], (len(t), 1)), posed_rotations(body, turns, len(t)))
