"""A shot becomes a scene and comes back; the tools work; nothing is left behind."""

from __future__ import annotations

import dataclasses
from dataclasses import replace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from addon_shots import joint_error, keys_of, motion, person, shot  # noqa: E402
from kfmocap import kfmocap_addon  # noqa: E402
from kfmocap.core.body import human  # noqa: E402
from kfmocap.core.body.body import REST_SIGMA  # noqa: E402
from kfmocap.core.choices import FEET, HAND_SHAPES, ROOT_MOTIONS, SOLVERS  # noqa: E402
from kfmocap.core.errors import CancelledError, FootageError, ShotError  # noqa: E402
from kfmocap.core.retargeting.hands.hand_shapes import FLEXIONS  # noqa: E402
from kfmocap.core.shot.settings import Settings  # noqa: E402
from kfmocap.core.shot.shot import KeyPoses, View  # noqa: E402
from kfmocap.kfmocap_addon import registration  # noqa: E402
from kfmocap.kfmocap_addon.scene_io import scene  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.body import body_armature  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.cameras import camera_poses  # noqa: E402
from test_addon_views import largest_difference  # noqa: E402

pytest_plugins = ("addon_fixtures",)

pytestmark = pytest.mark.blender


@pytest.mark.parametrize("fps", [60.0, 29.97, 30000 / 1001, 12.5])
@pytest.mark.parametrize("performers", [("man",), ("man", "woman")])
def test_a_shot_comes_back_from_its_scene(blender, tmp_path, fps, performers):
    original = replace(shot(tmp_path, performers, fps), settings=Settings(solver="relaxation", contact=False))
    read = scene.shot_from_scene(scene.build_scene(original))
    assert (read.name, read.frames, read.settings) == (original.name, original.frames, original.settings)
    assert read.fps == pytest.approx(fps, rel=1e-6)
    for got, view in zip(read.views, original.views, strict=True):
        assert (got.footage, got.keypoints) == (view.footage.resolve(), view.keypoints)
        assert (got.camera.name, got.offset, got.fields) == (view.camera.name, view.offset, view.fields)
        for frame in range(original.length):
            assert largest_difference(view.camera, got.camera, frame) < 1e-4
    for got, performer in zip(read.performers, original.performers, strict=True):
        assert got.name == performer.name and got.body.names == performer.body.names
        assert np.array_equal(got.key_poses.frames, performer.key_poses.frames)
        assert np.array_equal(got.key_poses.fixed, performer.key_poses.fixed)
        assert np.abs(got.key_poses.poses.difference(performer.key_poses.poses)).max() < 1e-5


def test_proposed_key_poses_come_back_as_proposals_also_after_tracking(blender, tmp_path):
    original = shot(tmp_path)
    man = original.performers[0]
    proposed = replace(man, key_poses=KeyPoses.proposed(man.key_poses.frames, man.key_poses.poses))
    original = replace(original, performers=(proposed,))
    built = scene.build_scene(original)
    (before,) = scene.shot_from_scene(built).performers
    assert before.key_poses.proposals().tolist() == man.key_poses.frames.tolist()
    assert np.abs(before.key_poses.poses.difference(man.key_poses.poses)).max() < 1e-5
    tracked = motion(original.length, seed=3)
    for which in (None, original):
        scene.write_motions(built, [tracked], which)
        (after,) = scene.shot_from_scene(built).performers
        assert after.key_poses.proposals().tolist() == man.key_poses.frames.tolist()
        assert np.abs(after.key_poses.poses.difference(tracked[man.key_poses.frames])).max() < 1e-5


def test_a_shot_comes_back_from_a_saved_file(blender, tmp_path):
    original = shot(tmp_path)
    scene.build_scene(original, [motion(original.length)], bpy.context.scene)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "shot.blend"))
    read = scene.shot_from_scene(bpy.context.scene)
    assert [view.footage for view in read.views] == [view.footage for view in original.views]
    assert np.abs(read.performers[0].key_poses.poses.difference(original.performers[0].key_poses.poses)).max() < 1e-5


