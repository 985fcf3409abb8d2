"""glTF, VRM animations and USD hold the motion in metres with Y up."""

from __future__ import annotations

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from addon_shots import motion, person, shot  # noqa: E402
from exported_files import TOLERANCE, glb_content, glb_joints, glb_values, result_of  # noqa: E402
from kfmocap.core.body import part_poses  # noqa: E402
from kfmocap.core.body.skeleton_motion import motion_of_body  # noqa: E402
from kfmocap.core.retargeting.transfer import RetargetOptions  # noqa: E402
from kfmocap.kfmocap_addon.export import exporters, presets  # noqa: E402
from kfmocap.kfmocap_addon.export.export_options import ExportOptions  # noqa: E402
from kfmocap.kfmocap_addon.retargeting.send import SendOptions, send_to_rig  # noqa: E402
from kfmocap.kfmocap_addon.scene_io import scene  # noqa: E402
from made_rigs import made_rig  # noqa: E402
from odd_characters import BODY, add_bones, skinned_human  # noqa: E402
from scipy.spatial.transform import Rotation  # noqa: E402
from synthetic import swing  # noqa: E402

pytest_plugins = ("addon_fixtures",)

pytestmark = pytest.mark.blender


@pytest.mark.parametrize("preset", ["BLENDER", "UNREAL"])
def test_gltf_holds_the_motion_in_metres_with_y_up(blender, tmp_path, preset):
    original = shot(tmp_path)
    built = scene.build_scene(original, result_of(original).motions, bpy.context.scene)
    [path] = exporters.export_performers(built, tmp_path, ExportOptions(preset, ("glb",)))
    names = [presets.PRESETS[preset].names.get(name, name) for name in person(1.7).names]
    places, seconds = glb_joints(path, names)
    assert np.abs(places - part_poses(person(1.7), motion(12))[1]).max() < TOLERANCE / 1000
    assert np.allclose(np.diff(seconds), 1 / 60, atol=1e-5)


@pytest.mark.parametrize("suffix", ["glb", "vrma"])
@pytest.mark.parametrize("fps", [29.97, 23.976])
def test_frames_last_as_long_as_the_rate_says_also_if_it_is_not_whole(blender, tmp_path, suffix, fps):
    original = shot(tmp_path)
    built = scene.build_scene(original, result_of(original).motions, bpy.context.scene)
    [path] = exporters.export_performers(built, tmp_path, ExportOptions(formats=(suffix,), fps=fps))
    content, binary = glb_content(path)
    for sampler in content["animations"][0]["samplers"]:
        seconds = glb_values(content, binary, sampler["input"])[:, 0]
        assert np.allclose(np.diff(seconds), 1 / fps, rtol=1e-5)
        accessor = content["accessors"][sampler["input"]]
        assert (accessor["min"], accessor["max"]) == ([seconds[0]], [seconds[-1]])


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
    assert len(named) == len(person().names)
    played = [
        (channel["target"]["node"], channel["target"]["path"]) for channel in content["animations"][0]["channels"]
    ]
    assert [node for node, path in played if path == "translation"] == [humanoid["hips"]["node"]]
    assert not any(path == "scale" for _, path in played)
    places, _ = glb_joints(path, person(1.7).names)
    assert np.abs(places - part_poses(person(1.7), motion(12))[1]).max() < TOLERANCE / 1000


def test_a_character_is_written_as_vrm_animation_with_its_fingers(blender, tmp_path):
    """VRM 1.0 calls a thumb's bones metacarpal, proximal and distal, those of fingers proximal to distal."""
    hero = skinned_human()
    hand = BODY.parts[BODY.index("hand.L")]
    for finger in ("thumb", "f_index"):
        above = "hand.L"
        for k in range(3):
            name = f"{finger}.0{k + 1}.L"
            place = hand.tail_world + [0.03 * k, 0.0, 0.0]
            add_bones(hero, [(name, above, place, place + [0.03, 0.0, 0.0])])
            above = name
    send_to_rig(bpy.context.scene, motion_of_body(BODY, swing(BODY, 4), "man", 30.0), hero, 1)
    options = ExportOptions(formats=("vrma",), frames=(1, 4))
    [path] = exporters.export_armatures(bpy.context.scene, [("hero", hero)], tmp_path, options, "hero")
    content, _ = glb_content(path)
    bones = content["extensions"]["VRMC_vrm_animation"]["humanoid"]["humanBones"]
    named = {bone: content["nodes"][one["node"]]["name"] for bone, one in bones.items()}
    assert named["leftLowerLeg"] == "shin.L"
    fingers = {bone: name for bone, name in named.items() if "Thumb" in bone or "Index" in bone}
    assert fingers == {
        "leftThumbMetacarpal": "thumb.01.L",
        "leftThumbProximal": "thumb.02.L",
        "leftThumbDistal": "thumb.03.L",
        "leftIndexProximal": "f_index.01.L",
        "leftIndexIntermediate": "f_index.02.L",
        "leftIndexDistal": "f_index.03.L",
    }


