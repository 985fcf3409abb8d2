"""glTF, VRM animations and USD hold the motion in metres with Y up."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from addon_shots import motion, shot  # noqa: E402
from exported_files import TOLERANCE, result_of  # noqa: E402
from kfmocap.core.body import human, part_poses  # noqa: E402
from kfmocap.kfmocap_addon.export import exporters, presets  # noqa: E402
from kfmocap.kfmocap_addon.export.export_options import ExportOptions  # noqa: E402
from kfmocap.kfmocap_addon.scene_io import scene  # noqa: E402
from scipy.spatial.transform import Rotation  # noqa: E402

pytest_plugins = ("addon_fixtures",)

pytestmark = pytest.mark.blender


def glb_content(path: Path) -> tuple[dict, bytes]:
    """The JSON and the binary part of a .glb file, read by its specification."""
    data = path.read_bytes()
    magic, version, length = struct.unpack_from("<4sII", data)
    assert (magic, version, length) == (b"glTF", 2, len(data))
    (size,) = struct.unpack_from("<I", data, 12)
    return json.loads(data[20 : 20 + size]), data[28 + size :]


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


@pytest.mark.parametrize("preset", ["BLENDER", "UNREAL"])
def test_gltf_holds_the_motion_in_metres_with_y_up(blender, tmp_path, preset):
    original = shot(tmp_path)
    built = scene.build_scene(original, result_of(original).motions, bpy.context.scene)
    [path] = exporters.export_performers(built, tmp_path, ExportOptions(preset, ("glb",)))
    names = [presets.PRESETS[preset].names.get(name, name) for name in human(1.7).names]
    places, seconds = glb_joints(path, names)
    assert np.abs(places - part_poses(human(1.7), motion(12))[1]).max() < TOLERANCE / 1000
    assert np.allclose(np.diff(seconds), 1 / 60, atol=1e-5)


def test_a_vrm_animation_says_which_joints_are_which_bones(blender, tmp_path):
    original = shot(tmp_path)
    built = scene.build_scene(original, result_of(original).motions, bpy.context.scene)
    options = ExportOptions("UNREAL", ("vrma",))
    [path] = exporters.export_performers(built, tmp_path, options)
    content, _ = glb_content(path)
    humanoid = content["extensions"]["VRMC_vrm_animation"]["humanoid"]["humanBones"]
    assert content["extensionsUsed"] == ["VRMC_vrm_animation"]
    named = {bone: content["nodes"][one["node"]]["name"] for bone, one in humanoid.items()}
    assert named["hips"] == "pelvis"
    assert named["leftLowerArm"] == "forearm.L"
    assert named["chest"] == "chest"
    assert len(named) == len(human().names)
    played = [
        (channel["target"]["node"], channel["target"]["path"]) for channel in content["animations"][0]["channels"]
    ]
    assert [node for node, path in played if path == "translation"] == [humanoid["hips"]["node"]]
    assert not any(path == "scale" for _, path in played)
    places, _ = glb_joints(path, human(1.7).names)
    assert np.abs(places - part_poses(human(1.7), motion(12))[1]).max() < TOLERANCE / 1000


@pytest.mark.parametrize("preset", ["BLENDER", "UNREAL"])
def test_usd_holds_the_motion_in_metres_with_y_up(blender, tmp_path, preset):
    usd = pytest.importorskip("pxr.Usd")
    from pxr import UsdGeom, UsdSkel

    original = shot(tmp_path)
    built = scene.build_scene(original, result_of(original).motions, bpy.context.scene)
    [path] = exporters.export_performers(built, tmp_path, ExportOptions(preset, ("usdc",)))
    stage = usd.Stage.Open(str(path))
    assert UsdGeom.GetStageUpAxis(stage) == "Y"
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    [prim] = [prim for prim in stage.Traverse() if prim.IsA(UsdSkel.Skeleton)]
    cache = UsdSkel.Cache()
    query = cache.GetSkelQuery(UsdSkel.Skeleton(prim))
    names = [joint.rpartition("/")[2] for joint in query.GetJointOrder()]
    order = [names.index(presets.PRESETS[preset].names.get(n, n).replace(".", "_")) for n in human().names]
    frames = range(int(stage.GetStartTimeCode()), int(stage.GetEndTimeCode()) + 1)
    assert len(frames) == 12
    assert stage.GetTimeCodesPerSecond() == pytest.approx(60)
    places = []
    for frame in frames:
        world = UsdGeom.XformCache(frame).GetLocalToWorldTransform(prim)
        joints = query.ComputeJointSkelTransforms(frame)
        places.append([(joints[j] * world).ExtractTranslation() for j in order])
    found = np.array(places) @ np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])
    assert np.abs(found - part_poses(human(1.7), motion(12))[1]).max() < TOLERANCE / 1000
