"""What went missing is said, can be had back, and no button stays enabled that cannot work."""

from __future__ import annotations

import shutil
from types import SimpleNamespace

import pytest

bpy = pytest.importorskip("bpy")

from addon_shots import shot  # noqa: E402
from kfmocap.core.errors import FootageError  # noqa: E402
from kfmocap.kfmocap_addon.operators.posing.place_joints import PlaceJoints  # noqa: E402
from kfmocap.kfmocap_addon.operators.tracking.track_motion import TrackAll  # noqa: E402
from kfmocap.kfmocap_addon.panels import body_panel, footage_panel, guide, key_poses_panel, texts  # noqa: E402
from kfmocap.kfmocap_addon.scene_io import scene as scenes  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.cameras import footage_background  # noqa: E402
from scene_state import differences, state  # noqa: E402

pytest_plugins = ("addon_fixtures",)

pytestmark = pytest.mark.blender

NEED_FOOTAGE = ("track", "track_changes", "fit_body", "refine_cameras", "show_residual")
NEED_BODIES = (*NEED_FOOTAGE, "clear_between", "export")


@pytest.fixture
def moved(blender, tmp_path):
    """A saved scene of two performers that is opened after its footage was moved, and the folder it is in now."""
    scenes.build_scene(shot(tmp_path, ("man", "woman")), scene=bpy.context.scene)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    now = tmp_path / "elsewhere" / "takes"
    now.mkdir(parents=True)
    for name in ("cam01.mp4", "cam02.mp4"):
        shutil.move(tmp_path / name, now / name)
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "scene.blend"))
    return now


def reopened(folder):
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.open_mainfile(filepath=str(folder / "scene.blend"))


def test_a_saved_scene_and_its_footage_can_be_moved_together(blender, tmp_path):
    """Also footage that was added, or found again, after the scene was saved."""
    folder = tmp_path / "job"
    (folder / "takes").mkdir(parents=True)
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "scene.blend"))
    scenes.build_scene(shot(folder / "takes"), scene=bpy.context.scene)
    (folder / "takes" / "cam02.mp4").rename(folder / "cam02.mp4")
    reopened(folder)
    bpy.ops.kfmocap.relink_footage(filepath=f"{folder}/")
    bpy.ops.wm.save_mainfile()
    folder.rename(tmp_path / "moved")
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "moved" / "scene.blend"))
    views = bpy.context.scene.kfmocap.views
    assert [view.missing for view in views] == [False, False]
    assert footage_background.footage_path(views[0]) == tmp_path / "moved" / "takes" / "cam01.mp4"


def enabled(tools):
    return [name for name in tools if getattr(bpy.ops.kfmocap, name).poll()]


def test_footage_that_was_moved_is_found_again_in_a_folder_above(moved, tracker):
    views = bpy.context.scene.kfmocap.views
    assert [view.missing for view in views] == [True, True]
    assert enabled(NEED_FOOTAGE) == [] and bpy.ops.kfmocap.export.poll()
    assert bpy.ops.kfmocap.relink_footage(filepath=f"{moved.parent}/") == {"FINISHED"}
    assert [footage_background.footage_path(view) for view in views] == [moved / "cam01.mp4", moved / "cam02.mp4"]
    assert not bpy.ops.kfmocap.relink_footage.poll()
    assert bpy.ops.kfmocap.track() == {"FINISHED"}


def test_footage_that_vanishes_while_the_file_is_open_can_be_relinked_after_the_error(blender, tmp_path, tracker):
    """As when a drive is disconnected: until then, no view misses anything."""
    scenes.build_scene(shot(tmp_path), scene=bpy.context.scene)
    (tmp_path / "cam02.mp4").rename(tmp_path / "away.mp4")
    tracker.error = FootageError("there is no such footage", where="cam02.mp4")
    with pytest.raises(RuntimeError, match=r"cam02\.mp4: there is no such footage"):
        bpy.ops.kfmocap.track()
    assert [view.missing for view in bpy.context.scene.kfmocap.views] == [False, True]
    assert enabled(NEED_FOOTAGE) == [] and bpy.ops.kfmocap.relink_footage.poll()


