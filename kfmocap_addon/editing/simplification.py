"""Fewer keys: tracked keys that the curves through the others say anyway are taken out.

A bone's rotation, and the root's location, keep the keys without which they would stray farther than a tolerance from
the curve as it was, on any frame. What is between the kept keys is measured on the curves that Blender makes of them.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core.numerics.arrays import Array
from ..scene_io import fcurves
from ..scene_io.body import body_channels
from ..scene_io.keys import key_ownership


@dataclass(frozen=True, eq=False)
class _KeyedAttribute:
    """The curves of one bone's rotation, or of the root's location, C of them, and their keys.

    Attributes
    ----------
    own, tracked : tuple of Keys
        By curve: the animator's keys, and the tracker's.
    """

    turns: bool
    curves: tuple[bpy.types.FCurve, ...]
    own: tuple[fcurves.Keys, ...]
    tracked: tuple[fcurves.Keys, ...]

    def frames(self) -> NDArray[np.int64]:
        """All frames from the first key to the last."""
        places = np.concatenate([keys["co"][:, 0] for keys in self.own + self.tracked])
        return np.arange(np.floor(places.min()), np.ceil(places.max()) + 1).astype(np.int64)

    def values(self, frames: NDArray[np.int64]) -> Array:
        """Return the values of the curves as they are now, shape (F, C)."""
        return np.array([[curve.evaluate(float(frame)) for curve in self.curves] for frame in frames])

    def count(self) -> int:
        return sum(len(curve.keyframe_points) for curve in self.curves)

    def keep(self, frames: Collection[int]) -> None:
        """Leave the animator's keys and, of the tracker's, those on some frames: smooth from one to the next."""
        for curve, own, tracked in zip(self.curves, self.own, self.tracked, strict=True):
            kept = tracked[np.isin(fcurves.frames_of(tracked), list(frames))]
            held = kept["interpolation"] == fcurves.enum_value("interpolation", "CONSTANT")
            kept["interpolation"][~held] = fcurves.enum_value("interpolation", "BEZIER")
            fcurves.set_keys(curve, [own, kept])

    def breaks(self) -> set[int]:
        """Return the frames beside those on which a curve jumps."""
        constant = fcurves.enum_value("interpolation", "CONSTANT")
        jumps = _frames(keys[keys["interpolation"] == constant] for keys in self.tracked)
        return jumps | {f + 1 for f in jumps}

    def strays(self, before: Array, now: Array) -> Array:
        """Return how far values (F, C) are from others: an angle in radians, or a distance in metres, shape (F,)."""
        if not self.turns:
            return np.linalg.norm(now - before, axis=1)
        a, b = (q / np.maximum(np.linalg.norm(q, axis=1, keepdims=True), 1e-12) for q in (before, now))
        along = np.linalg.norm(a - b * np.sign(np.sum(a * b, axis=1, keepdims=True)), axis=1)
        return 4 * np.arcsin(np.clip(along / 2, 0, 1))


def simplify(
    armature: bpy.types.Object, angle: float, distance: float, bones: Collection[str] | None = None
) -> tuple[int, int]:
    """Remove tracked keys that are not needed; the animator's keys stay.

    Parameters
    ----------
    angle : float
        How far a bone's rotation may stray from what it was, on every frame from the first key to the last, radians.
    distance : float
        The same of the root's location, metres.
    bones : collection of str, optional
        These bones alone; by default the whole body.

    Returns
    -------
    tuple of int
        Number of keys before and after.
    """
    before = after = 0
    for attribute in _keyed_attributes(armature, bones):
        before += attribute.count()
        _thin_out(attribute, angle if attribute.turns else distance)
        after += attribute.count()
    return before, after


def thin_out_curves(curves: Sequence[bpy.types.FCurve], tolerance: float, *, turns: bool) -> None:
    """Remove keys of curves that belong together, on all of them at once, where the remaining keys describe the curves.

    Parameters
    ----------
    tolerance : float
        How far they may stray together from what they were, on any frame: radians where `turns`, else in their unit.
    turns : bool
        They are the four components of quaternions.
    """
    keys = tuple(fcurves.get_keys(curve) for curve in curves)
    _thin_out(_KeyedAttribute(turns, tuple(curves), tuple(k[:0] for k in keys), keys), tolerance)


def _keyed_attributes(armature: bpy.types.Object, bones: Collection[str] | None) -> Iterator[_KeyedAttribute]:
    channels = body_channels.list_channels(armature)
    found = [
        row for row in key_ownership.channel_keys(armature, channels) if bones is None or channels[row[0]].bone in bones
    ]
    for path, rows in groupby(found, key=lambda row: channels[row[0]].path):
        _, curves, keys, own = zip(*rows, strict=True)
        if any((~mask).any() for mask in own):
            yield _KeyedAttribute(
                path.endswith("rotation_quaternion"),
                curves,
                tuple(k[mask] for k, mask in zip(keys, own, strict=True)),
                tuple(k[~mask] for k, mask in zip(keys, own, strict=True)),
            )


def _frames(groups: Iterable[fcurves.Keys]) -> set[int]:
    """All frames that keys of some curves lie on."""
    return {frame for keys in groups for frame in fcurves.frames_of(keys).tolist()}


def _thin_out(attribute: _KeyedAttribute, tolerance: float) -> None:
    """From the fewest keys on, keys come back where the curves stray most, until they stray too far nowhere."""
    frames = attribute.frames()
    target = attribute.values(frames)
    able = _frames(attribute.tracked)
    kept = ({int(frames[0]), int(frames[-1])} | attribute.breaks()) & able
    anchors = _frames(attribute.own)
    while True:
        attribute.keep(kept)
        stray = attribute.strays(target, attribute.values(frames))
        missing = _worst(frames, np.where(stray > tolerance, stray, 0.0), kept | anchors) & (able - kept)
        if not missing:
            break
        kept |= missing
    if (stray > tolerance).any():
        attribute.keep(able)


def _worst(frames: NDArray[np.int64], excess: Array, knots: Collection[int]) -> set[int]:
    """Return the frame between every two knots on which there is most excess, where there is any."""
    edges = [0, *sorted(np.searchsorted(frames, list(knots)).tolist()), len(frames)]
    found = set()
    for a, b in pairwise(edges):
        if b > a and excess[a:b].max() > 0:
            found.add(int(frames[a + int(excess[a:b].argmax())]))
    return found
