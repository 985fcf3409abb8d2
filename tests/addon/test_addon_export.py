"""BVH, FBX and shot.blend hold the motion that the core computed."""

from __future__ import annotations

import errno
import json
import os
import re
import shutil
import struct
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

import addon_utils  # noqa: E402
from addon_shots import blender, joint_error, motion, shot, track_result  # noqa: E402, F401
from kfmocap import kfmocap_addon  # noqa: E402
from kfmocap.cli.services import OutputRequest  # noqa: E402
from kfmocap.core.body import human, part_poses  # noqa: E402
from kfmocap.core.body.finger_bones import finger_bones  # noqa: E402
from kfmocap.core.body.motion import Motion  # noqa: E402
from kfmocap.core.errors import OutputError, ShotError  # noqa: E402
from kfmocap.core.formats.bvh import read_bvh  # noqa: E402
from kfmocap.core.formats.keypoint_layouts import HAND_POINTS  # noqa: E402
from kfmocap.core.numerics import rotations  # noqa: E402
from kfmocap.kfmocap_addon import registration  # noqa: E402
from kfmocap.kfmocap_addon.batch import BatchSession  # noqa: E402
from kfmocap.kfmocap_addon.export import blender_outputs, destinations, exporters, presets, whole_files  # noqa: E402
from kfmocap.kfmocap_addon.export.export_formats import EXPORT_FORMATS  # noqa: E402
from kfmocap.kfmocap_addon.export.export_options import ExportOptions  # noqa: E402
from kfmocap.kfmocap_addon.export.whole_files import check_whole  # noqa: E402
from kfmocap.kfmocap_addon.scene_io import scene  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.body import body_armature  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.keys import key_pose_curves  # noqa: E402
from mathutils import Matrix  # noqa: E402
from scipy.spatial.transform import Rotation  # noqa: E402

pytestmark = pytest.mark.blender

TOLERANCE = 0.1  # mm


def result_of(original):
    motions = tuple(motion(original.length, seed) for seed in range(len(original.performers)))
    return track_result(original, motions)


def write_outputs(original, folder: Path, home: Path | None = None) -> list[Path]:
    """As the command line does it, where no add-on is switched on."""
    return BatchSession().write_outputs(original, result_of(original), OutputRequest(folder, home or folder))


def empty_file():
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)


def imported(path: Path):
    empty_file()
    if path.suffix == ".bvh":
        bpy.ops.import_anim.bvh(filepath=str(path))
    else:
        bpy.ops.import_scene.fbx(filepath=str(path), anim_offset=0.0)
    [armature] = [o for o in bpy.data.objects if o.type == "ARMATURE"]
    return armature


@pytest.mark.parametrize("suffix", [".bvh", ".fbx"])
def test_the_motion_read_back_is_the_cores(tmp_path, suffix):
    original = shot(tmp_path)
    write_outputs(original, tmp_path / "out")
    armature = imported(tmp_path / "out" / f"walk{suffix}")
    assert joint_error(armature, human(1.7), motion(12)) < TOLERANCE
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
    assert joint_error(armature, human(1.7), motion(12), 30 / 29.97, 30 / 29.97) < TOLERANCE


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
        assert joint_error(slot.armature, human(1.7), motion(12)) < 0.05
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


def test_footage_of_a_shot_that_is_shown_before_it_is_tracked_is_opened_once(blender, tmp_path, monkeypatch):  # noqa: F811
    """It has the path that is saved from the beginning: Blender opens footage again when its path changes."""
    changed = []
    monkeypatch.setattr(
        blender_outputs, "_set_path", lambda item, path: changed.append(item) if item.filepath != path else None
    )
    here = Path.cwd()
    (tmp_path / "out").mkdir()
    blender_outputs.show_shot(shot(tmp_path), tmp_path / "out")
    clips = list(bpy.data.movieclips)
    assert [clip.filepath for clip in clips] == ["//../cam01.mp4", "//../cam02.mp4"]
    assert [clip.frame_duration for clip in clips] == [30, 30]
    assert changed == [] and Path.cwd() == here


