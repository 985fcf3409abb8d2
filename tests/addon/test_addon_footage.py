"""A shot is put together in an empty scene: footage, calibration, performer."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from unittest.mock import MagicMock

import cv2
import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from addon_shots import SIZE, camera, video  # noqa: E402
from bpy_extras.io_utils import ImportHelper  # noqa: E402
from kfmocap.core.cameras.world_axes import METRES  # noqa: E402
from kfmocap.core.errors import FootageError  # noqa: E402
from kfmocap.core.formats.calibrations.toml_cameras import save_cameras  # noqa: E402
from kfmocap.core.shot.frame_numbers import file_index  # noqa: E402
from kfmocap.core.shot.shot import Gap  # noqa: E402
from kfmocap.kfmocap_addon import registration  # noqa: E402
from kfmocap.kfmocap_addon.operators.mixin import BesideFootage  # noqa: E402
from kfmocap.kfmocap_addon.panels import footage_panel  # noqa: E402
from kfmocap.kfmocap_addon.scene_io import scene, solved_cameras  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.cameras import footage_background, view_cameras  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.cameras.view_gaps import packed_gaps  # noqa: E402
from retimed_videos import retimed  # noqa: E402
from test_addon_views import largest_difference  # noqa: E402

pytest_plugins = ("addon_fixtures",)

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("blender")]


@pytest.fixture
def take(tmp_path):
    """Two videos of 30 and 25 frames, and the cameras that took them."""
    for name, frames in (("walk_cam01", 30), ("walk_cam02", 25)):
        video(tmp_path / f"{name}.mp4", frames)
    save_cameras(tmp_path / "calibration.toml", [camera(1), camera(2)])
    return tmp_path


def add(folder, *names):
    return bpy.ops.kfmocap.add_footage(directory=str(folder), files=[{"name": name} for name in names])


def shot():
    return bpy.context.scene.kfmocap


def test_footage_becomes_views_of_an_empty_scene(take):
    assert add(take, "walk_cam02.mp4", "walk_cam01.mp4") == {"FINISHED"}
    assert [view.name for view in shot().views] == ["walk_cam01", "walk_cam02"]
    assert (shot().first, shot().last) == (0, 24)
    current = bpy.context.scene
    assert current.render.fps == 25 and current.frame_end == 25
    assert (current.render.resolution_x, current.render.resolution_y) == SIZE
    assert not any(view.is_calibrated for view in shot().views)
    assert not bpy.ops.kfmocap.track.poll()


@pytest.mark.parametrize("change", [None, "moved", "edited", "renamed"])
def test_the_cube_that_blender_starts_with_is_hidden_unless_it_was_changed(take, change):
    bpy.ops.wm.read_homefile(use_factory_startup=True)
    cube = bpy.data.objects["Cube"]
    if change == "moved":
        cube.matrix_basis[0][3] = 1.0
    elif change == "edited":
        cube.data.vertices[0].co.x = 2.0
    elif change == "renamed":
        cube.name = "Table"
    add(take, "walk_cam01.mp4")
    assert cube.hide_get() == (change is None)
    cube.hide_set(False)
    add(take, "walk_cam02.mp4")
    assert not cube.hide_get()


def test_a_phone_that_skipped_frames_gives_the_scene_its_own_rate_and_length(take):
    """Otherwise Blender, which shows frames by their times, would show others than those that are tracked."""
    whole = take / "walk_cam01.mp4"
    whole.write_bytes(retimed(whole.read_bytes(), [2 if frame in (6, 13) else 1 for frame in range(30)]))
    add(take, whole.name)
    assert bpy.context.scene.kfmocap.frame_rate == pytest.approx(25.0)
    assert shot().last == 30 + 2 - 1


def test_a_single_camera_is_offered_a_way_without_calibration(take, monkeypatch):
    monkeypatch.setattr(footage_panel, "draw_text", lambda *_: None)

    def offered():
        layout = MagicMock()
        layout.column.return_value.prop = prop = MagicMock()
        footage_panel.FootagePanel.draw_content(SimpleNamespace(layout=layout), bpy.context)
        return [call.args[1] for call in prop.call_args_list if call.args[1] in ("lens", "calibrated")]

    add(take, "walk_cam01.mp4")
    assert offered() == ["lens", "calibrated"]
    shot().views[0].calibrated = True
    assert offered() == []
    shot().views[0].calibrated = False
    add(take, "walk_cam02.mp4")
    assert offered() == []


def test_views_without_overlays_show_footage_and_no_other_overlay(take):
    """As in Blender's workspace Animation, whose camera's view would be empty but for the model."""
    bpy.ops.wm.read_homefile(use_factory_startup=True)
    views = [a.spaces.active for s in bpy.data.screens for a in s.areas if a.type == "VIEW_3D"]
    for view, perspective in zip(views, ("CAMERA", "PERSP", "CAMERA"), strict=False):
        view.region_3d.view_perspective = perspective
        for name in ("show_floor", "show_bones"):
            setattr(view.overlay, name, True)
        view.overlay.show_overlays = view == views[2]
    add(take, "walk_cam01.mp4")
    shown = [(view.overlay.show_overlays, view.overlay.show_floor, view.overlay.show_bones) for view in views[:3]]
    assert shown == [(True, False, False), (False, True, True), (True, True, True)]


def test_images_of_a_camera_in_its_own_folder_become_a_shot_with_a_rate_that_is_given(tmp_path):
    """Images have no frame rate; the shot is not named for its first camera."""
    for name in ("cam01", "cam02"):
        folder = tmp_path / "kick" / name
        folder.mkdir(parents=True)
        for number in range(3):
            cv2.imwrite(str(folder / f"{number:04d}.png"), np.full((SIZE[1], SIZE[0], 3), 90, np.uint8))
        assert add(folder, "0000.png") == {"FINISHED"}
    assert [view.name for view in shot().views] == ["cam01", "cam02"]
    assert shot().shot == "kick"
    shot().frame_rate = 59.94
    render = bpy.context.scene.render
    assert render.fps / render.fps_base == pytest.approx(59.94) == shot().frame_rate
    assert scene.frame_rate(bpy.context.scene) == pytest.approx(59.94, rel=1e-7)


def test_files_of_the_shot_are_looked_for_beside_its_footage(take, monkeypatch):
    monkeypatch.setattr(ImportHelper, "invoke", lambda _self, _context, _event: {"RUNNING_MODAL"})
    browser = type("Browser", (BesideFootage,), {"filepath": ""})()
    assert browser.invoke(bpy.context, None) == {"RUNNING_MODAL"} and browser.filepath == "", "there is no footage"
    add(take, "walk_cam01.mp4")
    browser.invoke(bpy.context, None)
    assert browser.filepath == f"{take}/"
    browser.filepath = "/elsewhere/calibration.toml"
    browser.invoke(bpy.context, None)
    assert browser.filepath == "/elsewhere/calibration.toml", "what was chosen before stays"


def test_a_shot_from_an_empty_scene_can_be_read_without_a_shot_file(take):
    add(take, "walk_cam01.mp4", "walk_cam02.mp4")
    assert bpy.ops.kfmocap.import_calibration(filepath=str(take / "calibration.toml")) == {"FINISHED"}
    assert bpy.ops.kfmocap.add_body(height=1.68) == {"FINISHED"}
    read = scene.shot_from_scene(bpy.context.scene)
    assert [view.camera.name for view in read.views] == ["cam01", "cam02"]
    assert [view.footage.name for view in read.views] == ["walk_cam01.mp4", "walk_cam02.mp4"]
    for seed, view in enumerate(read.views, 1):
        assert largest_difference(camera(seed), view.camera) < 1e-4
    assert [performer.name for performer in read.performers] == ["Performer"]
    assert read.name == take.name and read.fps == 25


def test_footage_begins_where_the_scene_does(take):
    """Many studios count frames from 1001."""
    bpy.context.scene.frame_start = 1001
    add(take, "walk_cam01.mp4")
    assert (shot().scene_first, shot().scene_last) == (1001, 1030)
    [clip] = bpy.data.movieclips
    assert clip.frame_start == 1001 and bpy.context.scene.frame_current == 1001


def test_footage_is_added_all_or_none(take):
    (take / "broken.mp4").write_bytes(b"no video")
    with pytest.raises(RuntimeError, match=r"broken\.mp4"):
        add(take, "walk_cam01.mp4", "broken.mp4")
    assert not shot().views and not bpy.data.movieclips and not bpy.data.cameras
    add(take, "walk_cam01.mp4")
    with pytest.raises(RuntimeError, match="already"):
        add(take, "walk_cam02.mp4", "walk_cam01.mp4")
    assert len(shot().views) == len(bpy.data.movieclips) == 1


def test_a_calibration_of_another_size_or_of_other_names_changes_nothing(take):
    add(take, "walk_cam01.mp4", "walk_cam02.mp4")
    before = [np.array(view.camera.matrix_basis) for view in shot().views]
    for name, cameras, message in (
        ("size", [camera(1), replace(camera(2), size=(640, 480))], "cam02.*640x480"),
        ("names", [replace(camera(1), name="left"), replace(camera(2), name="right")], "left, right"),
    ):
        save_cameras(take / f"{name}.toml", cameras)
        with pytest.raises(RuntimeError, match=message):
            bpy.ops.kfmocap.import_calibration(filepath=str(take / f"{name}.toml"))
        after = [np.array(view.camera.matrix_basis) for view in shot().views]
        assert np.array_equal(before, after)
        assert [view.name for view in shot().views] == ["walk_cam01", "walk_cam02"]


def test_views_of_other_names_than_the_cameras_take_those_that_are_entered_where_the_message_says(take):
    place = " > ".join((footage_panel.LookPanel.bl_label, footage_panel.ViewPanel.bl_label, "Camera"))
    add(take, "walk_cam01.mp4", "walk_cam02.mp4")
    save_cameras(take / "named.toml", [replace(camera(1), name="left"), replace(camera(2), name="right")])
    with pytest.raises(RuntimeError, match=place):
        bpy.ops.kfmocap.import_calibration(filepath=str(take / "named.toml"))
    for view, name in zip(shot().views, ("left", "right"), strict=True):
        view.name = name
    assert bpy.ops.kfmocap.import_calibration(filepath=str(take / "named.toml")) == {"FINISHED"}
    assert all(view.is_calibrated for view in shot().views)


@pytest.mark.parametrize("unit", ["mm", "cm"])
def test_a_calibration_in_millimetres_is_refused_until_its_unit_is_chosen(take, unit):
    add(take, "walk_cam01.mp4", "walk_cam02.mp4")
    true = [camera(1), camera(2)]
    for own, x in zip(true, (0.0, 2.0), strict=True):
        own.t_cam_world[:, 0] = x
    filed = [replace(own, t_cam_world=own.t_cam_world / METRES[unit]) for own in true]
    save_cameras(take / "calibration.toml", filed)
    for operator in (bpy.ops.kfmocap.import_calibration, bpy.ops.kfmocap.import_cameras):
        with pytest.raises(RuntimeError, match=r"m apart, as if it were not in metres .*choose its unit"):
            operator(filepath=str(take / "calibration.toml"))
        assert operator(filepath=str(take / "calibration.toml"), unit=unit) == {"FINISHED"}
    x = [view.camera.matrix_world.translation.x for view in shot().views]
    assert x == pytest.approx([float(own.centre_world()[0]) for own in true], abs=1e-5)


def test_a_calibration_is_scaled_to_footage_that_was_resized_after_it(take):
    add(take, "walk_cam01.mp4", "walk_cam02.mp4")
    large = take / "large.toml"
    save_cameras(large, [camera(seed).resized((2 * SIZE[0], 2 * SIZE[1])) for seed in (1, 2)])
    with pytest.raises(RuntimeError, match="Resized Footage"):
        bpy.ops.kfmocap.import_calibration(filepath=str(large))
    assert bpy.ops.kfmocap.import_calibration(filepath=str(large), resized=True) == {"FINISHED"}
    bpy.ops.kfmocap.add_body(height=1.68)
    for seed, view in enumerate(scene.shot_from_scene(bpy.context.scene).views, 1):
        assert largest_difference(camera(seed), view.camera) < 1e-4


@pytest.mark.parametrize("footage_first", [True, False])
def test_cameras_just_calibrated_in_the_scene_become_the_views(take, footage_first):
    solved = {c.name: c for c in (camera(1), camera(2))}
    if footage_first:
        add(take, "walk_cam01.mp4", "walk_cam02.mp4")
    solved_cameras.show_cameras(bpy.context.scene, solved, {"cam01": take / "walk_cam01.mp4"})
    if footage_first:
        assert bpy.ops.kfmocap.use_scene_cameras() == {"FINISHED"}
    else:
        add(take, "walk_cam01.mp4", "walk_cam02.mp4")
    read = view_cameras.read_views(bpy.context.scene, 1, 20)
    for view in read:
        assert largest_difference(solved[view.camera.name], view.camera) < 1e-4
    assert len([o for o in bpy.context.scene.objects if o.type == "CAMERA"]) == 2
    assert bpy.context.scene.camera == shot().views[0].camera


def test_calibrating_again_leaves_nothing_of_the_cameras_before(take):
    for _ in range(2):
        solved_cameras.show_cameras(bpy.context.scene, {c.name: c for c in (camera(1), camera(2))}, {})
        solved_cameras.show_points(bpy.context.scene, "Wand", np.zeros((2, 3)), [(0, 1)])
    assert (len(bpy.data.cameras), len(bpy.data.meshes)) == (2, 1)


def test_the_camera_that_blender_starts_with_calibrates_nothing(take):
    current = bpy.context.scene
    owner = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    current.collection.objects.link(owner)
    current.camera = owner
    add(take, "walk_cam01.mp4")
    assert not shot().views[0].is_calibrated and current.camera == shot().views[0].camera
    assert not bpy.ops.kfmocap.use_scene_cameras.poll()
    with pytest.raises(RuntimeError, match="no calibrated camera"):
        bpy.ops.kfmocap.use_scene_cameras()


def test_a_camera_with_footage_behind_it_becomes_a_view_as_it_stands(take):
    current = bpy.context.scene
    current.frame_start, current.frame_end = 11, 30
    solved_cameras.show_cameras(current, {"cam01": camera(1)}, {"cam01": take / "walk_cam01.mp4"}, {"cam01": 3.0})
    assert bpy.ops.kfmocap.use_scene_cameras() == {"FINISHED"}
    (view,) = view_cameras.read_views(current, shot().frame_start, shot().length)
    assert largest_difference(camera(1), view.camera) < 1e-4
    assert (view.offset, shot().frame_start, shot().length) == (3.0, 11, 20)


def show_take(take, scene_frames, offset):
    """Give the scene these first and last frames, and a camera of its own with footage; return its clip."""
    current = bpy.context.scene
    current.frame_start, current.frame_end = scene_frames
    solved_cameras.show_cameras(current, {"cam01": camera(1)}, {"cam01": take / "walk_cam01.mp4"}, {"cam01": offset})
    return bpy.data.movieclips[0]


def test_a_view_of_footage_that_is_shorter_than_the_scene_ends_with_it(take):
    show_take(take, (11, 250), 3.0)
    bpy.ops.kfmocap.use_scene_cameras()
    assert (shot().frame_start, shot().length) == (11, 27)


def test_footage_that_ends_before_the_scene_begins_leaves_it_its_length(take):
    show_take(take, (1001, 1100), 0.0).frame_start = 1
    bpy.ops.kfmocap.use_scene_cameras()
    assert (shot().frame_start, shot().length) == (1001, 100)


def test_footage_that_begins_within_its_file_ends_that_much_earlier(take):
    clip = show_take(take, (1, 250), 0.0)
    clip.frame_offset = 10
    bpy.ops.kfmocap.use_scene_cameras()
    assert (shot().frame_start, shot().length) == (1, clip.frame_duration - 10)


def test_cameras_of_the_scene_become_views_with_their_clips_where_these_are(take):
    current = bpy.context.scene
    solved_cameras.show_cameras(current, {"cam01": camera(1)}, {"cam01": take / "walk_cam01.mp4"}, {"cam01": 0.0})
    clip = bpy.data.movieclips[0]
    clip.frame_start, clip.frame_offset = 3, 7
    bpy.ops.kfmocap.use_scene_cameras()
    assert view_cameras.read_views(current, 1, 10)[0].offset == 1 - 3 + 7
    assert (clip.frame_start, clip.frame_offset) == (3, 7), "tracks made on the clip stay on their pictures"


@pytest.mark.parametrize(("fields", "per_picture"), [("progressive", 1), ("top-first", 2)])
def test_the_frame_offset_of_a_clip_stays_whatever_its_view_says(take, fields, per_picture):
    """Blender's tracks and solved cameras do not move with it, and would leave their pictures."""
    add(take, "walk_cam01.mp4")
    current, (view,) = bpy.context.scene, shot().views
    clip = footage_background.clip_behind(view.camera)
    clip.frame_offset = 7
    view.offset, view.fields = 4.0, fields
    current.frame_set(6)
    assert (6 - clip.frame_start + clip.frame_offset, clip.frame_offset) == ((5 + 4) // per_picture, 7)
    assert footage_background.moved_by(view, shot().first, shot().frame_start) == 0
    clip.frame_offset = 8
    assert footage_background.moved_by(view, shot().first, shot().frame_start) == 1


def test_moving_a_views_offset_moves_its_footage(take):
    add(take, "walk_cam01.mp4", "walk_cam02.mp4")
    view = shot().views[1]
    clip = footage_background.clip_behind(view.camera)
    for offset, index in ((4.0, 4), (-2.0, -2), (1.6, 2), (0.0, 0)):
        view.offset = offset
        assert 1 - clip.frame_start == index  # scene frame 1 shows the footage's frame of that number
    view.offset, view.fields = 2.0, "top-first"
    bpy.context.scene.frame_set(6)
    assert 6 - clip.frame_start == (5 + 2) // 2
    view.fields = "progressive"
    assert clip.animation_data is None or not clip.animation_data.drivers


def test_pictures_are_read_anew_where_a_clip_begins_on_another_frame(take, monkeypatch):
    # Blender would show those of the old start on frames that were shown already.
    anew = MagicMock(wraps=footage_background.forget_pictures)
    monkeypatch.setattr(footage_background, "forget_pictures", anew)
    add(take, "walk_cam01.mp4")
    (view,) = shot().views
    anew.reset_mock()
    for offset, times in ((4.0, 1), (4.2, 1), (5.0, 2)):
        view.offset = offset
        assert anew.call_count == times


def test_a_clip_that_was_moved_in_blender_is_refused_until_its_offset_is_entered(take):
    add(take, "walk_cam01.mp4")
    bpy.ops.kfmocap.import_calibration(filepath=str(take / "calibration.toml"))
    current, (view,) = bpy.context.scene, shot().views
    clip = footage_background.clip_behind(view.camera)
    clip.frame_start, clip.frame_offset = 0, 2
    with pytest.raises(FootageError, match=r"cam01: its pictures are shown 3 frames earlier .*enter the Offset 3"):
        view_cameras.read_views(current, 1, 10)
    view.offset = 3.0
    assert (clip.frame_start, clip.frame_offset) == (0, 2)
    assert view_cameras.read_views(current, 1, 10)[0].offset == 3.0


def test_an_offset_in_a_copy_of_a_scene_leaves_the_footage_of_the_original(take):
    add(take, "walk_cam01.mp4")
    bpy.ops.scene.new(type="FULL_COPY")
    original, copied = (next(s for s in bpy.data.scenes if (s == bpy.context.scene) is new) for new in (False, True))
    (view,) = copied.kfmocap.views
    view.offset = 4.0
    clips = [footage_background.clip_behind(one.kfmocap.views[0].camera) for one in (original, copied)]
    assert [clip.frame_start for clip in clips] == [1, -3]


def test_footage_of_twice_the_frame_rate_shows_every_second_frame(take):
    video(take / "walk_cam03.mp4", 50, fps=50)
    add(take, "walk_cam01.mp4")
    add(take, "walk_cam03.mp4")
    assert [view.every for view in shot().views] == [1, 2]
    current, view = bpy.context.scene, shot().views[1]
    clip = footage_background.clip_behind(view.camera)
    view.offset = 3.0
    for frame in range(1, 20):
        current.frame_set(frame)
        assert frame - clip.frame_start == 2 * (frame - 1) + 3
    assert view_cameras.read_specs(current)[1].every == 2
    view.every = 1
    assert clip.animation_data is None or not clip.animation_data.drivers


@pytest.mark.parametrize("every", [1, 2])
@pytest.mark.parametrize("fields", ["progressive", "top-first"])
def test_footage_goes_on_behind_a_gap_as_the_tracker_counts_it(take, fields, every):
    add(take, "walk_cam01.mp4")
    current, (view,) = bpy.context.scene, shot().views
    view.every = every
    view.offset, view.fields, view.found_gaps = 1.0, fields, packed_gaps([Gap(6, 2), Gap(12, -1)])
    clip = footage_background.clip_behind(view.camera)
    for frame in range(1, 25):
        current.frame_set(frame)
        assert frame - clip.frame_start == file_index(view, shot().first + frame - shot().frame_start)
    for gaps in ((), (Gap(6, 2, timed=True),)):
        view.found_gaps = packed_gaps(gaps)
        assert view.gaps == gaps
        current.frame_set(20)
        view_without = replace(view_cameras.read_specs(current)[0], gaps=())
        assert 20 - clip.frame_start == file_index(view_without, shot().first + 20 - shot().frame_start)


def test_one_opacity_serves_all_views(take):
    add(take, "walk_cam01.mp4")
    shot().opacity = 0.4
    add(take, "walk_cam02.mp4")
    alphas = [view.camera.data.background_images[0].alpha for view in shot().views]
    assert alphas == pytest.approx([0.4, 0.4])


def test_a_view_taken_out_leaves_nothing_behind(take):
    add(take, "walk_cam01.mp4", "walk_cam02.mp4")
    bpy.ops.kfmocap.look_through(view=0)
    assert bpy.ops.kfmocap.remove_view() == {"FINISHED"}
    assert [view.name for view in shot().views] == ["walk_cam02"]
    assert len(bpy.data.cameras) == len(bpy.data.movieclips) == 1
    assert bpy.context.scene.camera == shot().views[0].camera


def test_next_and_previous_go_round_the_views(take):
    add(take, "walk_cam01.mp4", "walk_cam02.mp4")
    seen = []
    for step in (1, 1, -1):
        bpy.ops.kfmocap.step_view(step=step)
        seen.append(shot().shown_view)
    assert seen == [1, 0, 1]


def drop(*paths) -> list[str]:
    """What Blender does with files dropped onto a 3D view: of the handlers that take their ending, and the place, the
    operator is invoked with their names; returns the handlers that take them."""
    area = next(a for a in bpy.context.window.screen.areas if a.type == "VIEW_3D")
    handlers = [cls for cls in registration.CLASSES if issubclass(cls, bpy.types.FileHandler)]
    with bpy.context.temp_override(area=area):
        able = [
            cls
            for cls in handlers
            if paths[0].suffix.lower() in cls.bl_file_extensions.split(";") and cls.poll_drop(bpy.context)
        ]
        module, name = able[0].bl_import_operator.split(".")
        tool = getattr(getattr(bpy.ops, module), name)
        known = tool.get_rna_type().properties.keys()
        given = {
            "filepath": str(paths[0]),
            "directory": f"{paths[0].parent}/",
            "files": [{"name": p.name} for p in paths],
        }
        assert "filepath" in known
        assert tool("INVOKE_DEFAULT", **{key: value for key, value in given.items() if key in known}) == {"FINISHED"}
    return [cls.bl_idname for cls in able]


def test_files_are_dropped_as_blender_does_it(take):
    """One handler takes each, so that Blender need not ask; beside a 3D view none does."""
    assert drop(take / "walk_cam01.mp4", take / "walk_cam02.mp4") == ["KFMOCAP_FH_footage"]
    assert len(shot().views) == 2
    assert drop(take / "calibration.toml") == ["KFMOCAP_FH_file"]
    assert all(view.is_calibrated for view in shot().views)
    area = next(a for a in bpy.context.window.screen.areas if a.type != "VIEW_3D")
    with bpy.context.temp_override(area=area):
        assert not any(
            cls.poll_drop(bpy.context) for cls in registration.CLASSES if issubclass(cls, bpy.types.FileHandler)
        )


@pytest.mark.parametrize("kind", ["calibration", "shot"])
def test_a_dropped_file_is_opened_by_what_it_holds(take, kind, monkeypatch):
    add(take, "walk_cam01.mp4", "walk_cam02.mp4")
    path = take / "calibration.toml"
    if kind == "shot":
        path = take / "shot.toml"
        path.write_text("[shot]\nname = 3\n")
        with pytest.raises(RuntimeError, match=r"shot\.toml \[shot\] name"):
            bpy.ops.kfmocap.open_file(filepath=str(path))
    else:
        assert bpy.ops.kfmocap.open_file(filepath=str(path)) == {"FINISHED"}
        assert all(view.is_calibrated for view in shot().views)
