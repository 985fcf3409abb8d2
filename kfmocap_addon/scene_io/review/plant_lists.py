"""The plants of a performer's feet stored in a scene: those that tracking has tested, the animator's corrections, and
the combination that is shown.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import bpy
import numpy as np

from ....core.body import Body
from ....core.body.soles import Soles
from ....core.numerics.arrays import Bools
from ....core.numerics.frame_ranges import runs


def write_tested(
    scene: bpy.types.Scene,
    slot: bpy.types.PropertyGroup,
    body: Body,
    planted: Bools | None,
    frames: range,
) -> None:
    """Keep and show which plants the tracker has held.

    Parameters
    ----------
    scene : bpy.types.Scene
    slot : KFMocapPerformer
    body : Body
        As it was tracked.
    planted : ndarray of bool, shape (F, C), optional
        On the frames that were tracked, see `TrackResult`; None where nothing was tested.
    frames : range
        These scene frames, F of them. Others keep what is known of them.
    """
    soles, first = Soles.of(body), frames.start
    forget(slot, frames)
    if planted is None or soles is None:
        return
    for name, column in zip(soles.names, planted.T, strict=True):
        for state in (True, False):
            for a, b in runs(column == state):
                _add(slot.tested_plants, name, first + a, first + b, state)
    show(scene, slot, shown(scene, slot) or {name: _none(scene) for name in soles.names})


def forget(slot: bpy.types.PropertyGroup, frames: Collection[int]) -> None:
    """Forget what was tested and what is shown on some scene frames; the animator's corrections stay."""
    for plants in (slot.tested_plants, slot.plants):
        pieces = []
        for plant in plants:
            stays = ~np.isin(np.arange(plant.first, plant.last + 1), list(frames))
            pieces += [(plant.name, plant.first + a, plant.first + b, plant.planted) for a, b in runs(stays)]
        plants.clear()
        for piece in pieces:
            _add(plants, *piece)


def shown(scene: bpy.types.Scene, slot: bpy.types.PropertyGroup) -> dict[str, Bools] | None:
    """Return on which of the F frames of the shot points of the soles are planted, by point, shape (F,); None where
    nobody has looked yet.
    """
    if not slot.plants_found:
        return None
    flags = {name: _none(scene) for name in slot.plants_found.split()}
    _put(scene, flags, slot.plants)
    return flags


def show(scene: bpy.types.Scene, slot: bpy.types.PropertyGroup, seeming: Mapping[str, Bools]) -> None:
    """Show when points of the soles are planted: as detected in the motion, replaced by what was tested, and then by
    the animator's corrections.
    """
    flags = {name: planted.copy() for name, planted in seeming.items()}
    _put(scene, flags, slot.tested_plants)
    _put(scene, flags, slot.plant_edits)
    slot.plants.clear()
    slot.plants_found = " ".join(flags)
    for name, planted in flags.items():
        for a, b in runs(planted):
            _add(slot.plants, name, scene.kfmocap.frame_start + a, scene.kfmocap.frame_start + b, True)


def edit(
    scene: bpy.types.Scene,
    slot: bpy.types.PropertyGroup,
    points: Collection[str],
    frames: tuple[int, int],
    planted: bool,
) -> None:
    """Correct points of the soles to be planted, or not, from one scene frame to another."""
    first, last = min(frames), max(frames)
    flags = shown(scene, slot) or {}
    for name in (name for name in flags if name in points):
        for k in reversed(range(len(slot.plant_edits))):
            old = slot.plant_edits[k]
            if old.name == name and first <= old.first and old.last <= last:
                slot.plant_edits.remove(k)
        _add(slot.plant_edits, name, first, last, planted)
    show(scene, slot, flags)


def with_edits(scene: bpy.types.Scene, slot: bpy.types.PropertyGroup, flags: Mapping[str, Bools]) -> dict[str, Bools]:
    """Flags of points (F,) as the animator has corrected them."""
    own = {name: planted.copy() for name, planted in flags.items()}
    _put(scene, own, slot.plant_edits)
    return own


def _none(scene: bpy.types.Scene) -> Bools:
    return np.zeros(max(scene.kfmocap.length, 0), bool)


def _put(scene: bpy.types.Scene, flags: Mapping[str, Bools], plants: Sequence[bpy.types.PropertyGroup]) -> None:
    start = scene.kfmocap.frame_start
    for plant in plants:
        if plant.name in flags:
            flags[plant.name][max(plant.first - start, 0) : max(plant.last - start + 1, 0)] = plant.planted


def _add(plants: bpy.types.CollectionProperty, name: str, first: int, last: int, planted: bool) -> None:
    plant = plants.add()
    plant.name, plant.first, plant.last, plant.planted = name, first, last, planted