def test_far_footage_is_named_by_its_absolute_path(tmp_path):
    (tmp_path / "footage").mkdir()
    original = shot(tmp_path / "footage")
    write_outputs(original, tmp_path / "a" / "b" / "c" / "d" / "out")
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "a" / "b" / "c" / "d" / "out" / "shot.blend"))
    assert Path(bpy.data.movieclips[0].filepath) == (tmp_path / "footage" / "cam01.mp4").resolve()


def test_footage_whose_path_stays_is_not_opened_again(blender, tmp_path):  # noqa: F811
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
        blender_outputs.write_blender_outputs(original, result_of(original), out, bpy.context.scene)
        bpy.context.view_layer.update()
    finally:
        bpy.app.handlers.depsgraph_update_post.remove(note)
    assert opened == []


def test_tracking_the_open_scene_loses_nothing_in_it(blender, tmp_path):  # noqa: F811
    original = shot(tmp_path)
    scene.build_scene(original, scene=bpy.context.scene)
    mine = bpy.data.objects.new("mine", None)
    bpy.context.scene.collection.objects.link(mine)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "mine.blend"))
    bpy.ops.file.make_paths_relative()
    bpy.ops.wm.save_mainfile()
    stored, names = (tmp_path / "mine.blend").read_bytes(), [clip.filepath for clip in bpy.data.movieclips]
    out = tmp_path / "results" / "out"
    blender_outputs.write_blender_outputs(original, result_of(original), out, bpy.context.scene)
    assert (tmp_path / "mine.blend").read_bytes() == stored
    assert bpy.data.filepath == str(tmp_path / "mine.blend")
    assert [clip.filepath for clip in bpy.data.movieclips] == names
    assert len(bpy.data.scenes) == len(bpy.data.armatures) == 1
    armature = bpy.context.scene.kfmocap.performers[0].armature
    assert armature.name == "man" and key_pose_curves.read_key_poses(armature, 1, 12).frames.tolist() == [0, 5, 11]
    bpy.ops.wm.open_mainfile(filepath=str(out / "shot.blend"))
    assert "mine" in bpy.data.objects
    assert [clip.frame_duration for clip in bpy.data.movieclips] == [30, 30]
    assert joint_error(bpy.data.objects["man"], human(1.7), motion(12)) < 0.05


def test_exporting_a_moved_armature_puts_it_where_it_is(blender, tmp_path):  # noqa: F811
    original = shot(tmp_path)
    built = scene.build_scene(original, scene=bpy.context.scene)
    armature = built.kfmocap.performers[0].armature
    turn = Matrix(rotations.exp(np.array([0.4, -0.2, 1.0])).tolist()).to_4x4()
    armature.matrix_world = Matrix.Translation((1, 2, 0.5)) @ turn
    bpy.context.view_layer.update()
    armature.animation_data_clear()  # key poses were set where it stood before
    body = body_armature.body_from_armature(armature)
    scene.write_motions(built, result_of(original).motions)
    built.frame_set(7)
    exporters.export_performers(built, tmp_path)
    assert built.frame_current == 7 and len(bpy.data.scenes) == 1
    for name in ("walk.bvh", "walk.fbx"):
        assert joint_error(imported(tmp_path / name), body, motion(12)) < TOLERANCE


def test_the_export_tool_writes_what_was_asked_for(blender, tmp_path):  # noqa: F811
    original = shot(tmp_path)
    scene.build_scene(original, result_of(original).motions, bpy.context.scene)
    bpy.context.scene.kfmocap.export.fbx = False
    assert bpy.ops.kfmocap.export(directory=str(tmp_path / "new")) == {"FINISHED"}
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["walk.bvh"]
    assert bpy.context.scene.kfmocap.export.written == str(tmp_path / "new" / "walk.bvh")
    assert bpy.ops.kfmocap.export(directory=str(tmp_path / "new"), filename="take 2.bvh") == {"FINISHED"}
    assert {path.name for path in (tmp_path / "new").iterdir()} == {"walk.bvh", "take 2.bvh"}


