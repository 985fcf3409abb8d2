"""The Export tool writes what was asked for: each preset's names, axes, units, range and rate."""

from __future__ import annotations

import errno
import os
import struct
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

import addon_utils  # noqa: E402
from addon_shots import joint_error, motion, person, shot  # noqa: E402
from exported_files import TOLERANCE, exported, glb_joints, imported, read_joints, result_of  # noqa: E402
from kfmocap.core.body import part_poses  # noqa: E402
from kfmocap.core.body.motion import Motion  # noqa: E402
from kfmocap.core.body.skeleton_motion import motion_of_body  # noqa: E402
from kfmocap.core.errors import OutputError, ShotError  # noqa: E402
from kfmocap.core.numerics import rotations  # noqa: E402
from kfmocap.kfmocap_addon.export import destinations, exporters, presets, whole_files  # noqa: E402
from kfmocap.kfmocap_addon.export.export_formats import EXPORT_FORMATS  # noqa: E402
from kfmocap.kfmocap_addon.export.export_options import ExportOptions  # noqa: E402
from kfmocap.kfmocap_addon.panels import export_panel  # noqa: E402
from kfmocap.kfmocap_addon.retargeting.send import send_to_rig  # noqa: E402
from kfmocap.kfmocap_addon.scene_io import scene  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.body import body_armature  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.keys import key_pose_curves  # noqa: E402
from mathutils import Matrix  # noqa: E402
from odd_characters import add_bones, skinned_human  # noqa: E402

pytest_plugins = ("addon_fixtures",)

pytestmark = pytest.mark.blender


def test_exporting_a_moved_armature_puts_it_where_it_is(blender, tmp_path):
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


def test_who_is_exported_is_asked_only_where_motion_went_to_a_rig(blender, tmp_path):
    def asked():
        layout = MagicMock()
        export_panel.ExportPanel.draw_content(SimpleNamespace(layout=layout), bpy.context)
        return [call.args[1] for call in layout.row.return_value.prop.call_args_list if call.args[1] == "whom"]

    built = scene.build_scene(shot(tmp_path), scene=bpy.context.scene)
    assert asked() == []
    built.kfmocap.retarget.target = built.kfmocap.performers[0].armature
    assert asked() == ["whom"]


def test_the_export_tool_writes_what_was_asked_for(blender, tmp_path):
    original = shot(tmp_path)
    scene.build_scene(original, result_of(original).motions, bpy.context.scene)
    bpy.context.scene.kfmocap.export.fbx = False
    assert bpy.ops.kfmocap.export(directory=str(tmp_path / "new")) == {"FINISHED"}
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["walk.bvh"]
    assert bpy.context.scene.kfmocap.export.written == str(tmp_path / "new" / "walk.bvh")
    assert bpy.ops.kfmocap.export(directory=str(tmp_path / "new"), filename="take 2.bvh") == {"FINISHED"}
    assert {path.name for path in (tmp_path / "new").iterdir()} == {"walk.bvh", "take 2.bvh"}


def test_the_character_of_send_to_rig_is_exported_instead_if_that_is_chosen(blender, tmp_path):
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
            assert joint_error(imported(tmp_path / folder / name), person(1.7), there) < TOLERANCE


@pytest.mark.parametrize("root_motion", [True, False])
def test_characters_of_all_kinds_are_exported_where_blender_shows_them(blender, tmp_path, root_motion):
    """Shifted by delta transforms, kept from being selected, or with feet that hang on the root."""
    body = person(1.7)
    hero = skinned_human(body=body)
    add_bones(hero, [("ground", "", (0, 0, 0), (0, 0.3, 0))])
    with body_armature.edit_bones(hero) as edited:
        edited["foot.L"].use_connect = False
        edited["foot.L"].parent = edited["ground"]
    hero.delta_location, hero.delta_rotation_euler, hero.delta_scale = (1, 2, 0.5), (0, 0, 0.7), (2, 2, 2)
    hero.hide_select = True
    bpy.context.view_layer.update()
    given = motion_of_body(body, motion(4), "man", 60.0)
    send_to_rig(bpy.context.scene, given, hero, 1)
    shown = read_joints(hero, list(body.names), list(range(1, 5)))
    if not root_motion:
        shown = shown - (shown[:, :1] - shown[:1, :1]) * [1.0, 1.0, 0.0]
    options = ExportOptions(formats=("fbx", "glb"), frames=(1, 4), root_motion=root_motion)
    fbx, glb = exporters.export_armatures(bpy.context.scene, [("hero", hero)], tmp_path, options, "hero")
    places, _ = glb_joints(glb, list(body.names))
    assert np.abs(places - shown).max() < 1e-4
    assert np.abs(read_joints(imported(fbx), list(body.names), list(range(1, 5))) - shown).max() < 1e-4


