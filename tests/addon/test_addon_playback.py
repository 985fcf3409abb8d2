"""Animation that shows a body otherwise than its keys say: refused where tracking would be wrong, else said."""

from __future__ import annotations

import pytest

bpy = pytest.importorskip("bpy")

from addon_shots import keys_of, shot  # noqa: E402
from kfmocap.core.errors import BodyError, ShotError  # noqa: E402
from kfmocap.kfmocap_addon.scene_io import fcurves, scene  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.body import performer_size  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.body.disturbances import disturbances  # noqa: E402

pytest_plugins = ("addon_fixtures",)

pytestmark = pytest.mark.blender


@pytest.fixture
def built(blender, tmp_path, tracker):
    return scene.build_scene(shot(tmp_path), scene=bpy.context.scene)


def armature_of(built, number=0):
    return built.kfmocap.performers[number].armature


def why_disabled(tool):
    with pytest.raises(RuntimeError) as refused:
        getattr(bpy.ops.kfmocap, tool)()
    return str(refused.value)


def pushed_down(armature):
    """Make the armature's action a strip of the NLA, as Push Down does; the strip."""
    data = armature.animation_data
    action = data.action
    strip = data.nla_tracks.new().strips.new("keys", 1, action)
    data.action = None
    return strip


def stretch(built):
    built.render.frame_map_new = 200
    return "time is stretched from 100 to 200"


def edit_a_strip(built):
    pushed_down(armature_of(built)).select = True
    data = armature_of(built).animation_data
    data.nla_tracks.active = data.nla_tracks[0]
    data.use_tweak_mode = True
    assert data.use_tweak_mode
    return "a strip of its NLA is being edited"


@pytest.mark.parametrize("change", [stretch, edit_a_strip])
def test_keys_that_are_played_on_other_frames_are_refused_with_the_reason(built, change):
    why = change(built)
    for tool in ("track", "set_key_pose"):
        assert why in why_disabled(tool)
    with pytest.raises(ShotError, match=why):
        scene.shot_from_scene(built)


def test_performers_with_one_action_are_refused(blender, tmp_path, tracker):
    built = scene.build_scene(shot(tmp_path, ("man", "woman")), scene=bpy.context.scene)
    man, woman = (armature_of(built, number).animation_data for number in range(2))
    woman.action = man.action
    woman.action_slot = woman.action.slots.new("OBJECT", "woman")
    scene.shot_from_scene(built)  # slots of their own are fine
    woman.action_slot = man.action_slot
    assert "woman: it has the same action as man" in why_disabled("track")


def saved_with_its_action(built, folder):
    """A file with the scene, as a library."""
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "library.blend"))
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    return str(folder / "library.blend")


def test_a_linked_action_is_refused_as_no_key_of_it_would_be_saved(built, tmp_path):
    library = saved_with_its_action(built, tmp_path)
    with bpy.data.libraries.load(library, link=True) as (_, here):
        here.actions = ["man"]
    again = scene.build_scene(shot(tmp_path), scene=bpy.context.scene)
    data = armature_of(again).animation_data
    data.action = next(action for action in bpy.data.actions if action.library)
    data.action_slot = data.action.slots[0]
    for tool in ("track", "set_key_pose"):
        assert "its action is linked from library.blend" in why_disabled(tool)


def overridden(built, tmp_path):
    """A scene whose performer is the override of one that is linked from library.blend."""
    library = saved_with_its_action(built, tmp_path)
    with bpy.data.libraries.load(library, link=True) as (_, here):
        here.collections = ["Performers"]
    current, linked = bpy.context.scene, bpy.data.collections["Performers"]
    current.collection.children.link(linked)
    made = linked.override_hierarchy_create(current, bpy.context.view_layer, do_fully_editable=True)
    bpy.context.view_layer.objects.active = next(o for o in made.all_objects if o.type == "ARMATURE")
    bpy.ops.kfmocap.add_footage(directory=f"{tmp_path}/", files=[{"name": "cam01.mp4"}, {"name": "cam02.mp4"}])
    for view in current.kfmocap.views:
        view.calibrated = True
    current.kfmocap.last = 11
    assert bpy.ops.kfmocap.use_armature() == {"FINISHED"}
    return current


def test_the_bones_of_a_performer_that_is_overridden_keep_their_lengths(built, tmp_path):
    """Blender cannot change them here. It is said before the body is fitted for minutes."""
    current = overridden(built, tmp_path)
    bpy.ops.kfmocap.set_key_pose()
    assert "are linked from library.blend" in why_disabled("fit_body")
    with pytest.raises(BodyError, match=r"linked from library\.blend, and cannot be changed in this file"):
        performer_size.set_height(armature_of(current), 1.5)


def test_a_performer_that_is_overridden_gets_an_action_of_its_own(built, tmp_path):
    """With the keys of the linked one, and the tracked ones are saved."""
    current = overridden(built, tmp_path)
    assert armature_of(current).override_library and armature_of(current).animation_data.action.library is None
    assert bpy.ops.kfmocap.track() == {"FINISHED"}
    tracked = keys_of(armature_of(current))
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "shot.blend"))
    assert keys_of(armature_of(bpy.context.scene)) == tracked


def test_an_action_that_was_pushed_down_is_said_to_be_there(built):
    pushed_down(armature_of(built))
    assert "The action of man was pushed down into the NLA" in why_disabled("track")
    assert "The action of man was pushed down into the NLA" in why_disabled("set_key_pose")
    armature_of(built).animation_data.action = bpy.data.actions.new("another")
    assert bpy.ops.kfmocap.set_key_pose() == {"FINISHED"}


