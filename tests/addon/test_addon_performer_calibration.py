"""Calibrate from Performer: the views' cameras come from keypoints and a height, without a wand."""

from __future__ import annotations

import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from addon_shots import video  # noqa: E402
from keypoint_shots import SIZE, cameras, seen_places, strolling, write_openpose  # noqa: E402
from kfmocap.core.body import human  # noqa: E402
from kfmocap.core.body.motion import Motion  # noqa: E402
from kfmocap.core.errors import CancelledError  # noqa: E402
from kfmocap.core.formats.calibrations.calibration_files import save_cameras  # noqa: E402
from kfmocap.kfmocap_addon.scene_io import added_views  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.body import body_armature  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.cameras import view_cameras  # noqa: E402
from scipy.spatial.transform import Rotation  # noqa: E402

pytest_plugins = ("addon_fixtures",)

pytestmark = pytest.mark.blender

FRAMES, HEIGHT = 20, 1.8
GIVEN = cameras(3)


@pytest.fixture
def filmed(blender, tmp_path: Path):
    """A scene with the footage and keypoints of somebody who walks about, whose cameras nobody knows."""
    body = human(HEIGHT)
    motion = strolling(body, FRAMES)
    rotations = motion.rotations.copy()
    turn = Rotation.from_rotvec(np.outer(np.linspace(-0.8, 0.8, FRAMES), [0, 0, 1]))
    rotations[:, 0] = turn.as_matrix() @ rotations[:, 0]
    places = seen_places(body, Motion(motion.translations, rotations))
    scene = bpy.context.scene
    added_views.add_footage(scene, [video(tmp_path / f"{camera.name}.mp4", FRAMES, SIZE) for camera in GIVEN])
    for camera in GIVEN:
        write_openpose(tmp_path / f"{camera.name}_json", camera, [places])
    assert bpy.ops.kfmocap.import_keypoints(directory=str(tmp_path)) == {"FINISHED"}
    assert [Path(slot.keypoints).name for slot in scene.kfmocap.views] == [f"{camera.name}_json" for camera in GIVEN]
    scene.kfmocap_capture.performer_height = HEIGHT
    return scene


def distances(scene: bpy.types.Scene) -> np.ndarray:
    """How far the cameras of a scene are from each other, metres."""
    bpy.context.view_layer.update()
    places = np.array([slot.camera.matrix_world.translation for slot in scene.kfmocap.views])
    return np.linalg.norm(places - np.roll(places, 1, axis=0), axis=1)


def true_distances() -> np.ndarray:
    places = np.array([-camera.R_cam_world[0].T @ camera.t_cam_world[0] for camera in GIVEN])
    return np.linalg.norm(places - np.roll(places, 1, axis=0), axis=1)


def test_the_views_cameras_are_found_scaled_by_the_height_and_reported(filmed: bpy.types.Scene) -> None:
    assert not any(slot.calibrated for slot in filmed.kfmocap.views)
    assert bpy.ops.kfmocap.calibrate_from_performer() == {"FINISHED"}
    assert all(slot.calibrated for slot in filmed.kfmocap.views)
    np.testing.assert_allclose(distances(filmed), true_distances(), rtol=0.05)
    read = view_cameras.read_views(filmed, filmed.kfmocap.frame_start, 1)
    for view, camera in zip(read, GIVEN, strict=True):
        assert view.camera.matrix[0, 0] == pytest.approx(camera.matrix[0, 0], rel=0.05)
    said = filmed.kfmocap_capture.performer_summary.splitlines()  # in the panel
    assert [line.split(":")[0] for line in said[:3]] == ["cam01", "cam02", "cam03"]


def test_where_there_is_a_body_its_height_counts(filmed: bpy.types.Scene) -> None:
    slot = filmed.kfmocap.performers.add()
    slot.name, slot.armature = "child", body_armature.build_armature(human(HEIGHT / 2), "child", filmed.collection)
    assert bpy.ops.kfmocap.calibrate_from_performer() == {"FINISHED"}
    np.testing.assert_allclose(distances(filmed), true_distances() / 2, rtol=0.05)


def test_known_lenses_are_kept_and_estimated_ones_do_not_count_as_known(filmed: bpy.types.Scene) -> None:
    slot = filmed.kfmocap.views[0]
    lens = slot.camera.data
    slot.lens_known, lens.lens = True, 0.9 * lens.lens
    wanted = lens.lens
    assert bpy.ops.kfmocap.calibrate_from_performer() == {"FINISHED"}
    assert lens.lens == pytest.approx(wanted)
    assert [view.lens_known for view in filmed.kfmocap.views] == [True, False, False]
    slot.lens_known = False
    assert bpy.ops.kfmocap.calibrate_from_performer() == {"FINISHED"}
    assert lens.lens != pytest.approx(wanted, rel=1e-3)
    calibration = Path(bpy.path.abspath(slot.camera.data.background_images[0].clip.filepath)).parent / "cameras.toml"
    save_cameras(calibration, list(GIVEN))
    assert bpy.ops.kfmocap.import_calibration(filepath=str(calibration)) == {"FINISHED"}
    assert all(view.lens_known for view in filmed.kfmocap.views)


def test_without_keypoints_of_every_view_it_is_switched_off(filmed: bpy.types.Scene) -> None:
    filmed.kfmocap.views[1].keypoints = ""
    with pytest.raises(RuntimeError, match="cam02 has no 2D keypoints yet"):
        bpy.ops.kfmocap.calibrate_from_performer()


def test_what_is_cancelled_changes_nothing(filmed: bpy.types.Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    def cancelled(*_: object, **__: object) -> None:
        raise CancelledError

    stand_in = ModuleType("performer_cameras")
    stand_in.cameras_of_views = cancelled
    monkeypatch.setitem(sys.modules, "kfmocap.core.calibration.performer.performer_cameras", stand_in)
    before = distances(filmed)
    assert bpy.ops.kfmocap.calibrate_from_performer() == {"CANCELLED"}
    np.testing.assert_array_equal(distances(filmed), before)
    assert not any(slot.calibrated for slot in filmed.kfmocap.views)
