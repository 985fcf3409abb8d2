"""When feet are planted, in Blender: found, corrected by the animator, used by Send to Rig and by Clean Feet."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from addon_shots import shot  # noqa: E402
from kfmocap.core.body import human  # noqa: E402
from kfmocap.core.body.kinematics import part_poses  # noqa: E402
from kfmocap.core.body.motion import Motion  # noqa: E402
from kfmocap.core.body.soles import SOLE_POINTS, Soles  # noqa: E402
from kfmocap.kfmocap_addon.overlays.plant_bars import ROWS  # noqa: E402
from kfmocap.kfmocap_addon.panels.review_panel import LEAST_SHARE, bar_pieces  # noqa: E402
from kfmocap.kfmocap_addon.retargeting import sole_plants  # noqa: E402
from kfmocap.kfmocap_addon.retargeting.tracked_bodies import skinned_body  # noqa: E402
from kfmocap.kfmocap_addon.scene_io import scene  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.body import body_armature  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.keys import key_pose_curves, motion_curves  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.review import plant_lists  # noqa: E402
from odd_characters import skinned_human  # noqa: E402
from render.motions import MOTIONS  # noqa: E402

pytest_plugins = ("addon_fixtures",)

pytestmark = pytest.mark.blender

FRAMES, START = 40, 1


@pytest.fixture
def dancer(blender, tmp_path):
    """A performer who dances, tracked as it were with an error of some millimetres."""
    scene.build_scene(shot(tmp_path, fps=30.0, frames=FRAMES), scene=bpy.context.scene)
    slot = bpy.context.scene.kfmocap.performers[0]
    slot.armature.animation_data.action = None
    dance = MOTIONS["whirl"](human(1.75), FRAMES, 30.0)
    error = 0.004 * np.sin(0.7 * np.arange(FRAMES)[:, None] + [0.0, 1.0, 2.0])
    motion_curves.write_motion(
        slot.armature, Motion(1.7 / 1.75 * dance.translations + error, dance.rotations), frame_start()
    )
    return slot


def frame_start():
    return bpy.context.scene.kfmocap.frame_start


def flags_of(slot):
    return plant_lists.shown(bpy.context.scene, slot)


def test_plants_are_found_and_the_animators_corrections_stay(dancer):
    assert flags_of(dancer) is None
    assert bpy.ops.kfmocap.find_plants() == {"FINISHED"}
    found = flags_of(dancer)
    assert set(found) == set(SOLE_POINTS) == set(ROWS)
    assert all(0.2 < flags.mean() < 0.95 for flags in found.values())
    frames = {"first": frame_start() + 3, "last": frame_start() + 20}
    assert bpy.ops.kfmocap.set_plant("EXEC_DEFAULT", point="heel.L", planted=False, **frames) == {"FINISHED"}
    assert bpy.ops.kfmocap.set_plant("EXEC_DEFAULT", point="R", planted=True, **frames) == {"FINISHED"}
    for _ in range(2):
        edited = flags_of(dancer)
        assert not edited["heel.L"][3:21].any()
        assert edited["heel.R"][3:21].all() and edited["ball.R"][3:21].all()
        assert np.array_equal(edited["ball.L"], found["ball.L"])
        assert np.array_equal(edited["heel.L"][21:], found["heel.L"][21:])
        assert bpy.ops.kfmocap.find_plants() == {"FINISHED"}
    assert bpy.ops.kfmocap.forget_plant_edits() == {"FINISHED"}
    assert all(np.array_equal(flags_of(dancer)[name], found[name]) for name in found)


def test_what_tracking_has_tested_is_shown_and_not_what_seems_to_stand(dancer):
    """Of an excerpt as well; what the animator sets is above it, and finding plants anew is without it."""
    shot_scene, start = bpy.context.scene, frame_start()
    body = body_armature.body_from_armature(dancer.armature)
    assert bpy.ops.kfmocap.find_plants() == {"FINISHED"}
    apparent = flags_of(dancer)
    held = np.zeros((FRAMES, len(SOLE_POINTS)), bool)
    held[5:20, 0] = held[15:, 3] = True
    plant_lists.write_tested(shot_scene, dancer, body, held, range(start, start + FRAMES))
    for _ in range(2):
        for c, name in enumerate(SOLE_POINTS):
            assert np.array_equal(flags_of(dancer)[name], held[:, c])
        sole_plants.find(shot_scene, dancer)
    again = np.ones((10, len(SOLE_POINTS)), bool)
    plant_lists.write_tested(shot_scene, dancer, body, again, range(start + 12, start + 22))
    held[12:22] = True
    assert all(np.array_equal(flags_of(dancer)[name], held[:, c]) for c, name in enumerate(SOLE_POINTS))
    frames = {"first": start, "last": start + 8}
    assert bpy.ops.kfmocap.set_plant("EXEC_DEFAULT", point="heel.L", planted=False, **frames) == {"FINISHED"}
    assert np.array_equal(flags_of(dancer)["heel.L"][9:], held[9:, 0]) and not flags_of(dancer)["heel.L"][:9].any()
    assert bpy.ops.kfmocap.forget_plant_edits() == {"FINISHED"}
    assert np.array_equal(flags_of(dancer)["heel.L"], held[:, 0])
    assert bpy.ops.kfmocap.find_plants() == {"FINISHED"}
    assert all(np.array_equal(flags_of(dancer)[name], apparent[name]) for name in apparent)


def test_frames_that_are_tracked_without_a_test_are_no_longer_tested(dancer):
    shot_scene, start = bpy.context.scene, frame_start()
    body = body_armature.body_from_armature(dancer.armature)
    held = np.ones((FRAMES, len(SOLE_POINTS)), bool)
    plant_lists.write_tested(shot_scene, dancer, body, held, range(start, start + FRAMES))
    plant_lists.write_tested(shot_scene, dancer, body, None, range(start + 10, start + 20))
    for flags in flags_of(dancer).values():
        assert flags[:10].all() and flags[20:].all() and not flags[10:20].any()


def test_a_foot_that_creeps_is_on_the_ground_for_a_character_unless_the_animator_says_no(dancer):
    shot_scene, start = bpy.context.scene, frame_start()
    body = body_armature.body_from_armature(dancer.armature)
    assert sole_plants.on_ground(shot_scene, dancer) is None
    assert bpy.ops.kfmocap.find_plants() == {"FINISHED"}
    apparent = flags_of(dancer)
    none = np.zeros((FRAMES, len(SOLE_POINTS)), bool)
    plant_lists.write_tested(shot_scene, dancer, body, none, range(start, start + FRAMES))
    frames = {"first": start, "last": start + 12}
    bpy.ops.kfmocap.set_plant("EXEC_DEFAULT", point="heel.L", planted=False, **frames)
    found = sole_plants.on_ground(shot_scene, dancer)
    assert not any(flags.any() for flags in flags_of(dancer).values())
    assert np.array_equal(found["heel.L"][13:], apparent["heel.L"][13:]) and not found["heel.L"][:13].any()
    assert np.array_equal(found["ball.R"], apparent["ball.R"])


def test_clean_feet_stand_still_and_the_animators_keys_stay(dancer):
    armature, start = dancer.armature, frame_start()
    body = body_armature.body_from_armature(armature)
    before = motion_curves.read_motion(armature, start, FRAMES)
    key = key_pose_curves.KeyPoses.whole([0], before[[0]])
    key_pose_curves.write_key_poses(armature, key, start)
    assert bpy.ops.kfmocap.find_plants() == {"FINISHED"}
    planted = np.stack([flags_of(dancer)[name] for name in SOLE_POINTS], axis=1)
    assert bpy.ops.kfmocap.clean_feet() == {"FINISHED"}
    after = motion_curves.read_motion(armature, start, FRAMES)
    soles = Soles.of(body)
    still = planted[1:] & planted[:-1]
    steps = [np.linalg.norm(np.diff(soles.world(part_poses(body, m)), axis=0), axis=2) for m in (before, after)]
    assert np.quantile(steps[1][still], 0.95) < 1e-3 < np.quantile(steps[0][still], 0.5)
    assert np.array_equal(after.rotations[0], before.rotations[0])
    assert np.array_equal(after.translations[0], before.translations[0])


@pytest.mark.parametrize(
    "plants",
    [
        [],
        [(1, 60)],
        [(60, 60)],
        [(1, 37), (46, 46), (59, 60)],
        [(1, 1), (3, 3), (5, 5)],
        [(58, 58), (60, 60)],
        [(-20, -3), (0, 4), (50, 90), (95, 99)],
    ],
)
def test_the_pieces_of_a_bar_fill_it_and_every_plant_on_its_frames_can_be_seen(plants):
    pieces = bar_pieces(plants, (1, 60))
    assert pieces[0][0] == 1 and pieces[-1][1] == 61
    assert all(before[1] == after[0] for before, after in itertools.pairwise(pieces))
    shown = [(start, stop, frames) for start, stop, frames, planted in pieces if planted]
    assert [frames for *_, frames in shown] == [(a, b) for a, b in plants if b >= 1 and a <= 60]
    assert all(stop - start >= LEAST_SHARE * 60 - 1e-9 for start, stop, _ in shown)
    assert all(start < stop for start, stop, *_ in pieces)
    numbers = [f for _, _, (first, last), _ in pieces for f in (first, last)]
    assert numbers == sorted(numbers)


def test_feet_of_somebody_elses_character_are_planted_as_those_of_the_default_body(dancer):
    own = {name: flags.copy() for name, flags in planted_of(dancer).items()}
    names = {name: f"joint_{i}" for i, name in enumerate(human(1.75).names)}
    skinned_body.use_as_body(bpy.context.scene, skinned_human(names))
    character = bpy.context.scene.kfmocap.performers[-1]
    body = body_armature.body_from_armature(character.armature)
    order = [list(names.values()).index(name) for name in body.names]
    dance = MOTIONS["whirl"](human(1.75), FRAMES, 30.0)
    error = 0.004 * np.sin(0.7 * np.arange(FRAMES)[:, None] + [0.0, 1.0, 2.0])
    moved = Motion(dance.translations + error, dance.rotations[:, order])
    motion_curves.write_motion(character.armature, moved, frame_start())
    bpy.context.view_layer.objects.active = character.armature
    found = planted_of(character)
    assert set(found) == set(own)
    assert np.mean([found[name] == own[name] for name in own]) > 0.9


def planted_of(slot):
    assert bpy.ops.kfmocap.find_plants() == {"FINISHED"}
    return flags_of(slot)
