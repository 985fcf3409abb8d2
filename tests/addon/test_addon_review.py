"""How far off bones may be is in the scene: as curves, as colours, and as frames to go to."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from addon_shots import motion, person, shot, sights  # noqa: E402
from kfmocap.core.tracking.expected_errors.uncertainty import JointErrors  # noqa: E402
from kfmocap.kfmocap_addon.overlays import misfit_backgrounds  # noqa: E402
from kfmocap.kfmocap_addon.scene_io import fcurves, scene  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.body.sides import colour_of  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.keys import key_pose_curves  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.review import bone_confidence, bone_visibility, lost_parts  # noqa: E402

pytest_plugins = ("addon_fixtures",)

pytestmark = pytest.mark.blender

FRAMES, START = 24, 1
BODY = person()
HAND, FOREARM = BODY.index("hand.L"), BODY.index("forearm.L")


def errors(peak: int = 15) -> np.ndarray:
    """Metres: largest on one frame, and of the left hand, zero on the key frames."""
    found = np.zeros((FRAMES, len(BODY)))
    found[6:-1] = 0.02 * np.exp(-(((np.arange(6, FRAMES - 1) - peak) / 3) ** 2))[:, None]
    found[:, [HAND, FOREARM]] *= 3
    return found


@pytest.fixture
def built(blender, tmp_path):
    original = shot(tmp_path, frames=FRAMES)
    made = scene.build_scene(original, [motion(FRAMES)], bpy.context.scene)
    bone_visibility.write_occlusion(made, original, sights(original))
    bone_confidence.write_confidence(made, [errors()])
    bone_confidence.refresh(made)
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
            assert armature.pose.bones[name][bone_confidence.ERROR] == pytest.approx(
                1000 * errors()[frame, part], abs=1e-4
            )
    np.testing.assert_allclose(bone_confidence.read_confidence(armature, START, FRAMES), errors(), atol=1e-8)


def test_curves_of_errors_do_not_count_as_key_poses(built):
    _, armature, _ = built
    before = key_pose_curves.read_key_poses(armature, START, FRAMES).frames.tolist()
    armature.pose.bones["hand.L"].keyframe_insert(f'["{bone_confidence.ERROR}"]', frame=13)
    assert key_pose_curves.read_key_poses(armature, START, FRAMES).frames.tolist() == before == [0, 5, FRAMES - 1]


def test_an_excerpt_replaces_its_own_frames_alone(built):
    made, armature, _ = built
    bone_confidence.write_confidence(made, [np.full((4, len(BODY)), 0.005)], first=8)
    expected = errors()
    expected[8:12] = 0.005
    np.testing.assert_allclose(bone_confidence.read_confidence(armature, START, FRAMES), expected, atol=1e-8)


def test_discarded_expected_errors_are_no_longer_shown(built):
    made, armature, _ = built
    bone_confidence.forget(made, made.kfmocap.performers[0], range(START, START + FRAMES))
    assert not bone_confidence.read_confidence(armature, START, FRAMES).any()
    assert not made.kfmocap.performers[0].helpful


def listed(made) -> list[tuple[str, list[int]]]:
    return [(item.name, list(item.frames)) for item in made.kfmocap.performers[0].lost]


def test_parts_that_may_be_lost_are_listed_with_their_frames_and_an_excerpt_replaces_its_own(built):
    made, *_ = built
    nothing = np.zeros((FRAMES, len(BODY)))
    lost = nothing.copy()
    lost[3:7, FOREARM] = lost[12:16, HAND] = 0.9
    lost_parts.write_lost(made, [JointErrors(nothing, nothing, lost)])
    assert listed(made) == [("forearm.L", [START + 3, START + 6]), ("hand.L", [START + 12, START + 15])]
    lost_parts.write_lost(made, [JointErrors(nothing[:8], nothing[:8], nothing[:8])], first=10)
    assert listed(made) == [("forearm.L", [START + 3, START + 6])]
    bone_confidence.forget(made, made.kfmocap.performers[0], range(START, START + FRAMES))
    assert listed(made) == []


def test_a_body_that_may_be_lost_is_listed_once_and_its_limbs_where_they_alone_may_be(built):
    made, *_ = built
    nothing = np.zeros((FRAMES, len(BODY)))
    lost = nothing.copy()
    lost[3:7], lost[3:9, FOREARM] = 0.9, 0.9
    lost_parts.write_lost(made, [JointErrors(nothing, nothing, lost)])
    assert listed(made) == [
        ("the whole body", [START + 3, START + 6]),
        ("forearm.L", [START + 7, START + 8]),
    ]
    lost_parts.write_lost(made, [JointErrors(nothing, nothing, nothing)])
    assert listed(made) == []


def test_the_most_helpful_frame_is_listed_first_with_its_parts(built):
    made, *_ = built
    first, *_ = made.kfmocap.performers[0].helpful
    assert abs(first.frame - (START + 15)) <= 1
    assert first.name == "forearm.L"
    assert first.error == pytest.approx(1000 * errors()[first.frame - START, FOREARM], rel=1e-5)
    assert first.gain > 0


def test_parts_are_green_where_they_are_sure_and_red_from_the_limit_on(built):
    made, armature, _ = built
    made.kfmocap.display = "SOLID"
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
    made.kfmocap.display = "SOLID"
    made.kfmocap.show_confidence = True
    share = sights(original)[0]
    share[:, 10, HAND] = 0
    bone_visibility.write_occlusion(made, original, [share])
    assert colour(armature, START + 10)[2] == 1
    assert colour(armature, START + 10, "hand.R")[2] == pytest.approx(0.1)


def bone_colour(armature, bone: str = "hand.L") -> list[float]:
    posed = armature.evaluated_get(bpy.context.evaluated_depsgraph_get())
    return list(posed.pose.bones[bone].color.custom.normal)


def test_bones_have_the_colours_of_their_parts(built):
    made, armature, _ = built
    made.kfmocap.display = "SOLID"
    made.kfmocap.show_confidence = True
    for frame in (5, 11, 15):
        np.testing.assert_allclose(colour(armature, START + frame)[:3], bone_colour(armature), atol=0.01)
    made.kfmocap.show_confidence = False
    assert armature.pose.bones["hand.L"].color.palette == "DEFAULT"


def test_outlines_have_the_colours_of_errors_where_these_are_shown_and_of_sides_elsewhere(built):
    made, armature, _ = built
    assert made.kfmocap.display == "OUTLINE"
    posed = armature.evaluated_get(bpy.context.evaluated_depsgraph_get())
    slot = made.kfmocap.performers[0]
    slot.colour = (1.0, 0.0, 1.0)
    assert bone_confidence.outline_colour(made, slot, posed.pose.bones["hand.L"]) == colour_of("hand.L")
    assert bone_confidence.outline_colour(made, slot, posed.pose.bones["head"]) == (1.0, 0.0, 1.0, 1.0)
    made.kfmocap.show_confidence = True
    made.frame_set(START + 5)
    posed = armature.evaluated_get(bpy.context.evaluated_depsgraph_get())
    np.testing.assert_allclose(
        bone_confidence.outline_colour(made, slot, posed.pose.bones["hand.L"]), [0, 1, 0.1, 1], atol=0.01
    )


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


def test_a_body_that_was_never_tracked_stays_white(blender, tmp_path):
    made = scene.build_scene(shot(tmp_path, frames=FRAMES), scene=bpy.context.scene)
    armature = made.kfmocap.performers[0].armature
    made.kfmocap.show_confidence = True
    assert colour(armature, START) == [1, 1, 1, 1]
    assert not any(bone_confidence.ERROR in curve.data_path for curve in fcurves.find_channelbag(armature).fcurves)


def film_of_a_body(folder, wrong: int | None = None):
    """A shot of a body that stands before a grey wall, filmed by one camera; its motion strays on one frame."""
    import cv2
    from kfmocap.core.shot.shot import KeyPoses, Performer, Shot, View
    from synthetic import at_rest, figure, look_at, poses_of, silhouette

    body, truth = figure(), at_rest(figure(), 9)
    truth = replace(truth, translations=truth.translations + np.linspace([-0.5, 0, 0], [0.5, 0, 0], 9))
    camera = look_at("cam01", (0.0, -3.2, 1.2), size=(160, 120), focal=120)
    writer = cv2.VideoWriter(str(folder / "cam01.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 25.0, (160, 120))
    poses = poses_of([body], [truth])
    for f in range(9):
        share = np.clip((silhouette([body], poses, f, camera, samples=2) - 4.0) / 248, 0, 1)[..., None]
        writer.write((share * (40, 40, 220) + (1 - share) * (120, 130, 110)).astype(np.uint8))
    writer.release()
    found = truth.translations.copy()
    if wrong is not None:
        found[wrong, 2] += 0.15
    keys = KeyPoses.whole([0, 8], truth[[0, 8]])
    shot_of_it = Shot("wall", 25.0, (0, 8), (View(camera, folder / "cam01.avi"),), (Performer("figure", body, keys),))
    return shot_of_it, replace(truth, translations=found)


def test_the_residual_picture_distinguishes_a_misplaced_model_from_one_that_fits(blender, tmp_path):
    original, strayed = film_of_a_body(tmp_path, wrong=4)
    built = scene.build_scene(original, [strayed], bpy.context.scene)
    found = [misfit_backgrounds.show(built, built.kfmocap.views[0], START + frame) for frame in (3, 4)]
    assert found[0].uncovered < 0.08 and found[0].beyond < 0.08
    assert found[1].uncovered > 0.1 and found[1].beyond > 0.1


def test_the_residual_is_behind_the_camera_on_its_frame_alone_and_goes_again(blender, tmp_path):
    original, strayed = film_of_a_body(tmp_path, wrong=4)
    built = scene.build_scene(original, [strayed], bpy.context.scene)
    built.frame_set(START + 4)
    for _ in range(2):
        assert bpy.ops.kfmocap.show_residual() == {"FINISHED"}
    camera = built.kfmocap.views[0].camera
    footage, shown = camera.data.background_images
    assert footage.source == "MOVIE_CLIP" and shown.source == "IMAGE"
    assert tuple(shown.image.size) == (160, 120) and shown.image.packed_file is not None
    for frame, expected in ((3, [True, False]), (4, [False, True]), (5, [True, False])):
        built.frame_set(START + frame)
        evaluated = camera.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
        assert [b.show_background_image for b in evaluated.background_images] == expected
    assert bpy.ops.kfmocap.hide_residual() == {"FINISHED"}
    assert [(b.source, b.show_background_image) for b in camera.data.background_images] == [("MOVIE_CLIP", True)]
    assert not len(camera.data.animation_data.drivers)
    assert not len(bpy.data.images) and not bpy.ops.kfmocap.hide_residual.poll()
    assert scene.shot_from_scene(built).views[0].footage == original.views[0].footage


def test_without_a_key_pose_around_there_is_no_residual_and_the_tool_says_why(blender, tmp_path):
    original, strayed = film_of_a_body(tmp_path)
    built = scene.build_scene(original, [strayed], bpy.context.scene)
    armature = built.kfmocap.performers[0].armature
    for frame in (1, 9):
        key_pose_curves.remove_key_pose(armature, frame)
    with pytest.raises(RuntimeError, match="no key pose of the whole body"):
        bpy.ops.kfmocap.show_residual()
    assert not len(bpy.data.images)
