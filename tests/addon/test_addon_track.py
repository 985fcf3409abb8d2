"""Tracking in Blender: all of a shot or some segments; it can be cancelled, undone, and is the same again."""

from __future__ import annotations

from contextlib import contextmanager
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from addon_shots import PARTS, keys_of, motion, shot, track_result  # noqa: E402
from kfmocap.core.cameras import lens_turns  # noqa: E402
from kfmocap.core.errors import CancelledError, ShotError  # noqa: E402
from kfmocap.core.fitting.checks.early_check import EARLY_MISFITS  # noqa: E402
from kfmocap.core.fitting.checks.view_findings import FootageMatch  # noqa: E402
from kfmocap.core.numerics import rotations  # noqa: E402
from kfmocap.core.runtime.processes.job import Job  # noqa: E402
from kfmocap.core.shot.footage_faults.footage_times import FootageRate  # noqa: E402
from kfmocap.core.shot.settings import Settings  # noqa: E402
from kfmocap.core.shot.shot import Gap  # noqa: E402
from kfmocap.core.tracking.results.late_views import LateView  # noqa: E402
from kfmocap.core.tracking.retracking import Excerpt, track_excerpts  # noqa: E402
from kfmocap.kfmocap_addon.operators import job_operator  # noqa: E402
from kfmocap.kfmocap_addon.operators.tracking.track_motion import Tracking  # noqa: E402
from kfmocap.kfmocap_addon.scene_io import fcurves, scene, tracked_segments  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.keys import key_pose_curves, motion_curves  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.keys.tracking_preview import TrackingPreview  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.review import faulty_footage  # noqa: E402
from scene_state import differences, state  # noqa: E402
from synthetic import CAMERAS, figure, film, look_at, shot_of, swing  # noqa: E402

pytest_plugins = ("addon_fixtures",)

pytestmark = pytest.mark.blender

GENERATED = 5
NO_SEARCH = Settings(limb_search=False)
FRAME = 1  # of shot frame 0 in the scene


@pytest.fixture
def built(blender, tmp_path, tracker):
    """A shot of the frames 0 to 11 with key poses at 0, 5 and 11, as the open scene."""
    return scene.build_scene(shot(tmp_path), scene=bpy.context.scene)


def armature_of(built):
    return built.kfmocap.performers[0].armature


def generated(built):
    """Shot frames with tracked keys on every channel."""
    frames = []
    for curve in fcurves.find_channelbag(armature_of(built)).fcurves:
        if "kfmocap" not in curve.data_path:
            keys = fcurves.get_keys(curve)
            frames.append({int(f) - FRAME for f in keys["co"][keys["type"] == GENERATED, 0]})
    assert all(f == frames[0] for f in frames)
    return sorted(frames[0])


def tracked_frames(tracker):
    return [(s.frames[0] - 5, s.frames[1] - 5) for s in tracker.shots]


def shift_key_pose(built, frame):
    """A key pose as the animator corrects it."""
    built.frame_set(frame + FRAME)
    armature_of(built).pose.bones["hand.L"].rotation_quaternion = (0.6, 0.0, 0.8, 0.0)
    key_pose_curves.key_current_pose(armature_of(built), frame + FRAME)


@pytest.mark.parametrize(
    ("tool", "frame", "tracked"),
    [
        ("track", 3, (0, 11)),
        ("track_here", 3, (0, 5)),
        ("track_here", 5, (0, 11)),
        ("track_here", 11, (5, 11)),
        ("track_forward", 3, (0, 11)),
        ("track_forward", 5, (5, 11)),
        ("track_backward", 5, (0, 5)),
        ("track_backward", 7, (0, 11)),
        ("track_changes", 3, (0, 11)),
    ],
)
def test_tools_track_the_segments_that_they_say(built, tracker, tool, frame, tracked):
    built.frame_set(frame + FRAME)
    assert getattr(bpy.ops.kfmocap, tool)() == {"FINISHED"}
    assert tracked_frames(tracker) == [tracked]
    assert generated(built) == [f for f in range(tracked[0], tracked[1] + 1) if f not in (0, 5, 11)]


