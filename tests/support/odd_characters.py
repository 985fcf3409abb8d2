"""Characters that nobody made for this program, with skins, for the tests of bodies and retargeting."""

from __future__ import annotations

import atexit
import shutil
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path

import addon_utils
import bpy
import numpy as np
from kfmocap.core.body import Body, Part, human
from kfmocap.kfmocap_addon.scene_io.body import armature_landmarks, body_armature
from kfmocap.kfmocap_addon.scene_io.characters import skins
from mathutils import Matrix

BODY = human(1.75)
CONTROL = "CTRL-"
_RIGIFY_SKIN = tuple(
    f"DEF-{name}" for name in ("spine", "upper_arm", "forearm", "hand", "thigh", "shin", "foot", "toe", "shoulder")
)


def foreign_armature(body: Body = BODY) -> bpy.types.Object:
    """The bones of a body as another program would have made them: without its parts and what these store in bones."""
    armature = body_armature.build_armature(body, "hero", bpy.context.scene.collection)
    for child in list(armature.children):
        bpy.data.objects.remove(child)
    for bone in armature.data.bones:
        for name in (body_armature.PART, body_armature.LIMITS, armature_landmarks.LANDMARKS, body_armature.REST):
            del bone[name]
    return armature


def points_of(part: Part) -> np.ndarray:
    """The surface points (V, 3) of a part of a body at rest, in the world."""
    return part.vertices @ part.R_world_rest.T + part.head_world


def skinned_human(names: Mapping[str, str] | None = None, body: Body = BODY) -> bpy.types.Object:
    """The default body as an armature with one skin, its bones under other names."""
    called = dict(names or {})
    armature = foreign_armature(body)
    for bone in list(armature.data.bones):
        bone.name = called.get(bone.name, bone.name)
    bind(armature, "skin", [(called.get(part.name, part.name), points_of(part)) for part in body.parts])
    return armature


