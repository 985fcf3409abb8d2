"""Characters as riggers and animators leave them: motion is sent, and limbs point where the performer's do."""

from __future__ import annotations

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from addon_shots import joint_error  # noqa: E402
from kfmocap.core.body.skeleton_motion import motion_of_body  # noqa: E402
from kfmocap.core.errors import BodyError  # noqa: E402
from kfmocap.core.retargeting.transfer import RetargetOptions  # noqa: E402
from kfmocap.kfmocap_addon.retargeting.live import LiveSource, stop_following  # noqa: E402
from kfmocap.kfmocap_addon.retargeting.rigs.overrides import editable  # noqa: E402
from kfmocap.kfmocap_addon.retargeting.rigs.rig_curves import CurveOptions  # noqa: E402
from kfmocap.kfmocap_addon.retargeting.send import SendOptions, send_to_rig  # noqa: E402
from kfmocap.kfmocap_addon.retargeting.target_armatures import find_target  # noqa: E402
from kfmocap.kfmocap_addon.retargeting.tracked_bodies.skinned_body import use_as_body  # noqa: E402
from kfmocap.kfmocap_addon.scene_io import fcurves  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.body import body_armature  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.keys import motion_curves  # noqa: E402
from mathutils import Matrix  # noqa: E402
from odd_characters import (  # noqa: E402
    BODY,
    CONTROL,
    add_bones,
    bind,
    bone_names,
    layered_human,
    linked,
    points_of,
    shown_heads,
    skinned_human,
)
from synthetic import swing  # noqa: E402

pytest_plugins = ("addon_fixtures",)

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("blender")]

FRAMES = 8
WAYS = [
    *(
        (f"{upper}.{side}", f"{lower}.{side}")
        for side in "LR"
        for upper, lower in (("thigh", "shin"), ("shin", "foot"), ("upper_arm", "forearm"), ("forearm", "hand"))
    ),
    ("thigh.L", "thigh.R"),
    ("upper_arm.L", "upper_arm.R"),
]
"""Pairs of joints: limbs, hips and shoulders."""


def sent(armature):
    """Send any poses to a character; returns the report."""
    return send_to_rig(bpy.context.scene, motion(), armature, 1)


def motion():
    return motion_of_body(BODY, swing(BODY, FRAMES, 0.3), "man", 30.0)


def shown(armature):
    """Orientations (F, B, 3, 3) and heads (F, B, 3) of the bones of the body as Blender shows them."""
    turns, heads = [], []
    for frame in range(1, FRAMES + 1):
        bpy.context.scene.frame_set(frame)
        posed = armature.evaluated_get(bpy.context.evaluated_depsgraph_get())
        matrices = [np.array(posed.matrix_world @ posed.pose.bones[name].matrix) for name in BODY.names]
        turns.append([matrix[:3, :3] for matrix in matrices])
        heads.append([matrix[:3, 3] for matrix in matrices])
    return np.array(turns), np.array(heads)


def worst_degrees(armature) -> float:
    """How far limbs point elsewhere than the performer's, and hands, feet and head are turned, at most."""
    given = motion()
    own = given.positions[:, given.rest.indices(BODY.names)]
    turns, heads = shown(armature)
    a, b = ([BODY.index(pair[k]) for pair in WAYS] for k in (0, 1))
    ways = [joints[:, b] - joints[:, a] for joints in (heads, own)]
    unit = [way / np.linalg.norm(way, axis=-1, keepdims=True) for way in ways]
    aside = np.arccos(np.clip(np.sum(unit[0] * unit[1], axis=-1), -1, 1)).max()
    ends = [BODY.index(name) for name in ("head", "hand.L", "hand.R", "foot.L", "foot.R")]
    wanted = given.turns[:, given.rest.indices(BODY.names)][:, ends]
    rest = np.array([np.array(armature.data.bones[BODY.names[k]].matrix_local)[:3, :3] for k in ends])
    apart = np.swapaxes(wanted @ rest, -1, -2) @ turns[:, ends]
    turned = np.arccos(np.clip((np.trace(apart, axis1=-2, axis2=-1) - 1) / 2, -1, 1)).max()
    return float(np.degrees(max(aside, turned)))


