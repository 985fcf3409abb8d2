"""The add-on's keys and its tool, and its menu entries beside Blender's."""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

bpy = pytest.importorskip("bpy")

from addon_shots import shot  # noqa: E402
from bl_ui.space_toolsystem_toolbar import VIEW3D_PT_tools_active  # noqa: E402
from kfmocap import kfmocap_addon  # noqa: E402
from kfmocap.kfmocap_addon import keymap  # noqa: E402
from kfmocap.kfmocap_addon.scene_io import scene  # noqa: E402

pytest_plugins = ("addon_fixtures",)

pytestmark = pytest.mark.blender
SEEN_IN_3D_VIEWS = {"Window", "Screen", "Frames", "3D View", "3D View Generic", "Object Mode", "Pose"}


def test_no_key_of_blenders_is_taken_away(blender, monkeypatch):
    """Blender's own keymap as its preset file has it: without a window it is not loaded."""
    [folder] = [p for s in bpy.utils.script_paths() if (p := Path(s, "presets/keyconfig/keymap_data")).is_dir()]
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.delitem(sys.modules, "blender_default", raising=False)
    import blender_default

    taken = {
        (item["type"], bool(item.get("ctrl")), bool(item.get("alt")), bool(item.get("shift")))
        for name, _, content in blender_default.generate_keymaps(blender_default.Params())
        if name in SEEN_IN_3D_VIEWS
        for _, item, _ in content["items"]
    }
    assert len(taken) > 100
    assert not {(key, True, True, False) for key, _, _ in keymap.KEYS} & taken


def test_every_key_calls_a_tool_that_there_is(blender):
    assert len({key for key, _, _ in keymap.KEYS}) == len(keymap.KEYS)
    for _, tool, settings in keymap.KEYS:
        category, name = tool.split(".")
        properties = getattr(getattr(bpy.ops, category), name).get_rna_type().properties
        assert set(settings) <= set(properties.keys()), tool
    assert hasattr(bpy.types, "KFMOCAP_MT_pie")


def test_the_preferences_tell_forward_from_backward():
    items = [SimpleNamespace(idname=tool, name=tool, properties=SimpleNamespace(**s)) for _, tool, s in keymap.KEYS]
    names = [keymap.name_of(item) for item in items]
    assert len(set(names)) == len(names)
    assert {"Next View", "Previous View", "Next Key Pose", "Previous Key Pose", "Pie Menu"} < set(names)


def test_one_steps_through_key_poses_and_suggestions(blender, tmp_path):
    built = scene.build_scene(shot(tmp_path), scene=bpy.context.scene)
    start, step = built.kfmocap.frame_start, bpy.ops.kfmocap.step_key_pose
    keys = [start + int(f) for f in shot(tmp_path).performers[0].key_poses.frames]
    built.frame_set(keys[0])
    assert step() == {"FINISHED"} and built.frame_current == keys[1]
    built.frame_set(keys[-1])
    assert step() == {"CANCELLED"} and step(backward=True) == {"FINISHED"} and built.frame_current == keys[-2]
    assert not bpy.ops.kfmocap.next_suggestion.poll(), "no frame is suggested"
    for frame in (7, 3):
        built.kfmocap.performers[0].helpful.add().frame = frame
    visited = []
    for _ in range(3):
        bpy.ops.kfmocap.next_suggestion()
        visited.append(built.frame_current)
    assert visited in ([3, 7, 3], [7, 3, 7])


def tools_in(mode: str) -> list[str]:
    """Names of the tools in the toolbar of 3D views."""
    shown = VIEW3D_PT_tools_active._tools[mode]
    return [tool.idname for tool in VIEW3D_PT_tools_active._tools_flatten(shown) if tool is not None]


@pytest.mark.parametrize("mode", ["OBJECT", "POSE"])
def test_place_joints_is_in_the_toolbar_while_the_add_on_is(mode):
    before = tools_in(mode)
    for _ in range(2):
        kfmocap_addon.register()
        assert tools_in(mode) == [*before, "kfmocap.place_joints_tool"]
        [keys] = [
            keys
            for keys in bpy.context.window_manager.keyconfigs.addon.keymaps
            if keys.name.endswith(f"{mode.title()}, Place Joints")
        ]
        assert [item.idname for item in keys.keymap_items] == ["kfmocap.place_joints"]
        kfmocap_addon.unregister()
        assert tools_in(mode) == before


def test_shots_are_imported_and_motion_exported_from_the_file_menu(blender):
    for menu, label in (("import", "KF Mocap Shot (.toml)"), ("export", "KF Mocap Motion")):
        drawn: list[str] = []
        layout = SimpleNamespace(operator=lambda _name, text="", drawn=drawn, **_more: drawn.append(text))
        entries = getattr(bpy.types, f"TOPBAR_MT_file_{menu}")._dyn_ui_initialize()
        for entry in entries:
            if entry.__module__.startswith("kfmocap."):
                entry(SimpleNamespace(layout=layout), bpy.context)
        assert drawn == [label]
