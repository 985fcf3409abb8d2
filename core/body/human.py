"""The default body: a human of tapered convex parts, scaled from a height or from measured lengths.

The rest pose is a T pose, facing -Y, left hand towards +X, feet on z = 0. Segment lengths as fractions of the height
follow R. Drillis and R. Contini, Body Segment Parameters (1966), as given in D. A. Winter, Biomechanics and Motor
Control of Human Movement, fig. 4.1; hip and shoulder widths are those of the joint centres.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from numbers import Real

import numpy as np

from ..errors import BodyError
from ..numerics.arrays import Array
from .body import REST_SIGMA, Body, Part

FRACTIONS: dict[str, float] = {
    "hip_width": 0.115,
    "shoulder_width": 0.215,
    "torso": 0.288,
    "head": 0.167,
    "nose_up": 0.085,
    "nose_forward": 0.065,
    "upper_arm": 0.172,
    "forearm": 0.150,
    "hand": 0.108,
    "thigh": 0.245,
    "shin": 0.246,
    "foot_forward": 0.105,
    "foot_down": 0.030,
    "heel_back": 0.035,
    "neck_rise": 0.015,
    "shoulders_forward": 0.0,
    "hips_rise": 0.0,
}
"""Measures of the body as fractions of its height: lengths, and (the last three) shifts of the neck above the line of
the shoulders, of the shoulders before the spine, and of the hip joints above the root."""

SHIFTS = ("neck_rise", "shoulders_forward", "hips_rise")
"""Measures that shift a joint, and are no lengths."""
_CENTRAL = {"hip_width", "shoulder_width", "torso", "head", "nose_up", "nose_forward", *SHIFTS}

_DEG = np.pi / 180


def _limits(x: tuple[float, float], y: tuple[float, float], z: tuple[float, float]) -> Array:
    return np.array([x, y, z]) * _DEG


_LIMITS: dict[str, Array] = {
    "spine": _limits((-40, 40), (-30, 30), (-30, 30)),
    "chest": _limits((-40, 40), (-30, 30), (-30, 30)),
    "head": _limits((-60, 60), (-80, 80), (-45, 45)),
    "shoulder": _limits((-20, 30), (-5, 5), (-15, 40)),
    "upper_arm": _limits((-120, 120), (-100, 100), (-120, 120)),
    "forearm": _limits((-5, 150), (-80, 80), (-8, 8)),
    "hand": _limits((-70, 70), (-30, 30), (-70, 70)),
    "thigh": _limits((-60, 140), (-60, 60), (-70, 70)),
    "shin": _limits((-150, 5), (-25, 25), (-8, 8)),
    "foot": _limits((-50, 50), (-30, 30), (-30, 30)),
}
_FREE = _limits((-180, 180), (-180, 180), (-180, 180))
_LIMITS_RIGHT = {kind: np.stack([x, -y[::-1], -z[::-1]]) for kind, (x, y, z) in _LIMITS.items()}
"""Those of parts on the right, mirrored across x = 0: turns about y and z change sign."""
_REST_SIGMAS = {"spine": 0.7, "chest": 0.7, "shoulder": 0.5}
"""Standard deviations of stiff parts from rest, radians. If landmarks do not show which parts bend, spine and chest
share the bend equally, and the arms turn rather than the collar bones."""

# Rings of each part: (place along the bone as a fraction of its length, half width, half depth, shift in depth), the
# last three in metres for a height of 1.75 m; width along the bone's x axis, depth along its z axis.
_RINGS: dict[str, list[tuple[float, float, float, float]]] = {
    "pelvis": [(-0.9, 0.09, 0.07, 0.0), (-0.2, 0.165, 0.11, 0.0), (1.0, 0.145, 0.095, 0.0)],
    "spine": [(0.0, 0.145, 0.095, 0.0), (1.0, 0.15, 0.105, 0.0)],
    "chest": [(0.0, 0.15, 0.105, 0.0), (0.6, 0.165, 0.11, 0.0), (0.95, 0.13, 0.08, 0.0), (1.1, 0.06, 0.05, 0.0)],
    "head": [(0.0, 0.055, 0.055, 0.0), (0.35, 0.065, 0.08, 0.02), (0.7, 0.075, 0.095, 0.02), (1.0, 0.04, 0.05, 0.0)],
    "shoulder": [(0.0, 0.04, 0.04, 0.0), (1.0, 0.05, 0.05, 0.0)],
    "upper_arm": [(-0.1, 0.035, 0.035, 0.0), (0.15, 0.052, 0.052, 0.0), (1.0, 0.042, 0.042, 0.0)],
    "forearm": [(0.0, 0.042, 0.042, 0.0), (0.25, 0.044, 0.042, 0.0), (1.0, 0.027, 0.027, 0.0)],
    "hand": [(0.0, 0.02, 0.028, 0.0), (0.45, 0.016, 0.042, 0.0), (0.95, 0.008, 0.03, 0.0)],
    "thigh": [(-0.1, 0.06, 0.065, 0.0), (0.12, 0.085, 0.085, 0.0), (1.0, 0.053, 0.055, 0.0)],
    "shin": [(0.0, 0.052, 0.055, 0.0), (0.3, 0.056, 0.06, -0.012), (1.0, 0.034, 0.036, 0.0)],
}
_COLLAR_START = 0.15
"""Start of the collar bones, as a share of the way from the middle of the body to the shoulder joints."""
_SIDES = 10
_FORWARD, _UP = np.array([0.0, -1.0, 0.0]), np.array([0.0, 0.0, 1.0])
_SOLE = 0.016  # below the heel and toe landmarks, metres for a height of 1.75 m


def default_measures(height: float) -> dict[str, float]:
    """Measures in metres of a person of that height; limbs are named per side (`thigh.L`)."""
    if not isinstance(height, Real):
        raise BodyError(f"a height of {height!r} is not a number", todo="give it in metres, 0.3 to 3.0")
    if not 0.3 <= height <= 3.0:
        todo = "give it in metres, 0.3 to 3.0; if it follows from landmarks or keypoints, check their units"
        raise BodyError(f"a height of {height:.4g} m is not a person's", todo=todo)
    measures: dict[str, float] = {}
    for name, fraction in FRACTIONS.items():
        for key in measure_names(name):
            measures[key] = fraction * height
    return measures


def measure_names(name: str) -> tuple[str, ...]:
    """Return the names of a measure on the sides of the body: one for the trunk and widths, two for the limbs."""
    return (name,) if name in _CENTRAL else (f"{name}.L", f"{name}.R")


def human(
    height: float = 1.75,
    measures: Mapping[str, float] | None = None,
    *,
    solid: bool = True,
    collar_bones: bool = True,
) -> Body:
    """Build the default body.

    Parameters
    ----------
    height : float
        Metres. It determines the measures that are not given, and the widths of all parts.
    measures : mapping, optional
        Measures in metres by the names of `default_measures`; a name without its side sets both.
    solid : bool
        Whether to build the polyhedra of the parts. Without them the body is built faster, with joints and landmarks
        only.
    collar_bones : bool
        Whether the arms hang on collar bones, named shoulder; otherwise they hang on the chest.

    Returns
    -------
    Body
        The parts are pelvis (root), spine, chest, head, and on each side shoulder, upper_arm, forearm, hand, thigh,
        shin, foot. Landmarks have Pose2Sim's names.
    """
    m = default_measures(height)
    for name, value in (measures or {}).items():
        keys = [name] if name in m else [k for k in (f"{name}.L", f"{name}.R") if k in m]
        if not keys:
            raise BodyError(f"unknown measure '{name}'", todo=f"the measures are {', '.join(FRACTIONS)}")
        if not np.isfinite(value) or (value <= 0 and name not in SHIFTS):
            raise BodyError(f"measure '{name}' is {value}", todo="give a positive number of metres")
        if abs(value) > height:
            what = f"measure '{name}' is {value}, which is more than the height of {height}"
            raise BodyError(what, todo="give both in metres")
        for key in keys:
            m[key] = value
    return _assemble(m, height / 1.75, solid=solid, collar_bones=collar_bones)


class _Assembly:
    """A body under construction."""

    def __init__(self, girth: float, *, solid: bool) -> None:
        self.parts: list[Part] = []
        self.landmarks: dict[str, tuple[int, Array]] = {}
        self._girth, self._solid = girth, solid

    def add(self, name: str, parent: str | None, head: Array, tail: Array, z_hint: Array = _FORWARD) -> int:
        """Add a part, with a solid made of rings along its bone if it has any, and return its index."""
        kind = name.split(".", maxsplit=1)[0]
        limits = (_LIMITS_RIGHT if name.endswith(".R") else _LIMITS).get(kind, _FREE)
        index = next((i for i, part in enumerate(self.parts) if part.name == parent), -1)
        axes = bone_axes(tail - head, z_hint)
        vertices = np.empty((0, 3))
        if self._solid and kind in _RINGS:
            length = float(np.linalg.norm(tail - head))
            rings = [(y * length, *(self._girth * r for r in ring)) for y, *ring in _RINGS[kind]]
            vertices = tapered(rings, _SIDES)
        departure = _REST_SIGMAS.get(kind, REST_SIGMA)
        self.parts.append(
            Part(
                name=name,
                parent=index,
                head_world=head,
                tail_world=tail,
                R_world_rest=axes,
                vertices=vertices,
                limits=limits,
                departure=departure,
            )
        )
        return len(self.parts) - 1

    def add_trunk(self, m: Mapping[str, float], hip: Array) -> Array:
        """Add pelvis, spine, chest and head above the root's joint, and return the neck."""
        tops = np.array([0.25, 0.55, 1.0]) * (m["torso"] + m["neck_rise"])  # of pelvis, spine and chest
        waist, breast, neck = (hip + h * _UP for h in tops)
        pelvis = self.add("pelvis", None, hip, waist)
        self.add("spine", "pelvis", waist, breast)
        self.add("chest", "spine", breast, neck)
        head = self.add("head", "chest", neck, neck + m["head"] * _UP)
        self.landmarks["Hip"] = (pelvis, np.zeros(3))
        self.landmarks["Neck"] = (head, np.zeros(3))
        self.landmarks["Head"] = (head, np.array([0.0, m["head"], 0.0]))
        self.landmarks["Nose"] = (head, np.array([0.0, m["nose_up"], m["nose_forward"]]))
        return neck

    def add_arm(self, m: Mapping[str, float], side: str, middle: Array, *, collar_bone: bool) -> None:
        """Add an arm, and its collar bone, on the line through the shoulders."""
        out = np.array([1.0 if side == "L" else -1.0, 0.0, 0.0])
        joint, parent = middle + out * m["shoulder_width"] / 2, "chest"
        if collar_bone:
            parent = f"shoulder.{side}"
            self.add(parent, "chest", middle + _COLLAR_START * (joint - middle), joint)
        for bone, landmark in (("upper_arm", "Shoulder"), ("forearm", "Elbow"), ("hand", "Wrist")):
            name, tip = f"{bone}.{side}", joint + out * m[f"{bone}.{side}"]
            index = self.add(name, parent, joint, tip)
            self.landmarks[side + landmark] = (index, np.zeros(3))
            joint, parent = tip, name
        self.landmarks[side + "Hand"] = (index, np.array([0.0, m[f"hand.{side}"], 0.0]))

    def add_leg(self, m: Mapping[str, float], side: str, joint: Array) -> None:
        """Add a leg below its hip joint."""
        parent = "pelvis"
        for bone, landmark in (("thigh", "Hip"), ("shin", "Knee")):
            name, tip = f"{bone}.{side}", joint - _UP * m[f"{bone}.{side}"]
            index = self.add(name, parent, joint, tip)
            self.landmarks[side + landmark] = (index, np.zeros(3))
            joint, parent = tip, name
        toe = joint + _FORWARD * m[f"foot_forward.{side}"] - _UP * m[f"foot_down.{side}"]
        heel = joint - _FORWARD * m[f"heel_back.{side}"] - _UP * m[f"foot_down.{side}"]
        index = self.add(f"foot.{side}", parent, joint, toe, _UP)
        axes = self.parts[index].R_world_rest
        if self._solid:
            vertices = (_foot(joint, toe, heel, self._girth) - joint) @ axes
            self.parts[index] = replace(self.parts[index], vertices=vertices)
        self.landmarks[side + "Ankle"] = (index, np.zeros(3))
        self.landmarks[side + "BigToe"] = (index, axes.T @ (toe - joint))
        self.landmarks[side + "Heel"] = (index, axes.T @ (heel - joint))