def test_other_segments_stay_to_the_last_bit(built, tracker):
    bpy.ops.kfmocap.track()
    before = {k: fcurves.get_keys(c)[6:] for k, c in body_curves(built).items()}
    motion_curves.write_motion(armature_of(built), motion(4, seed=9), FRAME + 1)
    built.frame_set(FRAME + 2)
    bpy.ops.kfmocap.track_here()
    for k, c in body_curves(built).items():
        for field in ("co", "type", "interpolation"):
            assert np.array_equal(fcurves.get_keys(c)[6:][field], before[k][field])


def body_curves(built):
    bag = fcurves.find_channelbag(armature_of(built))
    return {(c.data_path, c.array_index): c for c in bag.fcurves if "kfmocap" not in c.data_path}


def test_what_is_beside_is_held_where_it_is_tracked(built, tracker):
    built.frame_set(FRAME + 3)
    bpy.ops.kfmocap.track_here()
    assert tracker.around == (None, None)
    built.frame_set(FRAME + 8)
    bpy.ops.kfmocap.track_here()
    before, after = tracker.around
    assert after is None
    assert np.abs(before[0].difference(motion(12)[[4]])).max() < 1e-5


def test_changing_a_key_pose_tracks_the_segments_beside_it_alone(built, tracker):
    bpy.ops.kfmocap.track()
    with pytest.raises(RuntimeError, match="nothing has changed"):
        bpy.ops.kfmocap.track_changes()
    shift_key_pose(built, 11)
    bpy.ops.kfmocap.track_changes()
    assert tracked_frames(tracker) == [(0, 11), (5, 11)]
    shift_key_pose(built, 3)  # one more key pose: its own segments are new
    bpy.ops.kfmocap.track_changes()
    assert tracked_frames(tracker)[2:] == [(0, 5)]
    with pytest.raises(RuntimeError, match="nothing has changed"):
        bpy.ops.kfmocap.track_changes()
    built.kfmocap.solver = "relaxation"
    bpy.ops.kfmocap.track_changes()
    assert tracked_frames(tracker)[3:] == [(0, 11)]


def test_removed_tracked_keys_are_a_change(built, tracker):
    bpy.ops.kfmocap.track()
    built.frame_set(FRAME + 2)
    bpy.ops.kfmocap.clear_between(where="HERE")
    bpy.ops.kfmocap.track_changes()
    assert tracked_frames(tracker) == [(0, 11), (0, 5)]


@pytest.mark.parametrize(
    ("where", "frame", "left"), [("HERE", 2, range(6, 11)), ("HERE", 5, []), ("EVERYWHERE", 2, [])]
)
def test_clear_between_removes_tracked_keys_alone(built, where, frame, left):
    own = keys_of(armature_of(built))
    bpy.ops.kfmocap.track()
    built.frame_set(FRAME + frame)
    assert bpy.ops.kfmocap.clear_between(where=where) == {"FINISHED"}
    assert generated(built) == list(left)
    read = key_pose_curves.read_key_poses(armature_of(built), FRAME, 12)
    assert read.frames.tolist() == [0, 5, 11] and read.fixed.all()
    if not left:
        now = keys_of(armature_of(built))
        for channel in own:
            assert now[channel] == own[channel]


def test_clear_between_leaves_an_edited_tracked_key(built):
    bpy.ops.kfmocap.track()
    built.frame_set(FRAME + 3)
    armature_of(built).pose.bones["hand.L"].rotation_quaternion = (0.6, 0.0, 0.8, 0.0)
    armature_of(built).pose.bones["hand.L"].keyframe_insert("rotation_quaternion", frame=FRAME + 3)
    bpy.ops.kfmocap.clear_between(where="EVERYWHERE")
    assert key_pose_curves.read_key_poses(armature_of(built), FRAME, 12).frames.tolist() == [0, 3, 5, 11]
    with pytest.raises(RuntimeError, match="no tracked keys"):
        bpy.ops.kfmocap.clear_between(where="EVERYWHERE")