def test_bones_that_do_not_inherit_rotation_are_turned_as_the_others():
    armature = skinned_human()
    for name in ("upper_arm.L", "upper_arm.R", "thigh.L", "head"):
        armature.data.bones[name].use_inherit_rotation = False
    report = sent(armature)
    assert report["warnings"] == []
    assert worst_degrees(armature) < 0.1


def hung_on(armature, bones):
    """Hang bones elsewhere, where they stand."""
    with body_armature.edit_bones(armature) as edited:
        for name, other in bones.items():
            edited[name].use_connect = False
            edited[name].parent = edited[other] if other else None


@pytest.mark.parametrize(
    "bones",
    [
        {"foot.L": "ground", "foot.R": "ground"},
        {"foot.L": "", "hand.R": "pelvis"},
        {"spine": "", "head": "", "thigh.R": "ground"},
    ],
    ids=["feet on the root", "a foot on nothing and a hand on the hips", "several roots"],
)
def test_bones_that_hang_on_nothing_that_carries_them_go_with_the_body(bones):
    armature = skinned_human()
    add_bones(armature, [("ground", "", (0, 0, 0), (0, 0.3, 0))])
    hung_on(armature, bones)
    report = sent(armature)
    assert report["warnings"] == []
    assert worst_degrees(armature) < 0.1
    own, (_, heads) = motion(), shown(armature)
    apart = heads - own.positions[:, own.rest.indices(BODY.names)]
    assert np.ptp(apart, axis=1).max() < 0.001


def test_bones_that_stay_behind_a_character_that_follows_live_are_named():
    performer = body_armature.build_armature(BODY, "man", bpy.context.scene.collection)
    armature = skinned_human()
    hung_on(armature, {"foot.L": ""})
    report = send_to_rig(bpy.context.scene, motion(), armature, 1, SendOptions(live=LiveSource(performer, {})))
    assert any(said.startswith("bone foot.L: it does not hang on shin.L") for said in report["warnings"])


def test_a_character_in_its_rest_position_shows_the_motion_with_a_word():
    armature = skinned_human()
    armature.data.pose_position = "REST"
    report = sent(armature)
    assert report["warnings"] == ["armature hero: it was shown in its rest position, and shows its poses now"]
    assert worst_degrees(armature) < 0.1


def test_a_body_in_its_rest_position_shows_key_poses_with_a_word():
    armature = skinned_human()
    armature.data.pose_position = "REST"
    armature, remarks = use_as_body(bpy.context.scene, armature)
    assert remarks == ("armature hero: it was shown in its rest position, and shows its poses now",)
    assert armature.data.pose_position == "POSE"


def test_an_error_leaves_the_rest_position():
    armature = skinned_human()
    armature.data.pose_position = "REST"
    with pytest.raises(BodyError):
        send_to_rig(bpy.context.scene, motion(), armature, 1, SendOptions(preset="mixamo"))
    assert armature.data.pose_position == "REST"


def with_a_strip(armature):
    """Other motion in a track of the NLA."""
    action = bpy.data.actions.new("old")
    armature.animation_data_create().action = action
    bone = armature.pose.bones["upper_arm.L"]
    for frame, turn in ((1, (1, 0, 0, 0)), (20, (0.5, 0.5, 0.5, 0.5))):
        bone.rotation_quaternion = turn
        bone.keyframe_insert("rotation_quaternion", frame=frame)
    track = armature.animation_data.nla_tracks.new()
    track.strips.new("old", 1, action).blend_type = "COMBINE"
    armature.animation_data.action = None
    return track


def solo(armature):
    with_a_strip(armature).is_solo = True


def edited(armature):
    track = with_a_strip(armature)
    track.select = track.strips[0].select = True
    armature.animation_data.use_tweak_mode = True


def mixed(armature):
    with_a_strip(armature)
    armature.animation_data.action_blend_type = "COMBINE"
    armature.animation_data.action_influence = 0.5


@pytest.mark.parametrize("state", [with_a_strip, solo, edited, mixed])
def test_strips_of_the_nla_do_not_change_the_motion(state):
    armature = skinned_human()
    state(armature)
    report = sent(armature)
    assert report["warnings"] == []
    assert worst_degrees(armature) < 0.1
    assert [strip.action.name for track in armature.animation_data.nla_tracks for strip in track.strips] == ["old"]


