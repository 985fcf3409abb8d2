"""Motion that was sent to a character is taken back: it is animated and moves as before, whatever was done since."""

from __future__ import annotations

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from kfmocap.core.body.skeleton_motion import motion_of_body  # noqa: E402
from kfmocap.kfmocap_addon.retargeting.rigs.overrides import editable  # noqa: E402
from kfmocap.kfmocap_addon.retargeting.rigs.rig_curves import CurveOptions  # noqa: E402
from kfmocap.kfmocap_addon.retargeting.send import SendOptions, send_to_rig  # noqa: E402
from kfmocap.kfmocap_addon.retargeting.sent_actions import take_back, was_sent  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.body import body_armature  # noqa: E402
from odd_characters import (  # noqa: E402
    BODY,
    generated_rig,
    limited_legs,
    linked,
    one_chain_human,
    shown_heads,
    skinned_human,
    switched_human,
)
from synthetic import swing  # noqa: E402

pytest_plugins = ("addon_fixtures",)

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("blender")]

FRAMES = 8


def driven():
    """A character one of whose bones a driver turns, and whose hips are connected to a root."""
    armature = skinned_human()
    curve = armature.pose.bones["head"].driver_add("rotation_euler", 0)
    curve.driver.expression = "frame / 20"
    armature.pose.bones["head"].rotation_mode = "XYZ"
    with body_armature.edit_bones(armature) as bones:
        root = bones.new("root")
        root.head, root.tail = (0, 0, 0), bones["pelvis"].head
        bones["pelvis"].parent, bones["pelvis"].use_connect = root, True
    return armature


def posed(armature):
    """Give every bone a pose of its own: hands and feet are where inverse kinematics or the pose has them."""
    for k, bone in enumerate(armature.pose.bones):
        if not any(bone.lock_rotation):
            bone.rotation_mode = "XYZ"
            bone.rotation_euler = (0.05 * (k % 3), 0.04, -0.05 * (k % 2))
    bpy.context.view_layer.update()
    return armature


def keyed(armature):
    """The same with keys on some bones, two of them, so that it moves."""
    for bone in posed(armature).pose.bones[:12]:
        for frame in (1, FRAMES):
            bone.rotation_euler.x += 0.1
            bone.keyframe_insert("rotation_euler", frame=frame)
    return armature


def send(armature, frames=FRAMES, **options):
    motion = motion_of_body(BODY, swing(BODY, frames, 0.3), "man", 30.0)
    return send_to_rig(bpy.context.scene, motion, armature, 1, SendOptions(**options))


@pytest.mark.parametrize("before", [posed, keyed])
@pytest.mark.parametrize(
    "made",
    [skinned_human, switched_human, one_chain_human, limited_legs, driven, generated_rig],
    ids=lambda f: f.__name__,
)
def test_a_character_moves_as_before(made, before):
    armature = before(made())
    names = [bone.name for bone in armature.pose.bones]
    wanted, action = shown_heads(armature, FRAMES, names), armature.animation_data and armature.animation_data.action
    send(armature)
    assert np.abs(shown_heads(armature, FRAMES, names) - wanted).max() > 0.01
    take_back(armature)
    assert np.abs(shown_heads(armature, FRAMES, names) - wanted).max() < 1e-5
    assert armature.animation_data.action == action
    assert not was_sent(armature)


def test_a_layer_is_taken_off():
    armature = keyed(skinned_human())
    wanted, action = shown_heads(armature, FRAMES, BODY.names), armature.animation_data.action
    send(armature, curves=CurveOptions(layer=True))
    assert armature.animation_data.nla_tracks
    take_back(armature)
    assert not armature.animation_data.nla_tracks
    assert armature.animation_data.action == action
    assert np.abs(shown_heads(armature, FRAMES, BODY.names) - wanted).max() < 1e-5


def test_what_was_sent_last_is_taken_back_first():
    armature = keyed(switched_human())
    names = [bone.name for bone in armature.pose.bones]
    shown = [shown_heads(armature, FRAMES, names)]
    for frames in (4, FRAMES):
        send(armature, frames)
        shown.append(shown_heads(armature, FRAMES, names))
    for wanted in shown[-2::-1]:
        take_back(armature)
        assert np.abs(shown_heads(armature, FRAMES, names) - wanted).max() < 1e-5
    assert not was_sent(armature)


def test_a_saved_file_keeps_what_the_character_was(tmp_path):
    armature = keyed(switched_human())
    names = [bone.name for bone in armature.pose.bones]
    wanted = shown_heads(armature, FRAMES, names)
    send(armature)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "scene.blend"))
    armature = bpy.data.objects["hero"]
    take_back(armature)
    assert np.abs(shown_heads(armature, FRAMES, names) - wanted).max() < 1e-5


@pytest.mark.parametrize("made", [switched_human, one_chain_human, limited_legs])
def test_a_saved_file_has_motion_that_was_sent_again_to_a_linked_character(made, tmp_path):
    armature = editable(linked(made, tmp_path), bpy.context.scene)
    names = [bone.name for bone in armature.pose.bones]
    for _ in range(3):
        send(armature)
    wanted = shown_heads(armature, FRAMES, names)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "scene.blend"))
    armature = next(o for o in bpy.data.objects if o.type == "ARMATURE" and o.override_library)
    assert np.abs(shown_heads(armature, FRAMES, names) - wanted).max() < 1e-5
