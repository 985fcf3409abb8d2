"""The files that tracking writes with Blender hold the motion that the core computed: BVH, FBX and shot.blend."""

from __future__ import annotations

import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from addon_shots import joint_error, motion, person, shot  # noqa: E402
from exported_files import TOLERANCE, imported, result_of  # noqa: E402
from kfmocap import kfmocap_addon  # noqa: E402
from kfmocap.cli.services import OutputRequest  # noqa: E402
from kfmocap.core.body import human, part_poses  # noqa: E402
from kfmocap.core.body.finger_bones import finger_bones  # noqa: E402
from kfmocap.core.errors import OutputError  # noqa: E402
from kfmocap.core.formats.bvh import read_bvh  # noqa: E402
from kfmocap.core.formats.keypoint_layouts import HAND_POINTS  # noqa: E402
from kfmocap.kfmocap_addon import registration  # noqa: E402
from kfmocap.kfmocap_addon.batch import BatchSession, run_command  # noqa: E402
from kfmocap.kfmocap_addon.export import blender_outputs, whole_files  # noqa: E402
from kfmocap.kfmocap_addon.export.whole_files import check_whole  # noqa: E402
from kfmocap.kfmocap_addon.scene_io import scene  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.keys import key_pose_curves  # noqa: E402

pytest_plugins = ("addon_fixtures",)

pytestmark = pytest.mark.blender


def write_outputs(original, folder: Path, home: Path | None = None) -> list[Path]:
    """As the command line does it, where no add-on is switched on."""
    return BatchSession().write_outputs(original, result_of(original), OutputRequest(folder, home or folder))


@pytest.mark.parametrize("suffix", [".bvh", ".fbx"])
def test_the_motion_read_back_is_the_cores(tmp_path, suffix):
    original = shot(tmp_path)
    write_outputs(original, tmp_path / "out")
    armature = imported(tmp_path / "out" / f"walk{suffix}")
    assert joint_error(armature, person(1.7), motion(12)) < TOLERANCE
    first, last = armature.animation_data.action.frame_range
    assert (round(first), round(last)) == (1, 12)
    assert [o.type for o in bpy.data.objects] == ["ARMATURE"]
    assert armature.name == ("walk" if suffix == ".bvh" else "man")  # Blender names a BVH's armature by its file


def test_at_a_broken_rate_the_exports_keep_time(tmp_path):
    original = shot(tmp_path, fps=29.97)
    write_outputs(original, tmp_path)
    text = (tmp_path / "walk.bvh").read_text()
    assert float(re.search(r"Frame Time: (.*)", text)[1]) == pytest.approx(1 / 29.97, rel=1e-7)
    assert "Frames: 12\n" in text
    # Blender's FBX importer takes 29.97 frames per second for 30: its fault, undone here.
    armature = imported(tmp_path / "walk.fbx")
    assert joint_error(armature, person(1.7), motion(12), 30 / 29.97, 30 / 29.97) < TOLERANCE


@pytest.mark.parametrize("compressed", [False, True])
def test_a_file_that_blender_wrote_in_part_does_not_count(tmp_path, monkeypatch, compressed):
    """As on a full disk, where saving reports success."""
    monkeypatch.setattr(bpy.context.preferences.filepaths, "use_file_compression", compressed)
    paths = write_outputs(shot(tmp_path), tmp_path / "out")
    libraries = len(bpy.data.libraries)
    for path in paths:
        check_whole(path)
        whole = path.read_bytes()
        for length in (0, 20, len(whole) // 2, len(whole) - 4096, len(whole) - 1):
            path.write_bytes(whole[: max(length, 0)])
            if path.suffix == ".bvh" and length == len(whole) - 1:
                continue  # the end of its last line alone
            with pytest.raises(OutputError, match=f"{path.name}: Blender wrote it in part only"):
                check_whole(path)
    assert len(bpy.data.libraries) == libraries
    with pytest.raises(OutputError, match=r"out.walk\.fbx: Blender wrote"), whole_files.writing(paths[1]) as target:
        target.write_bytes(b"Kaydara FBX Binary")


def test_several_performers_have_files_of_their_own(tmp_path):
    original = shot(tmp_path, ("man", "woman"))
    paths = write_outputs(original, tmp_path / "out")
    names = ["walk_man.bvh", "walk_man.fbx", "walk_woman.bvh", "walk_woman.fbx", "shot.blend"]
    assert [path.name for path in paths] == names
    assert sorted(names) == sorted(path.name for path in (tmp_path / "out").iterdir())
    armature = imported(tmp_path / "out" / "walk_woman.fbx")
    assert joint_error(armature, human(1.8), motion(12, seed=1)) < TOLERANCE


def test_shot_blend_opens_with_everything(tmp_path):
    original = shot(tmp_path)
    write_outputs(original, tmp_path / "out")
    assert not registration.is_registered()
    kfmocap_addon.register()
    try:
        bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "out" / "shot.blend"))
        opened = bpy.context.scene
        [slot] = opened.kfmocap.performers
        assert joint_error(slot.armature, person(1.7), motion(12)) < 0.05
        assert opened.name == "walk" and opened.camera == opened.kfmocap.views[0].camera
        clips = [view.camera.data.background_images[0].clip for view in opened.kfmocap.views]
        assert all(clip.frame_duration == 30 for clip in clips)  # 0 where Blender cannot read it
        read = scene.shot_from_scene(opened)
        assert [view.footage for view in read.views] == [view.footage for view in original.views]
        assert read.performers[0].key_poses.frames.tolist() == [0, 5, 11]
    finally:
        kfmocap_addon.unregister()


