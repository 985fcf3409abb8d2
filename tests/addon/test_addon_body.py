"""Bodies are added, taken, edited and reshaped in Blender, and the tracker uses what is there then."""

from __future__ import annotations

import pickle
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from addon_shots import joint_error, motion, person, shot  # noqa: E402
from kfmocap.core.body import human  # noqa: E402
from kfmocap.core.body.measures.proportions import measured  # noqa: E402
from kfmocap.core.body.motion import Motion  # noqa: E402
from kfmocap.core.errors import BodyError  # noqa: E402
from kfmocap.core.shot.shot import KeyPoses  # noqa: E402
from kfmocap.kfmocap_addon.operators.performers.edit_body import LENGTHS  # noqa: E402
from kfmocap.kfmocap_addon.operators.performers.fit_body import FitBody  # noqa: E402
from kfmocap.kfmocap_addon.scene_io import scene  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.body import body_armature  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.keys import key_pose_curves  # noqa: E402
from mathutils import Matrix, Vector  # noqa: E402
from ready_scenes import fitted  # noqa: E402

pytest_plugins = ("addon_fixtures",)

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("blender")]


@pytest.fixture
def armature(blender):
    bpy.ops.kfmocap.add_body(height=1.8)
    return bpy.context.scene.kfmocap.performers[0].armature


def pose_mode(armature, bone):
    bpy.context.view_layer.objects.active = armature
    bpy.ops.object.mode_set(mode="POSE")
    armature.data.bones.active = armature.data.bones[bone]


def of(armature, name):
    body = body_armature.body_from_armature(armature)
    return body.parts[body.index(name)]


def test_a_body_has_the_height_and_the_lengths_asked_for():
    bpy.ops.kfmocap.add_body(performer="she", height=1.62, measured=True, thigh=0.41)
    (slot,) = bpy.context.scene.kfmocap.performers
    assert (slot.name, slot.armature.name) == ("she", "she")
    expected = human(1.62, {"thigh": 0.41})
    for got, part in zip(body_armature.body_from_armature(slot.armature).parts, expected.parts, strict=True):
        assert np.array_equal(got.head_world, part.head_world) and np.array_equal(got.vertices, part.vertices)
    assert bpy.context.active_object == slot.armature
    bpy.ops.kfmocap.add_body(performer="she", height=1.62)
    assert [slot.name for slot in bpy.context.scene.kfmocap.performers] == ["she", "she 2"]


def test_bodies_stand_beside_each_other():
    for _ in range(3):
        bpy.ops.kfmocap.add_body()
    places = np.array([slot.armature.location for slot in bpy.context.scene.kfmocap.performers])
    apart = np.linalg.norm(places[:, None] - places, axis=-1)
    assert (apart[np.triu_indices(3, 1)] > 0.5).all()


def test_a_body_stands_beside_where_others_are_posed():
    """Two performers who stand to the left and right of the cursor, as key poses have them."""
    for x in (-0.5, 1.2):
        bpy.ops.kfmocap.add_body()
        armature = bpy.context.scene.kfmocap.performers[-1].armature
        armature.location = (0, 0, 0)
        root = armature.pose.bones[0]
        root.location = armature.matrix_world.to_3x3() @ root.bone.matrix_local.to_3x3().inverted() @ Vector((x, 0, 0))
    bpy.ops.kfmocap.add_body()
    roots = [slot.armature.pose.bones[0] for slot in bpy.context.scene.kfmocap.performers]
    bpy.context.view_layer.update()
    places = np.array([(bone.id_data.matrix_world @ bone.head).xy for bone in roots])
    assert places[0, 0] == pytest.approx(-0.5) and places[1, 0] == pytest.approx(1.2)
    apart = np.linalg.norm(places[:, None] - places, axis=-1)
    assert (apart[np.triu_indices(3, 1)] > 0.7).all()


def test_a_body_stands_at_the_cursor():
    bpy.context.scene.cursor.location = (1, 2, 0)
    bpy.ops.kfmocap.add_body()
    armature = bpy.context.scene.kfmocap.performers[0].armature
    bpy.context.view_layer.update()
    pelvis = body_armature.body_from_armature(armature).parts[0].head_world
    assert np.allclose(pelvis, human(1.75).parts[0].head_world + [1, 2, 0], atol=1e-6)


