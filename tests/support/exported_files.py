"""Files that Blender exports, read back, for the tests of exports."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
from addon_shots import motion, track_result
from kfmocap.kfmocap_addon.export import exporters, presets
from kfmocap.kfmocap_addon.export.export_options import ExportOptions

TOLERANCE = 0.1
"""Largest error of a joint in a file that was read back, mm."""


def result_of(original):
    """What the tracker hands back for a shot: the true motion."""
    motions = tuple(motion(original.length, seed) for seed in range(len(original.performers)))
    return track_result(original, motions)


def empty_file():
    """Open an empty file in Blender."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)


def imported(path: Path):
    """A file read back into an empty scene: its armature."""
    empty_file()
    if path.suffix == ".bvh":
        bpy.ops.import_anim.bvh(filepath=str(path))
    else:
        bpy.ops.import_scene.fbx(filepath=str(path), anim_offset=0.0)
    [armature] = [o for o in bpy.data.objects if o.type == "ARMATURE"]
    return armature


def read_joints(armature, names: list[str], frames: list[int]) -> np.ndarray:
    """World places of the heads of bones on scene frames, (F, P, 3)."""
    places = []
    for frame in frames:
        bpy.context.scene.frame_set(frame)
        posed = armature.evaluated_get(bpy.context.evaluated_depsgraph_get())
        places.append([posed.matrix_world @ posed.pose.bones[name].head for name in names])
    return np.array(places)


def exported(folder: Path, suffix: str, **options):
    """A file of the scene's one performer, read back: its armature."""
    chosen = ExportOptions(formats=(suffix[1:],), **options)
    [path] = exporters.export_performers(bpy.context.scene, folder, chosen)
    scale = presets.PRESETS[chosen.preset].scale
    empty_file()
    if suffix == ".bvh":
        bpy.ops.import_anim.bvh(filepath=str(path), global_scale=1 / scale)
    else:
        bpy.ops.import_scene.fbx(filepath=str(path), anim_offset=0.0)
    [armature] = [o for o in bpy.data.objects if o.type == "ARMATURE"]
    return armature