def _assemble(m: Mapping[str, float], girth: float, *, solid: bool, collar_bones: bool) -> Body:
    body = _Assembly(girth, solid=solid)
    legs = [m[f"thigh.{s}"] + m[f"shin.{s}"] + m[f"foot_down.{s}"] for s in "LR"]
    hip = np.array([0.0, 0.0, max(legs) + _SOLE * girth - m["hips_rise"]])
    neck = body.add_trunk(m, hip)
    shoulders = neck + _FORWARD * m["shoulders_forward"] - _UP * m["neck_rise"]
    for side, sign in (("L", 1.0), ("R", -1.0)):
        body.add_arm(m, side, shoulders, collar_bone=collar_bones)
        body.add_leg(m, side, hip + np.array([sign * m["hip_width"] / 2, 0.0, m["hips_rise"]]))
    return Body(tuple(body.parts), body.landmarks)


def bone_axes(direction: Array, z_hint: Array) -> Array:
    """Rest orientation with y along `direction` and z as close to `z_hint` as possible, shape (3, 3)."""
    y = direction / math.sqrt(direction @ direction)
    z = z_hint - y * (y @ z_hint)
    z /= math.sqrt(z @ z)
    x = [
        y[1] * z[2] - y[2] * z[1],
        y[2] * z[0] - y[0] * z[2],
        y[0] * z[1] - y[1] * z[0],
    ]  # np.cross takes ten times as long, np.linalg.norm three times
    return np.array([x, y, z]).T