def test_the_add_menu_offers_a_body():
    entries = [item.__name__ for item in bpy.types.VIEW3D_MT_armature_add._dyn_ui_initialize()]
    assert "add_to_menu" in entries


def test_a_part_edited_by_the_animator_is_the_one_that_is_tracked(armature):
    before = of(armature, "forearm.L").vertices
    pose_mode(armature, "forearm.L")
    assert bpy.ops.kfmocap.edit_part() == {"FINISHED"}
    assert bpy.context.mode == "EDIT_MESH" and bpy.context.active_object.parent_bone == "forearm.L"
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.transform.resize(value=(2, 1, 1), orient_type="LOCAL", center_override=(0, 0, 0))
    assert not np.array_equal(of(armature, "forearm.L").vertices, before)  # even while it is being edited
    assert bpy.ops.kfmocap.finish_part(mirror=True) == {"FINISHED"}
    assert bpy.context.mode == "POSE" and bpy.context.active_object == armature
    left, right = of(armature, "forearm.L").vertices, of(armature, "forearm.R").vertices
    assert not np.allclose(np.ptp(left, axis=0), np.ptp(before, axis=0), rtol=0.2)
    order = [np.lexsort(v.round(5).T) for v in (left * [-1, 1, 1], right)]
    assert np.allclose((left * [-1, 1, 1])[order[0]], right[order[1]], atol=1e-6)
    assert all(child.hide_select for child in armature.children)


def test_a_part_with_more_vertices_than_before_is_read(armature):
    child = bpy.data.objects["Performer head"]
    count = len(child.data.vertices)
    child.data.vertices.add(1)
    child.data.vertices[count].co = (0.0, 0.4, 0.0)
    assert len(of(armature, "head").vertices) == count + 1
    assert of(armature, "head").vertices[:, 1].max() == pytest.approx(0.4)


def test_a_flat_part_is_refused_by_name(armature):
    child = bpy.data.objects["Performer shin.R"]
    for vertex in child.data.vertices:
        vertex.co.x = 0
    with pytest.raises(BodyError, match=r"shin\.R.*volume"):
        body_armature.body_from_armature(armature)


def test_any_armature_with_meshes_on_its_bones_becomes_a_performer(armature):
    bpy.ops.kfmocap.remove_performer(performer=0)
    assert not bpy.context.scene.kfmocap.performers and armature.name in bpy.context.scene.objects
    assert bpy.ops.kfmocap.use_armature() == {"FINISHED"}
    assert bpy.context.scene.kfmocap.performers[0].armature == armature
    assert not bpy.ops.kfmocap.use_armature.poll()


@pytest.mark.parametrize("moved", [False, True])
def test_a_reshaped_armature_is_the_new_body_and_keeps_its_keys(armature, moved):
    if moved:
        armature.matrix_world = Matrix.Translation((1, -2, 0.5)) @ Matrix.Rotation(0.7, 4, "Z")
        bpy.context.view_layer.update()
    truth = motion(6)
    key_pose_curves.write_key_poses(armature, KeyPoses.whole([0, 3, 5], truth[[0, 3, 5]]), 1)
    before = body_armature.body_from_armature(armature)
    root = before.parts[0]
    other = replace(before, parts=tuple(replace(p, vertices=1.1 * p.vertices) for p in before.parts))
    longer = other.parts[other.index("forearm.L")]
    longer = replace(longer, tail_world=longer.head_world + 1.2 * (longer.tail_world - longer.head_world))
    other = replace(other, parts=tuple(longer if p.name == "forearm.L" else p for p in other.parts))
    body_armature.reshape(armature, other)
    bpy.context.view_layer.update()
    read = body_armature.body_from_armature(armature)
    for got, part in zip(read.parts, other.parts, strict=True):
        assert np.abs(got.vertices - part.vertices).max() < 2e-6
        assert np.abs(got.tail_world - part.tail_world).max() < 2e-6
        assert np.abs(got.R_world_rest - part.R_world_rest).max() < 2e-6
    assert np.array_equal(read.parts[0].head_world, root.head_world)
    keys = key_pose_curves.read_key_poses(armature, 1, 6)
    assert np.abs(keys.poses.difference(truth[[0, 3, 5]])).max() < 1e-5
    poses = Motion(truth.translations[:1], truth.rotations[:1])
    assert joint_error(armature, read, poses) < 0.05


