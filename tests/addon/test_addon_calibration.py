"""Calibration in Blender: colours are picked, cameras appear, and camera objects go to files and come back."""

from __future__ import annotations

import sys
from dataclasses import astuple
from pathlib import Path
from types import ModuleType, SimpleNamespace

import cv2
import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from addon_shots import LENS, SIZE, camera, video  # noqa: E402
from kfmocap.core import calibration as core_calibration  # noqa: E402
from kfmocap.core.capture.capture_videos import CaptureVideos, CaptureVideoView  # noqa: E402
from kfmocap.core.capture.colours import parsed, to_hsv  # noqa: E402
from kfmocap.core.errors import CalibrationError, CancelledError  # noqa: E402
from kfmocap.core.formats import load_cameras, save_cameras  # noqa: E402
from kfmocap.kfmocap_addon.panels import calibration_panel  # noqa: E402
from kfmocap.kfmocap_addon.scene_io import capture_scene  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.cameras import footage_background, scene_cameras  # noqa: E402
from made_capture import made_capture  # noqa: E402
from ready_scenes import LFRAME, solution  # noqa: E402
from test_addon_views import largest_difference  # noqa: E402

pytest_plugins = ("addon_fixtures",)

pytestmark = pytest.mark.blender


WAND = '[wand]\ncolours = ["green", "blue"]\nlength = 0.4\ndiameter = 0.05\n'


def ball_video(path: Path) -> Path:
    writer = cv2.VideoWriter(str(path), cv2.CAP_OPENCV_MJPEG, cv2.VideoWriter_fourcc(*"MJPG"), 25.0, SIZE)
    for frame in range(6):
        image = np.full((SIZE[1], SIZE[0], 3), 120, np.uint8)
        cv2.circle(image, (100 + 10 * frame, 80), 14, (30, 40, 210), -1, cv2.LINE_AA)
        writer.write(image)
    writer.release()
    return path


def some_capture(folder: Path) -> CaptureVideos:
    videos = [(video(folder / f"l{k}.mp4"), video(folder / f"w{k}.mp4")) for k in (1, 2)]
    view = [CaptureVideoView(f"cam0{k}", *videos[k - 1], focal=400.0 * k) for k in (1, 2)]
    return CaptureVideos(
        LFRAME, parsed("red", ""), 0.06, 0.5, (parsed("green", ""), parsed("#2040d0", "")), 0.05, tuple(view)
    )


def same_capture(a: CaptureVideos, b: CaptureVideos) -> bool:
    colours = zip((a.lframe_colour, *a.wand_colours), (b.lframe_colour, *b.wand_colours), strict=True)
    return (
        np.allclose(a.lframe_points, b.lframe_points)
        and all(np.allclose(astuple(x), astuple(y), atol=1e-4) for x, y in colours)
        and np.allclose(
            (a.lframe_diameter, a.wand_length, a.wand_diameter), (b.lframe_diameter, b.wand_length, b.wand_diameter)
        )
        and [(v.camera, v.lframe, v.wand, v.offset, v.focal) for v in a.views]
        == [(v.camera, v.lframe, v.wand, v.offset, v.focal) for v in b.views]
    )


def test_a_capture_comes_back_from_its_scene(blender, tmp_path):
    given = some_capture(tmp_path)
    capture_scene.show_capture(bpy.context.scene.kfmocap_capture, given)
    assert same_capture(capture_scene.read_capture(bpy.context.scene.kfmocap_capture), given)


def test_a_capture_file_fills_in_the_capture_unless_it_names_points(blender, tmp_path):
    videos = {name: video(tmp_path / f"{name}.mp4") for name in ("l1", "w1", "l2", "w2")}
    views = "".join(f'[[view]]\ncamera = "cam0{k}"\nlframe = "l{k}.mp4"\nwand = "w{k}.mp4"\n' for k in (1, 2))
    file = tmp_path / "wand.toml"
    file.write_text(f'[lframe]\ncolour = "red"\npoints = {LFRAME.tolist()}\ndiameter = 0.06\n{WAND}{views}')
    bpy.ops.kfmocap.load_capture(filepath=str(file))
    found = capture_scene.read_capture(bpy.context.scene.kfmocap_capture)
    assert [(v.camera, v.lframe, v.wand) for v in found.views] == [
        (f"cam0{k}", videos[f"l{k}"], videos[f"w{k}"]) for k in (1, 2)
    ]
    assert found.wand_length == pytest.approx(0.4)
    points = tmp_path / "points"
    points.mkdir()
    with pytest.raises(RuntimeError, match=r"it names points, not videos.*kfmocap calibrate"):
        bpy.ops.kfmocap.load_capture(filepath=str(made_capture(points)))