def test_what_the_cameras_saw_of_other_segments_stays(built, tracker):
    from kfmocap.kfmocap_addon.scene_io.review import bone_visibility

    given = scene.shot_from_scene(built)
    blind = [np.ones((2, 12, PARTS))]
    blind[0][:, 2:9] = 0
    bone_visibility.write_occlusion(built, given, blind)
    bone_visibility.write_occlusion(built, given.between(5, 11), [np.ones((2, 7, PARTS))], first=5)
    bag = fcurves.find_channelbag(armature_of(built))
    curve = bag.fcurves.find('pose.bones["hand.L"]["kfmocap_views"]')
    assert [curve.evaluate(FRAME + f) for f in range(12)] == [2, 2, 0, 0, 0] + 7 * [2]


def test_tools_say_why_they_are_disabled(built):
    built.frame_set(FRAME - 1)
    for tool in ("track_here", "track_forward", "track_backward"):
        assert not getattr(bpy.ops.kfmocap, tool).poll()
    built.frame_set(FRAME)
    assert bpy.ops.kfmocap.track_forward.poll() and not bpy.ops.kfmocap.track_backward.poll()
    built.frame_set(FRAME + 11)
    assert bpy.ops.kfmocap.track_backward.poll() and not bpy.ops.kfmocap.track_forward.poll()
    armature_of(built).animation_data_clear()
    assert not bpy.ops.kfmocap.track.poll()


def test_a_scene_that_changed_meanwhile_is_left_alone(built, tracker):
    """As by another window: what was tracked is not what is there."""
    from kfmocap.kfmocap_addon.scene_io import tracked_segments

    given = scene.shot_from_scene(built)
    asked = tracked_segments.asked_tracking(built, given)
    parts = tracked_segments.excerpts(built, asked, [(0, 5)])
    from kfmocap.core.tracking.retracking import track_excerpts

    results = track_excerpts(given, parts)
    shift_key_pose(built, 5)
    before = keys_of(armature_of(built))
    with pytest.raises(ShotError, match="changed while"):
        tracked_segments.write(built, asked, parts, results)
    assert keys_of(armature_of(built)) == before


class Beside(Tracking):
    """Tracking whose work was done in another process, as in a window."""

    bl_label = "Track All"

    def __init__(self):
        self.reports = []

    def report(self, kind, text):
        self.reports.append(text)


@pytest.mark.parametrize("changed", [False, True])
def test_what_was_tracked_in_a_window_is_written_unless_the_scene_changed(built, tracker, changed):
    tool = Beside()
    tool.prepare(bpy.context)
    _, asked, parts = tool._asked
    tracked = SimpleNamespace(results=track_excerpts(asked.shot, parts), fits=None)
    if not changed:
        tool.finish(bpy.context, tracked)
        rates = [f"{name}: its footage has 25 frames per second, the shot 60" for name in ("cam01", "cam02")]
        assert tool.reports == [*rates, "Tracked 12 frames in 1.0 s"]
        return
    shift_key_pose(built, 5)
    with pytest.raises(ShotError, match="changed while"):
        tool.finish(bpy.context, tracked)


@pytest.fixture
def filmed(blender, tmp_path):
    """A small filmed shot as the open scene, with a key pose that was set in Blender. The pictures refute that pose:
    limbs would be looked for, which is not what the tests with it are about.
    """
    truth = swing(figure(), 9)
    given = shot_of(film(tmp_path, [figure()], [truth], CAMERAS), [figure()], [truth], (0, 8), NO_SEARCH)
    built = scene.build_scene(given, scene=bpy.context.scene)
    built.frame_set(FRAME + 4)
    armature_of(built).pose.bones["forearm.L"].rotation_quaternion = (0.96, 0.28, 0, 0)
    key_pose_curves.key_current_pose(armature_of(built), FRAME + 4)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    return tmp_path / "scene.blend"


def reopened(file):
    bpy.ops.wm.save_as_mainfile(filepath=str(file))
    bpy.ops.wm.open_mainfile(filepath=str(file))
    return bpy.context.scene


def test_saved_and_reopened_a_scene_is_tracked_to_the_same_last_bit(filmed):
    """All of it, and a part beside a tracked one."""
    built = bpy.context.scene
    bpy.ops.kfmocap.track()
    whole = keys_of(armature_of(built))
    built.frame_set(FRAME + 2)
    bpy.ops.kfmocap.track_here()
    part = keys_of(armature_of(built))
    assert part != whole
    built = reopened(filmed)
    assert keys_of(armature_of(built)) == part
    bpy.ops.kfmocap.track_here()
    assert keys_of(armature_of(built)) == part
    bpy.ops.kfmocap.track()
    assert keys_of(armature_of(built)) == whole
    with pytest.raises(RuntimeError, match="nothing has changed"):
        bpy.ops.kfmocap.track_changes()


