"""The rounded shapes that make the rendered figure, part by part."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from kfmocap.core.body import Body
from kfmocap.core.numerics.arrays import Array
from scipy.interpolate import PchipInterpolator

FAR = 0.15
"""Distance, metres, beyond which its exact value does not matter."""


@dataclass(frozen=True)
class Shape:
    """A rounded solid along a line from a to b in the frame of its part.

    Attributes
    ----------
    part : str
    a, b : tuple of float
        Ends of the line, metres.
    stations : tuple of (place, half width, half depth, shift in depth)
        Place as a fraction of the line, the rest in metres.
    depth : tuple of float
        Approximate direction of the depth.
    floor : float or None
        Depth below which the solid is cut off, like the sole of a shoe.
    """

    part: str
    a: tuple[float, float, float]
    b: tuple[float, float, float]
    stations: tuple[tuple[float, float, float, float], ...]
    depth: tuple[float, float, float] = (0.0, 0.0, 1.0)
    floor: float | None = None

    def distance(self, points: Array) -> Array:
        """Approximate signed distance of points (N, 3), in the part's frame, from the solid; 1 if far."""
        a, axis = np.array(self.a), np.subtract(self.b, self.a)
        length = np.linalg.norm(axis)
        d = np.ones(len(points))
        near = np.sum((points - a - axis / 2) ** 2, axis=1) < (length + FAR) ** 2
        if near.any():
            d[near] = self._near_distance(points[near] - a, axis / length, length)
        return d

    def _near_distance(self, points: Array, y: Array, length: float) -> Array:
        z = np.array(self.depth) - y * (y @ self.depth)
        z /= np.linalg.norm(z)
        along, across, deep = points @ y, points @ np.cross(y, z), points @ z
        place, *measures = np.array(self.stations).T
        t = np.clip(along / length, place[0], place[-1])
        width, depth, shift = (PchipInterpolator(place, m)(t) for m in measures)
        beyond = along - t * length
        radius = np.sqrt(width * depth)
        q = (across / width) ** 2 + ((deep - shift) / depth) ** 2 + (beyond / radius) ** 2
        d = (np.sqrt(q) - 1) * radius
        return d if self.floor is None else np.maximum(d, self.floor - deep)


def human_shapes(body: Body) -> tuple[Shape, ...]:
    """A clothed person, around the bones of `core.body.human`."""
    return (*_trunk_shapes(body), *_head_shapes(body), *(shape for side in "LR" for shape in _limb_shapes(body, side)))


def _along(body: Body, part: str, *stations: tuple[float, float, float, float]) -> Shape:
    """A shape along the whole bone of a part."""
    bone = body.parts[body.index(part)]
    return Shape(part, (0, 0, 0), (0, float(np.linalg.norm(bone.tail_world - bone.head_world)), 0), stations)


def _trunk_shapes(body: Body) -> list[Shape]:
    return [
        _along(
            body,
            "pelvis",
            (-0.7, 0.09, 0.085, -0.01),
            (-0.2, 0.152, 0.112, -0.014),
            (0.5, 0.15, 0.1, -0.006),
            (1.0, 0.138, 0.094, 0.0),
        ),
        _along(body, "spine", (0.0, 0.138, 0.096, 0.0), (0.5, 0.133, 0.093, 0.0), (1.0, 0.142, 0.1, 0.0)),
        _along(
            body,
            "chest",
            (0.0, 0.142, 0.1, 0.0),
            (0.5, 0.155, 0.112, 0.004),
            (0.8, 0.145, 0.1, -0.006),
            (1.02, 0.09, 0.06, -0.014),
        ),
    ]