@pytest.fixture
def fitter(monkeypatch):
    """Stands in for the fit: makes every body a tenth larger and moves its key poses by 1 cm."""
    from kfmocap.core.fitting import body_fit

    monkeypatch.setattr(body_fit, "fit_bodies", fitted)


@pytest.mark.parametrize("adjusted", [False, True])
def test_a_fitted_body_takes_the_old_ones_place(tmp_path, fitter, adjusted):
    original = shot(tmp_path)
    built = scene.build_scene(original, scene=bpy.context.scene)
    armature = built.kfmocap.performers[0].armature
    before, keys = (
        body_armature.body_from_armature(armature),
        key_pose_curves.read_key_poses(armature, 1, original.length),
    )
    assert bpy.ops.kfmocap.fit_body(adjust_poses=adjusted) == {"FINISHED"}
    read = scene.shot_from_scene(built).performers[0]
    assert np.allclose(read.body.offsets[1:], 1.1 * before.offsets[1:], atol=1e-6)
    assert np.array_equal(read.key_poses.frames, keys.frames) and read.key_poses.fixed.all()
    shift = keys.poses.difference(read.key_poses.poses)
    assert np.allclose(shift[:, :3], 0.01 if adjusted else 0, atol=1e-5) and np.abs(shift[:, 3:]).max() < 1e-5


def test_the_tooltip_says_whether_key_poses_move_with_the_fit():
    alone, both = (FitBody.description(bpy.context, SimpleNamespace(adjust_poses=moved)) for moved in (False, True))
    assert "move your key poses" not in alone and "\n" not in alone
    assert both.startswith(alone) and "move your key poses" in both


def test_the_work_of_a_fit_can_go_to_another_process(tmp_path):
    scene.build_scene(shot(tmp_path), scene=bpy.context.scene)
    work = pickle.loads(pickle.dumps(FitBody.prepare(None, bpy.context)))
    assert [view.camera.name for view in work.args[0].views] == ["cam01", "cam02"]


def test_the_model_is_drawn_as_asked(armature):
    shot = bpy.context.scene.kfmocap
    for display, hidden, kind in (("OUTLINE", True, "WIRE"), ("SOLID", False, "SOLID"), ("WIRE", False, "WIRE")):
        shot.display = display
        assert {c.hide_viewport for c in armature.children} == {hidden}
        assert {c.display_type for c in armature.children} == {kind}
        assert len(body_armature.body_from_armature(armature)) == len(person())


def test_height_is_a_field_that_scales_the_body_and_leaves_it_on_its_feet(armature):
    slot = bpy.context.scene.kfmocap.performers[0]
    sole = min(float(np.min(part.vertices @ part.R_world_rest[2] + part.head_world[2])) for part in parts_of(armature))
    tall, girth = slot.height, np.ptp(of(armature, "thigh.L").vertices, axis=0)
    assert tall == pytest.approx(1.8, abs=0.03)
    slot.height = 1.2
    bpy.context.view_layer.update()
    assert slot.height == pytest.approx(1.2, abs=1e-5)
    found = [float(np.min(part.vertices @ part.R_world_rest[2] + part.head_world[2])) for part in parts_of(armature)]
    assert min(found) == pytest.approx(sole, abs=1e-4)
    np.testing.assert_allclose(np.ptp(of(armature, "thigh.L").vertices, axis=0), girth * 1.2 / tall, rtol=1e-4)


@pytest.mark.parametrize(
    ("name", "value"), [("upper_arm", 0.25), ("shoulder_width", 0.5), ("torso", 0.6), ("foot", 0.3)]
)
def test_a_proportion_is_a_field_that_changes_nothing_else(armature, name, value):
    slot = bpy.context.scene.kfmocap.performers[0]
    others = [*LENGTHS[:-1], "foot"]
    before = {other: getattr(slot, other) for other in others}
    assert before[name] == pytest.approx(measures_of(human(1.8), name), abs=1e-5)
    setattr(slot, name, value)
    after = {other: getattr(slot, other) for other in others}
    assert after == pytest.approx(before | {name: value}, abs=1e-5)


def measures_of(body, name):
    ends = {part.name: (part.head_world, part.tail_world) for part in body.parts}
    return measured(ends, name)


def parts_of(armature):
    bpy.context.view_layer.update()
    return body_armature.body_from_armature(armature).parts