def test_the_panel_counts_in_scene_frames_alone(blender, tmp_path):
    built = scene.build_scene(shot(tmp_path), scene=bpy.context.scene)
    shown = built.kfmocap
    first, last = shown.first, shown.last
    assert (shown.scene_first, shown.scene_last) == (built.frame_start, built.frame_end) == (1, last - first + 1)
    shown.scene_last -= 2
    assert (shown.first, shown.last, built.frame_end) == (first, last - 2, last - first - 1)
    shown.scene_first = 0
    assert built.frame_start == shown.scene_first == 0 and shown.first == -shown.zero
    shown.zero = 1
    shown.scene_first = 0
    assert shown.first == 0 and shown.scene_first == built.frame_start == 1


def flat(value):
    """Every number and word of a shot."""
    if dataclasses.is_dataclass(value):
        return {f.name: flat(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, dict):
        return {key: flat(item) for key, item in value.items()}
    if isinstance(value, (tuple, list)):
        return [flat(item) for item in value]
    return value.tolist() if isinstance(value, np.ndarray) else value


@pytest.mark.parametrize("tracked", [False, True])
def test_a_scene_that_nobody_changed_is_its_shot_to_the_last_bit(blender, tmp_path, tracked):
    original = shot(tmp_path, ("man", "woman"), 30000 / 1001)
    motions = [motion(original.length), motion(original.length, 1)] if tracked else None
    scene.build_scene(original, motions, bpy.context.scene)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "shot.blend"))
    read = flat(scene.shot_from_scene(bpy.context.scene))
    assert read == flat(original)


def test_what_was_changed_in_blender_is_taken_from_blender(blender, tmp_path):
    original = shot(tmp_path)
    built = scene.build_scene(original, scene=bpy.context.scene)
    slot, armature = built.kfmocap.views[0], built.kfmocap.performers[0].armature
    slot.camera.location.x += 1e-4
    slot.camera.data.lens *= 1.0001
    bpy.data.objects["man shin.L"].data.vertices[0].co.x += 1e-4
    armature.pose.bones["head"].rotation_quaternion = (1, 0, 0, 0)
    armature.pose.bones["head"].keyframe_insert("rotation_quaternion", frame=1 + 5)
    read = scene.shot_from_scene(built)
    was, now = original.views[0].camera, read.views[0].camera
    assert now.centre_world()[0] - was.centre_world()[0] == pytest.approx(1e-4, rel=1e-2)
    assert now.matrix[0, 0] / was.matrix[0, 0] == pytest.approx(1.0001, abs=1e-6)
    body, part = read.performers[0].body, original.performers[0].body.index("shin.L")
    moved = body.parts[part].vertices - original.performers[0].body.parts[part].vertices
    assert moved[0, 0] == pytest.approx(1e-4, rel=1e-2)
    poses, head = read.performers[0].key_poses.poses, body.index("head")
    assert np.allclose(poses.rotations[1, head], np.eye(3), atol=1e-6)
    before = original.performers[0].key_poses.poses.rotations[1]
    assert np.array_equal(np.delete(poses.rotations[1], head, 0), np.delete(before, head, 0))


def test_the_scene_runs_over_the_shot_at_its_rate(blender, tmp_path):
    built = scene.build_scene(shot(tmp_path, fps=29.97))
    assert (built.frame_start, built.frame_end) == (1, 12)
    assert built.render.fps / built.render.fps_base == pytest.approx(29.97)
    assert built.camera == built.kfmocap.views[0].camera