@pytest.mark.parametrize(("name", "shown"), [("red", 0), ("green", 1), ("blue", 2)])
def test_the_colour_that_is_shown_is_the_middle_of_its_range(name, shown):
    """Red's range passes through 0."""
    found = capture_scene.typical(parsed(name, ""))
    assert np.argmax(found) == shown and found[shown] > 2 * np.delete(found, shown).max()


def test_what_a_capture_lacks_is_named(blender, tmp_path):
    slot = bpy.context.scene.kfmocap_capture
    with pytest.raises(CalibrationError, match="two views"):
        capture_scene.read_capture(slot)
    capture_scene.show_capture(slot, some_capture(tmp_path))
    slot.views[1].wand = ""
    with pytest.raises(CalibrationError, match="no video of the wand"):
        capture_scene.read_capture(slot)
    slot.second.hue = (0, 0)
    with pytest.raises(CalibrationError, match="second ball: no colour"):
        capture_scene.read_capture(slot)


def test_one_click_picks_the_colour_of_a_ball(blender, tmp_path):
    slot = bpy.context.scene.kfmocap_capture
    view = slot.views.add()
    view.name, view.wand = "cam01", str(ball_video(tmp_path / "wand.avi"))
    assert bpy.ops.kfmocap.pick_colour(slot="first", frame=3, point=(128, 78)) == {"FINISHED"}
    shown = np.full((1, 2, 3), 120, np.uint8)
    shown[0, 0] = (30, 40, 210)
    assert list(slot.first.get().mask(to_hsv(shown))[0]) == [255, 0]
    assert slot.first.swatch[0] > 0.7 > 0.3 > slot.first.swatch[1]
    assert tuple(bpy.data.images["Calibration Footage"].size) == SIZE


def test_a_click_on_grey_leaves_the_colour_as_it_was(blender, tmp_path):
    slot = bpy.context.scene.kfmocap_capture
    view = slot.views.add()
    view.name, view.wand = "cam01", str(ball_video(tmp_path / "wand.avi"))
    with pytest.raises(RuntimeError, match="no colour"):
        bpy.ops.kfmocap.pick_colour(slot="first", frame=0, point=(10, 10))
    assert not capture_scene.is_picked(slot.first)


def test_videos_are_added_with_those_of_the_lframe_beside_them(blender, tmp_path):
    for name in ("cam01_wand.mp4", "cam01_lframe.mp4", "wand-left.mp4"):
        video(tmp_path / name)
    files = [{"name": "wand-left.mp4"}, {"name": "cam01_wand.mp4"}]
    bpy.ops.kfmocap.add_videos(directory=str(tmp_path), files=files)
    found = [(view.name, bool(view.lframe)) for view in bpy.context.scene.kfmocap_capture.views]
    assert found == [("cam01", True), ("left", False)]
    bpy.ops.kfmocap.remove_videos()
    assert [view.name for view in bpy.context.scene.kfmocap_capture.views] == ["cam01"]


def test_a_whole_folder_can_be_chosen_for_the_videos(blender, tmp_path):
    files = ["a_LFRAME.mp4", "a_Wand.mp4", "b_lframe.mp4", "b_wand.mp4", "take 1.mp4"]
    for name in files:
        video(tmp_path / name)
    with pytest.raises(RuntimeError, match="choose the videos of the wand"):
        bpy.ops.kfmocap.add_videos(directory=str(tmp_path), files=[{"name": ""}])
    bpy.ops.kfmocap.add_videos(directory=str(tmp_path), files=[{"name": name} for name in files])
    found = [(view.name, Path(view.lframe).name) for view in bpy.context.scene.kfmocap_capture.views]
    assert found == [("a", "a_LFRAME.mp4"), ("b", "b_lframe.mp4")]