def test_the_character_of_send_to_rig_is_exported_instead_if_that_is_chosen(blender, tmp_path):  # noqa: F811
    original = shot(tmp_path)
    built = scene.build_scene(original, result_of(original).motions, bpy.context.scene)
    man = built.kfmocap.performers[0].armature
    hero = man.copy()
    hero.name = "hero"
    hero.location.x = 3.0
    built.collection.objects.link(hero)
    bpy.context.view_layer.update()
    built.kfmocap.export.whom = "CHARACTER"  # as long as there is none, it is the performers
    for folder, character in (("man", None), ("hero", hero)):
        built.kfmocap.retarget.target = character
        assert bpy.ops.kfmocap.export(directory=str(tmp_path / folder)) == {"FINISHED"}
        assert {path.name for path in (tmp_path / folder).iterdir()} == {"walk.bvh", "walk.fbx"}
    for name in ("walk.bvh", "walk.fbx"):
        for folder, shift in (("man", 0.0), ("hero", 3.0)):
            there = motion(12)
            there.translations[:, 0] += shift
            assert joint_error(imported(tmp_path / folder / name), human(1.7), there) < TOLERANCE


def test_the_export_goes_beside_the_footage_and_then_where_it_went_last(blender, tmp_path):  # noqa: F811
    built = scene.build_scene(shot(tmp_path), scene=bpy.context.scene)
    assert destinations.proposed(built) == tmp_path / "walk"
    assert bpy.ops.kfmocap.export(directory=str(tmp_path / "new"), filename="take 2") == {"FINISHED"}
    assert destinations.proposed(built) == tmp_path / "new" / "take 2"
    written = destinations.paths(built, tmp_path / "new", "take 2")
    assert [path.name for path in written] == ["take 2.bvh", "take 2.fbx"] and all(path.exists() for path in written)


def read_joints(armature, names: list[str], frames: list[int]) -> np.ndarray:
    """World places of the heads of bones on scene frames, (F, P, 3)."""
    places = []
    for frame in frames:
        bpy.context.scene.frame_set(frame)
        posed = armature.evaluated_get(bpy.context.evaluated_depsgraph_get())
        places.append([posed.matrix_world @ posed.pose.bones[name].head for name in names])
    return np.array(places)


def exported(folder: Path, suffix: str, **options):
    """A file of the scene's one performer, read back: its armature."""
    chosen = ExportOptions(formats=(suffix[1:],), **options)
    [path] = exporters.export_performers(bpy.context.scene, folder, chosen)
    scale = presets.PRESETS[chosen.preset].scale
    empty_file()
    if suffix == ".bvh":
        bpy.ops.import_anim.bvh(filepath=str(path), global_scale=1 / scale)
    else:
        bpy.ops.import_scene.fbx(filepath=str(path), anim_offset=0.0)
    [armature] = [o for o in bpy.data.objects if o.type == "ARMATURE"]
    return armature


EXPECTED = {
    "BLENDER": ("pelvis", "chest", "forearm.L", "shin.R"),
    "UNREAL": ("pelvis", "spine_03", "lowerarm_l", "calf_r"),
    "UNITY": ("Hips", "Chest", "LeftLowerArm", "RightLowerLeg"),
    "MIXAMO": ("mixamorig:Hips", "mixamorig:Spine2", "mixamorig:LeftForeArm", "mixamorig:RightLeg"),
}


@pytest.mark.parametrize("suffix", [".bvh", ".fbx"])
@pytest.mark.parametrize("preset", EXPECTED)
def test_every_presets_motion_read_back_is_the_cores_under_its_names(blender, tmp_path, preset, suffix):  # noqa: F811
    original = shot(tmp_path)
    scene.build_scene(original, result_of(original).motions, bpy.context.scene)
    armature = exported(tmp_path / "out", suffix, preset=preset)
    body = human(1.7)
    names = [presets.PRESETS[preset].names.get(name, name) for name in body.names]
    assert set(EXPECTED[preset]) <= {bone.name for bone in armature.data.bones} == set(names)
    found = read_joints(armature, names, list(range(1, 13)))
    assert 1000 * np.linalg.norm(found - part_poses(body, motion(12))[1], axis=-1).max() < TOLERANCE
    if suffix == ".fbx":
        assert armature.name == ("root" if preset == "UNREAL" else "man")


