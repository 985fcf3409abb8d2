"""Refining cameras by command and in Blender: the same cameras as the core's, and nothing half-done."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from kfmocap.__main__ import main
from kfmocap.cli import calibrate_command
from kfmocap.core import fitting
from kfmocap.core.errors import CalibrationError, CancelledError
from kfmocap.core.fitting.camera_fits.camera_refinement import RefinedCamera, Refinement
from kfmocap.core.fitting.camera_fits.resection import adjusted
from kfmocap.core.fitting.checks.view_findings import CameraFit, FootageMatch
from kfmocap.core.formats import load_cameras, save_cameras
from kfmocap.core.shot.shot import Shot

STEP = np.array([0.02, -0.01, 0.03, 0.01, 0.02, -0.03, 0.02])


def refined(shot: Shot, _progress: object = None, lost: tuple[int, ...] = ()) -> Refinement:
    """Every camera moved a little, but for those that are lost."""
    return Refinement(
        tuple(
            RefinedCamera(view.camera if v in lost else adjusted(view.camera, STEP), 12.3, 4.5, v not in lost)
            for v, view in enumerate(shot.views)
        ),
        np.array([0]),
    )


def refine(folder: Path, out: str = "refined.toml", shot: str = "shot.toml") -> int:
    return main(["calibrate", "--refine", str(folder / shot), "--out", str(folder / out)])


def test_the_command_writes_all_cameras_of_the_calibration(
    folder: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Those of the shot's views refined, the others as they were."""
    [camera] = load_cameras(folder / "calibration.toml").values()
    save_cameras(folder / "calibration.toml", [camera, replace(camera, name="other")])
    monkeypatch.setattr(calibrate_command, "refine_shot_cameras", refined)
    assert refine(folder) == 0
    printed = capsys.readouterr()
    assert printed.out == f"{folder / 'refined.toml'}\n"
    assert printed.err == "kfmocap: cam01: its picture moved by 12.3 px, known to 4.5 px\n"
    written = load_cameras(folder / "refined.toml")
    np.testing.assert_allclose(written["cam01"].matrix, adjusted(camera, STEP).matrix)
    np.testing.assert_allclose(written["cam01"].t_cam_world, adjusted(camera, STEP).t_cam_world)
    np.testing.assert_allclose(written["other"].t_cam_world, camera.t_cam_world)


def test_a_camera_that_is_lost_is_reported(
    folder: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(calibrate_command, "refine_shot_cameras", lambda shot, progress: refined(shot, lost=(0,)))
    assert refine(folder) == 0
    assert "cam01: not changed" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("out", "shot", "words"),
    [
        ("refined.txt", "shot.toml", "refined.txt: unknown kind of calibration"),
        ("shot.toml/refined.toml", "shot.toml", "shot.toml"),
        ("refined.toml", "none.toml", "the shot file cannot be read"),
        ("refined.toml", "shot.toml", "no camera shows the performers"),
    ],
)
def test_what_cannot_be_refined_is_one_line_and_writes_nothing(
    folder: Path,
    capsys: pytest.CaptureFixture[str],
    out: str,
    shot: str,
    words: str,
) -> None:
    """The footage of this shot is plain grey."""
    before = sorted(folder.rglob("*"))
    assert refine(folder, out, shot) == 1
    captured = capsys.readouterr()
    assert captured.out == "" and captured.err.count("\n") == 1 and words in captured.err
    assert sorted(folder.rglob("*")) == before


