"""How far off bones may be is in the scene: as curves, as colours, and as frames to go to."""

from __future__ import annotations

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from addon_shots import blender, motion, shot, sights  # noqa: E402, F401
from kfmocap.core.body import human  # noqa: E402
from kfmocap.core.review.uncertainty import expected_errors  # noqa: E402
from kfmocap.kfmocap_addon import actions, confidence, curves, occlusion, scene  # noqa: E402

pytestmark = pytest.mark.blender

FRAMES, START = 24, 1
BODY = human()
HAND, FOREARM = BODY.index("hand.L"), BODY.index("forearm.L")


def errors(peak: int = 15) -> np.ndarray:
    """Metres: largest on one frame, and of the left hand, zero on the key frames."""
    found = np.zeros((FRAMES, len(BODY)))
    found[6:-1] = 0.02 * np.exp(-(((np.arange(6, FRAMES - 1) - peak) / 3) ** 2))[:, None]
    found[:, [HAND, FOREARM]] *= 3
    return found


@pytest.fixture
def built(blender, tmp_path):  # noqa: F811
    original = shot(tmp_path, frames=FRAMES)
    made = scene.build_scene(original, [motion(FRAMES)], bpy.context.scene)
    occlusion.write_occlusion(made, original, sights(original))
    confidence.write_confidence(made, original, [errors()])
    return made, made.kfmocap.performers[0].armature, original


def part_of(armature, bone="hand.L"):
    return next(child for child in armature.children if child.parent_bone == bone)


def colour(armature, frame: int, bone: str = "hand.L") -> list[float]:
    bpy.context.scene.frame_set(frame)
    return list(part_of(armature, bone).evaluated_get(bpy.context.evaluated_depsgraph_get()).color)


def test_every_bone_carries_its_expected_error_in_millimetres(built):
    made, armature, _ = built
    for frame in (0, 9, 15, FRAMES - 1):
        made.frame_set(START + frame)
        for part, name in enumerate(BODY.names):
            assert armature.pose.bones[name][confidence.ERROR] == pytest.approx(1000 * errors()[frame, part], abs=1e-4)
    np.testing.assert_allclose(confidence.read_confidence(armature, START, FRAMES), errors(), atol=1e-8)


def test_errors_are_no_key_poses_and_change_none(built):
    _, armature, _ = built
    before = curves.read_key_poses(armature, START, FRAMES).frames.tolist()
    armature.pose.bones["hand.L"].keyframe_insert(f'["{confidence.ERROR}"]', frame=13)
    assert curves.read_key_poses(armature, START, FRAMES).frames.tolist() == before == [0, 5, FRAMES - 1]


def test_an_excerpt_replaces_its_own_frames_alone(built):
    made, armature, original = built
    confidence.write_confidence(made, original, [np.full((4, len(BODY)), 0.005)], first=8)
    expected = errors()
    expected[8:12] = 0.005
    np.testing.assert_allclose(confidence.read_confidence(armature, START, FRAMES), expected, atol=1e-8)


def test_what_is_forgotten_is_told_no_more(built):
    made, armature, _ = built
    confidence.forget(made, made.kfmocap.performers[0], range(START, START + FRAMES))
    assert not confidence.read_confidence(armature, START, FRAMES).any()
    assert not made.kfmocap.performers[0].helpful


def test_the_most_helpful_frame_is_listed_first_with_its_parts(built):
    made, *_ = built
    first, *_ = made.kfmocap.performers[0].helpful
    assert abs(first.frame - (START + 15)) <= 1
    assert first.name == "forearm.L"
    assert first.error == pytest.approx(1000 * expected_errors(errors(), BODY.parents)[first.frame - START], rel=1e-5)
    assert first.gain > 0


def test_parts_are_green_where_they_are_sure_and_red_from_the_limit_on(built):
    made, armature, _ = built
    made.kfmocap.confidence_limit = 60.0
    assert colour(armature, START + 15) == [1, 1, 1, 1]
    made.kfmocap.show_confidence = True
    np.testing.assert_allclose(colour(armature, START + 5), [0, 1, 0.1, 1], atol=1e-6)
    np.testing.assert_allclose(colour(armature, START + 15), [1, 0, 0.1, 1], atol=1e-5)
    error = 1000 * errors()[11, HAND]
    expected = [min(1, error / 30), min(1, 2 - error / 30), 0.1, 1]
    np.testing.assert_allclose(colour(armature, START + 11), expected, atol=1e-4)
    made.kfmocap.confidence_limit = 30.0
    np.testing.assert_allclose(colour(armature, START + 11)[0], min(1, error / 15), atol=1e-4)


def test_what_no_camera_sees_is_blue(built):
    made, armature, original = built
    made.kfmocap.show_confidence = True
    share = sights(original)[0]
    share[:, 10, HAND] = 0
    occlusion.write_occlusion(made, original, [share])
    assert colour(armature, START + 10)[2] == 1
    assert colour(armature, START + 10, "hand.R")[2] == pytest.approx(0.1)


def bone_colour(armature, bone: str = "hand.L") -> list[float]:
    posed = armature.evaluated_get(bpy.context.evaluated_depsgraph_get())
    return list(posed.pose.bones[bone].color.custom.normal)


def test_bones_have_the_colours_of_their_parts(built):
    made, armature, _ = built
    made.kfmocap.show_confidence = True
    for frame in (5, 11, 15):
        np.testing.assert_allclose(colour(armature, START + frame)[:3], bone_colour(armature), atol=0.01)
    made.kfmocap.show_confidence = False
    assert armature.pose.bones["hand.L"].color.palette == "DEFAULT"


def test_a_bone_that_the_animator_coloured_keeps_its_colour(built):
    made, armature, _ = built
    armature.pose.bones["hand.L"].color.palette = "THEME03"
    for shown in (True, False):
        made.kfmocap.show_confidence = shown
        assert armature.pose.bones["hand.L"].color.palette == "THEME03"


def test_switched_off_the_parts_are_white_again_and_nothing_is_left(built):
    made, armature, _ = built
    made.kfmocap.show_confidence = True
    made.kfmocap.show_confidence = False
    assert colour(armature, START + 15) == [1, 1, 1, 1]
    for owner in (part_of(armature), armature):
        data = owner.animation_data
        assert data is None or not len(data.drivers)


def test_the_drivers_need_no_python(built):
    """A file from elsewhere, in which scripts may not run, has its colours, too; and Python would cost time."""
    made, armature, _ = built
    made.kfmocap.show_confidence = True
    for curve in [*part_of(armature).animation_data.drivers, *armature.animation_data.drivers]:
        assert curve.driver.is_simple_expression and curve.driver.is_valid


def test_a_body_that_was_never_tracked_stays_white(blender, tmp_path):  # noqa: F811
    made = scene.build_scene(shot(tmp_path, frames=FRAMES), scene=bpy.context.scene)
    armature = made.kfmocap.performers[0].armature
    made.kfmocap.show_confidence = True
    assert colour(armature, START) == [1, 1, 1, 1]
    assert not any(confidence.ERROR in curve.data_path for curve in actions.find_channelbag(armature).fcurves)