def test_a_shot_trimmed_in_the_panel_keeps_its_footage_and_key_poses_in_step(blender, tmp_path):
    original = shot(tmp_path)  # frames 5 to 16, key poses at shot frames 0, 5 and 11
    built = scene.build_scene(original, [motion(original.length)], bpy.context.scene)
    built.kfmocap.first, built.kfmocap.last = 8, 14
    assert (built.frame_start, built.frame_end) == (4, 10)
    trimmed = scene.shot_from_scene(built)
    assert trimmed.frames == (8, 14)
    [performer] = trimmed.performers
    assert performer.key_poses.frames.tolist() == [2]
    assert np.abs(performer.key_poses.poses.difference(motion(original.length)[[5]])).max() < 1e-5
    moving = original.views[1].camera
    assert np.abs(trimmed.views[1].camera.centre_world(0) - moving.centre_world(3)).max() < 1e-5
    scene.write_motions(built, [motion(original.length)[3:10]])
    assert joint_error(built.kfmocap.performers[0].armature, person(1.7), motion(original.length)) < 0.05
    built.kfmocap.last = 7
    with pytest.raises(ShotError, match="before the first"):
        scene.shot_from_scene(built)


def test_footage_that_blender_cannot_read_leaves_nothing_behind(blender, tmp_path):
    original = shot(tmp_path)
    (tmp_path / "cam02.mp4").write_bytes(b"no video")
    with pytest.raises(FootageError, match=r"cam02\.mp4"):
        scene.build_scene(original)
    assert not bpy.data.objects and not bpy.data.movieclips and len(bpy.data.scenes) == 1


def test_an_incomplete_scene_is_refused_by_name(blender, tmp_path):
    with pytest.raises(ShotError, match="holds no shot"):
        scene.shot_from_scene(bpy.context.scene)
    built = scene.build_scene(shot(tmp_path))
    bpy.data.objects.remove(built.kfmocap.performers[0].armature)
    with pytest.raises(ShotError, match=r"performer man.*gone"):
        scene.shot_from_scene(built)


def test_load_shot_shows_a_shot_file(blender, tmp_path, monkeypatch, capfd):
    from kfmocap.core.tracking import prepare

    given = shot(tmp_path)
    later = replace(given, performers=tuple(replace(own, file_rows=900) for own in given.performers))
    monkeypatch.setattr(prepare, "load_shot", lambda path: replace(later, frames=(3, later.frames[1])))
    assert bpy.ops.kfmocap.load_shot(filepath=str(tmp_path / "shot.toml")) == {"FINISHED"}
    assert bpy.context.scene.kfmocap.shot == "walk"
    assert "write first_row = 0" in capfd.readouterr().out


def test_a_shot_file_that_is_wrong_is_reported_and_changes_nothing(blender, tmp_path):
    with pytest.raises(RuntimeError, match=r"Error: .*missing\.toml"):
        bpy.ops.kfmocap.load_shot(filepath=str(tmp_path / "missing.toml"))
    assert len(bpy.data.scenes) == 1 and not bpy.data.objects


def test_track_writes_what_the_tracker_finds_in_the_scene(blender, tmp_path, tracker):
    original = shot(tmp_path, ("man", "woman"))
    built = scene.build_scene(original, scene=bpy.context.scene)
    assert bpy.ops.kfmocap.track() == {"FINISHED"}
    [seen] = tracker.shots
    assert seen.performers[1].key_poses.frames.tolist() == [0, 5, 11]
    for seed, slot in enumerate(built.kfmocap.performers):
        body = human(1.7 + 0.1 * seed)
        assert joint_error(slot.armature, body, motion(original.length, seed)) < 0.05
        assert slot.armature.pose.bones["hand.L"]["kfmocap_views"] == 2


@pytest.mark.parametrize("error", [FootageError("broken", where="cam01.mp4"), CancelledError()])
def test_tracking_that_fails_leaves_the_scene_as_it_was(blender, tmp_path, tracker, error):
    built = scene.build_scene(shot(tmp_path), scene=bpy.context.scene)
    before, tracker.error = keys_of(built.kfmocap.performers[0].armature), error
    if isinstance(error, FootageError):
        with pytest.raises(RuntimeError, match=r"cam01\.mp4: broken"):
            bpy.ops.kfmocap.track()
    else:
        assert bpy.ops.kfmocap.track() == {"CANCELLED"}
    assert keys_of(built.kfmocap.performers[0].armature) == before


def test_tools_without_a_shot_are_disabled(blender):
    assert not bpy.ops.kfmocap.track.poll()
    assert not bpy.ops.kfmocap.export.poll()
    assert bpy.ops.kfmocap.load_shot.poll()


