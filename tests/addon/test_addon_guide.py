"""The sections of the sidebar follow the work: what is done folds, what is next opens, and long texts are not cut."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest

bpy = pytest.importorskip("bpy")

from addon_shots import shot  # noqa: E402
from kfmocap.core.shot.shot import KeyPoses  # noqa: E402
from kfmocap.kfmocap_addon import panels  # noqa: E402
from kfmocap.kfmocap_addon.operators.tracking.track_motion import TrackAll  # noqa: E402
from kfmocap.kfmocap_addon.panels import guide, key_poses_panel, texts  # noqa: E402
from kfmocap.kfmocap_addon.panels.section import Section  # noqa: E402
from kfmocap.kfmocap_addon.properties.section_properties import SECTIONS, sections_of  # noqa: E402
from kfmocap.kfmocap_addon.scene_io import scene as scenes  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.keys import motion_curves  # noqa: E402
from kfmocap.kfmocap_addon.viewports import changed_segments, key_list  # noqa: E402

pytest_plugins = ("addon_fixtures",)

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("blender")]


def step():
    """The step that the guide is at, once keys are looked up."""
    key_list.known_keys().outdate()
    key_list.known_keys().look_up()
    found = guide.current_step(bpy.context)
    guide.take_step(bpy.context, found)
    return found


def shown():
    return set(sections_of(bpy.context).shown)


def test_every_section_has_a_panel_with_its_title():
    classes = [cls for module in panels.PANEL_MODULES for cls in module.CLASSES if issubclass(cls, Section)]
    assert sorted((cls.section_name(), cls.bl_label) for cls in classes) == sorted(
        (name, title) for name, title, _ in SECTIONS
    )


def test_what_is_done_folds_and_the_next_step_opens(tmp_path, tracker):
    assert step() == "footage" and shown() == {"footage"}
    built = scenes.build_scene(shot(tmp_path), scene=bpy.context.scene)
    slot, armature = built.kfmocap.performers[0], built.kfmocap.performers[0].armature
    slot.armature = None
    assert step() == "body" and shown() == {"body", "look"}
    slot.armature = armature
    motion_curves.clear_motion(armature, range(100))
    action = armature.animation_data.action
    armature.animation_data.action = None
    assert step() == "key_poses" and shown() == {"key_poses", "look"}
    armature.animation_data.action = action
    assert step() == "track" and shown() == {"track", "look"}
    bpy.ops.kfmocap.track()
    assert step() == "review" and shown() == {"review", "look"}
    assert [name for name, _, _ in SECTIONS if guide.is_done(bpy.context, name)] == [
        "footage",
        "body",
        "key_poses",
        "track",
    ]


def test_a_second_window_with_another_scene_does_not_move_the_sections_for_ever(monkeypatch):
    scheduled = []
    timers = SimpleNamespace(
        is_registered=lambda _: False, register=lambda step, first_interval: scheduled.append(step)
    )
    monkeypatch.setattr("kfmocap.kfmocap_addon.panels.guide.bpy.app", SimpleNamespace(background=False, timers=timers))
    sections_of(bpy.context).step = "review"
    manager = bpy.context.window_manager
    guide.follow(SimpleNamespace(scene=bpy.data.scenes.new("another"), window_manager=manager))
    assert not scheduled
    guide.follow(SimpleNamespace(scene=bpy.context.scene, window_manager=manager))
    assert scheduled


@pytest.mark.parametrize("tracked", [False, True])
def test_proposals_wait_to_be_accepted_or_refused_until_the_shot_is_tracked(tmp_path, tracker, tracked):
    original = shot(tmp_path)
    [man] = original.performers
    keys = KeyPoses.proposed(man.key_poses.frames, man.key_poses.poses)
    built = scenes.build_scene(replace(original, performers=(replace(man, key_poses=keys),)), scene=bpy.context.scene)
    first, second, last = (built.kfmocap.frame_start + int(frame) for frame in keys.frames)
    assert step() == "key_poses"
    bpy.ops.kfmocap.accept_proposals(frame=first)
    bpy.ops.kfmocap.accept_proposals(frame=last)
    assert step() == "key_poses"
    if tracked:
        bpy.ops.kfmocap.track()
        assert step() == "review"
    else:
        bpy.ops.kfmocap.refuse_proposal(frame=second)
        assert step() == "track"


def advice_on(slot, monkeypatch):
    """A function that returns the hint above a performer's key poses."""
    said = []
    monkeypatch.setattr(key_poses_panel, "draw_text", lambda _layout, _context, text, _icon: said.append(text))
    button = SimpleNamespace(operator=lambda *_, **__: SimpleNamespace(), prop=lambda *_: None)
    layout = SimpleNamespace(column=lambda align: button)

    def advised():
        step()
        key_poses_panel._draw_advice(layout, bpy.context, slot, key_list.known_keys().entries(slot.armature))
        return said.pop()

    return advised


