"""Cameras and footage go to Blender and come back."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

import odd_characters  # noqa: E402
from addon_shots import SIZE, camera, shot, video  # noqa: E402
from bpy_extras.object_utils import world_to_camera_view  # noqa: E402
from kfmocap.core.cameras.camera import Camera  # noqa: E402
from kfmocap.core.errors import CalibrationError, FootageError  # noqa: E402
from kfmocap.core.shot.shot import View  # noqa: E402
from kfmocap.kfmocap_addon.scene_io import scene  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.cameras import distortion, footage_background, view_cameras  # noqa: E402
from kfmocap.kfmocap_addon.session import SESSION  # noqa: E402
from kfmocap.kfmocap_addon.viewports import performer_boxes, screens, timelines  # noqa: E402
from kfmocap.kfmocap_addon.viewports.see_through import SeenThrough  # noqa: E402
from mathutils import Vector  # noqa: E402

pytest_plugins = ("addon_fixtures",)

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("blender")]


def points_in_view(cam: Camera, frame: int = 0) -> np.ndarray:
    rng = np.random.default_rng(5)
    K, (R, t) = cam.matrix, cam.pose(frame)
    pixels = rng.uniform([0, 0], cam.size, (200, 2))
    rays = np.concatenate([(pixels - K[:2, 2]) / np.diag(K)[:2], np.ones((200, 1))], axis=1)
    return (rays * rng.uniform(3, 7, (200, 1)) - t) @ R


def largest_difference(a: Camera, b: Camera, frame: int = 0) -> float:
    points = points_in_view(a, frame)
    return float(np.abs(a.project(points, frame) - b.project(points, frame)).max())


def built(cam: Camera, folder: Path, first: int = 0) -> bpy.types.PropertyGroup:
    slot = bpy.context.scene.kfmocap.views.add()
    view = View(cam, video(folder / "footage.mp4"))
    clip = footage_background.load_clip(view.footage)
    view_cameras.build_view(view, clip, slot, bpy.context.scene.collection, first=first, frame_start=1)
    return slot


@pytest.mark.parametrize("moving", [False, True])
def test_blender_projects_as_the_core_does(tmp_path, moving):
    cam = camera(1, 4 if moving else 1).rectified()
    slot = built(cam, tmp_path)
    current = bpy.context.scene
    footage_background.look_through(current, slot)
    for frame in range(4):
        current.frame_set(1 + frame)
        points = points_in_view(cam, frame)
        seen = np.array([world_to_camera_view(current, slot.camera, Vector(p)) for p in points])
        pixels = seen[:, :2] * [1, -1] * SIZE + [-0.5, SIZE[1] - 0.5]
        assert np.abs(pixels - cam.project(points, frame)).max() < 2e-4  # Blender's own float32 is in this


@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("distortions", [(), (0.1, -0.05, 0.002, -0.003), (0.1, -0.05, 0.002, -0.003, 0.01)])
def test_a_camera_comes_back_within_a_ten_thousandth_of_a_pixel(tmp_path, moving, distortions):
    cam = camera(2, 5 if moving else 1, distortions or (0.0,) * 4)
    built(cam, tmp_path)
    [view] = view_cameras.read_views(bpy.context.scene, 1, 5)
    assert view.camera.moving == moving
    for frame in range(5):
        assert largest_difference(cam, view.camera, frame) < 1e-4


@pytest.mark.parametrize("fisheye", [False, True])
def test_a_lens_that_blender_has_no_model_for_comes_back(tmp_path, fisheye):
    distortions = (0.05, 0.01, -0.002, 0.001) if fisheye else (0.1, 0.02, 0.001, 0.002, 0.003, 0.1, 0.02, 0.004)
    cam = camera(1, distortions=distortions, fisheye=fisheye)
    built(cam, tmp_path)
    [view] = view_cameras.read_views(bpy.context.scene, 1, 5)
    assert view.camera.fisheye == fisheye
    assert np.array_equal(view.camera.distortions, cam.distortions)


def undistorted(clip: bpy.types.MovieClip, pixels: np.ndarray) -> np.ndarray:
    """Where Blender takes places of the undistorted picture from, by the Brown model in its own units and axes."""
    t = clip.tracking.camera
    (cx, cy), focal, ratio = t.principal_point_pixels, t.focal_length_pixels, 1 / t.pixel_aspect
    x, y = (pixels[:, 0] + 0.5 - cx) / focal, (clip.size[1] - pixels[:, 1] - 0.5 - cy) * ratio / focal
    r2 = x**2 + y**2
    scale = 1 + t.brown_k1 * r2 + t.brown_k2 * r2**2 + t.brown_k3 * r2**3 + t.brown_k4 * r2**4
    u = x * scale + 2 * t.brown_p2 * x * y + t.brown_p1 * (r2 + 2 * x**2)
    v = y * scale + 2 * t.brown_p1 * x * y + t.brown_p2 * (r2 + 2 * y**2)
    return np.stack([u * focal + cx - 0.5, clip.size[1] - (v * focal / ratio + cy) - 0.5], axis=1)


@pytest.mark.parametrize("stretch", [0.8, 1.0, 1.25])
@pytest.mark.parametrize("fisheye", [False, True])
def test_footage_is_undistorted_as_the_core_rectifies_it(tmp_path, stretch, fisheye):
    cam = camera(1, distortions=(0.02, -0.01, 0.004, -0.001), fisheye=fisheye)
    cam = replace(cam, matrix=cam.matrix * [[1], [stretch], [1]])
    slot = built(cam, tmp_path)
    points = points_in_view(cam.rectified())
    truth = cam.project(points)
    seen = ((truth > 0) & (truth < np.array(SIZE) - 1)).all(axis=1)
    shown = undistorted(footage_background.clip_behind(slot.camera), cam.rectified().project(points))
    assert np.abs(shown - truth)[seen].max() < (0.1 if fisheye else 1e-3)


def test_footage_before_cameras_of_other_shapes_spans_their_width(tmp_path):
    tall = replace(camera(2), size=(240, 320))
    slots = [built(cam, tmp_path) for cam in (camera(1), tall)]
    methods = []
    for slot in slots:
        footage_background.look_through(bpy.context.scene, slot)
        methods.append([s.camera.data.background_images[0].frame_method for s in slots])
    assert methods == [["STRETCH", "CROP"], ["FIT", "STRETCH"]]
    for slot in slots:
        width, height = footage_background.clip_behind(slot.camera).display_aspect
        assert width / height == pytest.approx(slot.aspect[0] / slot.aspect[1], rel=1e-6)


@pytest.mark.parametrize("fit", ["AUTO", "HORIZONTAL", "VERTICAL"])
@pytest.mark.parametrize(("size", "aspect"), [((640, 480), (1.0, 1.1)), ((480, 640), (1.2, 1.0))])
def test_any_sensor_fit_is_understood(fit, size, aspect):
    data = bpy.data.cameras.new("camera")
    data.sensor_fit, data.lens, data.shift_x, data.shift_y, data.sensor_height = fit, 40, 0.1, -0.07, 20
    owner = bpy.data.objects.new("camera", data)
    bpy.context.scene.collection.objects.link(owner)
    render = bpy.context.scene.render
    (render.resolution_x, render.resolution_y), (render.pixel_aspect_x, render.pixel_aspect_y) = size, aspect
    K = distortion.intrinsic_matrix(data, distortion.Frame(size, aspect))
    for point in [(0.3, 0.2, -2.0), (-0.4, 0.1, -1.5)]:
        x, y, _ = world_to_camera_view(bpy.context.scene, owner, Vector(point))
        u, v, w = K @ (np.array(point) * [1, -1, -1])
        assert np.allclose((u / w, v / w), (x * size[0] - 0.5, (1 - y) * size[1] - 0.5), atol=2e-4)


def test_a_camera_moved_by_a_constraint_is_read_on_every_frame(tmp_path):
    slot = built(camera(1), tmp_path)
    carrier = bpy.data.objects.new("carrier", None)
    bpy.context.scene.collection.objects.link(carrier)
    for frame in (1, 5):
        carrier.location.x = frame
        carrier.keyframe_insert("location", frame=frame)
    slot.camera.constraints.new("COPY_LOCATION").target = carrier
    bpy.context.scene.frame_set(3)
    [view] = view_cameras.read_views(bpy.context.scene, 1, 5)
    centres = [view.camera.centre_world(f)[0] for f in range(5)]
    assert centres[0] == pytest.approx(1) and centres[4] == pytest.approx(5)
    assert np.all(np.diff(centres) > 0)
    assert bpy.context.scene.frame_current == 3


@pytest.mark.parametrize("scale", [(-1, 1, 1), (0, 0, 0)])
def test_a_camera_that_its_scale_mirrors_is_named(tmp_path, scale):
    slot = built(camera(1), tmp_path)
    slot.camera.scale = scale
    with pytest.raises(CalibrationError, match=f"camera {slot.camera.name}: its scale mirrors or flattens it"):
        view_cameras.read_views(bpy.context.scene, 1, 5)


def test_the_footage_stands_behind_its_camera_at_the_right_frame(tmp_path):
    original = shot(tmp_path)
    scene.build_scene(original, scene=bpy.context.scene)
    for view, slot in zip(original.views, bpy.context.scene.kfmocap.views, strict=True):
        [background] = slot.camera.data.background_images
        assert slot.camera.data.show_background_images and background.clip_user.use_render_undistorted
        # Scene frame 1 is shot frame 0: the footage's frame first + offset.
        assert 1 - background.clip.frame_start == original.frames[0] + view.offset


@pytest.mark.parametrize("order", ["top-first", "bottom-first"])
@pytest.mark.parametrize("offset", [0.0, 3.0])
def test_interlaced_footage_shows_each_frame_for_its_two_fields(tmp_path, order, offset):
    original = shot(tmp_path)
    fixed, moving = original.views
    fixed = replace(fixed, offset=offset, fields=order)
    scene.build_scene(replace(original, views=(fixed, moving)), scene=bpy.context.scene)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "shot.blend"))
    current = bpy.context.scene
    clips = [slot.camera.data.background_images[0].clip for slot in current.kfmocap.views]
    for f in range(original.length):
        current.frame_set(1 + f)
        shown = [1 + f - clip.frame_start for clip in clips]
        assert shown == [(original.frames[0] + f + offset) // 2, original.frames[0] + f]
    assert [view.fields for view in scene.shot_from_scene(current).views] == [order, "progressive"]


def test_an_image_sequence_comes_back_as_its_pattern(tmp_path):
    import cv2

    for number in range(3, 7):
        cv2.imwrite(str(tmp_path / f"image_{number:04d}.png"), np.zeros((SIZE[1], SIZE[0]), np.uint8))
    view = View(camera(1), tmp_path / "image_%04d.png")
    clip = footage_background.load_clip(view.footage)
    slot = bpy.context.scene.kfmocap.views.add()
    view_cameras.build_view(view, clip, slot, bpy.context.scene.collection, first=0, frame_start=1)
    assert clip.source == "SEQUENCE" and clip.filepath.endswith("image_0003.png")
    assert view_cameras.read_views(bpy.context.scene, 1, 3)[0].footage == view.footage


def test_cameras_of_other_sizes_are_each_seen_at_their_own(tmp_path):
    render = bpy.context.scene.render
    tall = replace(camera(2), size=(240, 320))
    for cam in (camera(1), tall):
        slot = built(cam, tmp_path)
        footage_background.look_through(bpy.context.scene, slot)
        assert (render.resolution_x, render.resolution_y) == cam.size
        assert render.pixel_aspect_y / render.pixel_aspect_x == pytest.approx(
            cam.matrix[0, 0] / cam.matrix[1, 1], rel=1e-6
        )
    read = view_cameras.read_views(bpy.context.scene, 1, 3)
    assert largest_difference(tall, read[1].camera) < 1e-4


def test_what_blender_cannot_show_is_refused(tmp_path):
    cam = camera(1)
    skewed = replace(cam, matrix=cam.matrix + np.array([[0, 3.0, 0], [0, 0, 0], [0, 0, 0]]))
    with pytest.raises(CalibrationError, match=r"cam01.*skew"):
        distortion.set_lens(bpy.data.cameras.new("camera"), skewed)
    broken = tmp_path / "broken.mp4"
    broken.write_bytes(b"no video")
    with pytest.raises(FootageError, match=r"broken\.mp4"):
        footage_background.load_clip(broken)


def test_a_view_that_lost_its_camera_or_footage_is_named(tmp_path):
    slot = built(camera(1), tmp_path)
    slot.camera.data.background_images.clear()
    with pytest.raises(FootageError, match=r"camera cam01.*no footage"):
        view_cameras.read_views(bpy.context.scene, 1, 5)
    bpy.data.objects.remove(slot.camera)
    with pytest.raises(CalibrationError, match=r"view cam01.*gone"):
        view_cameras.read_views(bpy.context.scene, 1, 5)


def test_the_picture_stays_clear_of_bars_and_sidebars_that_lie_over_it():
    """Sizes as in Blender 5.2: 1180 x 786 pixels, tools at the left, the sidebar at the right, two headers above."""
    region, zoom = (2, 87, 1182, 873), 29.12
    bars = [(2, 846, 1182, 873), (2, 819, 1182, 846), (2, 87, 60, 819), (890, 87, 1182, 819), (0, 0, 1182, 86)]
    free = screens.free_box(region, bars)
    assert free == (60, 87, 890, 819)
    for aspect in (16 / 9, 9 / 16):
        new, offset = screens.framing(region, free, aspect, zoom)
        scale = (2**0.5 + new / 50) ** 2 / 4
        width = min(1180, 786 * aspect) * scale
        centre = [(region[i] + region[i + 2]) / 2 - 2 * scale * offset[i] * (region[i + 2] - region[i]) for i in (0, 1)]
        assert centre[0] - width / 2 >= 59 and centre[0] + width / 2 <= 891
        assert centre[1] - width / aspect / 2 >= 86 and centre[1] + width / aspect / 2 <= 820
        assert min(830 / width, 732 * aspect / width) == pytest.approx(1, abs=0.01)
    assert screens.free_box(region, []) == region
    assert screens.framing(region, region, 16 / 9, zoom) == (pytest.approx(zoom), (0.0, 0.0))


def test_a_sidebar_that_is_opened_later_moves_what_it_covers_and_nothing_else():
    region, free = (2, 87, 1182, 873), ((60, 87, 1182, 819), (60, 87, 890, 819))
    for aspect in (16 / 9, 9 / 16):
        zoom, offset = screens.framing(region, free[0], aspect, 29.12)
        found = screens.moved_clear(region, free, aspect, (zoom, offset))
        assert found is not None
        wanted = screens.framing(region, free[1], aspect, 29.12)
        assert found[0] == pytest.approx(wanted[0], abs=0.3) and found[1] == pytest.approx(wanted[1], abs=0.005)
        assert screens.moved_clear(region, free, aspect, found) is None, "it is clear now"
        assert screens.moved_clear(region, free, aspect, (zoom + 5, offset)) is None, "the user zoomed"
        assert screens.moved_clear(region, free, aspect, (zoom, (offset[0] + 0.05, offset[1]))) is None, "and moved"
        assert screens.moved_clear(region, (free[0], free[0]), aspect, (zoom, offset)) is None


def test_the_name_of_a_joint_is_not_cut_off_by_the_sidebar():
    from kfmocap.kfmocap_addon.overlays.mark_drawing import beside

    for pointer in (0.0, 300.0, 699.0):
        left = beside(pointer, 90.0, 700.0)
        assert left + 90 <= 700 and (left > pointer or left + 90 < pointer)


def test_a_part_of_the_picture_fills_what_is_free_of_a_view():
    region, free, zoom, aspect = (2, 87, 1182, 873), (60, 87, 890, 819), 29.12, 9 / 16
    for part in ((0.3, 0.2, 0.6, 0.7), (0.0, 0.0, 0.5, 0.4)):
        new, offset = screens.framing(region, free, aspect, zoom, part)
        scale = (2**0.5 + new / 50) ** 2 / 4
        size = (min(1180, 786 * aspect) * scale, min(1180, 786 * aspect) * scale / aspect)
        centre = [(region[i] + region[i + 2]) / 2 - 2 * scale * offset[i] * (region[i + 2] - region[i]) for i in (0, 1)]
        shown = [centre[i % 2] + (part[i] - 0.5) * size[i % 2] for i in range(4)]
        assert shown[0] >= 59 and shown[1] >= 86 and shown[2] <= 891 and shown[3] <= 820
        assert max((shown[2] - shown[0]) / 830, (shown[3] - shown[1]) / 732) == pytest.approx(1, abs=0.01)


def test_the_part_of_a_picture_with_the_performers_holds_their_joints_on_all_frames(blender, tmp_path):
    made = shot(tmp_path)
    scene.build_scene(made, scene=bpy.context.scene)
    still, moving = (view.camera for view in bpy.context.scene.kfmocap.views)
    left, bottom, right, top = performer_boxes.part_with_performers(bpy.context.scene, still)
    assert 0 <= left < right <= 1 and 0 <= bottom < top <= 1
    assert performer_boxes.part_with_performers(bpy.context.scene, moving) == performer_boxes.WHOLE
    near = performer_boxes.around(np.array([[-0.2, -0.4], [0.1, 0.4]]))
    assert near == pytest.approx((0.34, 0.24, 0.61, 0.76), abs=0.01)


def test_a_timeline_takes_room_from_the_3d_view_that_lies_on_it():
    """And from no other editor, nor from a view beside or above that one."""

    def area(kind, x, y, width, height):
        return SimpleNamespace(type=kind, x=x, y=y, width=width, height=height)

    timeline = area("DOPESHEET_EDITOR", 2, 24, 1180, 60)
    above, higher = area("VIEW_3D", 2, 87, 1180, 400), area("VIEW_3D", 2, 490, 1180, 383)
    others = [area("VIEW_3D", 1185, 87, 253, 786), area("IMAGE_EDITOR", 2, 30, 1180, 50)]
    window = SimpleNamespace(screen=SimpleNamespace(areas=[*others, higher, above, timeline]))
    assert timelines.view_above(window, timeline) is above
    window.screen.areas.remove(above)
    window.screen.areas.remove(higher)
    assert timelines.view_above(window, timeline) is None


@pytest.mark.parametrize("is_own", [True, False])
def test_skins_are_see_through_while_one_looks_through_a_camera(tmp_path, is_own):
    """A body of ours is drawn as outlines or wire, and hides nothing. Looking elsewhere gives the view back."""
    built(camera(1), tmp_path)
    if is_own:
        bpy.ops.kfmocap.add_body()
    else:
        bpy.context.view_layer.objects.active = odd_characters.skinned_human()
        assert bpy.ops.kfmocap.use_armature() == {"FINISHED"}
    views = [a.spaces.active for a in bpy.context.window.screen.areas if a.type == "VIEW_3D"]
    assert not any(view.shading.show_xray for view in views)
    bpy.ops.kfmocap.look_through(view=0)
    assert [view.shading.show_xray for view in views].count(True) == (0 if is_own else 1)
    seen = SESSION.of(SeenThrough)
    seen.take_back_elsewhere()
    assert any(view.shading.show_xray for view in views) != is_own
    for view in views:
        view.region_3d.view_perspective = "PERSP"
    seen.take_back_elsewhere()
    assert not any(view.shading.show_xray for view in views)


def test_an_x_ray_of_the_users_own_stays(tmp_path):
    built(camera(1), tmp_path)
    bpy.context.view_layer.objects.active = odd_characters.skinned_human()
    bpy.ops.kfmocap.use_armature()
    views = [a.spaces.active for a in bpy.context.window.screen.areas if a.type == "VIEW_3D"]
    for view in views:
        view.shading.show_xray = True
    bpy.ops.kfmocap.look_through(view=0)
    for view in views:
        view.region_3d.view_perspective = "PERSP"
    SESSION.of(SeenThrough).take_back_elsewhere()
    assert all(view.shading.show_xray for view in views)