def _head_shapes(body: Body) -> list[Shape]:
    nose = body.landmarks["Nose"][1]
    return [
        _along(body, "head", (-0.1, 0.055, 0.055, -0.012), (0.1, 0.052, 0.052, -0.004), (0.42, 0.05, 0.05, 0.004)),
        Shape(
            "head",
            (0, 0.10, 0.045),
            (0, 0.24, 0.035),
            ((0.12, 0.042, 0.042, 0.0), (0.6, 0.06, 0.056, 0.0), (0.9, 0.06, 0.056, 0.0)),
        ),
        Shape("head", (0, 0.19, 0.005), (0, 0.265, 0.0), ((0.0, 0.066, 0.078, 0.0), (1.0, 0.07, 0.086, 0.0))),
        Shape("head", (0, 0.093, 0.074), (0, 0.12, 0.078), ((0.0, 0.026, 0.022, 0.0), (1.0, 0.034, 0.024, 0.0))),
        Shape(
            "head",
            (0, nose[1] - 0.008, nose[2] - 0.016),
            (0, nose[1] + 0.035, nose[2] - 0.028),
            ((0.1, 0.015, 0.014, 0.0), (0.9, 0.008, 0.008, 0.0)),
        ),
    ]


def _limb_shapes(body: Body, side: str) -> list[Shape]:
    return [*_arm_shapes(body, side), *_leg_shapes(body, side)]


def _arm_shapes(body: Body, side: str) -> list[Shape]:
    """An arm with its shoulder."""
    sign = 1.0 if side == "L" else -1.0
    shoulder = body.offsets[body.index(f"upper_arm.{side}")]
    return [
        Shape(
            "chest",
            (sign * 0.05, shoulder[1] + 0.01, -0.015),
            tuple(shoulder - [0, 0.018, 0]),
            ((0.0, 0.05, 0.055, 0.0), (0.85, 0.05, 0.052, 0.0)),
        ),
        _along(
            body,
            f"upper_arm.{side}",
            (0.05, 0.055, 0.056, 0.0),
            (0.35, 0.051, 0.053, 0.0),
            (1.0, 0.043, 0.044, 0.0),
        ),
        _along(
            body,
            f"forearm.{side}",
            (0.0, 0.043, 0.044, 0.0),
            (0.25, 0.045, 0.046, 0.0),
            (0.7, 0.034, 0.036, 0.0),
            (1.0, 0.025, 0.031, 0.0),
        ),
        _along(
            body,
            f"hand.{side}",
            (0.0, 0.022, 0.03, 0.0),
            (0.35, 0.018, 0.037, 0.0),
            (0.65, 0.014, 0.034, 0.0),
            (0.93, 0.009, 0.026, 0.0),
        ),
        Shape(
            f"hand.{side}",
            (0, 0.035, 0.035),
            (0, 0.1, 0.06),
            ((0.1, 0.015, 0.015, 0.0), (0.9, 0.01, 0.011, 0.0)),
        ),
    ]


def _leg_shapes(body: Body, side: str) -> list[Shape]:
    """A leg with its shoe."""
    return [
        _along(
            body,
            f"thigh.{side}",
            (0.05, 0.083, 0.092, 0.0),
            (0.3, 0.082, 0.09, 0.0),
            (0.7, 0.066, 0.07, 0.0),
            (1.0, 0.056, 0.06, 0.0),
        ),
        _along(
            body,
            f"shin.{side}",
            (0.0, 0.056, 0.06, 0.0),
            (0.3, 0.056, 0.063, -0.012),
            (0.6, 0.049, 0.055, -0.008),
            (0.95, 0.05, 0.056, 0.0),
        ),
        _shoe(body, side),
    ]


def _shoe(body: Body, side: str) -> Shape:
    """A shoe with a flat sole under the heel and toe landmarks of a foot."""
    heel, toe = body.landmarks[f"{side}Heel"][1], body.landmarks[f"{side}BigToe"][1]
    up = -(heel + toe) / 2
    return Shape(f"foot.{side}", tuple(heel), tuple(toe),
                 ((0.03, 0.034, 0.04, 0.02), (0.3, 0.036, 0.062, 0.026), (0.7, 0.046, 0.042, 0.008),
                  (1.0, 0.036, 0.028, 0.002)), tuple(up), floor=-0.02)  # fmt: skip
