"""Limbs of a Rigify character that are moved by their IK controls look as those that are moved by FK."""

from __future__ import annotations

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")
from kfmocap.core.body.skeleton_motion import motion_of_body  # noqa: E402
from kfmocap.core.body.soles import BALL_SHARE  # noqa: E402
from kfmocap.core.numerics import rotations  # noqa: E402
from kfmocap.core.retargeting.transfer import RetargetOptions  # noqa: E402
from kfmocap.kfmocap_addon.retargeting.send import SendOptions, send_to_rig  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.body.body_armature import edit_bones  # noqa: E402
from mathutils import Vector  # noqa: E402
from odd_characters import BODY, generated_rig  # noqa: E402
from render.motions import MOTIONS  # noqa: E402
from render.walking import Walk  # noqa: E402
from render.walking_feet import Footfalls  # noqa: E402
from synthetic import swing  # noqa: E402

pytest_plugins = ("addon_fixtures",)

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("blender")]

FRAMES = 24
LIMBS = ("upper_arm", "forearm", "hand", "thigh", "shin", "foot")
SHOWN = [f"DEF-{limb}.{side}{half}" for limb in LIMBS for side in "LR" for half in ("", ".001") if limb != "foot"]
WALK = motion_of_body(BODY, MOTIONS["walk"](BODY, FRAMES, 30.0), "man", 30.0)
STEPS = Footfalls(1.2, 0.8, 0.66, -8, 30, BALL_SHARE, heel_off=0.5, start=0.2)
ROLLING = motion_of_body(BODY, Walk(STEPS).motion(BODY, np.arange(FRAMES) / 30.0), "man", 30.0)
TOES = [f"DEF-{bone}.{side}" for bone in ("foot", "toe") for side in "LR"]
AMPLITUDE = 0.2
SWING = motion_of_body(BODY, swing(BODY, FRAMES, AMPLITUDE), "man", 30.0)
"""Elbows and knees turn about all axes, by up to `AMPLITUDE`, radians."""


def shown(armature, bones=SHOWN):
    """Orientations (F, B, 3, 3) and heads (F, B, 3) of deforming bones."""
    turns, heads = [], []
    names = [name for name in bones if name in armature.pose.bones]
    for frame in range(1, FRAMES + 1, 3):
        bpy.context.scene.frame_set(frame)
        posed = armature.evaluated_get(bpy.context.evaluated_depsgraph_get()).pose.bones
        turns.append([np.array(posed[name].matrix)[:3, :3] for name in names])
        heads.append([posed[name].head for name in names])
    return rotations.orthonormal(np.array(turns)), np.array(heads)


def sent(motion, preset, feet="keep", knees_outward=0.0):
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    rig = generated_rig()
    move_knees(rig, knees_outward)
    report = send_to_rig(
        bpy.context.scene, motion, rig, 1, SendOptions(preset=preset, retarget=RetargetOptions(feet=feet))
    )
    return rig, report


def move_knees(rig, outward):
    """Move knees at rest to the sides, out of the plane in which the hinges of inverse kinematics bend them."""
    knees = {side: rig.data.bones[f"ORG-shin.{side}"].head_local.copy() for side in "LR" if outward}
    with edit_bones(rig) as bones:
        for side, knee in knees.items():
            way = Vector((outward if side == "L" else -outward, 0, 0))
            for bone in bones:
                head, tail = ((point - knee).length < 1e-3 for point in (bone.head, bone.tail))
                bone.head, bone.tail = bone.head + head * way, bone.tail + tail * way
    for bone in rig.pose.bones:
        for held in bone.constraints:
            if held.type == "STRETCH_TO":
                held.rest_length = 0.0  # measured anew


def apart(one, other):
    """Largest differences in degrees and metres."""
    angles = rotations.log(np.swapaxes(one[0], -1, -2) @ other[0])
    return np.degrees(np.linalg.norm(angles, axis=-1).max()), np.linalg.norm(one[1] - other[1], axis=-1).max()


def test_ik_limbs_bend_and_twist_as_fk_limbs_do():
    by_fk = shown(sent(WALK, "rigify")[0])
    rig, report = sent(WALK, "rigify-ik")
    angle, distance = apart(by_fk, shown(rig))
    assert angle < 0.5 and distance < 2e-3
    assert not report["warnings"]


def test_knees_bend_about_hinges_that_are_not_across_the_plane_of_the_leg():
    """Knees a centimetre to the side, as on rigs of MakeHuman: the pole turns the legs even at rest, so that solvers
    seem to stretch other bones. Legs that are nearly straight cannot be bent less than by two degrees.
    """
    by_fk = shown(sent(WALK, "rigify", knees_outward=0.01)[0])
    rig, _ = sent(WALK, "rigify-ik", knees_outward=0.01)
    angle, distance = apart(by_fk, shown(rig))
    assert angle < 1.5 and distance < 2e-3


def test_ik_limbs_differ_from_fk_limbs_by_no_more_than_knees_and_elbows_turn_sideways():
    """Those of inverse kinematics are hinges. Feet are not kept: that bends each leg further in a plane of its own."""
    by_fk = shown(sent(SWING, "rigify", feet="off")[0])
    rig, report = sent(SWING, "rigify-ik", feet="off")
    by_ik = shown(rig)
    angle, distance = apart(by_fk, by_ik)
    assert angle < np.degrees(AMPLITUDE) and distance < 0.03
    arms = ["arm" in name or "hand" in name for name in SHOWN if name in rig.pose.bones]
    angle, distance = apart([each[:, arms] for each in by_fk], [each[:, arms] for each in by_ik])
    assert angle < 3.0 and distance < 2e-3
    # Bones that deform nothing are twisted by more, which is no error.
    assert max(report["error"][f"arm.{side}"]["worst_degrees"] for side in "LR") < 3.0


def test_toes_of_ik_limbs_bend_as_those_of_fk_limbs_do():
    """On the floor, while a stiff foot of the performer rolls over its ball."""
    by_fk = shown(sent(ROLLING, "rigify")[0], TOES)
    rig, report = sent(ROLLING, "rigify-ik")
    by_ik = shown(rig, TOES)
    angle, distance = apart(by_fk, by_ik)
    assert angle < 0.5 and distance < 2e-3
    assert not report["warnings"]
    feet, toes = by_ik[0][:, :2], by_ik[0][:, 2:]
    bends = np.swapaxes(feet, -1, -2) @ toes
    angles = np.degrees(np.linalg.norm(rotations.log(np.swapaxes(bends[:1], -1, -2) @ bends), axis=-1))
    assert angles.max() > 15


def test_twists_of_ik_limbs_are_not_left_to_the_fk_limbs_that_follow():
    by_fk = shown(sent(WALK, "rigify")[0])
    rig, _ = sent(WALK, "rigify-ik")
    bpy.context.scene.frame_set(12)
    send_to_rig(bpy.context.scene, WALK, rig, 1, SendOptions(preset="rigify"))
    angle, distance = apart(by_fk, shown(rig))
    assert angle < 0.1 and distance < 1e-4
