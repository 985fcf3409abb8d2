"""People who are not wholly in the picture: marks on the bones, colours, the panel, and files without such bones."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from addon_shots import motion, person, shot, track_result  # noqa: E402
from kfmocap.core.shot.shot import KeyPoses  # noqa: E402
from kfmocap.kfmocap_addon import panels  # noqa: E402
from kfmocap.kfmocap_addon.export import exporters  # noqa: E402
from kfmocap.kfmocap_addon.export.export_options import ExportOptions  # noqa: E402
from kfmocap.kfmocap_addon.scene_io import scene  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.review import review_data, unknown_bones  # noqa: E402

pytest_plugins = ("addon_fixtures",)

pytestmark = pytest.mark.blender

LEG = ("thigh.L", "shin.L", "foot.L")


def shown(folder):
    """A scene of somebody whose left leg nothing shows, so that it rests, and that nothing showed the right foot."""
    original = shot(folder)
    (man,) = original.performers
    poses = man.key_poses.poses
    poses.rotations[:, [person().index(name) for name in LEG]] = np.eye(3)
    original = replace(original, performers=(replace(man, unknown=LEG),))
    built = scene.build_scene(original, scene=bpy.context.scene)
    result = track_result(original, [motion(original.length)], unknown=((*LEG, "foot.R"),))
    review_data.write_review(built, [(original, result, 0)])
    return built, built.kfmocap.performers[0].armature


def test_what_rests_comes_back_with_the_shot_until_a_key_pose_turns_it(blender, tmp_path):
    built, armature = shown(tmp_path)
    assert set(unknown_bones.unknown_bones(armature)) == {*LEG, "foot.R"}
    (man,) = scene.shot_from_scene(built).performers
    assert man.unknown == LEG  # the foot that no camera saw is not held: the next camera may see it
    bone = armature.pose.bones["shin.L"]
    bone.rotation_quaternion = (0.9, 0.4, 0.0, 0.0)
    bone.keyframe_insert("rotation_quaternion", frame=1)
    (man,) = scene.shot_from_scene(built).performers
    assert man.unknown == ("thigh.L", "foot.L")


def test_the_panel_and_the_colours_tell_it(blender, tmp_path):
    built, armature = shown(tmp_path)
    labels = []
    layout = SimpleNamespace(
        label=lambda text, icon="NONE": labels.append(text),
        operator=lambda *_, **__: SimpleNamespace(),
        prop=lambda *_, **__: None,
        separator=lambda: None,
    )
    layout.column = layout.row = lambda align=False: layout
    panels.review_panel.ReviewPanel.draw_content(SimpleNamespace(layout=layout), bpy.context)
    assert labels[:5] == ["man: nothing shows", "thigh.L", "shin.L", "foot.L", "foot.R"]
    assert labels[5] == "man: every other part is seen"
    assert "man: feet on the ground" in labels
    labels.clear()
    bpy.ops.kfmocap.add_body()  # and chosen, but not tracked
    panels.review_panel.ReviewPanel.draw_content(SimpleNamespace(layout=layout), bpy.context)
    assert labels and not any("feet on the ground" in text for text in labels)
    built.kfmocap.show_confidence = True
    bpy.context.view_layer.update()
    colours = {name: tuple(armature.pose.bones[name].color.custom.normal) for name in ("shin.L", "shin.R")}
    assert colours["shin.L"] == pytest.approx((0.4, 0.4, 0.4))
    assert colours["shin.R"] != pytest.approx((0.4, 0.4, 0.4))


@pytest.mark.parametrize("suffix", ["bvh", "fbx"])
def test_files_leave_out_its_bones_on_request(blender, tmp_path, suffix):
    built, armature = shown(tmp_path)
    for left_out in (False, True):
        path = tmp_path / f"man_{left_out}.{suffix}"
        options = ExportOptions(leave_out_unknown=left_out)
        getattr(exporters, f"export_{suffix}")(path, armature, built, options)
        written = path.read_bytes()
        assert (b"shin.L" in written, b"foot.R" in written) == (not left_out, not left_out)
        assert b"shin.R" in written
    assert len(armature.data.bones) == len(person())


def test_other_scenes_have_no_marks(blender, tmp_path):
    built = scene.build_scene(shot(tmp_path), scene=bpy.context.scene)
    armature = built.kfmocap.performers[0].armature
    assert not unknown_bones.unknown_bones(armature)
    assert not any(unknown_bones.UNKNOWN in bone for bone in armature.pose.bones)
    assert unknown_bones.resting_bones(armature, KeyPoses.whole([], motion(0))) == ()