def tapered(rings: Sequence[tuple[float, ...]], sides: int) -> Array:
    """Return the vertices of a solid of elliptic rings (y, half width, half depth, shift in depth), shape (rings *
    sides, 3).
    """
    angle = np.arange(sides) * 2 * np.pi / sides
    y, rx, rz, z = np.array(rings).T[:, :, None]
    corners = np.empty((len(rings), sides, 3))
    corners[..., 0], corners[..., 1], corners[..., 2] = rx * np.cos(angle), y, rz * np.sin(angle) + z
    return corners.reshape(-1, 3)


def _foot(ankle: Array, toe: Array, heel: Array, girth: float) -> Array:
    """Return the vertices of a wedge-shaped foot in the world's rest pose: sole, instep, and a cuff at the ankle."""
    side = np.array([1.0, 0.0, 0.0]) * girth
    tip = toe + (toe - heel) * 0.12
    ground = min(toe[2], heel[2]) - _SOLE * girth
    profile = [(heel, 0.030), (0.35 * heel + 0.65 * toe, 0.045), (tip, 0.030)]
    vertices = []
    for point, half in profile:
        sole = np.array([point[0], point[1], ground])
        rise = 0.045 if point is heel else 0.055 if point is not tip else 0.025
        for sign in (-1.0, 1.0):
            vertices += [sole + sign * half * side, sole + sign * 0.85 * half * side + [0, 0, rise * girth]]
    cuff = 0.033 * girth
    corners = [(1, 1), (1, -1), (-1, 1), (-1, -1)]
    vertices += [ankle + [cuff * sx, cuff * sy, 0.015] for sx, sy in corners]
    return np.array(vertices)