def shifted(armature):
    """Bones away from where they hang, as an animator has left them."""
    for name in ("spine", "upper_arm.L", "shin.R"):
        armature.pose.bones[name].location = (0.05, 0.03, 0.0)


def shifted_by_keys(armature):
    """The same in the present action, later than the current frame."""
    for frame, way in ((1, 0.0), (20, 0.3)):
        armature.pose.bones["upper_arm.L"].location.x = way
        armature.pose.bones["upper_arm.L"].keyframe_insert("location", frame=frame)
    bpy.context.scene.frame_set(1)


def shifted_by_a_strip(armature):
    shifted_by_keys(armature)
    armature.animation_data.nla_tracks.new().strips.new("old", 1, armature.animation_data.action)
    armature.animation_data.action = None


@pytest.mark.parametrize("state", [shifted, shifted_by_keys, shifted_by_a_strip])
@pytest.mark.parametrize("layer", [False, True])
def test_bones_that_were_shifted_go_back_to_where_they_hang(state, layer):
    armature = skinned_human()
    state(armature)
    options = SendOptions(curves=CurveOptions(layer=layer))
    report = send_to_rig(bpy.context.scene, motion(), armature, 1, options)
    assert report["warnings"] == []
    assert max(limb["worst_mm"] for limb in report["error"].values()) < 0.1
    bag = fcurves.find_channelbag(armature)
    keyed = {fcurves.bone_of(curve.data_path) for curve in bag.fcurves if curve.data_path.endswith("location")}
    assert keyed == {"pelvis", "upper_arm.L"} | ({"spine", "shin.R"} if state is shifted else set())


@pytest.mark.parametrize("state", [shifted, shifted_by_keys, shifted_by_a_strip])
def test_bones_that_were_shifted_are_so_again_once_a_character_stops_following(state):
    live = body_armature.build_armature(BODY, "man", bpy.context.scene.collection)
    motion_curves.write_motion(live, swing(BODY, FRAMES, 0.3), 1)
    armature = skinned_human()
    state(armature)
    before = shown_heads(armature, 1, BODY.names)
    report = send_to_rig(bpy.context.scene, motion(), armature, 1, SendOptions(live=LiveSource(live, {})))
    assert max(limb["worst_mm"] for limb in report["error"].values()) < 0.1
    stop_following(armature)
    assert np.abs(shown_heads(armature, 1, BODY.names) - before).max() < 1e-5


@pytest.mark.parametrize("state", [with_a_strip, solo, edited, mixed])
def test_strips_of_the_nla_do_not_change_what_is_tracked(state):
    armature = skinned_human()
    state(armature)
    armature, _ = use_as_body(bpy.context.scene, armature)
    truth = swing(body_armature.body_from_armature(armature), FRAMES, 0.3)
    motion_curves.write_motion(armature, truth, 1)
    assert joint_error(armature, body_armature.body_from_armature(armature), truth) < 0.1


@pytest.mark.parametrize("locked", [False, True])
def test_halves_of_a_limb_that_hang_on_a_copy_of_its_control_are_one_part(locked):
    armature = layered_human()
    whole = [f"{limb}.{side}" for limb in ("thigh", "upper_arm") for side in "LR"]
    for name in whole:
        part = BODY.parts[BODY.index(name)]
        middle, half = (part.head_world + part.tail_world) / 2, f"half.{name}"
        add_bones(armature, [(half, f"ORG-{name}", middle, part.tail_world)], deform=True)
        bind(armature, half, [(half, points_of(part))])
        armature.pose.bones[half].lock_rotation = (locked,) * 3
    armature, remarks = use_as_body(bpy.context.scene, armature)
    body = body_armature.body_from_armature(armature)
    assert not remarks
    assert len(body) == len(BODY)
    assert {f"{CONTROL}{name}" for name in whole} < set(body.names)
    truth = swing(body, FRAMES, 0.3)
    motion_curves.write_motion(armature, truth, 1)
    assert joint_error(armature, body, truth) < 0.1