def test_key_poses_that_lie_outside_the_shot_do_not_complete_the_step(tmp_path, monkeypatch):
    built = scenes.build_scene(shot(tmp_path), scene=bpy.context.scene)
    advised = advice_on(built.kfmocap.performers[0], monkeypatch)
    assert step() == "track"
    built.kfmocap.zero += 1000
    assert step() == "key_poses"
    first, last = built.kfmocap.scene_first, built.kfmocap.scene_last
    assert first > 1000 and advised().startswith(f"No key pose in the shot yet, {first} to {last}:")
    with pytest.raises(RuntimeError, match="performer man: there is no key pose on the shot's frames"):
        bpy.ops.kfmocap.track()


def test_while_proposals_are_left_nobody_is_sent_to_the_other_end(tmp_path, monkeypatch):
    original = shot(tmp_path)
    [man] = original.performers
    keys = KeyPoses.proposed(man.key_poses.frames, man.key_poses.poses)
    built = scenes.build_scene(replace(original, performers=(replace(man, key_poses=keys),)), scene=bpy.context.scene)
    advised = advice_on(built.kfmocap.performers[0], monkeypatch)
    first, second, last = (built.kfmocap.frame_start + int(frame) for frame in keys.frames)
    assert advised().startswith("Proposals only")
    bpy.ops.kfmocap.accept_proposals(frame=first)
    assert advised().startswith("Proposals are left")
    for frame in (second, last):
        bpy.ops.kfmocap.refuse_proposal(frame=frame)
    assert advised().startswith("A second key pose")


def test_a_second_performer_folds_everything_but_its_key_poses(tmp_path, tracker):
    scenes.build_scene(shot(tmp_path), scene=bpy.context.scene)
    bpy.ops.kfmocap.track()
    assert step() == "review"
    bpy.ops.kfmocap.open_section(section="body")
    bpy.ops.kfmocap.add_body()
    assert step() == "key_poses" and shown() == {"key_poses", "look"}


def test_the_track_section_says_who_has_no_key_pose(tmp_path):
    built = scenes.build_scene(shot(tmp_path), scene=bpy.context.scene)
    assert TrackAll.missing(bpy.context) == ""
    bpy.ops.kfmocap.add_body()
    second = built.kfmocap.performers[1].name
    assert TrackAll.missing(bpy.context).startswith(f"{second} has no key pose yet")
    built.kfmocap.tracked = "CHOSEN"
    assert TrackAll.missing(bpy.context).startswith(f"{second} has no key pose yet")
    bpy.context.view_layer.objects.active = built.kfmocap.performers[0].armature
    assert TrackAll.missing(bpy.context) == ""


def test_what_the_user_opens_stays_until_the_next_step(tmp_path):
    scenes.build_scene(shot(tmp_path), scene=bpy.context.scene)
    assert step() == "track"
    bpy.ops.kfmocap.open_section(section="footage")
    bpy.ops.kfmocap.open_section(section="track")
    assert step() == "track" and shown() == {"footage", "look"}
    bpy.context.scene.kfmocap.views[0].missing = True
    assert step() == "footage" and shown() == {"footage", "look"}
    bpy.context.scene.kfmocap.views[0].missing = False
    assert step() == "track" and shown() == {"track", "look"}