def test_tracking_that_is_cancelled_at_any_moment_leaves_the_scene_as_it_was(filmed, monkeypatch, pytestconfig):
    moments = 20 if pytestconfig.getoption("nightly") else 4
    built, told, ends = bpy.context.scene, [], [10**6]

    @contextmanager
    def cancelling(_context):
        told.clear()
        yield lambda what, fraction: told.append(fraction) or len(told) <= ends[0]

    monkeypatch.setattr(job_operator, "progress_shown", cancelling)
    bpy.ops.kfmocap.track()
    armature_of(built).pose.bones["forearm.L"].rotation_quaternion = (0.8, 0.6, 0, 0)  # not keyed
    before = state()
    for ends[0] in np.random.default_rng(0).integers(0, len(told), moments).tolist():
        assert bpy.ops.kfmocap.track() == {"CANCELLED"}
        assert len(told) == ends[0] + 1
        assert not differences(state(), before)


def test_a_pose_that_is_not_keyed_outlives_a_tracking_that_fails(built, tracker):
    """Also where cameras move, for which other frames are visited."""
    built.frame_set(FRAME + 5)
    armature_of(built).pose.bones["forearm.L"].rotation_quaternion = (0.8, 0.6, 0, 0)
    before, tracker.error = state(), CancelledError()
    assert bpy.ops.kfmocap.track() == {"CANCELLED"}
    assert not differences(state(), before)


def test_what_is_tracked_beside_blender_is_what_is_tracked_in_it(tmp_path):
    views = film(tmp_path, [figure()], [swing(figure(), 6)], [look_at("front", (0.5, -2.8, 1.5))])
    given = shot_of(views, [figure()], [swing(figure(), 6)], (0, 5))
    job = Job(partial(track_excerpts, given, [Excerpt(0, 5)]))
    [here] = track_excerpts(given, [Excerpt(0, 5)])
    job._thread.join(60)
    [there] = job.result()
    assert np.array_equal(here.motions[0].rotations, there.motions[0].rotations)
    assert np.array_equal(here.motions[0].translations, there.motions[0].translations)


@pytest.fixture
def pair(blender, tmp_path, tracker):
    """A man and a woman with key poses on the same frames."""
    return scene.build_scene(shot(tmp_path, ("man", "woman")), scene=bpy.context.scene)


def test_one_performer_is_tracked_with_the_others_held_as_they_are(pair, tracker):
    man, woman = pair.kfmocap.performers
    bpy.ops.kfmocap.track()
    bpy.context.view_layer.objects.active = None
    pair.kfmocap.tracked, pair.kfmocap.performer = "CHOSEN", "woman"
    before, hers = keys_of(man.armature), motion_curves.read_motion(woman.armature, FRAME, 12)
    motion_curves.clear_motion(woman.armature, range(FRAME, FRAME + 12))
    tracker.shots.clear()
    assert bpy.ops.kfmocap.track() == {"FINISHED"}
    [given] = tracker.shots
    held = given.performers[0].key_poses
    assert held.frames.tolist() == list(range(12)) and held.full().tolist() == [0, 5, 11]
    np.testing.assert_allclose(held.poses.rotations, motion(12, 0).rotations, atol=1e-6)
    assert given.performers[1].key_poses.frames.tolist() == [0, 5, 11]
    assert keys_of(man.armature) == before
    np.testing.assert_array_equal(motion_curves.read_motion(woman.armature, FRAME, 12).rotations, hers.rotations)


def test_one_performer_is_tracked_where_another_has_no_key_pose(pair, tracker):
    man, woman = pair.kfmocap.performers
    man.armature.animation_data_clear()
    assert not bpy.ops.kfmocap.track.poll()
    bpy.ops.kfmocap.choose_performer(performer=1)
    pair.kfmocap.tracked = "CHOSEN"
    assert bpy.ops.kfmocap.track_here() == {"FINISHED"}
    assert [p.name for p in tracker.shots[0].performers] == ["woman"]
    assert fcurves.find_channelbag(man.armature) is None
    assert motion_curves.keyed_frames(woman.armature, FRAME, 6).all()