def test_hips_travel_in_blender_though_they_begin_where_a_root_ends(blender, tmp_path):
    """Blender's FBX importer would connect them to it."""
    body = person(1.7)
    hero = skinned_human(body=body)
    add_bones(hero, [("root", "", (0, 0, 0), hero.data.bones[body.names[0]].head_local)])
    with body_armature.edit_bones(hero) as edited:
        edited[body.names[0]].parent = edited["root"]
    send_to_rig(bpy.context.scene, motion_of_body(body, motion(4), "man", 60.0), hero, 1)
    shown = read_joints(hero, list(body.names), list(range(1, 5)))
    options = ExportOptions(formats=("fbx",), frames=(1, 4))
    [fbx] = exporters.export_armatures(bpy.context.scene, [("hero", hero)], tmp_path, options, "hero")
    assert np.ptp(shown[:, 0, 0]) > 0.01
    assert np.abs(read_joints(imported(fbx), list(body.names), list(range(1, 5))) - shown).max() < 1e-4


def test_the_export_goes_beside_the_footage_and_then_where_it_went_last(blender, tmp_path):
    built = scene.build_scene(shot(tmp_path), scene=bpy.context.scene)
    assert destinations.proposed(built) == tmp_path / "walk"
    assert bpy.ops.kfmocap.export() == {"FINISHED"}  # by a script
    assert (tmp_path / "walk.bvh").is_file()
    assert bpy.ops.kfmocap.export(directory=str(tmp_path / "new"), filename="take 2") == {"FINISHED"}
    assert destinations.proposed(built) == tmp_path / "new" / "take 2"
    written = destinations.paths(built, tmp_path / "new", "take 2")
    assert [path.name for path in written] == ["take 2.bvh", "take 2.fbx"] and all(path.exists() for path in written)


EXPECTED = {
    "BLENDER": ("pelvis", "chest", "forearm.L", "shin.R"),
    "UNREAL": ("pelvis", "spine_03", "lowerarm_l", "calf_r"),
    "UNITY": ("Hips", "Chest", "LeftLowerArm", "RightLowerLeg"),
    "MIXAMO": ("mixamorig:Hips", "mixamorig:Spine2", "mixamorig:LeftForeArm", "mixamorig:RightLeg"),
}


@pytest.mark.parametrize("suffix", [".bvh", ".fbx"])
@pytest.mark.parametrize("preset", EXPECTED)
def test_every_presets_motion_read_back_is_the_cores_under_its_names(blender, tmp_path, preset, suffix):
    original = shot(tmp_path)
    scene.build_scene(original, result_of(original).motions, bpy.context.scene)
    armature = exported(tmp_path / "out", suffix, preset=preset)
    body = person(1.7)
    names = [presets.PRESETS[preset].names.get(name, name) for name in body.names]
    assert set(EXPECTED[preset]) <= {bone.name for bone in armature.data.bones} == set(names)
    found = read_joints(armature, names, list(range(1, 13)))
    assert 1000 * np.linalg.norm(found - part_poses(body, motion(12))[1], axis=-1).max() < TOLERANCE
    if suffix == ".fbx":
        assert armature.name == ("root" if preset == "UNREAL" else "man")


