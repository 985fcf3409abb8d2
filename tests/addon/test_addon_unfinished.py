"""A tracking that was ended with Blender goes on from what it had finished, when the file is opened again."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

bpy = pytest.importorskip("bpy")

from addon_shots import keys_of  # noqa: E402
from kfmocap.core.shot.settings import Settings  # noqa: E402
from kfmocap.core.tracking.results.journal import Journal  # noqa: E402
from kfmocap.kfmocap_addon.panels import track_panel  # noqa: E402
from kfmocap.kfmocap_addon.scene_io import scene, unfinished_tracking  # noqa: E402
from synthetic import CAMERAS, figure, film, shot_of, swing  # noqa: E402

pytest_plugins = ("addon_fixtures",)

pytestmark = pytest.mark.blender


@pytest.fixture
def filmed(blender, tmp_path):
    """A saved scene of three segments."""
    truth = swing(figure(), 7)
    views = film(tmp_path, [figure()], [truth], CAMERAS)
    given = shot_of(views, [figure()], [truth], (0, 2, 4, 6), Settings(limb_search=False))
    scene.build_scene(given, scene=bpy.context.scene)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    return tmp_path / "scene.blend"


def end_after(segments: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Have trackings end when they have finished so many segments."""
    write = Journal.write

    def ending(journal, key, finished):
        write(journal, key, finished)
        if len(journal.kept) == segments:
            raise MemoryError("ended")

    monkeypatch.setattr(Journal, "write", ending)


def opened(file):
    bpy.ops.wm.open_mainfile(filepath=str(file))
    return bpy.context.scene


def keys(built):
    return [keys_of(slot.armature) for slot in built.kfmocap.performers]


class Layout:
    """Records the texts of buttons."""

    def __init__(self) -> None:
        self.texts: list[str] = []

    def column(self, align: bool = False) -> Layout:
        return self

    row = column

    def prop(self, *_: object, **__: object) -> None:
        pass

    label = prop

    def operator(self, _name: str, text: str = "", icon: str = "NONE") -> SimpleNamespace:
        self.texts.append(text)
        return SimpleNamespace()


def offered() -> list[str]:
    layout = Layout()
    track_panel.TrackPanel.draw_content(SimpleNamespace(layout=layout), bpy.context)
    return [text for text in layout.texts if "Continue" in text]


def test_what_was_finished_is_offered_and_taken(filmed, monkeypatch: pytest.MonkeyPatch) -> None:
    bpy.ops.kfmocap.track()
    assert not offered()
    in_one_go = keys(bpy.context.scene)

    opened(filmed)
    with monkeypatch.context() as patch, pytest.raises(RuntimeError, match="ended"):
        end_after(2, patch)
        bpy.ops.kfmocap.track()
    before = keys(opened(filmed))
    assert offered() == ["Continue (2 segments finished)"]
    solved = []
    write = Journal.write
    monkeypatch.setattr(Journal, "write", lambda j, key, one: (solved.append(one.segment), write(j, key, one)))
    assert bpy.ops.kfmocap.continue_tracking() == {"FINISHED"}
    assert solved == [(4, 6)]
    assert keys(bpy.context.scene) == in_one_go != before
    assert not offered()


def test_a_new_tracking_and_another_scene_begin_afresh(filmed, monkeypatch: pytest.MonkeyPatch) -> None:
    built = bpy.context.scene
    with monkeypatch.context() as patch, pytest.raises(RuntimeError, match="ended"):
        end_after(1, patch)
        bpy.ops.kfmocap.track_forward()
    assert offered() == ["Continue (1 segment finished)"]
    assert unfinished_tracking.asked_segments(built) == {(0, 2), (2, 4), (4, 6)}
    bpy.ops.wm.save_as_mainfile(filepath=str(filmed.with_name("other.blend")))
    assert not offered()
    assert not bpy.ops.kfmocap.continue_tracking.poll()
    opened(filmed)
    bpy.ops.kfmocap.track()
    assert not offered()


def test_scenes_that_were_never_saved_are_told_apart_by_their_footage(blender, tmp_path) -> None:
    truth = swing(figure(), 7)
    takes = {}
    for take in ("one", "another"):
        (tmp_path / take).mkdir()
        takes[take] = shot_of(film(tmp_path / take, [figure()], [truth], CAMERAS), [figure()], [truth], (0, 6))
    counts = []
    for take in ("one", "another", "one"):
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        built = scene.build_scene(takes[take], scene=bpy.context.scene)
        counts.append(unfinished_tracking.segment_count(built))
        if not counts[1:]:
            journal = unfinished_tracking.begun(built, [(0, 6)], resume=False)
            (journal.folder / "0_6.segment").touch()
    (journal.folder / "0_6.segment").unlink()
    unfinished_tracking.discard(built)
    assert counts == [0, 0, 1]