@pytest.mark.parametrize("scrubbed", [False, True])
def test_frames_fill_in_while_they_are_tracked_and_cancelling_leaves_no_trace(built, scrubbed):
    """Also not of a pose that is not keyed, nor of bones without any key."""
    bag = fcurves.find_channelbag(armature_of(built))
    for curve in [curve for curve in bag.fcurves if "hand.R" in curve.data_path]:
        bag.fcurves.remove(curve)
    built.frame_set(FRAME + 3)
    armature_of(built).pose.bones["hand.R"].rotation_quaternion = (0.8, 0.0, 0.6, 0.0)
    if not scrubbed:
        armature_of(built).pose.bones["forearm.L"].rotation_quaternion = (0.8, 0.6, 0.0, 0.0)
    before = state()
    preview = TrackingPreview(built, {0: built.kfmocap.performers[0]})
    truth = motion(12)
    preview.show({(0, 5): (truth[:6],)})
    preview.show({(5, 11): (motion(12, 1)[5:],)})
    assert motion_curves.keyed_frames(armature_of(built), FRAME, 12).all()
    preview.show({(5, 11): (truth[5:],)})
    coming = motion_curves.read_motion(armature_of(built), FRAME, 12)
    np.testing.assert_allclose(coming.rotations[7], truth.rotations[7], atol=1e-5)
    if scrubbed:
        built.frame_set(FRAME + 8)
    preview.end()
    built.frame_set(FRAME + 3) if scrubbed else bpy.context.view_layer.update()
    assert not differences(state(), before)


def test_a_file_that_is_saved_while_it_is_tracked_holds_the_scene_as_it_was(built, tmp_path):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "before.blend"))
    preview = TrackingPreview(built, {0: built.kfmocap.performers[0]})
    preview.show({(0, 5): (motion(12)[:6],)})
    preview.show({(5, 11): (motion(12)[5:],)})
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "meanwhile.blend"))
    assert motion_curves.keyed_frames(armature_of(built), FRAME, 12).all()  # it goes on showing
    preview.end()
    found = []
    for name in ("before", "meanwhile"):
        bpy.ops.wm.open_mainfile(filepath=str(tmp_path / f"{name}.blend"))
        found.append(state())
    assert not differences(*found)


@pytest.mark.skipif(not hasattr(bpy.app.handlers, "exit_pre"), reason="this Blender says nothing before it ends")
def test_what_blender_saves_at_its_end_while_it_tracks_is_the_scene_as_it_was(built):
    before = state()
    preview = TrackingPreview(built, {0: built.kfmocap.performers[0]})
    preview.show({(0, 5): (motion(12)[:6],)})
    for handler in list(bpy.app.handlers.exit_pre):
        handler()
    assert not differences(state(), before)
    preview.end()  # as its tool does then
    assert not differences(state(), before) and not bpy.app.handlers.exit_pre


def test_parts_are_tracked_again_with_the_offset_found_on_the_whole_shot(built, tracker):
    tracker.footage_offset = 0.387
    bpy.ops.kfmocap.track()
    assert tracker.shots[-1].settings.footage_offset is None
    built.frame_set(3 + FRAME)
    tracker.footage_offset = 0.1
    bpy.ops.kfmocap.track_here()
    assert tracker.shots[-1].settings.footage_offset == 0.387
    assert tracked_segments.with_footage_offset(built, scene.shot_from_scene(built)).settings.footage_offset == 0.387
    shift_key_pose(built, 0)
    bpy.ops.kfmocap.track_changes()
    assert tracker.shots[-1].frames == (5, 10)  # the offset that was found is no change


def test_without_a_track_of_the_whole_shot_a_part_finds_its_own_offset(built, tracker):
    tracker.footage_offset = -0.25
    built.frame_set(3 + FRAME)
    bpy.ops.kfmocap.track_here()
    assert tracker.shots[-1].settings.footage_offset is None
    assert built.kfmocap.footage_offset == -0.25