@pytest.mark.parametrize("preset", ["UNREAL", "UNITY", "MIXAMO"])
def test_centimetres_are_the_files_unit_and_no_node_is_scaled(blender, tmp_path, preset):  # noqa: F811
    original = shot(tmp_path)
    scene.build_scene(original, result_of(original).motions, bpy.context.scene)
    armature = exported(tmp_path / "out", ".fbx", preset=preset)
    np.testing.assert_allclose(armature.scale, 0.01, rtol=1e-5)  # what Blender's importer makes of centimetres
    length = np.linalg.norm(human(1.7).offsets[human(1.7).index("shin.L")])
    thigh = presets.PRESETS[preset].names["thigh.L"]
    assert armature.data.bones[thigh].length == pytest.approx(100 * length, rel=1e-4)


def global_settings(path: Path) -> dict[str, float]:
    """Numbers of the table GlobalSettings of an FBX file, as they are in the file."""
    from io_scene_fbx import parse_fbx

    root, _version = parse_fbx.parse(str(path))
    [table] = [element for element in root.elems if element.id == b"GlobalSettings"]
    [properties] = [element for element in table.elems if element.id == b"Properties70"]
    entries = [entry.props for entry in properties.elems]
    return {entry[0].decode(): entry[4] for entry in entries if isinstance(entry[-1], (int, float))}


@pytest.mark.parametrize("preset", EXPECTED)
def test_an_fbx_file_says_that_y_is_up_and_what_its_unit_is(blender, tmp_path, preset):  # noqa: F811
    """Blender's importer undoes any axes; other programs take the file by its word."""
    original = shot(tmp_path)
    scene.build_scene(original, result_of(original).motions, bpy.context.scene)
    [path] = exporters.export_performers(bpy.context.scene, tmp_path / "out", ExportOptions(preset, ("fbx",)))
    settings = global_settings(path)
    axes = {axis: (settings[f"{axis}Axis"], settings[f"{axis}AxisSign"]) for axis in ("Up", "Front", "Coord")}
    assert axes == {"Up": (1, 1), "Front": (2, 1), "Coord": (0, 1)}, "Y up, facing +Z, X to the left"
    assert settings["UnitScaleFactor"] == 1.0, "centimetres"


@pytest.mark.parametrize("suffix", [".bvh", ".fbx"])
def test_a_frame_range_alone_is_written(blender, tmp_path, suffix):  # noqa: F811
    original = shot(tmp_path)
    scene.build_scene(original, result_of(original).motions, bpy.context.scene)
    armature = exported(tmp_path / "out", suffix, frames=(4, 9))
    first = round(armature.animation_data.action.frame_range[0])
    found = read_joints(armature, human(1.7).names, list(range(first, first + 6)))
    assert 1000 * np.linalg.norm(found - part_poses(human(1.7), motion(12)[3:9])[1], axis=-1).max() < TOLERANCE
    assert round(np.ptp(armature.animation_data.action.frame_range)) == 5


@pytest.mark.parametrize("suffix", [".bvh", ".fbx"])
def test_another_rate_shows_the_same_motion_and_rotations_go_the_shortest_way(blender, tmp_path, suffix):  # noqa: F811
    """At twice the rate every other frame is one of the shot's, and those between are half-way by slerp."""
    original = shot(tmp_path)
    scene.build_scene(original, result_of(original).motions, bpy.context.scene)
    armature = exported(tmp_path / "out", suffix, fps=120.0)
    T, Q = motion(12).translations, motion(12).rotations
    halves = Motion(
        (T[1:] + T[:-1]) / 2, Q[:-1] @ rotations.exp(rotations.log(np.swapaxes(Q[:-1], -1, -2) @ Q[1:]) / 2)
    )
    body = human(1.7)
    found = read_joints(armature, body.names, list(range(1, 24)))
    assert 1000 * np.linalg.norm(found[::2] - part_poses(body, motion(12))[1], axis=-1).max() < TOLERANCE
    assert 1000 * np.linalg.norm(found[1::2] - part_poses(body, halves)[1], axis=-1).max() < TOLERANCE


@pytest.mark.parametrize("suffix", [".bvh", ".fbx"])
def test_without_root_motion_the_performer_stays_over_its_first_place(blender, tmp_path, suffix):  # noqa: F811
    original = shot(tmp_path)
    scene.build_scene(original, result_of(original).motions, bpy.context.scene)
    armature = exported(tmp_path / "out", suffix, root_motion=False)
    T = motion(12).translations.copy()
    T[:, :2] = T[0, :2]
    expected = part_poses(human(1.7), Motion(T, motion(12).rotations))[1]
    found = read_joints(armature, human(1.7).names, list(range(1, 13)))
    assert 1000 * np.linalg.norm(found - expected, axis=-1).max() < TOLERANCE


