"""Rigs that Rigify generates for animals, as bodies."""

from __future__ import annotations

import time

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from addon_shots import joint_error  # noqa: E402
from kfmocap.kfmocap_addon.retargeting.rigs.rig_at_rest import update  # noqa: E402
from kfmocap.kfmocap_addon.retargeting.rigs.rig_reading import moved_matrices  # noqa: E402
from kfmocap.kfmocap_addon.retargeting.tracked_bodies.skinned_body import use_as_body  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.body import body_armature  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.keys import motion_curves  # noqa: E402
from odd_characters import generated_animal, shown_heads  # noqa: E402
from synthetic import swing  # noqa: E402

pytest_plugins = ("addon_fixtures",)

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("blender")]

LEG = ("thigh_fk", "shin_fk", "foot_fk")
CHAINS = {
    "basic_quadruped": [
        LEG,
        tuple(f"front_{name}" for name in LEG),
        ("neck", "head"),
        ("spine_fk.006", "spine_fk.004"),
    ],
    "bird": [LEG, ("Wing",), ("spine_fk.005", "head")],
    "cat": [LEG, ("spine_fk.003", "upper_arm_fk", "forearm_fk", "hand_fk"), ("spine_fk.001", "spine_fk", "thigh_fk")],
    "horse": [("thigh_fk", "lower_leg_fk", "hind_foot_fk", "r_toe_fk"), ("upper_arm_fk", "f_toe_fk"), ("neck", "head")],
    "shark": [("spine_fk.008", "spine_fk.003"), ("spine_fk.004", "neck", "head"), ("shoulder",)],
}
"""Controls of each animal that turn parts of its body, from the trunk outward; those of the left side."""
SECONDS = 60.0


def descends(body, name, above):
    """Whether a part hangs on another one, whatever lies between."""
    k = body.index(name)
    while k >= 0 and body.names[k] != above:
        k = body.parents[k]
    return k >= 0


@pytest.mark.parametrize("kind", CHAINS)
def test_an_animal_is_a_body_of_its_fk_controls(kind):
    given = generated_animal(kind)
    started = time.process_time()
    armature, remarks = use_as_body(bpy.context.scene, given)
    assert time.process_time() - started < SECONDS
    body = body_armature.body_from_armature(armature)
    assert not remarks
    assert body.names[0] == "torso"
    for chain in CHAINS[kind]:
        names = [name if name in body.names else f"{name}.L" for name in chain]
        assert all(descends(body, lower, upper) for upper, lower in zip(["torso", *names], names, strict=False))
    truth = swing(body, 3)
    motion_curves.write_motion(armature, truth, 1)
    assert joint_error(armature, body, truth) < 0.1


def test_the_limbs_of_an_animal_turn_with_their_controls():
    armature, _ = use_as_body(bpy.context.scene, generated_animal("basic_quadruped"))
    before = [np.array(armature.pose.bones[f"DEF-{name}.L"].matrix) for name in ("foot", "front_foot")]
    after = moved_matrices(armature, "thigh_fk.L", ["DEF-foot.L", "DEF-front_foot.L"])
    update()
    assert np.abs(after[0] - before[0]).max() > 0.1
    np.testing.assert_allclose(after[1], before[1], atol=1e-5)


def test_key_poses_of_an_animal_look_as_before_on_its_body():
    """As soon as the rig is a body, its legs turn with the trunk."""
    given, legs = generated_animal("bird"), ["DEF-shin.L", "DEF-foot.R"]
    for frame in (1, 4):
        given.pose.bones["torso"].rotation_quaternion = (0.95, 0.1 * frame, 0.0, 0.0)
        given.pose.bones["torso"].keyframe_insert("rotation_quaternion", frame=frame)
    wanted = shown_heads(given, 4, legs)[[0, 3]]
    taken, remarks = use_as_body(bpy.context.scene, given)
    assert np.linalg.norm(shown_heads(taken, 4, legs)[[0, 3]] - wanted, axis=-1).max() < 2e-3
    [said] = [text for text in remarks if "key poses" in text]
    assert said.startswith("armature rig: 2 key poses set with other controls are keyed on thigh_fk.L, shin_fk.L")