def bind(
    armature: bpy.types.Object, name: str, clouds: Sequence[tuple[str, np.ndarray]], groups: bool = True
) -> bpy.types.Object:
    """A mesh of points without faces, each cloud (V, 3) led by a bone; `groups` false binds it by envelopes alone."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(np.concatenate([points for _, points in clouds]).tolist(), [], [])
    skin = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(skin)
    modifier = skin.modifiers.new("Armature", "ARMATURE")
    modifier.object, modifier.use_vertex_groups, modifier.use_bone_envelopes = armature, groups, not groups
    start = 0
    for bone, points in clouds:
        skin.vertex_groups.new(name=bone).add(range(start, start + len(points)), 1.0, "REPLACE")
        start += len(points)
    return skin


def add_bones(
    armature: bpy.types.Object, bones: Iterable[tuple[str, str, Sequence[float], Sequence[float]]], deform: bool = False
) -> None:
    """Add bones: name, parent (empty for none), head and tail in the armature."""
    with body_armature.edit_bones(armature) as edited:
        for name, parent, head, tail in bones:
            bone = edited.new(name)
            bone.head, bone.tail = head, tail
            bone.use_deform = deform
            bone.parent = edited[parent] if parent else None


def controlled_human(kind: str = "COPY_TRANSFORMS", prefix: str = "DEF-") -> bpy.types.Object:
    """A home-made control rig: every deforming bone copies a control, whose names say nothing that a preset knows.

    The controls hang on each other below a root; the deforming bones are in a hidden bone collection.
    """
    armature = skinned_human({name: prefix + name for name in BODY.names})
    controls = armature.data.collections.new("Controls")
    deform = armature.data.collections.new("Deform")
    with body_armature.edit_bones(armature) as bones:
        root = bones.new("root")
        root.tail, root.use_deform = (0, 0.4, 0), False
        for part in BODY.parts:
            copied, bone = bones[prefix + part.name], bones.new(CONTROL + part.name)
            bone.head, bone.tail, bone.roll = copied.head, copied.tail, copied.roll
            bone.use_deform = False
            bone.parent = bones[CONTROL + BODY.parts[part.parent].name] if part.parent >= 0 else root
    for bone in armature.data.bones:
        (deform if bone.use_deform else controls).assign(bone)
    deform.is_visible = False
    for name in BODY.names:
        first = name == BODY.names[0]
        _copy(armature, prefix + name, CONTROL + name, "COPY_TRANSFORMS" if first else kind)
    return armature


def switched_human(influence: float = 1.0, where: str = "bone", expression: str = "") -> bpy.types.Object:
    """The home-made rig with a switch from FK to IK for each hand and foot, which stands at IK.

    Parameters
    ----------
    where : str
        What has the switches: the control of the hand or foot ("bone"), the armature object ("object"), the armature
        ("data"), an object that it hangs on ("parent"), or a bone's property that one of the object drives ("driven").
    expression : str
        What makes the influence of the switch `s`, by default `s` itself.
    """
    armature = controlled_human()
    if where == "parent":
        armature.parent = bpy.data.objects.new("settings", None)
        bpy.context.scene.collection.objects.link(armature.parent)
    for end, lower in (("hand", "forearm"), ("foot", "shin")):
        for side in "LR":
            _add_ik(armature, f"{end}.{side}", f"{lower}.{side}", influence, (where, expression))
    bpy.context.view_layer.update()
    return armature


def one_chain_human(where: str = "bone") -> bpy.types.Object:
    """A skinned character whose limbs have inverse kinematics on their own bones, switched on by a property of the goal
    ("bone") or of the armature object ("object").
    """
    armature = skinned_human()
    for end, lower in (("hand", "forearm"), ("foot", "shin")):
        for side in "LR":
            part = BODY.parts[BODY.index(f"{end}.{side}")]
            add_bones(armature, [(f"goal {end}.{side}", "", part.head_world, part.head_world + [0.0, -0.1, 0.0])])
            owner, key = (
                (armature.pose.bones[f"goal {end}.{side}"], "ik") if where == "bone" else (armature, f"ik {end}")
            )
            owner[key] = 1.0
            armature.update_tag()
            chain = armature.pose.bones[f"{lower}.{side}"].constraints.new("IK")
            chain.target, chain.subtarget, chain.chain_count = armature, f"goal {end}.{side}", 2
            path = f'pose.bones["goal {end}.{side}"]["ik"]' if where == "bone" else f'["ik {end}"]'
            _drive(chain.driver_add("influence").driver, armature, path)
    return armature


def hung_on_controls() -> bpy.types.Object:
    """Deforming bones that hang each on a control of its own, without a constraint."""
    armature = controlled_human()
    with body_armature.edit_bones(armature) as bones:
        for name in BODY.names:
            bones[f"DEF-{name}"].use_connect, bones[f"DEF-{name}"].parent = False, bones[CONTROL + name]
    for name in BODY.names:
        held = armature.pose.bones[f"DEF-{name}"].constraints
        held.remove(held[0])
    return armature


def layered_human() -> bpy.types.Object:
    """Deforming bones that hang on copies of the controls, and legs and spine that hang side by side on a control."""
    armature = controlled_human()
    with body_armature.edit_bones(armature) as bones:
        torso, pelvis = bones.new(f"{CONTROL}torso"), bones[f"{CONTROL}pelvis"]
        torso.head, torso.tail, torso.use_deform, torso.parent = pelvis.head, pelvis.tail, False, bones["root"]
        for name in ("pelvis", "spine", "thigh.L", "thigh.R"):
            bones[CONTROL + name].use_connect, bones[CONTROL + name].parent = False, torso
        for part in BODY.parts:
            copy, deforming = bones.new(f"ORG-{part.name}"), bones[f"DEF-{part.name}"]
            copy.head, copy.tail, copy.roll, copy.use_deform = deforming.head, deforming.tail, deforming.roll, False
            copy.parent = bones[f"ORG-{BODY.parts[part.parent].name}"] if part.parent >= 0 else bones["root"]
            deforming.use_connect, deforming.parent = False, copy
    for name in BODY.names:
        held = armature.pose.bones[f"DEF-{name}"].constraints
        held.remove(held[0])
        _copy(armature, f"ORG-{name}", CONTROL + name, "COPY_TRANSFORMS")
    return armature


def limited_legs() -> bpy.types.Object:
    """A character whose shins have inverse kinematics and a limit to one axis, as models for dances have them."""
    armature = skinned_human()
    goals = [(f"goal.{side}", "", BODY.parts[BODY.index(f"foot.{side}")].head_world, (0.1, 0.3, 0.0)) for side in "LR"]
    add_bones(armature, goals)
    for side in "LR":
        held = armature.pose.bones[f"shin.{side}"].constraints
        chain, limit = held.new("IK"), held.new("LIMIT_ROTATION")
        chain.target, chain.subtarget, chain.chain_count = armature, f"goal.{side}", 2
        limit.use_limit_x, limit.min_x, limit.max_x = True, 0.01, np.pi
        limit.use_limit_y = limit.use_limit_z = True
        limit.owner_space = "LOCAL"
    bpy.context.view_layer.update()
    return armature


def linked(made: Callable[[], bpy.types.Object], folder: Path) -> bpy.types.Object:
    """A character that is linked into an empty file, with its skin, from another one."""
    armature = made()
    collection = bpy.data.collections.new("character")
    for owner in (armature, *skins.skinned_meshes(armature)):
        collection.objects.link(owner)
    bpy.data.libraries.write(str(folder / "character.blend"), {collection})
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    with bpy.data.libraries.load(str(folder / "character.blend"), link=True) as (_, loaded):
        loaded.collections = ["character"]
    bpy.context.scene.collection.children.link(loaded.collections[0])
    return next(owner for owner in loaded.collections[0].objects if owner.type == "ARMATURE")


def generated_rig(*, face: bool = False) -> bpy.types.Object:
    """Rigify's human as it is generated, with small clouds of skin around what deforms its limbs; without its face
    unless that is asked for, which takes ten seconds, twenty times as long as all the rest.

    It is generated once, and kept in a file.
    """
    file = _library() / f"rig_{face}.blend"
    if file.exists():
        with bpy.data.libraries.load(str(file)) as (_, loaded):
            loaded.collections = ["generated"]
        bpy.context.scene.collection.children.link(loaded.collections[0])
        return loaded.collections[0].objects["rig"]
    rig = _generated(face=face)
    collection = bpy.data.collections.new("generated")
    for owner in (rig, *skins.skinned_meshes(rig)):
        collection.objects.link(owner)
    bpy.data.libraries.write(str(file), {collection})
    bpy.data.collections.remove(collection)
    return rig


@cache
def _library() -> Path:
    """A folder for as long as the tests run."""
    folder = Path(tempfile.mkdtemp(prefix="kfmocap-rig-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


def generated_animal(kind: str) -> bpy.types.Object:
    """Rigify's rig of an animal (wolf, bird, ...) as it is generated, with a skin around all its deforming bones."""
    return _generated(kind, ("DEF-",))