def test_an_export_changes_nothing_in_the_scene_and_leaves_nothing_behind(blender, tmp_path):  # noqa: F811
    original = shot(tmp_path)
    built = scene.build_scene(original, result_of(original).motions, bpy.context.scene)
    armature = built.kfmocap.performers[0].armature
    names = [bone.name for bone in armature.data.bones]
    kept = [len(kind) for kind in (bpy.data.actions, bpy.data.armatures, bpy.data.objects, bpy.data.scenes)]
    options = ExportOptions("MIXAMO", frames=(2, 7), fps=24.0, root_motion=False)
    exporters.export_performers(built, tmp_path / "out", options)
    with pytest.raises(ShotError, match="before the first"):
        exporters.export_performers(built, tmp_path / "out", ExportOptions(frames=(7, 2)))
    assert [len(kind) for kind in (bpy.data.actions, bpy.data.armatures, bpy.data.objects, bpy.data.scenes)] == kept
    assert [bone.name for bone in armature.data.bones] == names
    assert joint_error(armature, human(1.7), motion(12)) < 0.05


def test_the_export_button_says_what_is_missing(blender, tmp_path):  # noqa: F811
    original = shot(tmp_path)
    built = scene.build_scene(original, scene=bpy.context.scene)
    built.kfmocap.export.bvh = built.kfmocap.export.fbx = False
    with pytest.raises(RuntimeError, match="Choose what kind of files to write"):
        bpy.ops.kfmocap.export(directory=str(tmp_path / "out"))


def test_what_cannot_be_written_is_named_and_leaves_nothing(blender, tmp_path):  # noqa: F811
    original = shot(tmp_path)
    built = scene.build_scene(original, scene=bpy.context.scene)
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(OutputError, match=r"file: the folder cannot be made"):
        exporters.export_performers(built, tmp_path / "file")
    (tmp_path / "out" / "walk.bvh").mkdir(parents=True)
    with pytest.raises(OutputError, match=r"walk\.bvh: a folder is in the way"):
        exporters.export_performers(built, tmp_path / "out")
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["walk.bvh"]
    built.kfmocap.shot = "a/b"
    with pytest.raises(ShotError, match=r"a/b"):
        exporters.export_performers(built, tmp_path / "out")
    assert len(bpy.data.scenes) == 1


def test_what_blenders_exporter_failed_with_is_said_in_a_line(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """As on a full disk: Blender prints the traceback of an exporter in Python, and has it in its own message."""

    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("io_scene_fbx.export_fbx_bin.save", full)
    with pytest.raises(OutputError) as refused, whole_files.writing(tmp_path / "walk.fbx") as target:
        bpy.ops.export_scene.fbx(filepath=str(target))
    assert str(refused.value).endswith("walk.fbx: Blender cannot write it: OSError: [Errno 28] No space left on device")
    assert "Traceback" not in "".join(capfd.readouterr())
    assert not list(tmp_path.iterdir())


def glb_content(path: Path) -> tuple[dict, bytes]:
    """The JSON and the binary part of a .glb file, read by its specification."""
    data = path.read_bytes()
    magic, version, length = struct.unpack_from("<4sII", data)
    assert (magic, version, length) == (b"glTF", 2, len(data))
    (size,) = struct.unpack_from("<I", data, 12)
    return json.loads(data[20 : 20 + size]), data[28 + size :]


def glb_values(content: dict, binary: bytes, accessor: int) -> np.ndarray:
    one = content["accessors"][accessor]
    view = content["bufferViews"][one["bufferView"]]
    columns = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[one["type"]]
    start = view.get("byteOffset", 0) + one.get("byteOffset", 0)
    return np.frombuffer(binary, np.float32, one["count"] * columns, start).reshape(one["count"], columns)


def glb_joints(path: Path, names: list[str]) -> tuple[np.ndarray, np.ndarray]:
    """World places of joints on every frame (F, P, 3), Z up, and the seconds of the frames (F,)."""
    content, binary = glb_content(path)
    nodes = content["nodes"]
    (animation,) = content["animations"]
    seconds = glb_values(content, binary, animation["samplers"][0]["input"])[:, 0]
    moving = {}
    for channel in animation["channels"]:
        sampler = animation["samplers"][channel["sampler"]]
        moving[channel["target"]["node"], channel["target"]["path"]] = glb_values(content, binary, sampler["output"])
    parents = {child: n for n, node in enumerate(nodes) for child in node.get("children", ())}

    def placed(n: int, frame: int) -> np.ndarray:
        default = {"translation": [0, 0, 0], "rotation": [0, 0, 0, 1], "scale": [1, 1, 1]}
        t, q, s = (
            moving[n, key][min(frame, len(moving[n, key]) - 1)] if (n, key) in moving else nodes[n].get(key, value)
            for key, value in default.items()
        )
        matrix = np.eye(4)
        matrix[:3, :3] = Rotation.from_quat(q).as_matrix() * s
        matrix[:3, 3] = t
        return placed(parents[n], frame) @ matrix if n in parents else matrix

    index = {node["name"]: n for n, node in enumerate(nodes)}
    places = np.array([[placed(index[name], f)[:3, 3] for name in names] for f in range(len(seconds))])
    return places @ np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]), seconds


