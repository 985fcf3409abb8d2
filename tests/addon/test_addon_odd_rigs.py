"""Characters that nobody made for this program are tracked on their own bones, from key poses to motion."""

from __future__ import annotations

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from addon_shots import blender, joint_error  # noqa: E402, F401
from kfmocap.kfmocap_addon.retargeting.skinned_body import use_as_body  # noqa: E402
from kfmocap.kfmocap_addon.scene_io import (  # noqa: E402
    added_views,
    body_armature,
    key_pose_curves,
    shown_pose,
)
from odd_characters import quadruped, unreal_like  # noqa: E402
from synthetic import film, look_at, swing  # noqa: E402

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("blender")]

FRAMES = 8
EYES = ((3.0, -3.0, 0.6), (-3.0, -3.0, 0.3))


def error_of(armature, body, truth):
    """How far in mm the worst joint of a frame is off, on average over the frames of the shot."""
    first = bpy.context.scene.kfmocap.frame_start
    errors = [joint_error(armature, body, truth[[f]], first + f) for f in range(len(truth))]
    return float(np.mean(errors))


@pytest.mark.parametrize("made", [unreal_like, quadruped])
def test_a_character_is_tracked_on_its_own_bones(made, tmp_path):
    scene = bpy.context.scene
    armature, _ = use_as_body(scene, made())
    body = body_armature.body_from_armature(armature)
    truth = swing(body, FRAMES, 0.35)
    middle = body.parts[0].head_world
    cameras = [look_at(f"cam{i}", middle + np.array(eye), middle) for i, eye in enumerate(EYES)]
    film(tmp_path, [body], [truth], cameras)
    added_views.add_footage(scene, [tmp_path / camera.name / "000.png" for camera in cameras])
    added_views.calibrate_views(scene, {camera.name: camera for camera in cameras})
    first = scene.kfmocap.frame_start
    for frame in (0, FRAMES - 1):
        shown_pose.show_pose(armature, truth[[frame]])
        key_pose_curves.key_current_pose(armature, first + frame)
    curves = error_of(armature, body, truth)
    assert bpy.ops.kfmocap.track() == {"FINISHED"}
    assert error_of(armature, body, truth) < 0.3 * curves
    for frame in (0, FRAMES - 1):
        assert joint_error(armature, body, truth[[frame]], first + frame) < 0.1