def _generated(kind: str = "human", skin: tuple[str, ...] = _RIGIFY_SKIN, *, face: bool = False) -> bpy.types.Object:
    addon_utils.enable("rigify", default_set=True)
    getattr(bpy.ops.object, f"armature_{kind}_metarig_add")()
    bpy.ops.object.mode_set(mode="OBJECT")
    for bone in bpy.context.object.pose.bones:
        if bone.rigify_type == "faces.super_face" and not face:
            bone.rigify_type = ""
    bpy.ops.pose.rigify_generate()
    rig = next(owner for owner in bpy.data.objects if owner.type == "ARMATURE" and "rig_id" in owner.data)
    dice, clouds = np.random.default_rng(1), []
    for bone in rig.data.bones:
        if bone.name.startswith(skin):
            head, tail = np.array(bone.head_local), np.array(bone.tail_local)
            width = 0.6 * min(0.13, bone.length)
            around = dice.uniform(-1, 1, (40, 3)).clip(-0.6, 0.6) * width
            clouds.append((bone.name, head + dice.uniform(0, 1, (40, 1)) * (tail - head) + around))
    bind(rig, "skin", clouds)
    return rig


def _add_ik(
    armature: bpy.types.Object, end: str, lower: str, influence: float, switch: tuple[str, str] = ("bone", "")
) -> None:
    upper = BODY.parts[BODY.parents[BODY.index(lower)]].name
    with body_armature.edit_bones(armature) as bones:
        goal = bones.new(f"IK-{end}")
        goal.head, goal.tail, goal.use_deform = bones[CONTROL + end].head, bones[CONTROL + end].tail, False
        goal.parent = bones["root"]
        last = bones[CONTROL + upper].parent
        for name in (upper, lower):
            bone, copied = bones.new(f"MCH-{name}"), bones[CONTROL + name]
            bone.head, bone.tail, bone.roll, bone.use_deform = copied.head, copied.tail, copied.roll, False
            bone.parent, last = last, bone
    goal = armature.pose.bones[f"IK-{end}"]
    where, expression = switch
    path = f'pose.bones["IK-{end}"]["ik_fk"]' if where in ("bone", "driven") else f'["ik_fk {end}"]'
    owner = {"data": armature.data, "parent": armature.parent}.get(where, armature)
    key = "ik_fk" if where == "bone" else f"ik_fk {end}"
    (goal if where == "bone" else owner)[key] = influence
    owner.update_tag()  # a driver that does not find the property stays invalid
    if where == "driven":
        goal["ik_fk"] = influence
        _drive(goal.driver_add('["ik_fk"]').driver, armature, f'["ik_fk {end}"]')
    chain = armature.pose.bones[f"MCH-{lower}"].constraints.new("IK")
    chain.target, chain.subtarget, chain.chain_count = armature, f"IK-{end}", 2
    for name, followed in ((upper, f"MCH-{upper}"), (lower, f"MCH-{lower}"), (end, f"IK-{end}")):
        held = _copy(armature, f"DEF-{name}", followed, "COPY_TRANSFORMS")
        _drive(held.driver_add("influence").driver, owner, path, expression)