def test_of_several_files_of_a_name_that_in_the_folder_of_that_name_is_taken(moved):
    (other := moved.parent / "other").mkdir()
    (right := moved.parent / moved.parents[1].name).mkdir()
    for folder in (other, right):
        shutil.copy(moved / "cam01.mp4", folder)
    (moved / "cam01.mp4").unlink()
    bpy.ops.kfmocap.relink_footage(filepath=f"{moved.parent}/")
    assert footage_background.footage_path(bpy.context.scene.kfmocap.views[0]) == right / "cam01.mp4"


def test_where_one_view_misses_its_footage_any_file_can_be_chosen(moved):
    shutil.copy(moved / "cam02.mp4", moved.parents[1])
    (moved / "cam01.mp4").rename(moved / "renamed.mp4")
    assert bpy.ops.kfmocap.relink_footage(filepath=str(moved / "renamed.mp4")) == {"FINISHED"}
    assert footage_background.footage_path(bpy.context.scene.kfmocap.views[0]) == moved / "renamed.mp4"


def test_a_folder_without_the_footage_changes_nothing(moved, tmp_path):
    (tmp_path / "empty").mkdir()
    before = state()
    with pytest.raises(RuntimeError, match=r"none of the missing footage is here: cam01\.mp4, cam02\.mp4"):
        bpy.ops.kfmocap.relink_footage(filepath=str(tmp_path / "empty"))
    assert not differences(state(), before)


@pytest.fixture
def two(blender, tmp_path):
    made = scenes.build_scene(shot(tmp_path, ("man", "woman")), scene=bpy.context.scene)
    made.frame_set(made.frame_current)  # the poses are shown
    return made


def delete(armature):
    """As X does."""
    bpy.ops.object.select_all(action="DESELECT")
    armature.select_set(True)
    bpy.context.view_layer.objects.active = armature
    assert bpy.ops.object.delete() == {"FINISHED"}


def parts(name):
    return [thing for thing in bpy.context.scene.objects if thing.name.startswith(f"{name} ")]


def test_a_deleted_body_disables_what_cannot_work_and_is_brought_back_whole(two, tracker):
    before = state()
    delete(two.kfmocap.performers["woman"].armature)
    assert enabled(NEED_BODIES) == [] and bpy.ops.kfmocap.place_joints.poll()
    assert bpy.ops.kfmocap.restore_body(performer=1) == {"FINISHED"}
    bpy.context.view_layer.update()
    assert not differences(state(), before)
    assert bpy.ops.kfmocap.track() == {"FINISHED"}
    assert not bpy.ops.kfmocap.restore_body.poll()


def test_where_every_body_was_deleted_one_is_told_to_bring_it_back(two):
    assert not PlaceJoints.missing(bpy.context)
    for name in ("woman", "man"):
        delete(two.kfmocap.performers[name].armature)
    assert "bring it back under Body" in PlaceJoints.missing(bpy.context)
    two.kfmocap.performers.clear()
    assert "add a body" in PlaceJoints.missing(bpy.context)


@pytest.mark.parametrize("how", ["by X", "by a script"])
def test_a_deleted_body_is_removed_with_its_parts(two, how):
    woman = two.kfmocap.performers["woman"].armature
    assert len(parts("woman")) == len(parts("man")) > 10
    delete(woman) if how == "by X" else bpy.data.objects.remove(woman)
    assert bpy.ops.kfmocap.remove_performer(performer=1) == {"FINISHED"}
    assert not parts("woman") and len(parts("man")) > 10
    assert [slot.name for slot in two.kfmocap.performers] == ["man"]
    assert "woman" not in bpy.data.objects


def test_a_performer_that_is_removed_leaves_its_armature(two):
    bpy.ops.kfmocap.remove_performer(performer=1)
    assert "woman" in two.objects and parts("woman")


def test_a_deleted_camera_is_brought_back_with_its_footage(two, tracker):
    before = state()
    delete(two.kfmocap.views[1].camera)
    assert enabled(NEED_FOOTAGE) == [] and "bring it back" in TrackAll.missing(bpy.context)
    assert guide.current_step(bpy.context) == "footage"
    with pytest.raises(RuntimeError, match="View 0 has no camera that could be brought back"):
        bpy.ops.kfmocap.restore_camera(view=0)
    assert bpy.ops.kfmocap.restore_camera(view=1) == {"FINISHED"}
    bpy.context.view_layer.update()
    assert not differences(state(), before)
    assert bpy.ops.kfmocap.track() == {"FINISHED"}
    assert not bpy.ops.kfmocap.restore_camera.poll()


