"""A study of other people's characters tracked on their own rigs, compared with Blender's curves.

python -m kfmocap.benchmarks.studies.rig_study [NAME ...]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np

from ...core.errors import KFMocapError
from ...core.formats.calibrations.calibration_files import load_cameras
from ...core.numerics.arrays import Array
from ...kfmocap_addon.registration import registered
from ...kfmocap_addon.scene_io import added_views, fcurves
from ..footage_renderer import ROOT, render
from ..tables import markdown
from .shown_meshes import meshes_of, vertices_on_frames

CREATURES = ("person", "dog", "hammer")
RIGS = ("bird", "cat", "dragon", "robot", "avatar", "vroid")
CHARACTERS = (*CREATURES, *RIGS)
CACHE = ROOT / "build" / "creatures"
KEY_EVERY = 24
BAR = 0.2
"""Largest acceptable ratio of the tracker's error to that of Blender's curves."""


@dataclass(frozen=True, eq=False)
class RigRow:
    """The measurements of one character.

    Attributes
    ----------
    tracked, interpolated : ndarray, shape (F,)
        Mean distance of the skin's vertices from their true positions on every frame, metres.
    seconds : float
        Processor time of tracking.
    """

    name: str
    parts: int
    tracked: Array
    interpolated: Array
    seconds: float

    @property
    def ratio(self) -> float:
        """Ratio of the mean error to that of Blender's curves."""
        return float(self.tracked.mean() / self.interpolated.mean())

    def cells(self) -> list[str]:
        """Return the cells of the table's row, errors in millimetres."""
        errors = (1000 * self.interpolated.mean(), 1000 * self.tracked.mean(), 1000 * self.tracked.max())
        return [self.name, str(self.parts), *(f"{error:.1f}" for error in errors), f"{self.ratio:.2f}"]


HEADS = ["character", "parts", "Blender's curves, mm", "tracked, mm", "worst frame, mm", "ratio"]


def measured(name: str, folder: Path, save: Path | None = None) -> RigRow:
    """Track a character as a user does: open its file, keep keys every 24 frames, use it as a body, track.

    Parameters
    ----------
    folder : Path
        As `tools/render_creatures.py` or `tools/render_rigs.py` writes it.
    save : Path, optional
        Where the tracked file is saved.
    """
    with registered():
        bpy.ops.wm.open_mainfile(filepath=str(folder / "rig.blend"))
        scene = bpy.context.scene
        armature = next(o for o in scene.objects if o.type == "ARMATURE")
        meshes = [mesh.name for mesh in meshes_of(armature)]
        truth = _shown(meshes)
        keep_keys(armature, KEY_EVERY)
        curves = _shown(meshes)
        bpy.context.view_layer.objects.active = armature
        done(bpy.ops.kfmocap.use_armature)
        cameras = load_cameras(folder / "calibration.toml")
        added_views.add_footage(scene, [folder / camera / "0000.jpg" for camera in cameras])
        added_views.calibrate_views(scene, cameras)
        begin = time.process_time()
        done(bpy.ops.kfmocap.track)
        seconds = time.process_time() - begin
        found = _shown(meshes)
        parts = sum(child.parent_type == "BONE" for child in armature.children)
        if save is not None:
            bpy.ops.wm.save_as_mainfile(filepath=str(save))
    tracked, interpolated = (np.linalg.norm(skin - truth, axis=-1).mean(axis=1) for skin in (found, curves))
    return RigRow(name, parts, tracked, interpolated, seconds)


def _shown(names: Sequence[str]) -> Array:
    """Return the vertices of meshes on every frame; using a rig as a body may have made references to them invalid."""
    return vertices_on_frames([bpy.data.objects[name] for name in names])


def done(operator: Callable[[], set[str]]) -> None:
    """Run an operator of the add-on; an error that it reports becomes a RuntimeError."""
    if operator() != {"FINISHED"}:
        raise KFMocapError("it was cancelled", where=str(operator))


def keep_keys(armature: bpy.types.Object, every: int) -> None:
    """Thin out keys on every frame to those that an animator might set: one every few frames, Bezier."""
    first = bpy.context.scene.frame_start
    for curve in fcurves.find_channelbag(armature).fcurves:
        keys = fcurves.get_keys(curve)
        kept = keys[(fcurves.frames_of(keys) - first) % every == 0]
        fcurves.set_keys(curve, [fcurves.new_keys(kept["co"][:, 0], kept["co"][:, 1], "KEYFRAME", "BEZIER")])


def main(argv: Sequence[str] | None = None) -> int:
    """Measure characters and print the table."""
    parser = argparse.ArgumentParser(prog="python -m kfmocap.benchmarks.studies.rig_study", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"by default all: {', '.join(CHARACTERS)}")
    parser.add_argument("--save", type=Path, metavar="FOLDER", help="save the tracked files there")
    args = parser.parse_args(argv)
    if unknown := sorted(set(args.names) - set(CHARACTERS)):
        parser.error(f"there is no {', '.join(unknown)}; there are {', '.join(CHARACTERS)}")
    names = args.names or list(CHARACTERS)
    for script, known in (("render_creatures.py", CREATURES), ("render_rigs.py", RIGS)):
        if chosen := [name for name in names if name in known]:
            render(script, [*chosen, "--out", str(CACHE)], what=" ".join(chosen))
    if args.save is not None:
        args.save.mkdir(parents=True, exist_ok=True)
    rows = []
    for name in names:
        rows.append(measured(name, CACHE / name, None if args.save is None else args.save.resolve() / f"{name}.blend"))
        print(f"{name}: ratio {rows[-1].ratio:.2f}, {rows[-1].seconds:.0f} s", flush=True)
    print(f"\n{markdown(HEADS, [row.cells() for row in rows])}")
    return int(any(row.ratio > BAR for row in rows))


if __name__ == "__main__":
    raise SystemExit(main())