def rig_with_root():
    """A rig with five bones in its spine, two in its neck and a root, as a game engine's mannequin."""
    made = made_rig("unreal", BODY, 0.7)
    armature = bpy.data.objects.new("hero", bpy.data.armatures.new("hero"))
    bpy.context.scene.collection.objects.link(armature)
    bones = [
        (name, made.rest.names[p] if p >= 0 else "root", head, tail)
        for name, p, head, tail in zip(
            made.rest.names, made.rest.parents, made.rest.heads, made.rest.tails, strict=True
        )
    ]
    add_bones(armature, [("root", "", (0, 0, 0), (0, 0.3, 0)), *bones])
    return armature


def test_what_vrm_has_no_bone_for_is_played_by_the_bones_that_it_has(blender, tmp_path):
    """Players read the rotations of the humanoid's bones alone, and the place of its hips."""
    hero = rig_with_root()
    given = motion_of_body(BODY, swing(BODY, 4, 0.3), "man", 30.0)
    send_to_rig(bpy.context.scene, given, hero, 1, SendOptions(retarget=RetargetOptions(root="root-bone")))
    options = ExportOptions(formats=("vrma",), frames=(1, 4))
    [path] = exporters.export_armatures(bpy.context.scene, [("hero", hero)], tmp_path, options, "hero")
    content, binary = glb_content(path)
    bones = content["extensions"]["VRMC_vrm_animation"]["humanoid"]["humanBones"]
    nodes, [animation] = content["nodes"], content["animations"]
    above = {child: n for n, node in enumerate(nodes) for child in node.get("children", ())}
    curves = {
        (c["target"]["node"], c["target"]["path"]): glb_values(
            content, binary, animation["samplers"][c["sampler"]]["output"]
        )
        for c in animation["channels"]
    }
    assert {node for node, _ in curves} <= {one["node"] for one in bones.values()}

    def turned(node, frame):
        own = curves.get((node, "rotation"), [nodes[node].get("rotation", (0, 0, 0, 1))] * 4)[frame]
        return turned(above[node], frame) * Rotation.from_quat(own) if node in above else Rotation.from_quat(own)

    y_up = Rotation.from_euler("x", -90, degrees=True)
    for frame in range(4):
        bpy.context.scene.frame_set(frame + 1)
        for one in bones.values():
            shown = hero.pose.bones[nodes[one["node"]]["name"]].matrix.to_quaternion()
            wanted = y_up * Rotation.from_quat([*shown[1:], shown[0]])
            assert (turned(one["node"], frame).inv() * wanted).magnitude() < 1e-3
    way = given.positions[:, given.rest.names.index("pelvis"), :2]
    assert np.ptp(curves[bones["hips"]["node"], "translation"][:, 0]) == pytest.approx(np.ptp(way[:, 0]), rel=0.05)


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
    order = [names.index(presets.PRESETS[preset].names.get(n, n).replace(".", "_")) for n in person().names]
    frames = range(int(stage.GetStartTimeCode()), int(stage.GetEndTimeCode()) + 1)
    assert len(frames) == 12
    assert stage.GetTimeCodesPerSecond() == pytest.approx(60)
    places = []
    for frame in frames:
        world = UsdGeom.XformCache(frame).GetLocalToWorldTransform(prim)
        joints = query.ComputeJointSkelTransforms(frame)
        places.append([(joints[j] * world).ExtractTranslation() for j in order])
    found = np.array(places) @ np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])
    assert np.abs(found - part_poses(person(1.7), motion(12))[1]).max() < TOLERANCE / 1000