@pytest.mark.parametrize("preset", ["BLENDER", "UNREAL"])
def test_gltf_holds_the_motion_in_metres_with_y_up(blender, tmp_path, preset):  # noqa: F811
    original = shot(tmp_path)
    built = scene.build_scene(original, result_of(original).motions, bpy.context.scene)
    [path] = exporters.export_performers(built, tmp_path, ExportOptions(preset, ("glb",)))
    names = [presets.PRESETS[preset].names.get(name, name) for name in human(1.7).names]
    places, seconds = glb_joints(path, names)
    assert np.abs(places - part_poses(human(1.7), motion(12))[1]).max() < TOLERANCE / 1000
    assert np.allclose(np.diff(seconds), 1 / 60, atol=1e-5)


def test_a_vrm_animation_says_which_joints_are_which_bones(blender, tmp_path):  # noqa: F811
    original = shot(tmp_path)
    built = scene.build_scene(original, result_of(original).motions, bpy.context.scene)
    options = ExportOptions("UNREAL", ("vrma",))
    [path] = exporters.export_performers(built, tmp_path, options)
    content, _ = glb_content(path)
    humanoid = content["extensions"]["VRMC_vrm_animation"]["humanoid"]["humanBones"]
    assert content["extensionsUsed"] == ["VRMC_vrm_animation"]
    named = {bone: content["nodes"][one["node"]]["name"] for bone, one in humanoid.items()}
    assert named["hips"] == "pelvis"
    assert named["leftLowerArm"] == "forearm.L"
    assert named["chest"] == "chest"
    assert len(named) == len(human().names)
    played = [
        (channel["target"]["node"], channel["target"]["path"]) for channel in content["animations"][0]["channels"]
    ]
    assert [node for node, path in played if path == "translation"] == [humanoid["hips"]["node"]]
    assert not any(path == "scale" for _, path in played)
    places, _ = glb_joints(path, human(1.7).names)
    assert np.abs(places - part_poses(human(1.7), motion(12))[1]).max() < TOLERANCE / 1000


@pytest.mark.parametrize("preset", ["BLENDER", "UNREAL"])
def test_usd_holds_the_motion_in_metres_with_y_up(blender, tmp_path, preset):  # noqa: F811
    usd = pytest.importorskip("pxr.Usd")
    from pxr import UsdGeom, UsdSkel

    original = shot(tmp_path)
    built = scene.build_scene(original, result_of(original).motions, bpy.context.scene)
    [path] = exporters.export_performers(built, tmp_path, ExportOptions(preset, ("usdc",)))
    stage = usd.Stage.Open(str(path))
    assert UsdGeom.GetStageUpAxis(stage) == "Y"
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    [prim] = [prim for prim in stage.Traverse() if prim.IsA(UsdSkel.Skeleton)]
    cache = UsdSkel.Cache()
    query = cache.GetSkelQuery(UsdSkel.Skeleton(prim))
    names = [joint.rpartition("/")[2] for joint in query.GetJointOrder()]
    order = [names.index(presets.PRESETS[preset].names.get(n, n).replace(".", "_")) for n in human().names]
    frames = range(int(stage.GetStartTimeCode()), int(stage.GetEndTimeCode()) + 1)
    assert len(frames) == 12
    assert stage.GetTimeCodesPerSecond() == pytest.approx(60)
    places = []
    for frame in frames:
        world = UsdGeom.XformCache(frame).GetLocalToWorldTransform(prim)
        joints = query.ComputeJointSkelTransforms(frame)
        places.append([(joints[j] * world).ExtractTranslation() for j in order])
    found = np.array(places) @ np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])
    assert np.abs(found - part_poses(human(1.7), motion(12))[1]).max() < TOLERANCE / 1000


