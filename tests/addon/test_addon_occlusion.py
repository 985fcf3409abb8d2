"""What the cameras saw is in the scene: on the bones, in the panel, and never taken for the animator's work."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from addon_shots import PARTS, motion, person, shot, track_result  # noqa: E402
from kfmocap.cli.services import OutputRequest  # noqa: E402
from kfmocap.kfmocap_addon import panels  # noqa: E402
from kfmocap.kfmocap_addon.export import blender_outputs, exporters  # noqa: E402
from kfmocap.kfmocap_addon.export.export_options import ExportOptions  # noqa: E402
from kfmocap.kfmocap_addon.scene_io import fcurves, scene  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.keys import key_pose_curves  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.review import bone_visibility  # noqa: E402

pytest_plugins = ("addon_fixtures",)

pytestmark = pytest.mark.blender

FRAMES, START = 24, 1
HAND = person().index("hand.L")


def sights(*hidden: tuple[int, int, int, int], views: int = 2) -> np.ndarray:
    """Visible shares of all parts, of which some (view, part, first, last) are hidden."""
    share = np.ones((views, FRAMES, len(person())))
    for view, part, first, last in hidden:
        share[view, first : last + 1, part] = 0.1
    return share


def hidden(slot, frame: int) -> list[str]:
    """What no camera sees of a performer on a frame of the scene."""
    bpy.context.scene.frame_set(frame)
    return bone_visibility.hidden_parts(slot.armature)


UNSEEN = sights((0, HAND, 5, 14), (1, HAND, 7, 16))


def tracked(folder, share=UNSEEN):
    original = shot(folder, frames=FRAMES)
    built = scene.build_scene(original, [motion(FRAMES)], bpy.context.scene)
    bone_visibility.write_occlusion(built, original, [share])
    return built, built.kfmocap.performers[0].armature, original


def views_curve(armature, bone="hand.L"):
    return fcurves.find_channelbag(armature).fcurves.find(f'pose.bones["{bone}"]["{bone_visibility.VIEWS}"]')


def test_each_bone_carries_the_number_of_cameras_that_see_it(blender, tmp_path):
    built, armature, _ = tracked(tmp_path)
    counts = (UNSEEN > 0.3).sum(axis=0)
    for frame in range(FRAMES):
        built.frame_set(START + frame)
        for part, name in enumerate(person().names):
            assert armature.pose.bones[name][bone_visibility.VIEWS] == counts[frame, part]


def test_there_are_keys_only_where_the_number_changes(blender, tmp_path):
    _, armature, _ = tracked(tmp_path)
    keys = fcurves.get_keys(views_curve(armature))
    assert keys["co"].tolist() == [[1, 2], [6, 1], [8, 0], [16, 1], [18, 2]]
    assert set(keys["interpolation"]) == {fcurves.enum_value("interpolation", "CONSTANT")}
    assert set(keys["type"]) == {fcurves.enum_value("type", "GENERATED")}
    assert len(fcurves.get_keys(views_curve(armature, "head"))) == 1
    assert views_curve(armature).group.name == "hand.L"


def test_the_property_explains_itself(blender, tmp_path):
    _, armature, _ = tracked(tmp_path)
    shown = armature.pose.bones["hand.L"].id_properties_ui(bone_visibility.VIEWS).as_dict()
    assert "Cameras that see this part" in shown["description"]
    assert (shown["min"], shown["max"]) == (0, 2)


def test_the_next_tracking_replaces_it(blender, tmp_path):
    built, armature, original = tracked(tmp_path)
    bone_visibility.write_occlusion(built, original, [sights((0, HAND, 2, 3), views=1)])
    assert fcurves.get_keys(views_curve(armature))["co"].tolist() == [[1, 1], [3, 0], [5, 1]]
    assert armature.pose.bones["hand.L"].id_properties_ui(bone_visibility.VIEWS).as_dict()["max"] == 1
    assert not built.kfmocap.performers[0].suggestions
    assert sum(bone_visibility.VIEWS in curve.data_path for curve in fcurves.find_channelbag(armature).fcurves) == PARTS


def test_the_animators_keys_and_key_poses_stay(blender, tmp_path):
    built, armature, original = tracked(tmp_path)
    armature.pose.bones["hand.L"]["strength"] = 0.5
    armature.pose.bones["hand.L"].keyframe_insert('["strength"]', frame=4)

    def others():
        bag = fcurves.find_channelbag(armature)
        return {
            (c.data_path, c.array_index): fcurves.get_keys(c).tobytes()
            for c in bag.fcurves
            if bone_visibility.VIEWS not in c.data_path
        }

    before = others()
    bone_visibility.write_occlusion(built, original, [sights((1, 3, 9, 11))])
    assert others() == before
    # Whole-character keying sets key custom properties too: still no key pose.
    armature.pose.bones["hand.L"].keyframe_insert(f'["{bone_visibility.VIEWS}"]', frame=13)
    assert key_pose_curves.read_key_poses(armature, START, FRAMES).frames.tolist() == [0, 5, FRAMES - 1]


def test_a_saved_scene_still_says_what_was_hidden(blender, tmp_path):
    original = shot(tmp_path, frames=FRAMES)
    result = track_result(original, [motion(FRAMES)], (UNSEEN,))
    blender_outputs.write_blender_outputs(original, result, OutputRequest(tmp_path / "out"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "out" / "shot.blend"))
    slot = bpy.context.scene.kfmocap.performers[0]
    assert hidden(slot, 8) == ["hand.L"]
    assert not hidden(slot, 7) and not hidden(slot, 16)
    assert [(s.frame, s.name, tuple(s.hidden)) for s in slot.suggestions] == [(16, "hand.L", (8, 15))]


def test_a_batch_of_an_open_scene_writes_it_too(blender, tmp_path):
    original = shot(tmp_path, frames=FRAMES)
    built = scene.build_scene(original, scene=bpy.context.scene)
    result = track_result(original, [motion(FRAMES)], (UNSEEN,))
    blender_outputs.write_blender_outputs(original, result, OutputRequest(tmp_path / "out", open_scene=True))
    assert hidden(built.kfmocap.performers[0], 8) == ["hand.L"]


@pytest.mark.parametrize("suffix", ["bvh", "fbx"])
def test_exports_are_the_same_without_it(blender, tmp_path, suffix):
    built, armature, _ = tracked(tmp_path)

    def channels():
        path = tmp_path / f"man.{suffix}"
        getattr(exporters, f"export_{suffix}")(path, armature, built, ExportOptions())
        return path.read_bytes() if suffix == "bvh" else path.stat().st_size

    exported = channels()
    for bone in armature.pose.bones:
        fcurves.find_channelbag(armature).fcurves.remove(views_curve(armature, bone.name))
        del bone[bone_visibility.VIEWS]
    assert exported == channels()


class Layout:
    """Records what a panel draws."""

    def __init__(self) -> None:
        self.labels, self.buttons = [], []

    def column(self, align: bool = False) -> Layout:
        return self

    row = column

    def separator(self) -> None:
        pass

    def prop(self, _owner: object, _name: str, **_how: object) -> None:
        pass

    def label(self, text: str, icon: str = "NONE") -> None:
        self.labels.append(text)

    def operator(self, _name: str, text: str = "", icon: str = "NONE") -> SimpleNamespace:
        self.buttons.append(SimpleNamespace(text=text))
        return self.buttons[-1]


def drawn(frame):
    bpy.context.scene.frame_set(frame)
    layout = Layout()
    panels.review_panel.ReviewPanel.draw_content(SimpleNamespace(layout=layout), bpy.context)
    return layout


def test_the_panel_lists_what_no_camera_sees_on_the_current_frame(blender, tmp_path):
    tracked(tmp_path)
    assert drawn(8).labels[:2] == ["man: no camera sees", "hand.L"]
    assert drawn(7).labels[0] == "man: every part is seen"


def test_the_panel_jumps_to_suggested_key_frames(blender, tmp_path):
    built, _, _ = tracked(tmp_path)
    button = next(button for button in drawn(1).buttons if ":" in button.text)
    assert button.text == "16: hand.L"
    assert "by no camera on frames 8 to 15" in button.reason
    assert bpy.ops.kfmocap.go_to_frame(frame=button.frame, reason=button.reason) == {"FINISHED"}
    assert built.frame_current == 16


def test_before_any_tracking_the_panel_says_so(blender, tmp_path):
    built = scene.build_scene(shot(tmp_path), scene=bpy.context.scene)
    assert drawn(1).labels == ["Not tracked yet: use Track All"]
    assert not hidden(built.kfmocap.performers[0], 1)
    bpy.data.objects.remove(built.kfmocap.performers[0].armature)
    assert drawn(1).labels == ["Not tracked yet: use Track All"]