def _drive(driver: bpy.types.Driver, owner: bpy.types.ID, path: str, expression: str = "") -> None:
    variable = driver.variables.new()
    variable.name = "s"
    variable.targets[0].id_type = owner.id_type
    variable.targets[0].id, variable.targets[0].data_path = owner, path
    driver.type = "SCRIPTED" if expression else "AVERAGE"
    if expression:
        driver.expression = expression


def _copy(armature: bpy.types.Object, owner: str, followed: str, kind: str) -> bpy.types.Constraint:
    held = armature.pose.bones[owner].constraints.new(kind)
    held.target, held.subtarget = armature, followed
    return held


def bone_names(trunk: str, limbs: str, on_side: Callable[[str, str], str]) -> dict[str, str]:
    """Return the names of a character's bones by the parts of `BODY`.

    Parameters
    ----------
    trunk : str
        Pelvis, spine, chest and head.
    limbs : str
        Words for upper arm, forearm, hand, thigh, shin and foot.
    on_side : callable
        Makes a name of such a word and a side, "L" or "R".
    """
    parts = ("upper_arm", "forearm", "hand", "thigh", "shin", "foot")
    names = dict(zip(("pelvis", "spine", "chest", "head"), trunk.split(), strict=True))
    for side in "LR":
        names |= {f"{part}.{side}": on_side(word, side) for part, word in zip(parts, limbs.split(), strict=True)}
    return names