def test_a_title_clicked_with_ctrl_opens_its_section_and_folds_all_others():
    bpy.ops.kfmocap.open_section(section="body")
    assert shown() == {"footage", "body"}
    bpy.ops.kfmocap.open_section(section="export", alone=True)
    assert shown() == {"export"}
    bpy.ops.kfmocap.open_section(section="export")
    assert shown() == set()


class Layout(SimpleNamespace):
    """Notes the tools that have a button, in whatever row."""

    def __getattr__(self, name: str):
        if name.startswith("__"):
            raise AttributeError(name)
        return lambda *_args, **_more: self if name in ("row", "column", "box", "split", "grid_flow") else None

    def operator(self, name: str, **_more: object) -> SimpleNamespace:
        self.tools.append(name)
        return SimpleNamespace()


@pytest.mark.parametrize("misfit", ["", "12 px off the key poses"])
def test_no_tool_has_two_buttons_of_the_same_meaning(tmp_path, tracker, misfit):
    built = scenes.build_scene(shot(tmp_path, ("man", "woman")), scene=bpy.context.scene)
    bpy.ops.kfmocap.track()
    built.kfmocap.views[0].misfit = misfit
    key_list.known_keys().look_up()
    sections_of(bpy.context).shown = {name for name, *_ in SECTIONS}
    layout = Layout(tools=[])
    for module in panels.PANEL_MODULES:
        for cls in module.CLASSES:
            if issubclass(cls, bpy.types.Panel):
                drawn = cls.draw_content if issubclass(cls, Section) else cls.draw
                drawn(SimpleNamespace(layout=layout), bpy.context)
    several = {
        "go_to_frame",
        "choose_performer",
        "look_through",
        "step_view",
        "fit_body",
        "clear_between",
        "pick_colour",
    }
    several |= {"remove_performer", "paste_pose", "nudge_pose", "nudge_depth", "add_videos", "set_plant"}
    names = [name.removeprefix("kfmocap.") for name in layout.tools]
    assert len(names) > 40
    assert {name for name in names if names.count(name) > 1} - several == set()


def test_tools_that_could_do_nothing_are_disabled(blender, tmp_path, tracker):
    """Of one camera there is no next view, and before tracking there is nothing to clear."""
    scenes.build_scene(shot(tmp_path), scene=bpy.context.scene)
    bpy.ops.kfmocap.look_through(view=0)
    assert bpy.ops.kfmocap.step_view.poll() and not bpy.ops.kfmocap.clear_between.poll()
    bpy.ops.kfmocap.track()
    assert bpy.ops.kfmocap.clear_between.poll()
    bpy.ops.kfmocap.remove_view(view=1)
    assert not bpy.ops.kfmocap.step_view.poll()


def test_a_disabled_place_joints_is_explained_and_one_camera_has_its_own_hint(tmp_path, monkeypatch):
    built = scenes.build_scene(shot(tmp_path), scene=bpy.context.scene)
    said = []
    monkeypatch.setattr(key_poses_panel, "draw_text", lambda _layout, _context, text, _icon: said.append(text))
    layout = SimpleNamespace(column=lambda align: None)
    rows = tuple(key_list.KeyPoseEntry(frame) for frame in (built.frame_start, built.frame_end))

    def advised():
        said.clear()
        key_poses_panel._draw_advice(layout, bpy.context, built.kfmocap.performers[0], rows)
        return " ".join(said)

    views = built.kfmocap.views
    assert not advised()
    for view in views:
        view.camera.animation_data_clear()  # a camera that is moved is known
        view.calibrated = False
    assert advised().startswith("No view has a calibrated camera yet") and "Import Calibration" in advised()
    monkeypatch.setattr(key_poses_panel, "is_placing", lambda _context: True)
    views[0].calibrated = True
    assert "One camera does not show depth" in advised()
    views[1].calibrated = True
    assert "in two views or more" in advised()