def _exclude(scene):
    bpy.context.view_layer.layer_collection.children["Views"].exclude = True


def _hide_collection(scene):
    bpy.context.view_layer.layer_collection.children["Views"].hide_viewport = True


def _hide_everywhere(scene):
    bpy.data.collections["Views"].hide_viewport = scene.camera.hide_viewport = True


HIDING = {
    "by H": lambda scene: scene.camera.hide_set(True),
    "its collection excluded": _exclude,
    "its collection hidden": _hide_collection,
    "in all views": _hide_everywhere,
}


@pytest.mark.parametrize("how", HIDING)
def test_a_hidden_camera_is_said_and_shown_again_with_the_footage_behind_it(two, how):
    assert not two.kfmocap.views[0].missing and not bpy.ops.kfmocap.show_hidden.poll()
    bpy.ops.kfmocap.look_through(view=0)
    assert not drawn(footage_panel.LookPanel)
    HIDING[how](two)
    bpy.context.view_layer.update()
    [text, (tool, name)] = drawn(footage_panel.LookPanel)
    assert text == "The footage cannot be seen: 'cam01' is hidden" and tool == "kfmocap.show_hidden"
    assert bpy.ops.kfmocap.show_hidden(hidden=name) == {"FINISHED"}
    assert two.camera.visible_get() and two.objects["man"].visible_get()
    assert not drawn(footage_panel.LookPanel) and not bpy.ops.kfmocap.show_hidden.poll()


def test_a_hidden_body_is_said_where_it_is_posed(two):
    sections = (body_panel.BodyPanel, key_poses_panel.KeyPosesPanel)
    two.objects["woman"].hide_set(True)
    assert not any(drawn(section) for section in sections), "another one is chosen"
    two.objects["man"].hide_set(True)
    for section in sections:
        assert drawn(section) == ["The body cannot be seen: 'man' is hidden", ("kfmocap.show_hidden", "man")]
    with pytest.raises(RuntimeError, match="There is no object 'child' in the scene"):
        bpy.ops.kfmocap.show_hidden(hidden="child")


def drawn(section):
    """What a section says of hidden objects, and its buttons that show them, each with a name."""
    layout = SayingLayout(said=[])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(texts, "draw_text", lambda _layout, _context, text, _icon="NONE": layout.said.append(text))
        section.draw_content(SimpleNamespace(layout=layout), bpy.context)
    shown = [(item[0], item[1].hidden) if isinstance(item, tuple) else item for item in layout.said]
    return shown[-2:]


class SayingLayout(SimpleNamespace):
    """Notes the buttons that show hidden objects, in whatever row."""

    def __getattr__(self, name: str):
        if name.startswith("__"):
            raise AttributeError(name)
        return lambda *_args, **_more: self if name in ("row", "column", "box", "split", "grid_flow") else None

    def operator(self, name: str, **_more: object) -> SimpleNamespace:
        button = SimpleNamespace()
        if name == "kfmocap.show_hidden":
            self.said.append((name, button))
        return button


@pytest.mark.parametrize("how", ["EMPTY", "LINK_COPY", "FULL_COPY"])
def test_what_is_removed_from_a_copy_of_a_scene_stays_in_the_original(two, tracker, how):
    """With `EMPTY`, the copy has the shot, but none of its objects."""
    assert bpy.ops.kfmocap.track() == {"FINISHED"}
    bpy.ops.scene.new(type=how)
    copy = next(scene for scene in bpy.data.scenes if scene != two)
    bpy.context.window_manager.windows[0].scene = copy
    for _ in range(2):
        assert bpy.ops.kfmocap.remove_performer(performer=0) == {"FINISHED"}
        assert bpy.ops.kfmocap.remove_view(view=0) == {"FINISHED"}
    assert not copy.kfmocap.views and not copy.kfmocap.performers
    bpy.context.window_manager.windows[0].scene = two
    assert len(parts("woman")) == len(parts("man")) > 10
    assert bpy.ops.kfmocap.track() == {"FINISHED"}


def test_a_view_whose_camera_was_deleted_can_be_removed(two, tracker):
    bpy.data.objects.remove(two.kfmocap.views[1].camera)
    assert enabled(NEED_FOOTAGE) == []
    assert bpy.ops.kfmocap.remove_view(view=1) == {"FINISHED"}
    assert bpy.ops.kfmocap.track() == {"FINISHED"}