MIXAMO = bone_names(
    "Hips Spine Spine1 Head",
    "Arm ForeArm Hand UpLeg Leg Foot",
    lambda word, side: {"L": "Left", "R": "Right"}[side] + word,
)
UNREAL = bone_names(
    "pelvis spine_01 spine_02 head",
    "upperarm lowerarm hand thigh calf foot",
    lambda word, side: f"{word}_{side.lower()}",
)
JAPANESE = bone_names(
    "腰 上半身 胸 頭", "腕 ひじ 手首 足 ひざ 足首", lambda word, side: word + {"L": "1", "R": "2"}[side]
)


def as_imported(armature: bpy.types.Object) -> None:
    """Leave a character as importers of FBX do: bones in centimetres, the object scaled and turned."""
    matrix = Matrix.Rotation(np.pi / 2, 4, "X") @ Matrix.Scale(0.01, 4)
    armature.data.transform(matrix.inverted())
    for skin in skins.skinned_meshes(armature):
        skin.parent = armature
        skin.data.transform(matrix.inverted())
    armature.matrix_world = matrix
    bpy.context.view_layer.update()


def mixamo_like() -> bpy.types.Object:
    """Mixamo's names, as importers of FBX leave it."""
    armature = skinned_human({name: f"mixamorig:{other}" for name, other in MIXAMO.items()})
    as_imported(armature)
    return armature


def foreign() -> bpy.types.Object:
    """Bones in Japanese, left and right told by numbers alone."""
    return skinned_human(JAPANESE)


def unreal_like() -> bpy.types.Object:
    """Unreal's names, with a root and the bones of its inverse kinematics, which lead no skin."""
    armature = skinned_human(UNREAL)
    with body_armature.edit_bones(armature) as bones:
        root = bones.new("root")
        root.tail = (0, 0.3, 0)
        bones["pelvis"].parent = root
        for name, parent, like in (
            ("ik_foot_root", "root", "root"),
            ("ik_foot_l", "ik_foot_root", "foot_l"),
            ("ik_foot_r", "ik_foot_root", "foot_r"),
            ("ik_hand_root", "root", "root"),
            ("ik_hand_gun", "ik_hand_root", "hand_r"),
            ("ik_hand_l", "ik_hand_gun", "hand_l"),
            ("ik_hand_r", "ik_hand_gun", "hand_r"),
            ("interaction", "root", "root"),
        ):
            bone = bones.new(name)
            bone.head, bone.tail, bone.parent = bones[like].head, bones[like].tail, bones[parent]
    return armature


def helped() -> bpy.types.Object:
    """Leaf, twist and helper bones; arms that hang on no bone but follow the chest by a constraint."""
    armature = skinned_human()
    helpers: list[tuple[str, str, Sequence[float], Sequence[float]]] = []
    for part in BODY.parts:
        if part.name[:-2] in ("forearm", "thigh"):
            a, b = part.head_world, part.tail_world
            helpers.append((f"{part.name}_twist", part.name, a + 0.3 * (b - a), a + 0.6 * (b - a)))
        if part.name[:-2] in ("hand", "foot") or part.name == "head":
            way = part.tail_world - part.head_world
            helpers.append((f"{part.name}_end", part.name, part.tail_world, part.tail_world + 0.3 * way))
    add_bones(armature, helpers, deform=True)
    dice = np.random.default_rng(0)
    bind(
        armature,
        "twists",
        [(n, np.array(h) + dice.uniform(-0.04, 0.04, (30, 3))) for n, _, h, _ in helpers if n.endswith("_twist")],
    )
    for name, above, _, _ in helpers:
        if name.endswith("_twist"):
            _copy(armature, name, above, "COPY_ROTATION").influence = 0.5
    return armature