def test_set_key_pose_makes_a_tracked_pose_the_animators(blender, tmp_path):
    original = shot(tmp_path)
    built = scene.build_scene(original, [motion(original.length)], bpy.context.scene)
    built.frame_set(1 + 3)
    assert bpy.ops.kfmocap.set_key_pose() == {"FINISHED"}
    keys = scene.shot_from_scene(built).performers[0].key_poses
    assert keys.frames.tolist() == [0, 3, 5, 11] and keys.fixed.all()
    assert np.abs(keys.poses[[1]].difference(motion(original.length)[[3]])).max() < 1e-5


def test_set_key_pose_keys_the_selected_bones_alone(blender, tmp_path):
    built = scene.build_scene(shot(tmp_path), scene=bpy.context.scene)
    armature = built.kfmocap.performers[0].armature
    built.frame_set(1 + 8)
    bpy.context.view_layer.objects.active = armature
    bpy.ops.object.mode_set(mode="POSE")
    for bone in armature.pose.bones:
        # From 5.0 on the pose bone is what is selected, before it was the bone.
        (bone if bpy.app.version >= (5, 0) else bone.bone).select = bone.name == "hand.R"
    assert bpy.ops.kfmocap.set_key_pose() == {"FINISHED"}
    bpy.ops.object.mode_set(mode="OBJECT")
    keys = scene.shot_from_scene(built).performers[0].key_poses
    part = person().index("hand.R")
    assert keys.frames.tolist() == [0, 5, 8, 11]
    assert np.flatnonzero(keys.fixed[2]).tolist() == list(range(3 + 3 * part, 6 + 3 * part))


def test_looking_through_a_view_shows_it_at_its_size(blender, tmp_path):
    original = shot(tmp_path)
    tall = replace(original.views[1].camera, size=(240, 320))
    views = (original.views[0], View(tall, original.views[1].footage))
    built = scene.build_scene(replace(original, views=views), scene=bpy.context.scene)
    assert bpy.ops.kfmocap.look_through(view=1) == {"FINISHED"}
    assert built.camera == built.kfmocap.views[1].camera
    assert (built.render.resolution_x, built.render.resolution_y) == (240, 320)


def test_dope_sheets_of_all_workspaces_show_the_keys_of_a_loaded_shot(blender, tmp_path, monkeypatch):
    from kfmocap.core.tracking import prepare

    monkeypatch.setattr(prepare, "load_shot", lambda path: shot(tmp_path))
    bpy.ops.kfmocap.load_shot(filepath=str(tmp_path / "shot.toml"))
    spaces = [space for screen in bpy.data.screens for area in screen.areas for space in area.spaces]
    sheets = [space.dopesheet for space in spaces if space.type == "DOPESHEET_EDITOR"]
    assert len(sheets) > 1 and not any(sheet.show_only_selected for sheet in sheets)
    assert not bpy.context.window.scene.show_keys_from_selected_only


def test_the_timeline_shows_the_whole_shot_also_where_it_has_one_key_pose(blender, tmp_path, monkeypatch):
    from kfmocap.core.tracking import prepare

    given = shot(tmp_path)
    [performer] = given.performers
    first = replace(performer, key_poses=KeyPoses.whole([0], performer.key_poses.poses[[0]]))
    monkeypatch.setattr(prepare, "load_shot", lambda path: replace(given, performers=(first,)))
    bpy.ops.kfmocap.load_shot(filepath=str(tmp_path / "shot.toml"))
    [timeline] = [area for area in bpy.context.screen.areas if area.type == "DOPESHEET_EDITOR"]
    region = next(region for region in timeline.regions if region.type == "WINDOW")
    left, right = (region.view2d.region_to_view(x, 0)[0] for x in (0, region.width))
    first_frame, last_frame = bpy.context.scene.frame_start, bpy.context.scene.frame_end
    assert left <= first_frame and last_frame <= right < 2 * last_frame


def constrained(camera):
    camera.constraints.new("COPY_LOCATION").target = None