def test_what_is_wrong_with_footage_is_shown_until_a_whole_track_finds_nothing(
    built,
    tracker,
    monkeypatch,
):
    monkeypatch.setattr(faulty_footage, "container_rate", lambda view: 0.0)
    views = built.kfmocap.views
    nothing = [() for _ in views]
    tracker.torn, tracker.late = [(3, 4), *nothing[1:]], [LateView(2, 0.6, 12.0), *(None for _ in views[1:])]
    bpy.ops.kfmocap.track()
    assert f"{FRAME + 3}, {FRAME + 4}" in views[0].faults
    assert f"early from about frame {FRAME + 2} on" in views[0].faults
    assert not any(view.faults for view in views[1:])
    tracker.torn, tracker.late = nothing, [None for _ in views]
    built.frame_set(3 + FRAME)
    bpy.ops.kfmocap.track_here()
    assert views[0].faults
    tracker.torn = [(1,), *nothing[1:]]
    built.frame_set(7 + FRAME)
    bpy.ops.kfmocap.track_here()
    assert f"{FRAME + 5 + 1} " in views[0].faults
    tracker.torn = nothing
    bpy.ops.kfmocap.track()
    assert not any(view.faults for view in views)


def test_a_gap_that_tracking_finds_stays_with_the_view(built, tracker, monkeypatch):
    monkeypatch.setattr(faulty_footage, "container_rate", lambda view: 0.0)
    view, zero = built.kfmocap.views[1], scene.shot_from_scene(built).frames[0]
    tracker.gaps = [(), (Gap(zero + 7, 1),)]
    bpy.ops.kfmocap.track()
    assert f"frame {FRAME + 7} is missing (corrected)" in view.faults
    now = scene.shot_from_scene(built)
    assert now.views[1].gaps == tracker.gaps[1]
    assert not tracked_segments.out_of_date(built, now)
    built.frame_set(7 + FRAME)
    bpy.ops.kfmocap.track_here()
    assert tracker.shots[-1].views[1].gaps == tracker.gaps[1]
    view.found_gaps = ""
    assert tracked_segments.out_of_date(built, scene.shot_from_scene(built)) == [(5, 11)]


def test_a_camera_that_tracking_finds_to_turn_gets_keys_and_nothing_is_out_of_date(built, tracker):
    before = scene.shot_from_scene(built).views[0].camera
    turns = rotations.exp(np.linspace(0, 0.02, 12)[:, None] * [1.0, -2.0, 0.5])
    tracker.turns = (turns, None)
    bpy.ops.kfmocap.track()
    now = scene.shot_from_scene(built)
    assert now.views[0].camera.moving and not now.views[0].camera.stands_still
    assert before.displacements(now.views[0].camera.turns_to(before.turned(turns[:1])) @ turns).max() < 0.01
    assert not tracked_segments.out_of_date(built, now)


def test_a_camera_whose_lens_tracking_finds_to_zoom_gets_keys_of_its_focal_length(built, tracker):
    before = scene.shot_from_scene(built).views[0].camera
    axes = rotations.exp(np.linspace(0, 0.02, 12)[:, None] * [1.0, -2.0, 0.5])
    turns = lens_turns.zooming(zooms := np.linspace(0.9, 1.2, 12)) @ axes
    tracker.turns = (turns, None)
    bpy.ops.kfmocap.track()
    for frame in (FRAME, FRAME + 7):
        built.frame_set(frame)
        now = scene.shot_from_scene(built)
        assert np.abs(now.views[0].camera.turns_since(before) - turns).max() < 1e-5
        assert np.array_equal(now.views[0].camera.matrix, before.matrix) and now.views[1].camera.zooms is None
        assert not tracked_segments.out_of_date(built, now)
    lens = before.matrix[0, 0] * built.kfmocap.views[0].camera.data.sensor_width / before.size[0]
    assert built.kfmocap.views[0].camera.data.lens == pytest.approx(lens * zooms[7], rel=1e-5)