def test_a_pose_between_two_pictures_is_not_keyed(built):
    built.frame_set(3, subframe=0.4)
    for tool in (
        "set_key_pose",
        "paste_pose",
        "mirror_pose",
        "breakdown_pose",
        "nudge_pose",
        "nudge_depth",
        "place_joints",
    ):
        assert "Go to a whole frame first" in why_disabled(tool)
    built.frame_set(3)
    assert bpy.ops.kfmocap.set_key_pose() == {"FINISHED"}


def test_a_view_whose_camera_is_none_is_named(built):
    built.kfmocap.views[0].camera = armature_of(built)
    assert "is gone from the scene: remove the view" in why_disabled("track")


@pytest.mark.parametrize("by", ["keys", "parent"])
def test_an_armature_that_is_moved_as_a_whole_is_refused(built, by):
    armature = armature_of(built)
    moving = armature
    if by == "parent":
        moving = armature.parent = bpy.data.objects.new("cart", None)
        built.collection.objects.link(moving)
    bpy.ops.kfmocap.track()
    for frame, x in ((1, 0.0), (8, 1.0)):
        moving.location.x = x
        moving.keyframe_insert("location", frame=frame)
    with pytest.raises(RuntimeError, match="the armature object itself, and only bones are tracked"):
        bpy.ops.kfmocap.track()


def test_a_scene_that_is_linked_cannot_be_worked_on(built, tmp_path):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    with bpy.data.libraries.load(str(tmp_path / "shot.blend"), link=True) as (there, here):
        here.scenes = there.scenes
    bpy.context.window.scene = next(s for s in bpy.data.scenes if s.library)
    assert "This scene is linked from shot.blend" in why_disabled("track")


def constrain(armature):
    held = armature.pose.bones["hand.L"].constraints.new("COPY_LOCATION")
    held.target, held.subtarget = armature, "hand.R"
    return "the constraint 'Copy Location' of hand.L"


def shift(armature):
    armature.pose.bones["upper_arm.L"].location = (0.1, 0.0, 0.0)
    return "100 mm from where its keys put it, by the location of upper_arm.L"


def scale(armature):
    armature.pose.bones["upper_arm.L"].scale = (2.0, 2.0, 2.0)
    return "the scale of upper_arm.L"


def part_from_the_bone_above(armature):
    armature.data.bones["forearm.L"].use_inherit_rotation = False
    return "by Inherit Rotation of forearm.L, which is off: the tracker does not know of it"


def rest(armature):
    armature.data.pose_position = "REST"
    return "it is shown in its rest position"


def mute(armature):
    for curve in arm_curves(armature):
        curve.mute = True
    return "channels are muted, and what was tracked of them is not shown: upper_arm.L"


def shake(armature):
    for curve in arm_curves(armature):
        curve.modifiers.new("NOISE")
    return "modifiers of curves change what was tracked: upper_arm.L"


def drive(armature):
    armature.driver_add('pose.bones["upper_arm.L"].rotation_quaternion', 1).driver.expression = "0.5"
    return "drivers stand in the place of keys, and what was tracked there is not shown: upper_arm.L"


def blend(armature):
    other = bpy.data.actions.new("other")
    armature.animation_data.nla_tracks.new().strips.new("other", 1, other)
    armature.animation_data.action_blend_type = "COMBINE"
    return "its action is blended with strips of the NLA"


def arm_curves(armature):
    return [c for c in fcurves.find_channelbag(armature).fcurves if "upper_arm.L" in c.data_path]


@pytest.mark.parametrize("change", [constrain, shift, scale, part_from_the_bone_above, rest, mute, shake, drive, blend])
def test_what_keeps_a_tracked_pose_from_being_shown_is_named(built, change):
    armature = armature_of(built)
    read = scene.shot_from_scene(built).performers[0].body
    assert disturbances(armature, read) == []
    expected = change(armature)
    bpy.context.view_layer.update()
    [said] = disturbances(armature, read)
    assert expected in said


def test_tracking_says_it_until_it_is_gone(built, capfd):
    expected = shift(armature_of(built))
    bpy.ops.kfmocap.track()
    [slot] = built.kfmocap.performers
    assert f"Warning: man: upper_arm.L is shown {expected}" in capfd.readouterr().out
    assert slot.disturbances.startswith(f"upper_arm.L is shown {expected}")
    armature_of(built).pose.bones["upper_arm.L"].location = (0.0, 0.0, 0.0)
    bpy.context.view_layer.update()
    bpy.ops.kfmocap.track()
    assert slot.disturbances == ""


def test_a_key_pose_outside_the_shot_is_said_to_count_for_nothing(built, capfd):
    """As where the timeline was moved after the footage was added."""
    built.frame_set(101)
    assert bpy.ops.kfmocap.set_key_pose() == {"FINISHED"}
    told = capfd.readouterr().out
    assert "Frame 101 is not one of the shot's, which are 1 to 12: the key pose counts for nothing in tracking" in told
    assert "Frame 101 is not one of the shot's, which are 1 to 12" in why_disabled("track_here")
    built.frame_set(12)
    assert bpy.ops.kfmocap.set_key_pose() == {"FINISHED"}
    assert "not one of the shot's" not in capfd.readouterr().out
    assert "The shot has no frame after this one" in why_disabled("track_forward")