def muted(camera):
    camera.animation_data.action.layers[0].strips[0].channelbags[0].fcurves[0].mute = True


def moved_beside(camera):
    camera.delta_location.x = 0.5


def scaled_by_keys(camera):
    camera.keyframe_insert("scale", frame=3)


@pytest.mark.parametrize("change", [constrained, muted, moved_beside, scaled_by_keys, None])
def test_a_moving_camera_is_read_as_the_scene_shows_it(blender, tmp_path, change):
    """By its curves alone where nothing else moves it, to the last bit."""
    built = scene.build_scene(shot(tmp_path), scene=bpy.context.scene)
    camera = built.kfmocap.views[1].camera
    camera.scale = (2.0, 2.0, 2.0)
    if change is not None:
        change(camera)
    assert (camera_poses._along_curves(camera, [1]) is None) == (change is not None)
    [(R, t)] = camera_poses.read_poses(built, [camera], 1, 5)
    for frame in range(5):
        built.frame_set(1 + frame)
        seen = np.array(camera.evaluated_get(bpy.context.evaluated_depsgraph_get()).matrix_world)
        (expected_R,), (expected_t,) = camera_poses._cv_poses(seen[None])
        assert np.array_equal(R[frame], expected_R) and np.array_equal(t[frame], expected_t)


def test_registering_again_works_and_unregistering_leaves_nothing():
    def traces():
        kinds = (bpy.types.Operator, bpy.types.Panel, bpy.types.PropertyGroup)
        names = [c.__name__ for kind in kinds for c in kind.__subclasses__() if c.__module__.startswith("kfmocap.")]
        return [n for n in names if getattr(bpy.types, n, None)], "kfmocap" in dir(bpy.ops) and dir(bpy.ops.kfmocap)

    before = set(dir(bpy.types))
    for _ in range(2):
        kfmocap_addon.register()
        assert registration.is_registered() and set(dir(bpy.types)) > before
        kfmocap_addon.unregister()
        assert not registration.is_registered() and set(dir(bpy.types)) == before
        assert not traces()[0] and not traces()[1]


def test_menus_offer_what_the_core_knows(blender):
    shot, retarget = bpy.context.scene.kfmocap, bpy.context.scene.kfmocap.retarget
    hands = bpy.ops.kfmocap.hand_shape.get_rna_type()
    menus = {(shot, "solver"): SOLVERS, (retarget, "root"): ROOT_MOTIONS, (retarget, "feet"): FEET}
    for (owner, name), choices in menus.items():
        assert [item.identifier for item in owner.bl_rna.properties[name].enum_items] == list(choices)
    assert [item.identifier for item in hands.properties["shape"].enum_items] == list(HAND_SHAPES)
    assert set(FLEXIONS) == set(HAND_SHAPES)


def test_every_tool_and_property_explains_itself(blender):
    for cls in registration.CLASSES:
        for prop in cls.bl_rna.properties:
            if prop.identifier in getattr(cls, "__annotations__", {}) and not prop.is_hidden:
                collection = prop.type == "COLLECTION"
                assert collection or prop.description, f"{cls.__name__}.{prop.identifier}"
        if issubclass(cls, bpy.types.Operator):
            tool = getattr(bpy.ops.kfmocap, cls.bl_idname.split(".")[1])
            description = tool.get_rna_type().description
            assert description and description == " ".join(description.split())  # not broken as in the source


@pytest.mark.parametrize("collar_bones", [True, False])
def test_usual_departures_survive_saving_and_old_bodies_have_none(blender, tmp_path, collar_bones):
    body = human(collar_bones=collar_bones)
    armature = body_armature.build_armature(body, "man", bpy.context.scene.collection)
    armature.data.bones["chest"].name = "ribs"
    if not collar_bones:
        for bone in armature.data.bones:
            del bone[body_armature.DEPARTURE]
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "body.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "body.blend"))
    read = body_armature.body_from_armature(bpy.data.objects["man"])
    assert read.departures.tolist() == (body.departures.tolist() if collar_bones else [REST_SIGMA] * len(body))
    assert read.is_stiff.any() == collar_bones