def loose_arms() -> bpy.types.Object:
    """Arms whose bones hang on none, and are held at the chest by a constraint, as some exporters leave them."""
    armature = skinned_human()
    with body_armature.edit_bones(armature) as bones:
        for side in "LR":
            bones[f"upper_arm.{side}"].use_connect, bones[f"upper_arm.{side}"].parent = False, None
    for side in "LR":
        held = armature.pose.bones[f"upper_arm.{side}"].constraints.new("CHILD_OF")
        held.target, held.subtarget = armature, "chest"
        held.inverse_matrix = armature.data.bones["chest"].matrix_local.inverted()
    return armature


def quadruped() -> bpy.types.Object:
    """A four-legged animal with a neck and a tail of three bones."""
    armature = bpy.data.objects.new("dog", bpy.data.armatures.new("dog"))
    bpy.context.scene.collection.objects.link(armature)
    chain: list[tuple[str, str, Sequence[float], Sequence[float]]] = [
        ("hips", "", (0, 0.35, 0.6), (0, 0.1, 0.62)),
        ("back", "hips", (0, 0.1, 0.62), (0, -0.25, 0.62)),
        ("neck", "back", (0, -0.25, 0.62), (0, -0.45, 0.8)),
        ("skull", "neck", (0, -0.45, 0.8), (0, -0.7, 0.78)),
        ("tail_1", "hips", (0, 0.36, 0.62), (0, 0.55, 0.66)),
        ("tail_2", "tail_1", (0, 0.55, 0.66), (0, 0.72, 0.74)),
        ("tail_3", "tail_2", (0, 0.72, 0.74), (0, 0.86, 0.84)),
    ]
    for name, parent, x, y in (
        ("leg_fl", "back", 0.12, -0.2),
        ("leg_fr", "back", -0.12, -0.2),
        ("leg_bl", "hips", 0.12, 0.3),
        ("leg_br", "hips", -0.12, 0.3),
    ):
        chain += [
            (f"{name}_1", parent, (x, y, 0.55), (x, y + 0.04, 0.3)),
            (f"{name}_2", f"{name}_1", (x, y + 0.04, 0.3), (x, y, 0.06)),
            (f"{name}_3", f"{name}_2", (x, y, 0.06), (x, y - 0.12, 0.0)),
        ]
    add_bones(armature, chain, deform=True)
    dice = np.random.default_rng(4)
    clouds = []
    for name, _, head, tail in chain:
        a, b = np.array(head), np.array(tail)
        width = 0.13 if name in ("hips", "back") else 0.045
        share = dice.uniform(0, 1, (60, 1))
        round_it = dice.normal(size=(60, 3))
        clouds.append((name, a + share * (b - a) + width * round_it / np.linalg.norm(round_it, axis=1, keepdims=True)))
    bind(armature, "fur", clouds)
    return armature


def awkward() -> bpy.types.Object:
    """Locked axes, every rotation order, below a scaled and turned parent."""
    armature = skinned_human()
    orders = ("XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX", "AXIS_ANGLE", "QUATERNION")
    for k, bone in enumerate(armature.pose.bones):
        bone.rotation_mode = orders[k % len(orders)]
    for side in "LR":
        armature.pose.bones[f"shin.{side}"].lock_rotation = (False, True, True)
    above = bpy.data.objects.new("above", None)
    bpy.context.scene.collection.objects.link(above)
    above.scale, above.rotation_euler, above.location = (0.5, 0.5, 0.5), (0, 0, 0.7), (0.3, -0.2, 0.0)
    armature.parent = above
    for skin in skins.skinned_meshes(armature):
        skin.parent = armature
    bpy.context.view_layer.update()
    return armature


def shown_heads(armature: bpy.types.Object, frames: int, names: Sequence[str]) -> np.ndarray:
    """Return the heads of bones in the world on frames 1 to `frames` as Blender shows them, shape (F, B, 3)."""
    found = []
    for frame in range(1, frames + 1):
        bpy.context.scene.frame_set(frame)
        posed = armature.evaluated_get(bpy.context.evaluated_depsgraph_get())
        found.append([posed.matrix_world @ posed.pose.bones[name].head for name in names])
    return np.array(found)
