"""Fingers of a character move as the hands that detectors see in the footage, in Blender."""

from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from addon_shots import metarig  # noqa: E402
from keypoint_shots import cameras, person_with_hands  # noqa: E402
from kfmocap.cli import tracked_files  # noqa: E402
from kfmocap.core.body import landmark_positions  # noqa: E402
from kfmocap.core.errors import BodyError  # noqa: E402
from kfmocap.core.formats.bvh import read_bvh  # noqa: E402
from kfmocap.core.formats.keypoint_layouts import HAND_POINTS  # noqa: E402
from kfmocap.core.numerics import rotations  # noqa: E402
from kfmocap.core.retargeting.bone_roles.roles import FINGERS  # noqa: E402
from kfmocap.kfmocap_addon.export import exporters  # noqa: E402
from kfmocap.kfmocap_addon.export.export_options import ExportOptions  # noqa: E402
from kfmocap.kfmocap_addon.retargeting import finger_tracking  # noqa: E402
from kfmocap.kfmocap_addon.retargeting.tracked_bodies.skinned_body import use_as_body  # noqa: E402
from kfmocap.kfmocap_addon.scene_io import fcurves  # noqa: E402
from kfmocap.kfmocap_addon.scene_io import scene as scenes  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.body import body_armature  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.keys import motion_curves  # noqa: E402
from odd_characters import unreal_like  # noqa: E402
from test_addon_posing import BENT, BODY, WALK, walk_scene  # noqa: E402

pytest_plugins = ("addon_fixtures",)

pytestmark = pytest.mark.blender

FIST = 12
"""Scene frame on which the hands are closed."""


def points(rig: bpy.types.Object, side: str) -> np.ndarray:
    """The 21 points of a hand of Rigify's metarig as it is posed, (21, 3)."""
    bones = rig.pose.bones
    found = [bones[f"hand.{side}"].head]
    for finger in FINGERS:
        names = [f"{finger if finger == 'thumb' else 'f_' + finger}.0{k}.{side}" for k in (1, 2, 3)]
        found += [*(bones[name].head for name in names), bones[names[-1]].tail]
    assert len(found) == len(HAND_POINTS)
    return np.array([list(rig.matrix_world @ point) for point in found])


def bends(rig: bpy.types.Object) -> np.ndarray:
    """Angles between the neighbouring bones of all fingers, degrees."""
    found = []
    for side in "LR":
        bones = np.diff(points(rig, side)[1:].reshape(5, 4, 3), axis=1)
        bones /= np.linalg.norm(bones, axis=-1, keepdims=True)
        found.append(np.degrees(np.arccos(np.clip(np.sum(bones[:, 1:] * bones[:, :-1], axis=-1), -1, 1))))
    return np.stack(found)


def write_hands(folder, hands: np.ndarray) -> None:
    """OpenPose's files of two cameras, of hands (2, 21, 3) that stay as they are at the walker's wrists."""
    wrists = landmark_positions(BODY, WALK, ["LWrist", "RWrist"])
    for camera in cameras(2):
        path = folder / f"{camera.name}_json"
        path.mkdir()
        bent = replace(camera, distortions=np.array(BENT))
        for f, places in enumerate(wrists):
            turn = rotations.exp(np.array([0.0, 0.0, 0.02 * f]))
            there = np.concatenate(
                [place + (hand - hand[0]) @ turn.T for place, hand in zip(places, hands, strict=True)]
            )
            person = person_with_hands(bent.project(there, f))
            (path / f"{camera.name}_{f:06d}.json").write_text(json.dumps({"people": [person]}))
        files = [{"name": f"{camera.name}_000000.json"}]
        bpy.ops.kfmocap.import_keypoints(directory=str(path), files=files)


def test_fingers_bend_as_seen_and_the_animators_keys_stay(blender, tmp_path):
    walk_scene(tmp_path, tracked=True)
    rig = metarig()
    bpy.ops.kfmocap.hand_shape(shape="grip")
    bpy.context.view_layer.update()
    hands, wanted = np.stack([points(rig, side) for side in "LR"]), bends(rig)
    rig.animation_data_clear()
    for bone in rig.pose.bones:
        bone.rotation_quaternion, bone.rotation_euler = (1, 0, 0, 0), (0, 0, 0)
    bpy.context.view_layer.update()
    rest = bends(rig)
    write_hands(tmp_path, hands)

    own = rig.pose.bones["f_index.02.L"]
    own.rotation_euler = (0.3, 0.0, 0.0)
    own.keyframe_insert("rotation_euler", frame=FIST)
    bpy.context.view_layer.objects.active = rig
    for _ in range(2):  # again: the keys of the first time are replaced
        assert bpy.ops.kfmocap.fingers_from_keypoints() == {"FINISHED"}
    bpy.context.scene.frame_set(20)
    assert np.abs(rest - wanted).max() > 20
    assert np.abs(bends(rig) - wanted).max() < 3
    curve = fcurves.find_channelbag(rig).fcurves.find('pose.bones["f_index.02.L"].rotation_euler', index=0)
    keys = fcurves.get_keys(curve)
    assert len(keys) == len(WALK)
    [mine] = keys[keys["type"] != fcurves.enum_value("type", "GENERATED")]
    assert mine["co"].tolist() == pytest.approx([FIST, 0.3])