def test_poses_between_and_towards_key_poses_need_these(blender, tmp_path):
    """Proposals are none, and before key poses are looked up nothing is disabled."""
    rows = [key_list.KeyPoseEntry(4), key_list.KeyPoseEntry(9, ("hand.L",)), key_list.KeyPoseEntry(20, proposed=True)]
    sides = [key_poses_panel._sides_with_key_poses(tuple(rows), frame) for frame in (3, 4, 6, 9, 12)]
    assert sides == [(False, True), (False, True), (True, True), (True, False), (True, False)]
    assert key_poses_panel._sides_with_key_poses(None, 6) == (True, True)


def test_the_end_that_is_farther_from_all_key_poses_is_offered(blender, tmp_path):
    """As long as it has none; where keypoints show the performer, only for the second key pose."""
    scenes.build_scene(shot(tmp_path), scene=bpy.context.scene)
    built = bpy.context.scene
    built.frame_start, built.frame_end = 1, 55
    for view in built.kfmocap.views:
        view.keypoints = ""
    ends = [key_poses_panel._open_end(built, keyed) for keyed in ([1], [55], [20], [1, 25], [30, 50], [1, 25, 55])]
    assert ends == [55, 1, 55, 55, 1, None]
    built.kfmocap.views[0].keypoints = "keypoints.json"
    assert [key_poses_panel._open_end(built, keyed) for keyed in ([1], [1, 25])] == [55, None]


def test_lines_beside_an_icon_have_less_room(monkeypatch):
    monkeypatch.setattr(texts, "_drawn_width", lambda text: 8.0 * len(text))
    drawn = {"NONE": [], "INFO": []}
    for icon, found in drawn.items():
        layout = SimpleNamespace(
            column=lambda align, found=found: SimpleNamespace(label=lambda text, icon: found.append(text))
        )
        texts.draw_text(layout, bpy.context, "x " * 60, icon)
    longest = {icon: max(map(len, found)) for icon, found in drawn.items()}
    assert longest["INFO"] < longest["NONE"]


def test_long_texts_are_broken_between_words(monkeypatch):
    monkeypatch.setattr(texts, "_drawn_width", lambda text: 8.0 * len(text))
    text = "One key pose: a second at the other end helps the tracker most"
    broken = texts.lines(text, 200)
    assert " ".join(broken) == text and len(broken) == 3
    assert all(8 * len(line) <= 200 for line in broken)
    assert texts.lines("unbreakable", 10) == ["unbreakable"]


@pytest.fixture
def looked_up(blender):
    """See which of some tools are enabled, once keys and changes have been looked up."""

    def enabled(*names: str) -> set[str]:
        key_list.known_keys().outdate()
        changed_segments.known_changes().outdate()
        found = {name for name in names if getattr(bpy.ops.kfmocap, name).poll()}  # they ask for what they need
        assert found == set(names), "nothing is refused before it has been looked up"
        key_list.known_keys().look_up()
        changed_segments.known_changes().look_up()
        return {name for name in names if getattr(bpy.ops.kfmocap, name).poll()}

    return enabled


def test_track_changes_is_enabled_where_something_has_changed(looked_up, tmp_path, tracker):
    scenes.build_scene(shot(tmp_path), scene=bpy.context.scene)
    assert looked_up("track_changes"), "nothing is tracked yet"
    bpy.ops.kfmocap.track()
    assert not looked_up("track_changes")
    with pytest.raises(RuntimeError, match="Nothing has changed"):
        bpy.ops.kfmocap.track_changes()
    bpy.context.scene.frame_set(3)
    bpy.ops.kfmocap.set_key_pose()
    assert bpy.ops.kfmocap.track_changes.poll(), "a change that has not been looked up yet"
    assert looked_up("track_changes")
    bpy.ops.kfmocap.track_changes()
    assert not looked_up("track_changes")
    bpy.context.scene.kfmocap.views[0].camera.data.lens += 1.0
    assert looked_up("track_changes"), "a camera has changed"