@pytest.fixture
def solver(monkeypatch):
    """Stands in for detection and solver, and for the report."""
    stand_in, pictures = ModuleType("api"), ModuleType("calibration_report")
    stand_in.captures, stand_in.cameras = [], [camera(1), camera(2)]

    def calibrate(given, progress):
        stand_in.captures.append(given)
        if not progress("solve", 0.5):
            raise CancelledError
        return solution(stand_in.cameras)

    stand_in.calibrate = calibrate
    pictures.sheet = lambda solved: np.full((40, 60, 3), 200, np.uint8)
    pictures.write_report = lambda folder, solved: None
    for name, module in (("api", stand_in), ("calibration_report", pictures)):
        monkeypatch.setitem(sys.modules, f"kfmocap.core.calibration.{name}", module)
        monkeypatch.setattr(core_calibration, name, module, raising=False)
    return stand_in


def test_calibrate_shows_cameras_wand_lframe_and_report(blender, tmp_path, solver):
    scene = bpy.context.scene
    capture_scene.show_capture(scene.kfmocap_capture, some_capture(tmp_path))
    for _ in range(2):  # a second run replaces what the first one built
        assert bpy.ops.kfmocap.calibrate() == {"FINISHED"}
    assert same_capture(solver.captures[-1], some_capture(tmp_path))
    owners = bpy.data.collections["Calibration"].objects
    assert sorted(o.name for o in owners) == ["L-Frame", "Wand", "cam01", "cam02"]
    assert len(owners["Wand"].data.vertices) == 60 and len(owners["L-Frame"].data.edges) == 3
    assert owners["cam01"].data.background_images[0].clip is not None
    starts = [owners[name].data.background_images[0].clip.frame_start for name in ("cam01", "cam02")]
    assert starts == [scene.frame_start, scene.frame_start - 3]
    assert "Calibration Report" in bpy.data.images
    expected = ["Found 2 cameras, reprojection error 0.42 pixels", "the wand was waved at one depth"]
    assert scene.kfmocap_capture.summary.splitlines() == expected
    read = scene_cameras.read_cameras(scene, [owners["cam01"], owners["cam02"]], 1, 1)
    for built, original in zip(read, solver.cameras, strict=True):
        assert largest_difference(original, built, 0) < 1e-4


def test_calibrate_without_colours_is_switched_off(blender, tmp_path):
    assert not bpy.ops.kfmocap.calibrate.poll()


def test_cameras_go_to_a_file_and_come_back(blender, tmp_path):
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 5, 16
    originals = [camera(1), camera(2, 12), camera(3, distortions=(0.1, 0.02, 0.0, 0.0, 0.01, 0.2, 0.1, 0.01))]
    save_cameras(tmp_path / "in.toml", originals)
    bpy.ops.kfmocap.import_cameras(filepath=str(tmp_path / "in.toml"))
    bpy.ops.kfmocap.export_cameras(filepath=str(tmp_path / "out.toml"))
    back = load_cameras(tmp_path / "out.toml")
    assert list(back) == ["cam01", "cam02", "cam03"]
    for original in originals:
        assert back[original.name].moving == original.moving
        for frame in range(12):
            assert largest_difference(original, back[original.name], frame) < 1e-9


