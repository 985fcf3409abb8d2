"""Measures of a body as one would take them with a tape, and bodies with other measures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...errors import BodyError
from ...numerics.arrays import Array
from ..body import Body
from ..human import measure_names
from .shaping import shaped

Ends = Mapping[str, tuple[Sequence[float], Sequence[float]]]
"""Head and tail of every bone by its name, metres."""
_HEAD, _TAIL = 0, 1
_ACROSS, _ALONG = 0, 1
"""Axes of a part: across the body (for parts of the trunk), and along the bone."""


@dataclass(frozen=True)
class _Measure:
    """A distance between two ends of bones, and the parts that are stretched with it: some along one of their axes,
    others, which a body need not have, along the bone.
    """

    start: tuple[str, int]
    end: tuple[str, int]
    parts: tuple[str, ...]
    axis: int = _ALONG
    bones: tuple[str, ...] = ()


def _limb(bone: str, below: str | None) -> dict[str, _Measure]:
    """Return a limb's length on both sides, to the joint below or to its tip."""
    found = {}
    for name, side in zip(measure_names(bone), (".L", ".R"), strict=True):
        end = (bone + side, _TAIL) if below is None else (below + side, _HEAD)
        found[name] = _Measure((bone + side, _HEAD), end, (bone + side,))
    return found


_MEASURES: dict[str, _Measure] = {
    "shoulder_width": _Measure(
        ("upper_arm.L", _HEAD), ("upper_arm.R", _HEAD), ("chest",), _ACROSS, ("shoulder.L", "shoulder.R")
    ),
    "hip_width": _Measure(("thigh.L", _HEAD), ("thigh.R", _HEAD), ("pelvis",), _ACROSS),
    "torso": _Measure(("pelvis", _HEAD), ("head", _HEAD), ("pelvis", "spine", "chest")),
    "head": _Measure(("head", _HEAD), ("head", _TAIL), ("head",)),
    **_limb("upper_arm", "forearm"),
    **_limb("forearm", "hand"),
    **_limb("hand", None),
    **_limb("thigh", "shin"),
    **_limb("shin", "foot"),
    **_limb("foot", None),
}


def measured(ends: Ends, name: str) -> float | None:
    """Take a measure of a skeleton at rest, metres; for limbs this is the mean of both sides.

    Parameters
    ----------
    ends : mapping
        See `Ends`.
    name : str
        As "torso" or "thigh".

    Returns
    -------
    float or None
        None if a bone is missing, because the skeleton is not that of the default body.
    """
    found = [_length(ends, _MEASURES[key]) for key in _keys(name)]
    lengths = [length for length in found if length is not None]
    return float(np.mean(lengths)) if len(lengths) == len(found) else None


def with_measure(body: Body, name: str, value: float) -> Body:
    """Return the body with one measure changed, on both sides; all other measures stay.

    Raises
    ------
    BodyError
        The body has no such measure, or the value is not a possible length.
    """
    if not np.isfinite(value) or value <= 0:
        raise BodyError(f"measure '{name}' is {value}", todo="give a positive number of metres")
    ends = {part.name: (part.head_world.tolist(), part.tail_world.tolist()) for part in body.parts}
    stretch = np.zeros((len(body), 3))
    for key in _keys(name):
        length = _length(ends, _MEASURES[key])
        if length is None or length <= 0:
            raise BodyError(f"the body has no measure '{name}'", todo="its bones are not the default body's")
        for part in _MEASURES[key].parts:
            stretch[body.index(part), _MEASURES[key].axis] = value / length - 1
        for part in set(_MEASURES[key].bones) & set(body.names):
            stretch[body.index(part), _ALONG] = value / length - 1
    return shaped(body, stretch, np.zeros((len(body), 3)))


def scaled(body: Body, factor: float) -> Body:
    """Return the body with all lengths and widths multiplied by a factor; the root's joint stays."""
    return shaped(body, np.full((len(body), 3), factor - 1), np.zeros((len(body), 3)))


def _keys(name: str) -> list[str]:
    return [key for key in (name, f"{name}.L", f"{name}.R") if key in _MEASURES]


def _length(ends: Ends, measure: _Measure) -> float | None:
    (start, first), (end, last) = measure.start, measure.end
    if start not in ends or end not in ends or not all(part in ends for part in measure.parts):
        return None
    apart: Array = np.subtract(ends[end][last], ends[start][first])
    return float(np.linalg.norm(apart))