@pytest.mark.parametrize("preset", ["UNREAL", "UNITY", "MIXAMO"])
def test_centimetres_are_the_files_unit_and_no_node_is_scaled(blender, tmp_path, preset):
    original = shot(tmp_path)
    scene.build_scene(original, result_of(original).motions, bpy.context.scene)
    armature = exported(tmp_path / "out", ".fbx", preset=preset)
    np.testing.assert_allclose(armature.scale, 0.01, rtol=1e-5)  # what Blender's importer makes of centimetres
    length = np.linalg.norm(person(1.7).offsets[person(1.7).index("shin.L")])
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
def test_an_fbx_file_says_that_y_is_up_and_what_its_unit_is(blender, tmp_path, preset):
    """Blender's importer undoes any axes; other programs take the file by its word."""
    original = shot(tmp_path)
    scene.build_scene(original, result_of(original).motions, bpy.context.scene)
    [path] = exporters.export_performers(bpy.context.scene, tmp_path / "out", ExportOptions(preset, ("fbx",)))
    settings = global_settings(path)
    axes = {axis: (settings[f"{axis}Axis"], settings[f"{axis}AxisSign"]) for axis in ("Up", "Front", "Coord")}
    assert axes == {"Up": (1, 1), "Front": (2, 1), "Coord": (0, 1)}, "Y up, facing +Z, X to the left"
    assert settings["UnitScaleFactor"] == 1.0, "centimetres"


@pytest.mark.parametrize("suffix", [".bvh", ".fbx"])
def test_a_frame_range_alone_is_written(blender, tmp_path, suffix):
    original = shot(tmp_path)
    scene.build_scene(original, result_of(original).motions, bpy.context.scene)
    armature = exported(tmp_path / "out", suffix, frames=(4, 9))
    first = round(armature.animation_data.action.frame_range[0])
    found = read_joints(armature, person(1.7).names, list(range(first, first + 6)))
    assert 1000 * np.linalg.norm(found - part_poses(person(1.7), motion(12)[3:9])[1], axis=-1).max() < TOLERANCE
    assert round(np.ptp(armature.animation_data.action.frame_range)) == 5


@pytest.mark.parametrize("suffix", [".bvh", ".fbx"])
def test_a_shot_that_begins_before_frame_0_is_written_whole(blender, tmp_path, suffix):
    original = shot(tmp_path)
    built = scene.build_scene(original, scene=bpy.context.scene)
    armature = built.kfmocap.performers[0].armature
    for frame in (1, 6, 12):
        key_pose_curves.remove_key_pose(armature, frame)
    built.kfmocap.zero -= 8
    scene.write_motions(built, result_of(original).motions)
    assert built.kfmocap.frame_start == -7
    armature = exported(tmp_path / "out", suffix)
    first = round(armature.animation_data.action.frame_range[0])
    found = read_joints(armature, person(1.7).names, list(range(first, first + 12)))
    assert 1000 * np.linalg.norm(found - part_poses(person(1.7), motion(12))[1], axis=-1).max() < TOLERANCE


@pytest.mark.parametrize("suffix", [".bvh", ".fbx"])
def test_another_rate_shows_the_same_motion_and_rotations_go_the_shortest_way(blender, tmp_path, suffix):
    """At twice the rate every other frame is one of the shot's, and those between are half-way by slerp."""
    original = shot(tmp_path)
    scene.build_scene(original, result_of(original).motions, bpy.context.scene)
    armature = exported(tmp_path / "out", suffix, fps=120.0)
    T, Q = motion(12).translations, motion(12).rotations
    halves = Motion(
        (T[1:] + T[:-1]) / 2, Q[:-1] @ rotations.exp(rotations.log(np.swapaxes(Q[:-1], -1, -2) @ Q[1:]) / 2)
    )
    body = person(1.7)
    found = read_joints(armature, body.names, list(range(1, 24)))
    assert 1000 * np.linalg.norm(found[::2] - part_poses(body, motion(12))[1], axis=-1).max() < TOLERANCE
    assert 1000 * np.linalg.norm(found[1::2] - part_poses(body, halves)[1], axis=-1).max() < TOLERANCE


@pytest.mark.parametrize("suffix", [".bvh", ".fbx"])
def test_without_root_motion_the_performer_stays_over_its_first_place(blender, tmp_path, suffix):
    original = shot(tmp_path)
    scene.build_scene(original, result_of(original).motions, bpy.context.scene)
    armature = exported(tmp_path / "out", suffix, root_motion=False)
    T = motion(12).translations.copy()
    T[:, :2] = T[0, :2]
    expected = part_poses(person(1.7), Motion(T, motion(12).rotations))[1]
    found = read_joints(armature, person(1.7).names, list(range(1, 13)))
    assert 1000 * np.linalg.norm(found - expected, axis=-1).max() < TOLERANCE