def test_a_limit_of_the_hips_way_is_taken_with_a_word():
    armature = skinned_human()
    limit = armature.pose.bones["pelvis"].constraints.new("LIMIT_LOCATION")
    limit.use_min_x, limit.min_x, limit.owner_space = True, 1.0, "LOCAL"
    report = sent(armature)
    assert report["warnings"] == ["bone pelvis: its constraint 'Limit Location' has no influence in the new action"]
    assert report["error"]["trunk"]["worst_mm"] < 0.1


@pytest.mark.parametrize(
    ("bone", "kind"),
    [("pelvis", "COPY_LOCATION"), ("pelvis", "LIMIT_DISTANCE"), ("foot.L", "FLOOR"), ("foot.L", "PIVOT")],
)
def test_constraints_that_shift_bones_from_where_they_hang_are_taken_with_a_word(bone, kind):
    armature = skinned_human()
    add_bones(armature, [("aside", "", (0.5, 0, 1), (0.5, 0, 1.2))])
    constraint = armature.pose.bones[bone].constraints.new(kind)
    constraint.target, constraint.subtarget = armature, "aside"
    [said] = sent(armature)["warnings"]
    assert said == f"bone {bone}: its constraint '{constraint.name}' has no influence in the new action"
    assert worst_degrees(armature) < 0.1


def test_a_spine_along_a_curve_is_freed_with_a_word():
    armature = skinned_human()
    curve = bpy.data.curves.new("path", "CURVE")
    curve.dimensions = "3D"
    curve.splines.new("POLY").points.add(2)
    for k, point in enumerate(curve.splines[0].points):
        point.co = (0, 0.1 * k, 1 + 0.3 * k, 1)
    path = bpy.data.objects.new("path", curve)
    bpy.context.scene.collection.objects.link(path)
    constraint = armature.pose.bones["chest"].constraints.new("SPLINE_IK")
    constraint.target, constraint.chain_count = path, 2
    [said] = sent(armature)["warnings"]
    assert said == "bone chest: its constraint 'Spline IK' has no influence in the new action"
    assert worst_degrees(armature) < 0.1


def test_hips_that_are_connected_to_a_root_are_disconnected_with_a_word():
    """As Blender's own importer of FBX files leaves them."""
    armature = skinned_human()
    with body_armature.edit_bones(armature) as edited:
        root = edited.new("root")
        root.head, root.tail = (0.0, 0.0, 0.0), edited["pelvis"].head
        edited["pelvis"].parent, edited["pelvis"].use_connect = root, True
    report = sent(armature)
    assert report["warnings"] == [
        "bone pelvis: it was connected to the bone above, which kept it from moving, and is no longer"
    ]
    given = motion()
    own = given.positions[:, given.rest.indices(BODY.names)[0]]
    way = shown(armature)[1][:, 0]
    np.testing.assert_allclose(np.diff(way[:, :2], axis=0), np.diff(own[:, :2], axis=0), atol=1e-4)


def driven(armature, bone, attribute, index):
    """Give a bone a driver whose value is 0.3."""
    armature.pose.bones[bone].rotation_mode = "XYZ"
    armature.pose.bones[bone].driver_add(attribute, index).driver.expression = "0.3"
    bpy.context.view_layer.update()


@pytest.mark.parametrize(
    ("bone", "attribute", "index", "what"),
    [("pelvis", "location", 2, "location"), ("upper_arm.L", "rotation_euler", 0, "rotation")],
)
def test_drivers_of_what_gets_keys_are_muted_with_a_word(bone, attribute, index, what):
    armature = skinned_human()
    driven(armature, bone, attribute, index)
    [said] = sent(armature)["warnings"]
    assert said == f"bone {bone}: the driver of its {what} is muted, as keys would be without effect"
    assert worst_degrees(armature) < 0.1


def test_drivers_of_an_override_stay_muted_in_a_saved_file(tmp_path):
    def made():
        armature = skinned_human()
        driven(armature, "upper_arm.L", "rotation_euler", 0)
        armature.pose.bones["head"].driver_add("location", 0).driver.expression = "0.0"
        return armature

    linked(made, tmp_path)
    armature = editable(find_target(None), bpy.context.scene)
    [said] = sent(armature)["warnings"]
    assert said == "bone upper_arm.L: the driver of its rotation is muted, as keys would be without effect"
    for _ in range(2):  # what an override keeps is written again from what was read
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
        bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "shot.blend"))
    armature = find_target(None)
    assert armature.override_library is not None
    muted = {driver.data_path: driver.mute for driver in armature.animation_data.drivers}
    assert muted == {
        'pose.bones["upper_arm.L"].rotation_euler': True,
        'pose.bones["head"].location': False,  # nothing is written there
    }
    assert worst_degrees(armature) < 0.1