def test_shot_blend_and_footage_move_together(tmp_path):
    """The results are staged beside their folder first, as the command line does it."""
    project = tmp_path / "project"
    (project / "out").mkdir(parents=True)
    original = shot(project)
    stage = project / "deep" / "stage"
    write_outputs(original, stage, home=project / "out")
    shutil.move(stage / "shot.blend", project / "out" / "shot.blend")
    project.rename(tmp_path / "moved")
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "moved" / "out" / "shot.blend"))
    assert [clip.frame_duration for clip in bpy.data.movieclips] == [30, 30]


def test_a_shot_that_blender_shows_before_it_is_tracked_is_written_the_same(tmp_path):
    """What does not hang on the motion is built while the shot is tracked, with paths as their folder needs them."""
    (tmp_path / "project" / "out").mkdir(parents=True)
    original = shot(tmp_path / "project", ("man", "woman"))
    stages = [tmp_path / "project" / "deep" / name for name in ("at once", "before")]
    home = tmp_path / "project" / "out"
    write_outputs(original, stages[0], home=home)
    session = BatchSession()
    try:
        session.show_shot(original, home)
        session.write_outputs(original, result_of(original), OutputRequest(stages[1], home, shown=True))
    finally:
        registration.unregister()
    saved = []
    for stage in stages:
        assert (stage / "walk_man.bvh").read_bytes() == (stages[0] / "walk_man.bvh").read_bytes()
        bpy.ops.wm.open_mainfile(filepath=str(stage / "shot.blend"))
        saved.append(([clip.filepath for clip in bpy.data.movieclips], sorted(item.name for item in bpy.data.objects)))
        shutil.move(stage / "shot.blend", home / "shot.blend")
        bpy.ops.wm.open_mainfile(filepath=str(home / "shot.blend"))
        assert [clip.frame_duration for clip in bpy.data.movieclips] == [30, 30]
    assert saved[0] == saved[1]


@pytest.mark.parametrize("made", ["out", "staged"])
def test_footage_of_a_shot_that_is_shown_before_it_is_tracked_is_opened_once(blender, tmp_path, monkeypatch, made):
    """It has the path that is saved from the beginning: Blender opens footage again when its path changes."""
    changed = []
    monkeypatch.setattr(
        blender_outputs, "_set_path", lambda item, path: changed.append(item) if item.filepath != path else None
    )
    here = Path.cwd()
    (tmp_path / made).mkdir()
    blender_outputs.show_shot(shot(tmp_path), tmp_path / "out", tmp_path / "staged")
    clips = list(bpy.data.movieclips)
    assert [clip.filepath for clip in clips] == ["//../cam01.mp4", "//../cam02.mp4"]
    assert [clip.frame_duration for clip in clips] == [30, 30]
    assert changed == [] and Path.cwd() == here


def test_a_shot_is_shown_though_the_folder_of_its_results_is_still_to_be_made(blender, tmp_path):
    blender_outputs.show_shot(shot(tmp_path), tmp_path / "new" / "out")
    clips = list(bpy.data.movieclips)
    assert [clip.filepath for clip in clips] == ["//../../cam01.mp4", "//../../cam02.mp4"]
    assert [clip.frame_duration for clip in clips] == [30, 30]
    assert not (tmp_path / "new").exists()


def test_a_shot_whose_files_are_named_from_the_working_folder_is_shown(blender, tmp_path, monkeypatch):
    """As after `cd shot; kfmocap track shot.toml`: its paths are relative to where the command was run."""
    given = shot(tmp_path)
    monkeypatch.chdir(tmp_path)
    views = tuple(replace(view, footage=Path(view.footage.name)) for view in given.views)
    (tmp_path / "out").mkdir()
    blender_outputs.show_shot(replace(given, views=views), Path("out"))
    assert [clip.filepath for clip in bpy.data.movieclips] == ["//../cam01.mp4", "//../cam02.mp4"]


def test_far_footage_is_named_by_its_absolute_path(tmp_path):
    (tmp_path / "footage").mkdir()
    original = shot(tmp_path / "footage")
    write_outputs(original, tmp_path / "a" / "b" / "c" / "d" / "out")
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "a" / "b" / "c" / "d" / "out" / "shot.blend"))
    assert Path(bpy.data.movieclips[0].filepath) == (tmp_path / "footage" / "cam01.mp4").resolve()


