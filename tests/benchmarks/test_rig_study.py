"""The rigs that are rendered show what was painted, and an animator's keys are left of their motion."""

from __future__ import annotations

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from kfmocap.benchmarks.studies import held_prop_study  # noqa: E402
from kfmocap.benchmarks.studies.rig_study import CREATURES, RigRow, keep_keys, skin_on_frames  # noqa: E402
from kfmocap.kfmocap_addon.scene_io import fcurves  # noqa: E402
from render import creatures  # noqa: E402
from render_creatures import FIRST, build_rig  # noqa: E402

pytestmark = pytest.mark.blender


@pytest.mark.parametrize("make", [creatures.person, creatures.dog, creatures.hammer])
def test_a_rigs_skin_moves_as_the_painted_one(make):
    creature = make(0.03)
    armature = build_rig(creature)
    assert armature.scale[0] == pytest.approx(creature.scale)
    bpy.context.scene.frame_start = bpy.context.scene.frame_end = FIRST + 17
    (shown,) = skin_on_frames(armature)
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


def test_every_character_that_can_be_rendered_is_measured():
    assert {*CREATURES, held_prop_study.CREATURE} == set(creatures.CREATURES)
