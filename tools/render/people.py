"""The people of the benchmark's shots: heights, builds, clothes that may hang loosely, shoulders that rise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from kfmocap.core.body import Body, default_measures, human, part_poses
from kfmocap.core.body.motion import Motion
from numpy.typing import NDArray

from .figure import Figure, make_figure
from .movement_phrases import Movement
from .shapes import Shape, human_shapes
from .textures import noise

Array = NDArray[np.float64]
Colour = tuple[float, float, float]

TRUNK, ARM, LEG = ("pelvis", "spine", "chest"), ("upper_arm", "forearm"), ("thigh", "shin")
SHOULDER_RISE, SHOULDER_REACH = 0.045, 0.025
"""How far a shoulder rises with the raised arm, and moves inwards and forwards with the arm that reaches; metres."""
CLOTH_LAG = 0.07
"""Seconds by which loose clothes follow the body."""


@dataclass(frozen=True)
class Wardrobe:
    """Colours of clothes, sRGB.

    Attributes
    ----------
    shirt : tuple of Colour
        One for a plain shirt, two for one with a pattern.
    pattern : float
        Width of the pattern's stripes, metres; they run round the body, and with `checks` also along it.
    sleeve, leg : float
        Share of the forearm and of the shin that clothes cover; below 0 they end on the upper arm and the thigh.
    """

    shirt: tuple[Colour, ...]
    trousers: Colour
    skin: Colour = (0.76, 0.57, 0.46)
    hair: Colour = (0.2, 0.14, 0.1)
    shoes: Colour = (0.25, 0.24, 0.25)
    pattern: float = 0.05
    checks: bool = False
    sleeve: float = 0.8
    leg: float = 1.0


@dataclass(frozen=True)
class Person:
    """A person as filmed.

    Attributes
    ----------
    height : float
        Metres.
    proportions : mapping
        Factors on the measures of the default body.
    girth : float
        Factor on the widths of trunk and limbs.
    looseness : float
        How far clothes hang off the body, metres.
    """

    height: float
    wardrobe: Wardrobe
    proportions: Mapping[str, float] = field(default_factory=dict)
    girth: float = 1.0
    looseness: float = 0.0

    def body(self) -> Body:
        """The skeleton and landmarks; its polyhedra are not used."""
        usual = default_measures(self.height)
        sides = {name: [key for key in usual if key.split(".")[0] == name] for name in self.proportions}
        measures = {key: usual[key] * self.proportions[name] for name, keys in sides.items() for key in keys}
        return human(self.height, measures, collar_bones=False)

    def figure(self, body: Body, voxel: float) -> Figure:
        """The skin with its clothes."""
        return make_figure(body, voxel, self._shapes(body), self._painted)

    def _shapes(self, body: Body) -> list[Shape]:
        fitted = []
        for shape in human_shapes(body):
            kind = shape.part.split(".")[0]
            grow = 1.0 if kind in ("head", "hand") else self.girth * self.height / 1.78
            worn = self.looseness * {"upper_arm": 0.6, "forearm": 0.5, "thigh": 0.8, "shin": 0.9}.get(kind, 0.0)
            worn += self.looseness * (kind in TRUNK)
            stations = tuple((at, grow * w + worn, grow * d + worn, grow * s) for at, w, d, s in shape.stations)
            fitted.append(replace(shape, stations=stations))
        return fitted

    def _painted(self, body: Body, nearest: NDArray[np.int64], local: Array) -> Array:
        """Colours of the vertices, sRGB."""
        kind = np.array([name.split(".")[0] for name in body.names])[nearest]
        length = np.array([np.linalg.norm(p.tail_world - p.head_world) for p in body.parts])[nearest]
        place = local[:, 1] / length
        worn, shift = self.wardrobe, nearest[:, None] * 2.3
        colours = np.tile(np.array(worn.skin), (len(local), 1))
        covered = np.where(kind == "upper_arm", place - 1, place) < worn.sleeve
        shirt = np.isin(kind, ("spine", "chest")) | (np.isin(kind, ARM) & covered)
        rings = np.mod(local[:, 1], 2 * worn.pattern) < worn.pattern
        around = np.mod(np.arctan2(local[:, 2], local[:, 0]) * 0.1, 2 * worn.pattern) < worn.pattern
        second = (rings ^ around) if worn.checks else rings
        colours[shirt] = np.array([worn.shirt[0], worn.shirt[-1]])[second.astype(int)][shirt]
        low = np.where(kind == "thigh", place - 1, place) < worn.leg
        colours[(kind == "pelvis") | (np.isin(kind, LEG) & low)] = worn.trousers
        colours[kind == "foot"] = worn.shoes
        head = kind == "head"
        colours[head & (local[:, 1] > np.maximum(0.262 - 1.3 * np.clip(0.07 - local[:, 2], 0, 0.12), 0.13))] = worn.hair
        eye = np.hypot(np.abs(local[:, 0]) - 0.03, local[:, 1] - 0.185) < 0.012
        colours[head & eye & (local[:, 2] > 0.05)] = 0.1
        shade = 0.10 * noise(local / 0.07 + shift) + 0.08 * noise(local / 0.022 + shift)
        creases = 1 + np.where(shirt | (kind == "pelvis") | np.isin(kind, LEG), 1.0, 0.4) * shade
        return np.clip(colours * creases[:, None], 0.02, 0.95)

    def hanging(self, figure: Figure) -> Array:
        """How loosely each vertex hangs, 0 to 1, shape (V,)."""
        if not self.looseness:
            return np.zeros(len(figure.vertices))
        share = {name: 1.0 for name in (*TRUNK, *ARM, *LEG)}
        parts = np.array([share.get(name.split(".")[0], 0.0) for name in figure.body.names])
        worn = figure.weights @ parts
        return np.asarray(worn * (0.5 + 0.5 * np.tanh(2 * noise(figure.vertices / 0.15))))


def posed_parts(body: Body, motion: Motion) -> tuple[Array, Array]:
    """World poses of the parts, with shoulders that move on the chest as the arms do; the tracker's body has none."""
    R, T = part_poses(body, motion)
    chest = R[:, body.index("chest")]
    for side, sign in (("L", 1.0), ("R", -1.0)):
        arm = [body.index(f"{name}.{side}") for name in ("upper_arm", "forearm", "hand")]
        along = np.einsum("fba,fb->fa", chest, R[:, arm[0], :, 1])
        rise = np.clip(along[:, 1] + 0.5, 0, 1.5) / 1.5
        reach = np.clip(along[:, 2], 0, 1)
        moved = np.stack([sign * (-0.4 * SHOULDER_RISE * rise - 0.5 * SHOULDER_REACH * reach),
                          SHOULDER_RISE * rise, SHOULDER_REACH * reach], axis=1)  # fmt: skip
        T[:, arm] += np.einsum("fab,fb->fa", chest, moved)[:, None]
    return R, T


def true_landmarks(body: Body, motion: Motion) -> Array:
    """Landmarks in the world, metres, shape (F, L, 3), in the order of the body's."""
    parts, points = body.landmark_arrays(list(body.landmarks))
    R, T = posed_parts(body, motion)
    return np.asarray(np.einsum("flab,lb->fla", R[:, parts], points) + T[:, parts])


def skin_at(person: Person, figure: Figure, movement: Movement, seconds: Array) -> Array:
    """Vertices in the world at times, shape (F, V, 3): loose clothes lag behind the body and crease."""

    def skinned(t: Array) -> Array:
        return figure.skinned(*posed_parts(figure.body, movement.motion(figure.body, t)))

    skin = skinned(seconds)
    if not person.looseness:
        return skin
    loose = person.hanging(figure)[:, None]
    late = skinned(np.maximum(seconds - CLOTH_LAG, 0.0))
    sway = np.clip(late - skin, -1.5 * person.looseness, 1.5 * person.looseness)
    return np.asarray(skin + loose * sway)
