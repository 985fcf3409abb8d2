"""Legs posed so that the feet stand where they should. Needs no Blender."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from kfmocap.core.body import Body, part_poses
from kfmocap.core.body.motion import Motion
from kfmocap.core.numerics.arrays import Array
from scipy.interpolate import PchipInterpolator
from scipy.spatial.transform import Rotation

from .figure_pose import HEADING, turn

HEEL_FIRST = 0.7
"""Share of a foot's lift by which its toes stay lower than its heel."""


@dataclass(frozen=True, eq=False)
class Foot:
    """The path of a foot.

    Attributes
    ----------
    place : ndarray, shape (F, 2)
        Position of the ankle on the floor, metres.
    heading : ndarray, shape (F,)
        Direction of the toes, radians from +X.
    lift : ndarray, shape (F,)
        Height above standing flat, metres.
    """

    place: Array
    heading: Array
    lift: Array

    @classmethod
    def through(cls, t: Array, *knots: tuple[float, float, float, float, float]) -> Foot:
        """Interpolate smoothly between knots (second, x, y, degrees, lift); equal knots make the foot stand still."""
        seconds, x, y, degrees, lift = np.array(knots, float).T
        x, y, heading, lift = (PchipInterpolator(seconds, v)(t) for v in (x, y, np.radians(degrees), lift))
        return cls(np.stack([x, y], axis=1), heading, lift)


def stepping(heading: Array, side: str, step: float, half_width: float, height: float) -> Foot:
    """A foot of a person who turns on the spot, following an increasing heading (F,) in steps of `step` radians.

    The left foot steps while the right one stands, and the other way round.
    """
    sign = 1.0 if side == "L" else -1.0
    way = heading / step + 0.25 * sign
    swing = np.clip(2 * (way - np.floor(way)) - 0.5, 0, 1)
    toes = step * (np.floor(way) + swing * swing * (3 - 2 * swing) - 0.25 * sign)
    place = sign * half_width * np.stack([-np.sin(toes), np.cos(toes)], axis=1)
    return Foot(place, toes, height * np.sin(np.pi * swing) ** 2)


def reaching_legs(body: Body, pelvis: Motion, feet: dict[str, Foot]) -> dict[str, Rotation]:
    """Rotations Q of thighs, shins and feet that bring both feet to their paths; knees bend towards the toes.

    Parameters
    ----------
    pelvis : Motion
        Only its root is used.

    Raises
    ------
    ValueError
        If a foot is out of reach.
    """
    paths = {}
    for side, foot in feet.items():
        ankle = np.column_stack([foot.place, body.parts[body.index(f"foot.{side}")].head_world[2] + foot.lift])
        toes_down = np.arcsin(HEEL_FIRST * foot.lift / np.linalg.norm(body.landmarks[f"{side}BigToe"][1]))
        paths[side] = ankle, foot.heading, toes_down
    return legs_to(body, pelvis, paths)


def legs_to(body: Body, pelvis: Motion, paths: dict[str, tuple[Array, Array, Array]]) -> dict[str, Rotation]:
    """Rotations Q of thighs, shins and feet that bring both ankles to their paths; knees bend towards the toes.

    Parameters
    ----------
    pelvis : Motion
        Only its root is used.
    paths : dict
        By side: the ankle (F, 3), the direction of the toes from +X, and how far they point down, radians, (F,).

    Raises
    ------
    ValueError
        If an ankle is out of reach.
    """
    R_body, T_body = part_poses(body, pelvis)
    turns = {}
    for side, (ankle, heading, down) in paths.items():
        thigh, shin, sole = (body.index(f"{name}.{side}") for name in ("thigh", "shin", "foot"))
        lengths = np.linalg.norm(body.offsets[[shin, sole]], axis=1)
        c, s = np.cos(heading), np.sin(heading)
        toes = np.stack([c, s, 0 * c], axis=1)
        world = dict(zip((thigh, shin), _two_bones(T_body[:, thigh], ankle, toes, lengths), strict=True))
        world[sole] = sole_turn(heading, down) @ body.parts[sole].R_world_rest
        above = R_body[:, body.parents[thigh]]
        for part in (thigh, shin, sole):
            Q = body.R_parent_rest[part].T @ np.swapaxes(above, -1, -2) @ world[part]
            turns[body.names[part]] = Rotation.from_matrix(Q)
            above = world[part]
    return turns


def sole_turn(heading: Array, down: Array) -> Array:
    """World rotations (F, 3, 3) of a foot from its rest pose, whose toes point there and down, radians."""
    return np.asarray(turn("zyz", heading, down, np.full_like(down, HEADING)).as_matrix())


def _two_bones(hip: Array, ankle: Array, front: Array, lengths: Array) -> tuple[Array, Array]:
    """World orientations of thigh and shin, shape (F, 3, 3) each: y along the bone, z to the front."""
    upper, lower = lengths
    along = ankle - hip
    reach = np.linalg.norm(along, axis=1, keepdims=True)
    if (far := reach.max()) > upper + lower:
        raise ValueError(f"an ankle is {far:.3f} m from its hip, the leg is {upper + lower:.3f} m long")
    along /= reach
    forward = front - along * np.sum(front * along, axis=1, keepdims=True)
    forward /= np.linalg.norm(forward, axis=1, keepdims=True)
    near = (upper**2 - lower**2 + reach**2) / (2 * reach)
    knee = hip + near * along + np.sqrt(upper**2 - near**2) * forward
    x = np.cross(along, forward)
    frames = []
    for start, end in ((hip, knee), (knee, ankle)):
        y = (end - start) / np.linalg.norm(end - start, axis=1, keepdims=True)
        frames.append(np.stack([x, y, np.cross(x, y)], axis=-1))
    return frames[0], frames[1]
