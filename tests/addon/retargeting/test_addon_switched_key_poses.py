"""Key poses that were set with inverse kinematics stay what they are when a rig is tracked through its FK controls."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

bpy = pytest.importorskip("bpy")

from kfmocap.core.errors import BodyError  # noqa: E402
from kfmocap.kfmocap_addon.retargeting.tracked_bodies.skinned_body import use_as_body  # noqa: E402
from kfmocap.kfmocap_addon.scene_io import fcurves  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.body import body_armature  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.keys import key_pose_curves  # noqa: E402
from odd_characters import (  # noqa: E402
    BODY,
    CONTROL,
    add_bones,
    generated_rig,
    shown_heads,
    skinned_human,
    switched_human,
)

pytest_plugins = ("addon_fixtures",)

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("blender")]

KEYED = (1, 7)
LIMBS = [f"DEF-{part}.{side}" for part in ("upper_arm", "forearm", "hand", "thigh", "shin", "foot") for side in "LR"]
KNEES = [f"DEF-{part}.{side}" for part in ("forearm", "shin") for side in "LR"]
ENDS = [f"DEF-{part}.{side}" for part in ("hand", "foot") for side in "LR"]


def keyed_goals(armature, ways):
    """Key goals of inverse kinematics at rest, and six frames later elsewhere, by ways in the armature's
    axes, metres.
    """
    for k, frame in enumerate(KEYED):
        for name, way in ways.items():
            bone = armature.pose.bones[name]
            axes = np.array(bone.bone.matrix_local)[:3, :3] if bone.bone.use_local_location else np.eye(3)
            bone.location = (k * np.array(way) @ axes).tolist()
            bone.keyframe_insert("location", frame=frame)


def swung(part, end, axis, angle):
    """How far the end of a straight limb goes when it is swung about its first joint."""
    arm = BODY.parts[BODY.index(end)].head_world - BODY.parts[BODY.index(part)].head_world
    return Rotation.from_euler(axis, angle, degrees=True).apply(arm) - arm


ARM, LEG = swung("upper_arm.L", "hand.L", "z", -35), swung("thigh.R", "foot.R", "x", 30)


def test_key_poses_of_goals_become_those_of_fk_controls():
    armature = switched_human()
    keyed_goals(armature, {"IK-hand.L": ARM, "IK-foot.R": LEG})
    wanted = shown_heads(armature, KEYED[-1], LIMBS)[[frame - 1 for frame in KEYED]]
    assert np.ptp(wanted, axis=0).max() > 0.2
    bpy.context.scene.frame_set(3, subframe=0.25)
    taken, remarks = use_as_body(bpy.context.scene, armature)
    assert (bpy.context.scene.frame_current, bpy.context.scene.frame_subframe) == (3, 0.25)
    found = shown_heads(taken, KEYED[-1], LIMBS)[[frame - 1 for frame in KEYED]]
    assert np.linalg.norm(found - wanted, axis=-1).max() < 2e-3
    [said] = [text for text in remarks if "key poses" in text]
    assert said.startswith(
        f"armature {taken.name}: 2 key poses set with other controls are keyed on {CONTROL}upper_arm.L"
    )
    assert f"{CONTROL}thigh.R" in said
    poses = key_pose_curves.read_key_poses(taken, 1, KEYED[-1])
    assert poses.frames.tolist() == [frame - 1 for frame in KEYED]
    body = body_armature.body_from_armature(taken)
    i = body.index(f"{CONTROL}forearm.L")
    assert poses.fixed[:, 3 + 3 * i : 6 + 3 * i].all()


def test_keys_of_a_switch_get_its_value_for_tracking():
    armature = switched_human()
    goal = armature.pose.bones["IK-hand.L"]
    for frame in KEYED:
        goal.keyframe_insert('["ik_fk"]', frame=frame)
    keyed_goals(armature, {"IK-hand.L": ARM})
    wanted = shown_heads(armature, KEYED[-1], LIMBS)[[frame - 1 for frame in KEYED]]
    taken, remarks = use_as_body(bpy.context.scene, armature)
    found = shown_heads(taken, KEYED[-1], LIMBS)[[frame - 1 for frame in KEYED]]
    assert np.linalg.norm(found - wanted, axis=-1).max() < 2e-3
    curves = {c.data_path: fcurves.get_keys(c) for c in fcurves.find_channelbag(taken).fcurves}
    assert (curves['pose.bones["IK-hand.L"]["ik_fk"]']["co"][:, 1] == 0).all()
    assert any(text.startswith("bone IK-hand.L: its property 'ik_fk' is 0 now, on all its keys") for text in remarks)


@pytest.mark.parametrize("with_switches", [False, True])
def test_hands_and_feet_of_rigifys_key_poses_are_kept_though_its_limbs_stretch(with_switches):
    """With keys of the switches, the limbs are away from their FK controls on the frame that is shown."""
    rig = generated_rig()
    for limb in ("upper_arm", "thigh") if with_switches else ():
        for side in "LR":
            rig.pose.bones[f"{limb}_parent.{side}"].keyframe_insert('["IK_FK"]', frame=KEYED[0])
    keyed_goals(rig, {"hand_ik.L": (-0.3, -0.1, 0.1), "foot_ik.R": (0.0, -0.3, 0.3), "torso": (0.0, 0.0, -0.04)})
    wanted = shown_heads(rig, KEYED[-1], ENDS + KNEES)[[frame - 1 for frame in KEYED]]
    bpy.context.scene.frame_set(KEYED[-1])
    taken, remarks = use_as_body(bpy.context.scene, rig)
    found = shown_heads(taken, KEYED[-1], ENDS + KNEES)[[frame - 1 for frame in KEYED]]
    apart = np.linalg.norm(found - wanted, axis=-1)
    assert apart[:, :4].max() < 0.001 and apart[:, 4:].max() < 0.04
    [said] = [text for text in remarks if "key poses" in text]
    assert "forearm_fk.L" in said and "shin_fk.R" in said and "cm, at bone DEF-shin.R" in said


def test_rigs_without_key_poses_and_those_at_fk_are_left_as_they_are():
    _, remarks = use_as_body(bpy.context.scene, switched_human())
    assert not any("key poses" in text for text in remarks)
    armature = switched_human(influence=0.0)
    keyed_goals(armature, {"IK-hand.L": ARM})
    taken, remarks = use_as_body(bpy.context.scene, armature)
    assert not any("key poses" in text for text in remarks)
    assert not any(CONTROL in curve.data_path for curve in fcurves.find_channelbag(taken).fcurves)
    assert len(BODY) == len(body_armature.body_from_armature(taken))


def limbs_with_own_goals():
    """A character whose limbs have inverse kinematics on their own bones; hands and feet turn with the goals."""
    armature = skinned_human()
    for end, lower in (("hand", "forearm"), ("foot", "shin")):
        for side in "LR":
            part = BODY.parts[BODY.index(f"{end}.{side}")]
            add_bones(armature, [(f"goal-{end}.{side}", "", part.head_world, part.tail_world)])
            chain = armature.pose.bones[f"{lower}.{side}"].constraints.new("IK")
            turn = armature.pose.bones[f"{end}.{side}"].constraints.new("COPY_ROTATION")
            chain.chain_count = 2
            for held in (chain, turn):
                held.target, held.subtarget = armature, f"goal-{end}.{side}"
    bpy.context.view_layer.update()
    return armature


def test_key_poses_of_goals_that_move_a_limbs_own_bones_become_turns_of_these():
    armature = limbs_with_own_goals()
    keyed_goals(armature, {"goal-hand.L": ARM, "goal-foot.R": LEG})
    own = [name.removeprefix("DEF-") for name in LIMBS]
    wanted = shown_heads(armature, KEYED[-1], own)[[frame - 1 for frame in KEYED]]
    assert np.ptp(wanted, axis=0).max() > 0.2
    taken, remarks = use_as_body(bpy.context.scene, armature)
    found = shown_heads(taken, KEYED[-1], own)[[frame - 1 for frame in KEYED]]
    assert np.linalg.norm(found - wanted, axis=-1).max() < 2e-3
    assert "bone foot.R: its constraint 'Copy Rotation' is muted now: the limb is turned by its own bones" in remarks
    assert any("2 key poses set with other controls are keyed on upper_arm.L, forearm.L" in text for text in remarks)
    poses = key_pose_curves.read_key_poses(taken, 1, KEYED[-1])
    assert poses.frames.tolist() == [frame - 1 for frame in KEYED]


def test_goals_act_again_where_a_character_is_refused():
    armature = limbs_with_own_goals()
    armature.data.bones["head"].use_inherit_rotation = False
    with pytest.raises(BodyError, match="bone head"):
        use_as_body(bpy.context.scene, armature)
    assert not any(held.mute for bone in armature.pose.bones for held in bone.constraints)
