"""Turning motions: a discus throw, and a turn on the spot with waving arms. Needs no Blender."""

from __future__ import annotations

import numpy as np
from kfmocap.core.body import Body
from kfmocap.core.body.motion import Motion
from kfmocap.core.numerics.arrays import Array
from scipy.interpolate import CubicSpline, PchipInterpolator
from scipy.spatial.transform import Rotation

from .figure_pose import HEADING, hanging_arm, posed_rotations, turn
from .footwork import Foot, reaching_legs, stepping

THROW_TIME = 71 / 60
"""Duration of the throw in seconds, at any number of frames."""

STEP = np.radians(66)
"""How far a foot turns in one step of the turn on the spot."""


def throw(body: Body, frames: int, fps: float) -> Motion:
    """Throw the discus towards +X: from the backswing on one and a half turns to the left, and forward.

    The hips turn at up to 600 degrees a second, the right hand passes 10 m/s.
    """
    t = np.arange(frames) / fps
    still = np.zeros_like(t)
    heading = _smooth(t, (0, 172), (0.2, 215), (0.4, 318), (0.6, 440), (0.8, 555), (1.0, 672), (THROW_TIME, 722))
    lean = _curve(t, (0, 14), (0.3, 16), (0.6, 12), (0.85, 10), (1.05, -4), (THROW_TIME, 4))
    lag = _curve(t, (0, -62), (0.25, -48), (0.6, -46), (0.85, -52), (1.05, 8), (THROW_TIME, 24))
    turns = {
        "pelvis": turn("yx", heading + HEADING, 0.5 * lean),
        "spine": turn("yx", 0.45 * lag, 0.5 * lean),
        "chest": turn("yx", 0.45 * lag, 0.4 * lean),
        "head": turn("yx", -0.6 * lag, -0.8 * lean),
    }
    back = _curve(t, (0, -48), (0.3, -38), (0.85, -52), (1.06, 30), (THROW_TIME, 68))
    drop = _curve(t, (0, 22), (0.35, 14), (0.7, 24), (0.9, 8), (1.08, -16), (THROW_TIME, 6))
    turns["upper_arm.R"] = turn("xzy", back, drop, still + 0.2)
    turns["forearm.R"] = turn("x", _curve(t, (0, 14), (0.9, 10), (1.05, 8), (THROW_TIME, 48)))
    ahead = _curve(t, (0, 58), (0.35, 18), (0.65, 62), (0.95, 12), (THROW_TIME, -22))
    fold = _curve(t, (0, 40), (0.35, 18), (0.65, 60), (0.9, 40), (1.05, 95), (THROW_TIME, 105))
    turns["upper_arm.L"] = turn("xzy", -ahead, -_curve(t, (0, 24), (0.4, 12), (1.0, 22), (THROW_TIME, 48)), still)
    turns["forearm.L"] = turn("x", fold)
    path = [
        _along(t, (0, -0.62), (0.25, -0.56), (0.5, -0.16), (0.75, 0.22), (1.0, 0.42), (THROW_TIME, 0.5)),
        _along(t, (0, 0.04), (0.25, -0.14), (0.5, -0.06), (0.75, 0.06), (1.0, 0.07), (THROW_TIME, 0.06)),
        _along(t, (0, 0.80), (0.25, 0.79), (0.48, 0.84), (0.72, 0.79), (1.02, 0.865), (THROW_TIME, 0.86)),
    ]
    left = Foot.through(
        t, (0, -0.62, -0.26, 205, 0), (0.1, -0.62, -0.26, 210, 0), (0.4, -0.6, -0.25, 315, 0.05),
        (0.56, -0.1, 0.3, 430, 0.14), (0.74, 0.54, 0.2, 540, 0), (0.95, 0.56, 0.2, 620, 0),
        (THROW_TIME, 0.56, 0.2, 675, 0),
    )  # fmt: skip
    right = Foot.through(
        t, (0, -0.62, 0.28, 150, 0), (0.12, -0.62, 0.28, 155, 0), (0.34, -0.3, -0.45, 290, 0.16),
        (0.52, -0.02, -0.06, 420, 0.05), (0.75, 0, -0.03, 520, 0.05), (1.0, 0.04, -0.03, 650, 0.08),
        (THROW_TIME, 0.08, -0.04, 690, 0.1),
    )  # fmt: skip
    return _on_feet(body, turns, np.stack(path, axis=1), {"L": left, "R": right})


def whirl(body: Body, frames: int, fps: float) -> Motion:
    """Turn on the spot to the left, a little more than once, and wave both arms up and down twice per turn."""
    share = np.arange(frames) / (frames - 1)
    t = np.arange(frames) / fps
    heading = np.radians(-90 + 400 * share)
    feet = {side: stepping(heading, side, STEP, 0.13, 0.035) for side in "LR"}
    sway = np.radians(3) * np.sin(2 * np.pi * heading / STEP)
    turns = {
        "pelvis": turn("yz", heading + HEADING, sway),
        "spine": turn("yz", np.full_like(t, np.radians(4)), -0.6 * sway),
        "head": turn("yx", np.full_like(t, np.radians(14)), np.radians(5) * np.sin(2 * np.pi * 0.8 * t)),
    }
    for side, sign, late in (("L", 1.0, 0.0), ("R", -1.0, 0.09)):
        wave = -np.cos(2 * np.pi * (0.85 * t - late))  # -1 is down
        turns[f"upper_arm.{side}"] = hanging_arm(sign, np.radians(18 + 10 * wave), np.radians(14 - 46 * wave))
        bend = np.radians(42 + 26 * np.cos(2 * np.pi * (0.85 * t - late - 0.2)))
        turns[f"forearm.{side}"] = turn("yx", np.full_like(t, 0.2 * sign), bend)
    height = 0.9 + 0.006 * np.cos(4 * np.pi * heading / STEP)
    return _on_feet(body, turns, np.stack([0 * t, 0 * t, height], axis=1), feet)


def _along(t: Array, *knots: tuple[float, float]) -> Array:
    """Values at t of a curve through (second, value), without overshoot."""
    x, y = np.array(knots, float).T
    return PchipInterpolator(x, y)(np.clip(t, x[0], x[-1]))


def _curve(t: Array, *knots: tuple[float, float]) -> Array:
    """Radians at t of a curve through (second, degrees), without overshoot."""
    return np.radians(_along(t, *knots))


def _smooth(t: Array, *knots: tuple[float, float]) -> Array:
    """Radians at t of a curve through (second, degrees) with a smooth derivative."""
    x, y = np.array(knots, float).T
    return np.radians(CubicSpline(x, y)(t))


def _on_feet(body: Body, turns: dict[str, Rotation], path: Array, feet: dict[str, Foot]) -> Motion:
    """The motion whose hips follow a path (F, 3) and whose legs reach for the feet."""
    upright = Motion(path, posed_rotations(body, turns, len(path)))
    legs = reaching_legs(body, upright, feet)
    return Motion(path, posed_rotations(body, turns | legs, len(path)))