def test_a_lens_with_keys_of_the_user_is_the_same_on_whichever_frame_the_scene_is(built, tracker):
    owner = built.kfmocap.views[0].camera
    del owner["kfmocap_matrix"]  # as of a camera that was not built here
    for frame, length in ((FRAME, 30.0), (FRAME + 11, 41.0)):
        owner.data.lens = length
        owner.data.keyframe_insert("lens", frame=frame)
    built.frame_set(FRAME)
    bpy.ops.kfmocap.track()
    built.frame_set(FRAME + 7)
    now = scene.shot_from_scene(built)
    assert now.views[0].camera.zooms[[0, 11]] == pytest.approx([1, 41 / 30])
    assert not tracked_segments.out_of_date(built, now)


def test_a_lens_that_zooms_after_the_shot_is_that_of_the_shot(built):
    owner = built.kfmocap.views[0].camera
    before = scene.shot_from_scene(built).views[0].camera
    for frame, zoom in ((FRAME + 11, 1.0), (FRAME + 30, 1.5)):
        owner.data.lens *= zoom
        owner.data.keyframe_insert("lens", frame=frame)
    built.frame_set(FRAME + 30)
    now = scene.shot_from_scene(built).views[0].camera
    assert now.zooms is None and np.array_equal(now.matrix, before.matrix)


def test_segments_behind_a_gap_that_were_not_tracked_with_it_are_out_of_date(built, tracker):
    bpy.ops.kfmocap.track()
    zero = scene.shot_from_scene(built).frames[0]
    tracker.gaps = [(), (Gap(zero + 3, 1),)]
    built.frame_set(3 + FRAME)
    bpy.ops.kfmocap.track_here()
    assert tracked_segments.out_of_date(built, scene.shot_from_scene(built)) == [(5, 11)]


def test_footage_of_another_frame_rate_is_said(built, tracker, monkeypatch):
    rate = scene.shot_from_scene(built).fps
    for given, said in ((0.0, ""), (rate, ""), (50.0, f"its footage has 50 frames per second, the shot {rate:g}")):
        monkeypatch.setattr(faulty_footage, "container_rate", lambda view, given=given: given)
        bpy.ops.kfmocap.track()
        assert [view.faults for view in built.kfmocap.views] == [said] * len(built.kfmocap.views)


def test_footage_that_does_not_match_is_shown_while_it_is_tracked(built):
    tracking = SimpleNamespace(_asked=(built.name, None, ()), _preview=None)
    Tracking.show(tracking, bpy.context, {EARLY_MISFITS: [FootageMatch("cam02", 0.5)]})
    assert [view.misfit for view in built.kfmocap.views[:2]] == ["", "footage and key poses do not belong together"]
    assert tracking._preview is None


def test_keypoints_that_contradict_the_others_are_said_beside_their_view(built, tracker, monkeypatch):
    monkeypatch.setattr(faulty_footage, "container_rate", lambda view: 0.0)
    others = [None] * (len(built.kfmocap.views) - 2)
    performer = SimpleNamespace(agreements=lambda: [0.21, 0.65, *others])
    observed = SimpleNamespace(performers=(performer,), frames_off=(None, -1.1, *others))
    tracked = scene.shot_from_scene(built)
    part = Excerpt(0, tracked.length - 1)
    result = track_result(tracked, [motion(tracked.length)])
    result.observed = observed
    said, late = faulty_footage.show_faults(built, tracked, [part], [result])
    assert said.startswith("cam01: of its keypoints, 79% contradict the other views")
    assert late.startswith("cam02: its keypoints") and "1.1 frames before" in late
    assert built.kfmocap.views[0].faults == "most of its keypoints contradict the others"


def test_files_whose_rate_tracking_has_measured_are_not_opened_again(built, tracker, monkeypatch):
    opened = []
    monkeypatch.setattr(faulty_footage, "container_rate", lambda view: opened.append(view.camera.name) or 0.0)
    even, uneven = FootageRate(49.99996, 0.1, 0), FootageRate(31.4, 2.0, 7)
    first, second, *others = built.kfmocap.views
    tracker.rates = (even, uneven, *(None for _ in others))
    bpy.ops.kfmocap.track()
    rate = scene.shot_from_scene(built).fps
    assert first.faults == f"its footage has 50 frames per second, the shot {rate:g}"
    assert second.faults == "its frame rate varies"
    assert opened == [second.name, *(view.name for view in others)]