def test_an_export_changes_nothing_in_the_scene_and_leaves_nothing_behind(blender, tmp_path):
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
    assert joint_error(armature, person(1.7), motion(12)) < 0.05


def test_the_export_button_says_what_is_missing(blender, tmp_path):
    original = shot(tmp_path)
    built = scene.build_scene(original, scene=bpy.context.scene)
    built.kfmocap.export.bvh = built.kfmocap.export.fbx = False
    with pytest.raises(RuntimeError, match="Choose what kind of files to write"):
        bpy.ops.kfmocap.export(directory=str(tmp_path / "out"))


def test_what_cannot_be_written_is_named_and_leaves_nothing(blender, tmp_path):
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


def test_of_several_files_those_that_were_written_before_one_failed_are_named(blender, tmp_path):
    built = scene.build_scene(shot(tmp_path), scene=bpy.context.scene)
    (tmp_path / "out" / "walk.fbx").mkdir(parents=True)
    with pytest.raises(OutputError, match=r"walk\.fbx: a folder is in the way; before it, walk\.bvh was written"):
        exporters.export_performers(built, tmp_path / "out")
    assert (tmp_path / "out" / "walk.bvh").is_file()


def test_what_blenders_exporter_failed_with_is_said_in_a_line(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """As on a full disk: Blender prints the traceback of an exporter in Python, and has it in its own message."""

    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("io_scene_fbx.export_fbx_bin.save", full)
    with pytest.raises(OutputError) as refused, whole_files.writing(tmp_path / "walk.fbx") as target:
        bpy.ops.export_scene.fbx(filepath=str(target))
    said = "walk.fbx: Blender cannot write it: OSError: [Errno 28] No space left on device (make room on its disk"
    assert said in str(refused.value)
    assert "Traceback" not in "".join(capfd.readouterr())
    assert not list(tmp_path.iterdir())


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
def test_an_fbx_file_states_its_axes_and_its_unit(blender, tmp_path, preset):
    original = shot(tmp_path)
    built = scene.build_scene(original, result_of(original).motions, bpy.context.scene)
    [path] = exporters.export_performers(built, tmp_path, ExportOptions(preset, ("fbx",)))
    axes = ("UpAxis", "UpAxisSign", "FrontAxis", "FrontAxisSign", "CoordAxis", "CoordAxisSign")
    assert [fbx_setting(path, axis) for axis in axes] == [1, 1, 2, 1, 0, 1]
    assert fbx_setting(path, "UnitScaleFactor") == 1.0  # centimetres


def test_every_format_has_a_property_and_a_writer(blender):
    settings = bpy.context.scene.kfmocap.export
    for name, known in EXPORT_FORMATS.items():
        assert settings.bl_rna.properties[name].name == known.label
        assert getattr(settings, name) == known.is_default
    assert set(exporters._WRITERS) == set(EXPORT_FORMATS)


@pytest.mark.parametrize("kind", ["bvh", "fbx", "glb", "vrma"])
def test_a_missing_exporter_is_named_before_anything_is_written(blender, tmp_path, kind):
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
def test_windows_show_the_scene_that_they_showed_before(blender, tmp_path, kind):
    """Blender's exporters may turn a window to the scene that they write; removing that shows the file's first."""
    window = bpy.context.window_manager.windows[0]
    shown = bpy.data.scenes.new("zz shown")
    window.scene = shown
    scene.build_scene(shot(tmp_path), scene=shown)
    armature = shown.kfmocap.performers[0].armature
    getattr(exporters, f"export_{kind}")(tmp_path / f"walk.{kind}", armature, shown, ExportOptions())
    assert window.scene == shown


@pytest.mark.parametrize("whose", ["shot", "performer"])
def test_a_name_that_cannot_be_a_files_is_named_as_the_scene_has_it(blender, tmp_path, whose):
    """Not as a shot file would, which there is none of."""
    built = scene.build_scene(shot(tmp_path, ("man", "woman")), scene=bpy.context.scene)
    if whose == "shot":
        built.kfmocap.shot = "a/b"
    else:
        built.kfmocap.performers[1].name = "a/b"
    with pytest.raises(ShotError, match=rf"scene {built.name}, {whose}'s name: 'a/b' cannot be a file's name"):
        exporters.export_performers(built, tmp_path)