def test_footage_whose_path_stays_is_not_opened_again(blender, tmp_path):
    """Blender would do that when it evaluates the scene next."""
    (tmp_path / "footage").mkdir()
    original = shot(tmp_path / "footage")
    scene.build_scene(original, scene=bpy.context.scene)
    bpy.context.view_layer.update()
    out, opened = tmp_path / "a" / "b" / "c" / "d" / "out", []

    def note(_scene, graph):
        opened.extend(update.id.name for update in graph.updates if isinstance(update.id, bpy.types.MovieClip))

    bpy.app.handlers.depsgraph_update_post.append(note)
    try:
        blender_outputs.write_blender_outputs(original, result_of(original), OutputRequest(out, open_scene=True))
        bpy.context.view_layer.update()
    finally:
        bpy.app.handlers.depsgraph_update_post.remove(note)
    assert opened == []


def test_a_scene_that_an_animator_has_corrected_is_kept_when_a_new_one_replaces_it(blender, tmp_path):
    original, out, stage = shot(tmp_path), tmp_path / "out", tmp_path / "stage"
    blender_outputs.write_blender_outputs(original, result_of(original), OutputRequest(out))
    assert not (out / "shot.blend1").exists()
    (out / "shot.blend").write_bytes(b"corrected")
    for folder in (stage, out):  # as the command writes it, and directly
        blender_outputs.write_blender_outputs(original, result_of(original), OutputRequest(folder, home=out))
        assert (folder / "shot.blend1").read_bytes() == b"corrected" != (folder / "shot.blend").read_bytes()


def test_tracking_the_open_scene_loses_nothing_in_it(blender, tmp_path):
    original = shot(tmp_path)
    scene.build_scene(original, scene=bpy.context.scene)
    mine = bpy.data.objects.new("mine", None)
    bpy.context.scene.collection.objects.link(mine)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "mine.blend"))
    bpy.ops.file.make_paths_relative()
    bpy.ops.wm.save_mainfile()
    stored, names = (tmp_path / "mine.blend").read_bytes(), [clip.filepath for clip in bpy.data.movieclips]
    out = tmp_path / "results" / "out"
    blender_outputs.write_blender_outputs(original, result_of(original), OutputRequest(out, open_scene=True))
    assert (tmp_path / "mine.blend").read_bytes() == stored
    assert bpy.data.filepath == str(tmp_path / "mine.blend")
    assert [clip.filepath for clip in bpy.data.movieclips] == names
    assert len(bpy.data.scenes) == len(bpy.data.armatures) == 1
    armature = bpy.context.scene.kfmocap.performers[0].armature
    assert armature.name == "man" and key_pose_curves.read_key_poses(armature, 1, 12).frames.tolist() == [0, 5, 11]
    bpy.ops.wm.open_mainfile(filepath=str(out / "shot.blend"))
    assert "mine" in bpy.data.objects
    assert [clip.frame_duration for clip in bpy.data.movieclips] == [30, 30]
    assert joint_error(bpy.data.objects["man"], person(1.7), motion(12)) < 0.05


def test_files_have_the_fingers_of_hands_that_were_found(tmp_path):
    original = shot(tmp_path)
    result, body = result_of(original), original.performers[0].body
    R, T = part_poses(body, result.motions[0])
    hands = np.zeros((len(T), 2, len(HAND_POINTS), 3))
    for side, letter in enumerate("LR"):
        part = body.index(f"hand.{letter}")
        bones = [bone for bone in finger_bones(body) if bone.name.endswith(letter)]
        fingers = ("thumb", "f_index", "f_middle", "f_ring", "f_pinky")
        chains = [[bone for bone in bones if bone.name.startswith(name)] for name in fingers]
        rest = [body.parts[part].head_world]
        for chain in chains:
            rest += [*(bone.head_world for bone in chain), chain[-1].tail_world]
        local = (np.array(rest) - body.parts[part].head_world) @ body.parts[part].R_world_rest
        hands[:, side] = np.einsum("fab,kb->fka", R[:, part], local) + T[:, None, part]
    BatchSession().write_outputs(original, result, OutputRequest(tmp_path / "out", tmp_path / "out", hands=(hands,)))
    moved = read_bvh(tmp_path / "out" / "walk.bvh")
    [index, middle] = moved.rest.indices(["f_index.01.L", "f_middle.01.L"])
    where = hands[:, 0, [HAND_POINTS.index("Index1"), HAND_POINTS.index("Middle1")]]
    assert np.abs(moved.positions[:, [index, middle]] - where).max() < 1e-3
    assert b"f_pinky.03.R" in (tmp_path / "out" / "walk.fbx").read_bytes()
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "out" / "shot.blend"))
    assert "thumb.02.L" in bpy.data.objects["man"].pose.bones


def test_the_open_file_is_not_replaced_by_its_results(blender, tmp_path, capsys):
    scene.build_scene(shot(tmp_path), scene=bpy.context.scene)
    file = tmp_path / "shot.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(file))
    before = file.read_bytes()
    assert run_command(["track", "--out", str(tmp_path)]) == 1
    assert "shot.blend: would be replaced by the results" in capsys.readouterr().err
    assert file.read_bytes() == before