def fbx_setting(path: Path, name: str) -> float:
    """A number among the global settings of a binary FBX file: the name, three further strings, and the value."""
    data, start = path.read_bytes(), b"S" + struct.pack("<I", len(name)) + name.encode()
    at = data.index(start)
    for _ in range(4):
        assert data[at : at + 1] == b"S"
        at += 5 + int.from_bytes(data[at + 1 : at + 5], "little")
    kind = {b"I": "<i", b"D": "<d"}[data[at : at + 1]]
    return struct.unpack_from(kind, data, at + 1)[0]


@pytest.mark.parametrize("preset", ["BLENDER", "UNREAL"])
def test_an_fbx_file_states_its_axes_and_its_unit(blender, tmp_path, preset):  # noqa: F811
    original = shot(tmp_path)
    built = scene.build_scene(original, result_of(original).motions, bpy.context.scene)
    [path] = exporters.export_performers(built, tmp_path, ExportOptions(preset, ("fbx",)))
    axes = ("UpAxis", "UpAxisSign", "FrontAxis", "FrontAxisSign", "CoordAxis", "CoordAxisSign")
    assert [fbx_setting(path, axis) for axis in axes] == [1, 1, 2, 1, 0, 1]
    assert fbx_setting(path, "UnitScaleFactor") == 1.0  # centimetres


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


def test_every_format_has_a_property_and_a_writer(blender):  # noqa: F811
    settings = bpy.context.scene.kfmocap.export
    for name, known in EXPORT_FORMATS.items():
        assert settings.bl_rna.properties[name].name == known.label
        assert getattr(settings, name) == known.is_default
    assert set(exporters._WRITERS) == set(EXPORT_FORMATS)


@pytest.mark.parametrize("kind", ["bvh", "fbx", "glb", "vrma"])
def test_a_missing_exporter_is_named_before_anything_is_written(blender, tmp_path, kind):  # noqa: F811
    """Add-ons can be disabled, and builds of Blender without USD have no operator for it either."""
    scene.build_scene(shot(tmp_path), scene=bpy.context.scene)
    module = {"bvh": "io_anim_bvh", "fbx": "io_scene_fbx"}.get(kind, "io_scene_gltf2")
    folder = tmp_path / "out"
    everything = ExportOptions(formats=("bvh", "fbx", "glb", "vrma"))
    addon_utils.disable(module)
    try:
        with pytest.raises(OutputError, match=r"no exporter .*\n?.*enable the add-on") as refused:
            exporters.export_performers(bpy.context.scene, folder, everything)
    finally:
        addon_utils.enable(module)
    assert "*." in str(refused.value)
    assert not folder.exists()
    assert all(
        name in dir(getattr(bpy.ops, module)) for module, name in (known.exporter for known in EXPORT_FORMATS.values())
    ), "all are there"


@pytest.mark.parametrize("kind", ["bvh", "fbx", "glb", "vrma"])
def test_windows_show_the_scene_that_they_showed_before(blender, tmp_path, kind):  # noqa: F811
    """Blender's exporters may turn a window to the scene that they write; removing that shows the file's first."""
    window = bpy.context.window_manager.windows[0]
    shown = bpy.data.scenes.new("zz shown")
    window.scene = shown
    scene.build_scene(shot(tmp_path), scene=shown)
    armature = shown.kfmocap.performers[0].armature
    getattr(exporters, f"export_{kind}")(tmp_path / f"walk.{kind}", armature, shown, ExportOptions())
    assert window.scene == shown
