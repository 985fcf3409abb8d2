"""Limbs of a Rigify character that are moved by their IK controls look as those that are moved by FK."""

from __future__ import annotations

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from addon_shots import blender  # noqa: E402, F401
from kfmocap.core.body.skeleton_motion import motion_of_body  # noqa: E402
from kfmocap.core.numerics import rotations  # noqa: E402
from kfmocap.kfmocap_addon.retargeting.send import SendOptions, send_to_rig  # noqa: E402
from odd_characters import BODY, generated_rig  # noqa: E402
from render.motions import MOTIONS  # noqa: E402
from synthetic import swing  # noqa: E402

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("blender")]

FRAMES = 24
LIMBS = ("upper_arm", "forearm", "hand", "thigh", "shin", "foot")
SHOWN = [f"DEF-{limb}.{side}{half}" for limb in LIMBS for side in "LR" for half in ("", ".001") if limb != "foot"]
WALK = motion_of_body(BODY, MOTIONS["walk"](BODY, FRAMES, 30.0), "man", 30.0)
SWING = motion_of_body(BODY, swing(BODY, FRAMES, 0.2), "man", 30.0)
"""Elbows and knees turn about all axes."""


def shown(armature):
    """Orientations (F, B, 3, 3) and heads (F, B, 3) of deforming bones."""
    turns, heads = [], []
    names = [name for name in SHOWN if name in armature.pose.bones]
    for frame in range(1, FRAMES + 1, 3):
        bpy.context.scene.frame_set(frame)
        posed = armature.evaluated_get(bpy.context.evaluated_depsgraph_get()).pose.bones
        turns.append([np.array(posed[name].matrix)[:3, :3] for name in names])
        heads.append([posed[name].head for name in names])
    return rotations.orthonormal(np.array(turns)), np.array(heads)


def sent(motion, preset):
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    rig = generated_rig()
    report = send_to_rig(bpy.context.scene, motion, rig, 1, SendOptions(preset=preset))
    return rig, report


def apart(one, other):
    """Largest differences in degrees and metres."""
    angles = rotations.log(np.swapaxes(one[0], -1, -2) @ other[0])
    return np.degrees(np.linalg.norm(angles, axis=-1).max()), np.linalg.norm(one[1] - other[1], axis=-1).max()


@pytest.mark.parametrize(("motion", "degrees", "mm"), [(WALK, 0.5, 2.0), (SWING, 10.0, 20.0)], ids=["walk", "swing"])
def test_ik_limbs_bend_and_twist_as_fk_limbs_do(motion, degrees, mm):
    """But for elbows that turn about all axes, and bend backward: inverse kinematics does not."""
    by_fk = shown(sent(motion, "rigify")[0])
    rig, report = sent(motion, "rigify-ik")
    angle, distance = apart(by_fk, shown(rig))
    assert angle < degrees and 1000 * distance < mm
    assert motion is SWING or not report["warnings"]


def test_twists_of_ik_limbs_are_not_left_to_the_fk_limbs_that_follow():
    by_fk = shown(sent(WALK, "rigify")[0])
    rig, _ = sent(WALK, "rigify-ik")
    bpy.context.scene.frame_set(12)
    send_to_rig(bpy.context.scene, WALK, rig, 1, SendOptions(preset="rigify"))
    angle, distance = apart(by_fk, shown(rig))
    assert angle < 0.1 and distance < 1e-4