def test_drivers_act_again_after_an_error_and_when_a_character_stops_following():
    performer = body_armature.build_armature(BODY, "man", bpy.context.scene.collection)
    armature = skinned_human()
    driven(armature, "upper_arm.L", "rotation_euler", 0)
    [driver] = armature.animation_data.drivers
    with pytest.raises(BodyError):
        send_to_rig(bpy.context.scene, motion(), armature, 1, SendOptions(retarget=RetargetOptions(root="root-bone")))
    assert not driver.mute
    send_to_rig(bpy.context.scene, motion(), armature, 1, SendOptions(live=LiveSource(performer, {})))
    assert driver.mute
    stop_following(armature)
    assert not driver.mute


def test_a_character_that_lies_at_rest_is_named():
    armature = skinned_human()
    armature.data.transform(Matrix.Rotation(-np.pi / 2, 4, "X"))
    [said] = sent(armature)["warnings"]
    assert said.startswith("armature hero: it does not stand upright at rest")


def car():
    """An empty that moves by a metre."""
    vehicle = bpy.data.objects.new("car", None)
    bpy.context.scene.collection.objects.link(vehicle)
    for frame, place in ((1, 0.0), (FRAMES, 1.0)):
        vehicle.location.x = place
        vehicle.keyframe_insert("location", frame=frame)
    return vehicle


def on_parent(armature):
    armature.parent = car()


def on_constraint(armature):
    armature.constraints.new("COPY_LOCATION").target = car()


@pytest.mark.parametrize(("hold", "said"), [(on_parent, "its parent car"), (on_constraint, "its constraint 'Copy Loc")])
def test_a_character_that_rides_is_sent_motion_with_a_word_and_not_tracked(hold, said):
    armature = skinned_human()
    hold(armature)
    bpy.context.scene.frame_set(1)
    report = sent(armature)
    [warning] = report["warnings"]
    assert warning.startswith(f"armature hero: {said}") and "moves it as a whole" in warning
    assert max(limb["worst_mm"] for limb in report["error"].values()) < 0.1, "in the vehicle"
    with pytest.raises(BodyError, match=f"armature hero: {said}.* moves the armature object itself"):
        use_as_body(bpy.context.scene, armature)


def test_a_character_below_a_parent_that_stays_is_tracked_without_a_word():
    armature = skinned_human()
    armature.parent = car()
    bpy.data.objects["car"].animation_data_clear()
    assert not sent(armature)["warnings"]
    assert not use_as_body(bpy.context.scene, armature)[1]


def test_a_character_in_edit_mode_is_refused_by_name():
    armature = skinned_human()
    bpy.context.view_layer.objects.active = armature
    bpy.ops.object.mode_set(mode="EDIT")
    with pytest.raises(BodyError, match=r"armature hero: it is in edit mode \(leave it first"):
        sent(armature)
    bpy.ops.object.mode_set(mode="OBJECT")


GAME = bone_names(
    "C_pelvis_SHJnt C_spine01_SHJnt C_spine02_SHJnt C_head_SHJnt",
    "arm_upper arm_lower hand leg_upper leg_lower foot",
    lambda word, side: f"{side}_{word}_SHJnt",
)


def test_leaf_bones_of_a_bought_character_play_no_role():
    armature = skinned_human(GAME)
    ends = ["head", "hand.L", "hand.R", "foot.L", "foot.R"]
    tips = [BODY.parts[BODY.index(name)].tail_world for name in ends]
    add_bones(
        armature,
        [(f"{GAME[name]}_end", GAME[name], tip, tip + [0, 0, 0.05]) for name, tip in zip(ends, tips, strict=True)],
    )
    found = sent(armature)["target"]["bones"]
    assert {name: found[name] for name in ends} == {name: [GAME[name]] for name in ends}