def test_a_camera_that_blenders_tracker_moves_is_exported_frame_by_frame(blender, tmp_path):
    """Not built by us: it hangs on a moved parent and has footage whose clip knows the lens."""
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 1, 10
    parent = bpy.data.objects.new("dolly", None)
    scene.collection.objects.link(parent)
    for frame, x in ((1, 0.0), (10, 0.9)):
        parent.location = (x, 0, 0)
        parent.keyframe_insert("location", frame=frame)
    owner = bpy.data.objects.new("solved", bpy.data.cameras.new("solved"))
    scene.collection.objects.link(owner)
    owner.parent, owner.location = parent, (0, -4, 1)
    owner.rotation_euler = (np.pi / 2, 0, 0)
    clip = footage_background.load_clip(video(tmp_path / "take.mp4"))
    clip.tracking.camera.distortion_model = "BROWN"
    clip.tracking.camera.brown_k1 = LENS[0]
    background = owner.data.background_images.new()
    background.source, background.clip = "MOVIE_CLIP", clip
    bpy.ops.kfmocap.export_cameras(filepath=str(tmp_path / "out.toml"))
    [read] = load_cameras(tmp_path / "out.toml").values()
    assert read.moving and read.size == SIZE and len(read.R_cam_world) == 10
    assert read.distortions[0] == pytest.approx(LENS[0], abs=1e-6)
    for frame in (0, 4, 9):
        scene.frame_set(1 + frame)
        np.testing.assert_allclose(read.centre_world(frame), owner.matrix_world.translation, atol=1e-5)
        ahead = read.project(read.centre_world(frame) + [0, 2.0, 0], frame)
        np.testing.assert_allclose(ahead, (np.array(SIZE) - 1) / 2, atol=1e-3)


def test_a_camera_that_zooms_is_exported_with_its_zoom_and_imported_again(blender, tmp_path):
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 1, 10
    owner = bpy.data.objects.new("zooming", bpy.data.cameras.new("zooming"))
    scene.collection.objects.link(owner)
    for frame, length in ((1, 30.0), (10, 45.0)):
        owner.data.lens = length
        owner.data.keyframe_insert("lens", frame=frame)
    bpy.ops.kfmocap.export_cameras(filepath=str(tmp_path / "out.toml"))
    [written] = load_cameras(tmp_path / "out.toml").values()
    assert len(written.R_cam_world) == 10 and written.zooms[[0, 9]] == pytest.approx([1, 1.5])
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    bpy.ops.kfmocap.import_cameras(filepath=str(tmp_path / "out.toml"))
    bpy.context.scene.frame_start, bpy.context.scene.frame_end = 1, 10
    bpy.context.scene.frame_set(6)
    bpy.ops.kfmocap.export_cameras(filepath=str(tmp_path / "again.toml"))
    [again] = load_cameras(tmp_path / "again.toml").values()
    np.testing.assert_array_equal(again.zooms, written.zooms)
    np.testing.assert_array_equal(again.matrix, written.matrix)


def test_cameras_can_be_written_while_there_are_any(blender, tmp_path):
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    assert not bpy.ops.kfmocap.export_cameras.poll()
    save_cameras(tmp_path / "in.toml", [camera(1)])
    bpy.ops.kfmocap.import_cameras(filepath=str(tmp_path / "in.toml"))
    assert bpy.ops.kfmocap.export_cameras.poll()


class Labels:
    """A layout that notes what its buttons and labels say, in whatever row."""

    def __init__(self):
        self.said = []

    def row(self, **_more):
        return self

    def column(self, **_more):
        return self

    box = row

    def label(self, *, text="", **_more):
        self.said.append(text)

    def prop(self, _owner, name, *, text=None, **_more):
        self.said.append(name if text is None else text)

    def operator(self, name, *, text="", **_more):
        self.said.append(text)
        return SimpleNamespace(name=name)


@pytest.mark.parametrize("one_colour", [True, False])
@pytest.mark.parametrize("picked", [True, False])
def test_each_ball_has_its_own_button_to_pick_a_colour(blender, one_colour, picked):
    capture = bpy.context.scene.kfmocap_capture
    capture.one_colour = one_colour
    for slot in capture_scene.SLOTS if picked else ():
        capture.colour(slot).hue = (0.1, 0.2)
    layout = Labels()
    calibration_panel.BallsPanel.draw(SimpleNamespace(layout=layout), bpy.context)
    balls = ["First Ball", "Second Ball"] if picked else ["Pick First Colour", "Pick Second Colour"]
    one = ["Colour" if picked else "Pick Colour"]
    wanted = one + (one if one_colour else balls)
    assert [text for text in layout.said if text.endswith(("Colour", "Ball"))] == wanted