def test_tools_for_keys_are_enabled_where_there_are_such(looked_up, tmp_path, tracker):
    tracked = ("bake", "simplify", "clear_between")
    neighbours = ("breakdown_pose", "nudge_pose", "step_key_pose")
    scenes.build_scene(shot(tmp_path), scene=bpy.context.scene)
    bpy.ops.kfmocap.track()
    start = bpy.context.scene.kfmocap.frame_start
    assert looked_up("remove_key_pose", *tracked, *neighbours) == {
        *("remove_key_pose", "nudge_pose", "step_key_pose"),
        *tracked,
    }, "no key pose is before the first"
    bpy.context.scene.frame_set(start + 2)
    assert looked_up("remove_key_pose", *neighbours) == set(neighbours), "a tracked frame is no key pose"
    bpy.ops.kfmocap.clear_between(where="EVERYWHERE")
    assert not looked_up("simplify", "bake"), "they need tracked keys"


def test_changes_are_looked_up_once_nothing_changes_any_more(tmp_path, monkeypatch):
    now = [100.0]
    monkeypatch.setattr(changed_segments.time, "monotonic", lambda: now[0])
    scene = scenes.build_scene(shot(tmp_path), scene=bpy.context.scene)
    known = changed_segments.ChangeCache()
    assert known.known(scene) is None
    now[0] += 0.3
    known.outdate()
    now[0] += 0.3
    assert known._look_up_at_rest() == pytest.approx(0.1)
    assert known.known(scene) is None
    now[0] += 0.2
    assert known._look_up_at_rest() is None
    assert known.known(scene) is True
    known.clear()


@pytest.mark.parametrize(
    ("system", "scale", "warns"),
    [("METRIC", 0.01, True), ("IMPERIAL", 1.0, False), ("METRIC", 1.0, False), ("NONE", 0.01, False)],
)
def test_lengths_that_blender_would_show_wrongly_are_said(monkeypatch, system, scale, warns):
    """A height of 1.75 would be shown as 1.75 cm, and 1.75 m could not be entered."""
    units, drawn = bpy.context.scene.unit_settings, []
    units.system, units.scale_length = system, scale
    monkeypatch.setattr(texts, "draw_text", lambda _layout, _context, text, _icon: drawn.append(text))
    texts.draw_unit_scale(None, bpy.context)
    assert drawn == ["The scene's Unit Scale is 0.01, but a unit is a metre here: set it to 1"] * warns


def test_a_frame_rate_that_an_import_changes_is_said_and_set_back(tmp_path, monkeypatch):
    """Blender's importer of FBX gives the scene the frame rate of its file: the motion would be exported as a slower
    one."""
    drawn = []
    monkeypatch.setattr(texts, "draw_text", lambda _layout, _context, text, _icon: drawn.append(text))
    column = SimpleNamespace(operator=lambda *_, **button: drawn.append(button["text"]))
    layout = SimpleNamespace(column=lambda align: column)
    bpy.ops.mesh.primitive_cube_add()
    bpy.ops.export_scene.fbx(filepath=str(tmp_path / "character.fbx"), use_selection=True)
    current = scenes.build_scene(shot(tmp_path, fps=29.97))
    bpy.context.window.scene = current
    texts.draw_replaced_rate(layout, bpy.context)
    assert not drawn and not bpy.ops.kfmocap.restore_frame_rate.poll()
    bpy.ops.import_scene.fbx(filepath=str(tmp_path / "character.fbx"))
    assert current.kfmocap.frame_rate == 24
    texts.draw_replaced_rate(layout, bpy.context)
    assert "24 frames per second" in drawn[0] and "has 29.97" in drawn[0] and drawn[1] == "Set Back to 29.97"
    bpy.ops.kfmocap.restore_frame_rate()
    assert scenes.frame_rate(current) == 29.97 and current.kfmocap.replaced_rate == 0
    current.render.fps, current.render.fps_base = 12, 1.0
    current.kfmocap.frame_rate = 12  # the new one is wanted
    assert current.kfmocap.replaced_rate == 0
