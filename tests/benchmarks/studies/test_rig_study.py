"""The rigs that are rendered show what was painted, and an animator's keys are left of their motion."""

from __future__ import annotations

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from kfmocap.benchmarks.studies import held_prop_study, rig_study  # noqa: E402
from kfmocap.benchmarks.studies.rig_study import RigRow, keep_keys  # noqa: E402
from kfmocap.benchmarks.studies.shown_meshes import meshes_of, vertices_on_frames  # noqa: E402
from kfmocap.kfmocap_addon.scene_io import fcurves  # noqa: E402
from render import creatures, rigs  # noqa: E402
from render.drawing import linear  # noqa: E402
from render.rig_parts import colours_of  # noqa: E402
from render_creatures import FIRST, build_rig  # noqa: E402
from render_rigs import animate, built, controls, shown  # noqa: E402

pytestmark = pytest.mark.blender


@pytest.mark.parametrize("make", [creatures.person, creatures.dog, creatures.hammer])
def test_a_rigs_skin_moves_as_the_painted_one(make):
    creature = make(0.03)
    armature = build_rig(creature)
    assert armature.scale[0] == pytest.approx(creature.scale)
    bpy.context.scene.frame_start = bpy.context.scene.frame_end = FIRST + 17
    (shown,) = vertices_on_frames(meshes_of(armature))
    (painted,) = creature.figure.posed(creature.motion(np.array([17 / creatures.FPS])))
    assert np.linalg.norm(shown - painted, axis=1).max() < 1e-4


def test_keys_are_left_every_24_frames_and_the_curves_between_them_are_blenders():
    armature = build_rig(creatures.hammer(0.03))
    keep_keys(armature, creatures.KEY_EVERY)
    for curve in fcurves.find_channelbag(armature).fcurves:
        keys = fcurves.get_keys(curve)
        assert (fcurves.frames_of(keys) - FIRST).tolist() == [0, 24, 48, 72]
        assert set(keys["interpolation"]) == {fcurves.enum_value("interpolation", "BEZIER")}


def test_the_ratio_is_that_of_the_mean_errors():
    row = RigRow("dog", 20, np.array([0.002, 0.004]), np.array([0.02, 0.04]), 1.0)
    assert row.ratio == pytest.approx(0.1)
    assert row.cells() == ["dog", "20", "30.0", "3.0", "4.0", "0.10"]


def test_all_bones_of_a_rig_move_its_meshes_apart_from_locked_axes(tmp_path):
    bones = controls("robot", tmp_path)
    armature = built("robot", tmp_path)
    assert set(bones) == set(armature.data.bones.keys())
    locked = armature.pose.bones["claw_Lft"]
    locked.lock_rotation = (True, False, True)
    animate(armature, bones, seed=1)
    for mesh in meshes_of(armature):
        start, later = (shown([mesh], FIRST + frame) for frame in (0, 8.5))
        assert np.linalg.norm(later - start, axis=1).min() > 0.01, mesh.name
        np.testing.assert_array_equal(colours_of(mesh.data).shape, start.shape)
    bpy.context.scene.frame_set(FIRST + 8)
    assert np.abs(locked.rotation_quaternion[2]) > 0.01
    np.testing.assert_allclose([locked.rotation_quaternion[k] for k in (1, 3)], 0, atol=1e-6)


def test_a_linked_character_is_overridden_beside_its_library(tmp_path):
    armature = built("avatar", tmp_path)
    assert armature.override_library and not armature.override_library.is_system_override
    (skin,) = meshes_of(armature)
    assert skin.library is None and skin.data.library.filepath == "//avatar.blend"
    still = shown([skin], FIRST)
    assert np.ptp(still, axis=0)[2] == pytest.approx(1.7, abs=0.05)  # with hair and soles
    assert (colours_of(skin.data) <= linear(0.95) + 1e-6).all()
    animate(armature, ["J_Bip_C_Hips"], seed=1)
    assert np.linalg.norm(shown([skin], FIRST + 10) - still, axis=1).min() > 0.01


def test_every_character_that_can_be_rendered_is_measured():
    assert {*rig_study.CREATURES, held_prop_study.CREATURE} == set(creatures.CREATURES)
    assert set(rig_study.RIGS) == set(rigs.RIGS)
