"""A study of holds: a person with a hammer, both tracked on their own rigs, with and without a hold.

python -m kfmocap.benchmarks.studies.held_prop_study
"""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np

from ...core.formats.calibrations.calibration_files import load_cameras
from ...core.numerics.arrays import Array
from ...kfmocap_addon.registration import registered
from ...kfmocap_addon.scene_io import added_views
from ..footage_renderer import render
from ..tables import markdown
from .rig_study import CACHE, KEY_EVERY, done, keep_keys
from .shown_meshes import vertices_on_frames

CREATURE = "worker"
HAND = "Te_r"
"""The bone that holds the hammer."""
HEADS = ["hammer in the hand", "person, mm", "right hand, mm", "hammer, mm", "hammer, worst frame, mm"]


def measured(folder: Path, *, held: bool, every: int = KEY_EVERY) -> list[Array]:
    """Track both as a user does; see `rig_study.measured`.

    Parameters
    ----------
    folder : Path
        As written by `tools/render_creatures.py`.
    held : bool
        Whether the scene has a hold of the hammer.
    every : int
        Frames between key poses.

    Returns
    -------
    list of ndarray, shape (F,)
        Mean distances of vertices from their true positions on every frame, metres: of the skin, of the right hand
        alone, and of the hammer.
    """
    with registered():
        bpy.ops.wm.open_mainfile(filepath=str(folder / "rig.blend"))
        scene = bpy.context.scene
        armature = next(o for o in scene.objects if o.type == "ARMATURE")
        skin = next(c for c in armature.children if c.type == "MESH")
        group = skin.vertex_groups[HAND].index
        hand = [v.index for v in skin.data.vertices if any(g.group == group and g.weight > 0.9 for g in v.groups)]
        prop = scene.objects["hammer"]
        truth = [vertices_on_frames([mesh]) for mesh in (skin, prop)]
        for owner in (armature, prop):
            keep_keys(owner, every)
            bpy.context.view_layer.objects.active = owner
            done(bpy.ops.kfmocap.use_armature)
        cameras = load_cameras(folder / "calibration.toml")
        added_views.add_footage(scene, [folder / camera / "0000.jpg" for camera in cameras])
        added_views.calibrate_views(scene, cameras)
        scene.frame_set(scene.frame_start)
        if held:
            done(bpy.ops.kfmocap.hold_prop)
        done(bpy.ops.kfmocap.track)
        found = [vertices_on_frames([mesh]) for mesh in (skin, prop)]
    person, thing = (np.linalg.norm(a - b, axis=-1) for a, b in zip(found, truth, strict=True))
    return [person.mean(axis=1), person[:, hand].mean(axis=1), thing.mean(axis=1)]


def main() -> int:
    """Measure with and without the hold, and print the table."""
    render("render_creatures.py", [CREATURE, "--out", str(CACHE)], what=CREATURE)
    rows = []
    for held in (False, True):
        person, hand, thing = (1000 * errors for errors in measured(CACHE / CREATURE, held=held))
        values = (person.mean(), hand.mean(), thing.mean(), thing.max())
        rows.append(["held" if held else "not held", *(f"{value:.1f}" for value in values)])
    print(markdown(HEADS, rows))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