def test_what_belongs_to_other_calibrations_is_refused(
    folder: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    arguments = ["calibrate", "--refine", str(folder / "shot.toml"), "--out", str(folder / "refined.toml")]
    for extra in (["--report", str(folder / "report")], ["--points", str(folder / "p.csv")], ["--drift"]):
        assert main(arguments + extra) == 1
        assert "apply to a wand capture only" in capsys.readouterr().err
    assert main([*arguments, "--lenses", str(folder / "lenses.toml")]) == 1
    assert "--lenses applies to --performer only" in capsys.readouterr().err
    assert not (folder / "report").exists()


@pytest.mark.parametrize("name", ["refined.yml", "refined.qca.txt"])
def test_the_refined_calibration_is_of_the_kind_asked_for(
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    name: str,
) -> None:
    monkeypatch.setattr(calibrate_command, "refine_shot_cameras", refined)
    assert refine(folder, name) == 0
    [before], [after] = (load_cameras(folder / n).values() for n in ("calibration.toml", name))
    np.testing.assert_allclose(after.t_cam_world, adjusted(before, STEP).t_cam_world, atol=1e-4)


def test_calibrating_needs_a_source(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["calibrate", "--out", "calibration.toml"])
    assert "--refine" in capsys.readouterr().err


bpy = pytest.importorskip("bpy")

from addon_shots import shot  # noqa: E402
from kfmocap.kfmocap_addon.scene_io import scene  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.cameras import view_cameras  # noqa: E402
from test_addon_views import largest_difference  # noqa: E402

pytest_plugins = (
    "addon_fixtures",
    "tiny_shot_fixtures",
)

in_blender = pytest.mark.blender


@pytest.fixture
def refiner(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """Stands in for the core: moves all cameras, but those that a test calls lost, or raises what it sets."""
    stand_in = ModuleType("kfmocap.core.fitting.shot_cameras")
    state = SimpleNamespace(lost=(), error=None)

    def refine_cameras(given: Shot, progress: object) -> Refinement:
        progress("refining cameras", 0.5)
        if state.error is not None:
            raise state.error
        return refined(given, lost=state.lost)

    stand_in.refine_shot_cameras = refine_cameras
    monkeypatch.setitem(sys.modules, "kfmocap.core.fitting.shot_cameras", stand_in)
    monkeypatch.setattr(fitting, "shot_cameras", stand_in)
    return state


@in_blender
def test_the_tool_moves_fixed_and_moving_cameras(blender, tmp_path, refiner):
    original = shot(tmp_path)
    scene.build_scene(original, scene=bpy.context.scene)
    assert bpy.ops.kfmocap.refine_cameras() == {"FINISHED"}
    read = scene.shot_from_scene(bpy.context.scene)
    for got, view in zip(read.views, original.views, strict=True):
        truth = adjusted(view.camera, STEP)
        assert got.camera.moving == view.camera.moving
        assert np.array_equal(got.camera.matrix, truth.matrix)  # to the last bit, as the core's
        assert np.array_equal(got.camera.R_cam_world, truth.R_cam_world)
        assert max(largest_difference(truth, got.camera, f) for f in range(original.length)) < 1e-4
        owner = bpy.data.objects[view.camera.name]
        assert owner.data.lens == pytest.approx(truth.matrix[0, 0] * 36 / truth.size[0], rel=1e-6)
        [background] = owner.data.background_images
        assert background.clip.tracking.camera.focal_length_pixels == pytest.approx(truth.matrix[0, 0], rel=1e-6)


@in_blender
def test_a_camera_that_does_not_fit_is_shown_until_it_is_refined(blender, tmp_path, refiner):
    scene.build_scene(shot(tmp_path), scene=bpy.context.scene)
    views = bpy.context.scene.kfmocap.views
    fits = [CameraFit(14.6, 2.0, 5.0, "cam01", "key poses"), CameraFit(1.0, 2.0, 5.0, "cam02", "key poses")]
    assert view_cameras.show_fits(views, fits) == [f"{fits[0].summary}. Refine Cameras may help"]
    assert [view.misfit for view in views] == ["15 px off the key poses", ""]
    bpy.ops.kfmocap.refine_cameras()
    assert not any(view.misfit for view in views)


@in_blender
def test_an_offset_that_fits_better_is_taken_by_a_button(blender, tmp_path):
    scene.build_scene(shot(tmp_path), scene=bpy.context.scene)
    views = bpy.context.scene.kfmocap.views
    [said] = view_cameras.show_fits(views, [FootageMatch("cam02", 0.8, offset=6.0), FootageMatch("cam01", 0.97)])
    assert "offset of about 6" in said and "Use Offset" in said
    assert [view.fitting_offset for view in views] == ["", "6"]
    before = views[0].offset
    assert bpy.ops.kfmocap.use_offset(view=1) == {"FINISHED"}
    assert [view.offset for view in views] == [before, 6.0]
    assert not any(view.misfit or view.fitting_offset for view in views)
    with pytest.raises(RuntimeError, match="No better offset is known"):
        bpy.ops.kfmocap.use_offset(view=1)


@in_blender
def test_a_camera_that_was_keyed_at_one_place_is_moved_there_too(blender, tmp_path, refiner):
    original = shot(tmp_path)
    scene.build_scene(original, scene=bpy.context.scene)
    owner = bpy.context.scene.kfmocap.views[0].camera
    for frame in (1, 9):
        owner.keyframe_insert("location", frame=frame)
        owner.keyframe_insert("rotation_quaternion", frame=frame)
    bpy.ops.kfmocap.refine_cameras()
    got = scene.shot_from_scene(bpy.context.scene).views[0].camera
    assert largest_difference(adjusted(original.views[0].camera, STEP), got, 0) < 1e-4


@in_blender
def test_a_lost_camera_stays(blender, tmp_path, refiner):
    original = shot(tmp_path)
    scene.build_scene(original, scene=bpy.context.scene)
    refiner.lost = (0,)
    bpy.ops.kfmocap.refine_cameras()
    first, second = scene.shot_from_scene(bpy.context.scene).views
    assert np.array_equal(first.camera.R_cam_world, original.views[0].camera.R_cam_world)
    assert not np.array_equal(second.camera.R_cam_world, original.views[1].camera.R_cam_world)


@in_blender
@pytest.mark.parametrize("error", [CalibrationError("there is no key pose"), CancelledError()])
def test_an_error_leaves_the_cameras_alone(blender, tmp_path, refiner, error):
    original = shot(tmp_path)
    scene.build_scene(original, scene=bpy.context.scene)
    refiner.error = error
    if isinstance(error, CancelledError):
        assert bpy.ops.kfmocap.refine_cameras() == {"CANCELLED"}
    else:
        with pytest.raises(RuntimeError, match="there is no key pose"):
            bpy.ops.kfmocap.refine_cameras()
    read = scene.shot_from_scene(bpy.context.scene)
    assert np.array_equal(read.views[0].camera.R_cam_world, original.views[0].camera.R_cam_world)


@in_blender
def test_a_camera_that_something_else_moves_is_refused(blender, tmp_path, refiner):
    scene.build_scene(shot(tmp_path), scene=bpy.context.scene)
    owner = bpy.context.scene.kfmocap.views[1].camera
    owner.constraints.new("COPY_LOCATION")
    with pytest.raises(RuntimeError, match=r"cam02: a parent or a constraint moves it.*Bake"):
        bpy.ops.kfmocap.refine_cameras()
    assert bpy.ops.kfmocap.refine_cameras.poll()