def test_without_fingers_or_hands_it_is_said_what_is_missing(blender, tmp_path):
    walk_scene(tmp_path, tracked=True)
    with pytest.raises(RuntimeError, match="No view has 2D keypoints yet"):
        bpy.ops.kfmocap.fingers_from_keypoints()
    bpy.context.scene.kfmocap.views[0].keypoints = str(tmp_path / "none.json")
    for make in (lambda: None, metarig):
        make()
        with pytest.raises(RuntimeError, match=r"none\.json"):
            bpy.ops.kfmocap.fingers_from_keypoints()
    armature = bpy.context.scene.kfmocap.performers[0].armature
    assert len(armature.data.bones) == len(BODY), "no fingers are added in vain"


def test_fingers_missing_on_a_foreign_armature_are_reported(blender):
    armature = unreal_like()
    with pytest.raises(BodyError, match="no armature has fingers that are known"):
        finger_tracking.with_fingers(use_as_body(bpy.context.scene, armature)[0])


def test_the_button_gives_a_body_without_fingers_some_that_move_as_seen(blender, tmp_path):
    slot = walk_scene(tmp_path, tracked=True)
    rig = metarig()
    bpy.ops.kfmocap.hand_shape(shape="grip")
    bpy.context.view_layer.update()
    hands, wanted = np.stack([points(rig, side) for side in "LR"]), bends(rig)
    bpy.data.objects.remove(rig)
    write_hands(tmp_path, hands)
    for _ in range(2):  # again: the fingers that are there move
        assert bpy.ops.kfmocap.fingers_from_keypoints() == {"FINISHED"}
    assert len(slot.armature.data.bones) == len(BODY) + 30
    bpy.context.scene.frame_set(20)
    assert np.abs(bends(slot.armature) - wanted).max() < 3


def test_a_hand_shape_without_a_character_is_the_chosen_performers(blender, tmp_path):
    slot = walk_scene(tmp_path, tracked=True)
    bpy.context.view_layer.objects.active = None
    for side in ("L", "LR"):
        assert bpy.ops.kfmocap.hand_shape(shape="fist", side=side) == {"FINISHED"}
        bpy.context.view_layer.update()
        assert (bends(slot.armature)["LR".index(side[-1]), 1:] > 45).all()
    assert len(slot.armature.data.bones) == len(BODY) + 30


def test_the_body_gets_fingers_and_files_have_them(blender, tmp_path, capsys):
    """As `kfmocap track` writes them where the shot file asks for fingers."""
    slot = walk_scene(tmp_path, tracked=True)
    rig = metarig()
    bpy.context.view_layer.objects.active = rig
    bpy.ops.kfmocap.hand_shape(shape="grip")
    bpy.context.view_layer.update()
    hands, wanted = np.stack([points(rig, side) for side in "LR"]), bends(rig)
    bpy.data.objects.remove(rig)
    write_hands(tmp_path, hands)

    scene = bpy.context.scene
    slot.fingers = True
    shot = scenes.shot_from_scene(scene)
    [found] = tracked_files._hands(shot, SimpleNamespace(motions=[WALK]))
    for _ in range(2):  # again: the bones that are there are used
        armature, bones = finger_tracking.with_fingers(slot.armature)
        assert finger_tracking.write_fingers(scene, armature, bones, found) == 30
    assert armature == slot.armature
    assert len(armature.data.bones) == len(BODY) + 30
    scene.frame_set(20)
    assert np.abs(bends(armature) - wanted).max() < 3
    assert [part.name for part in body_armature.body_from_armature(armature).parts] == BODY.names
    assert np.abs(motion_curves.read_motion(armature, 1, len(WALK)).difference(WALK)).max() < 1e-5

    exporters.export_bvh(tmp_path / "fingers.bvh", armature, scene, ExportOptions())
    moved = read_bvh(tmp_path / "fingers.bvh")
    assert {"f_index.03.L", "thumb.01.R"} < set(moved.rest.names)
    chain = moved.rest.indices(["f_index.01.L", "f_index.02.L", "f_index.03.L"])
    bones = np.diff(moved.positions[19, chain], axis=0)
    angle = np.degrees(np.arccos(bones[0] @ bones[1] / np.prod(np.linalg.norm(bones, axis=1))))
    assert angle == pytest.approx(wanted[0, 1, 0], abs=3)

    far = replace(WALK, translations=WALK.translations + 3.0)
    assert tracked_files._hands(shot, SimpleNamespace(motions=[far])) == (None,)
    assert "man is written without fingers: " in capsys.readouterr().err
