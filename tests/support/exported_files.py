"""Files that Blender exports, read back, for the tests of exports."""

from __future__ import annotations

import json
from pathlib import Path

import bpy
import numpy as np
import pytest
from addon_shots import motion, track_result
from kfmocap.kfmocap_addon.export import exporters, presets
from kfmocap.kfmocap_addon.export.export_options import ExportOptions
from scipy.spatial.transform import Rotation

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


def glb_content(path: Path) -> tuple[dict, bytes]:
    """The JSON and the binary part of a .glb file, as another program's library reads them."""
    read = pytest.importorskip("pygltflib").GLTF2().load_binary(str(path))
    return json.loads(read.to_json()), read.binary_blob()


def glb_values(content: dict, binary: bytes, accessor: int) -> np.ndarray:
    one = content["accessors"][accessor]
    view = content["bufferViews"][one["bufferView"]]
    columns = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[one["type"]]
    start = view.get("byteOffset", 0) + one.get("byteOffset", 0)
    return np.frombuffer(binary, np.float32, one["count"] * columns, start).reshape(one["count"], columns)


def glb_joints(path: Path, names: list[str]) -> tuple[np.ndarray, np.ndarray]:
    """World places of joints on every frame (F, P, 3), Z up, and the seconds of the frames (F,)."""
    content, binary = glb_content(path)
    nodes = content["nodes"]
    (animation,) = content["animations"]
    seconds = glb_values(content, binary, animation["samplers"][0]["input"])[:, 0]
    moving = {}
    for channel in animation["channels"]:
        sampler = animation["samplers"][channel["sampler"]]
        moving[channel["target"]["node"], channel["target"]["path"]] = glb_values(content, binary, sampler["output"])
    parents = {child: n for n, node in enumerate(nodes) for child in node.get("children", ())}

    def placed(n: int, frame: int) -> np.ndarray:
        default = {"translation": [0, 0, 0], "rotation": [0, 0, 0, 1], "scale": [1, 1, 1]}
        t, q, s = (
            moving[n, key][min(frame, len(moving[n, key]) - 1)] if (n, key) in moving else nodes[n].get(key, value)
            for key, value in default.items()
        )
        matrix = np.eye(4)
        matrix[:3, :3] = Rotation.from_quat(q).as_matrix() * s
        matrix[:3, 3] = t
        return placed(parents[n], frame) @ matrix if n in parents else matrix

    index = {node["name"]: n for n, node in enumerate(nodes)}
    places = np.array([[placed(index[name], f)[:3, 3] for name in names] for f in range(len(seconds))])
    return places @ np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]), seconds
