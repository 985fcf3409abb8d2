"""Using an armature as a body to track: one whose bones carry meshes, a skinned character, or a control rig."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace

import bpy
import numpy as np

from ....core.errors import BodyError
from ....core.numerics import rotations
from ....core.retargeting.bone_matching import preset_of
from ....core.retargeting.bone_roles.roles import SIDES, BoneMap
from ...scene_io import fcurves, performers, scene
from ...scene_io.body import body_armature, part_meshes
from ...scene_io.characters import skinned_parts
from ...scene_io.characters.followed_bones import following
from ...scene_io.characters.merged_clouds import says_twist
from ...scene_io.linked import linked_file
from ..rigs import fk_controls
from ..rigs.fk_controls import FkControls
from ..rigs.held_bones import with_drivers, without_drivers
from ..rigs.overrides import editable
from ..rigs.rig_at_rest import at_rest, leave_rest_position, posed_matrices
from ..rigs.rig_reading import moved_matrices
from ..rigs.rig_settings import has_keys, keep_in_override, setting_name, with_settings
from ..rigs.rig_warnings import undriven
from ..target_armatures import target_bones
from .freed_limbs import freed_remarks, with_goals, without_goals
from .part_roles import PART_ROLES, carried_along, controls_along, limb_bones, limbs_of, taken_in
from .rig_landmarks import add_landmarks
from .rigify_animals import animal_controls, goes_on_four, is_generated
from .root_keys import keyed_on_body
from .switched_key_poses import keep_freed_poses, keep_key_poses
from .tracked_bones import movable_root, refuse_apart, refuse_following, refuse_moving_object, remove_parts, tied_bones

_FOLLOWS = 0.5
"""Least fraction of a control's rotation with which a deforming bone follows it."""
_APART = 0.5
"""Fraction of deforming bones without a deforming parent from which they are taken to be parented to controls."""


def use_as_body(current: bpy.types.Scene, armature: bpy.types.Object) -> tuple[bpy.types.Object, tuple[str, ...]]:
    """Make an armature a performer of the scene's shot; returns it, and remarks on what could not be used.

    The parts of a skinned character are made from its skin; on a control rig, they are parented to the FK controls. For
    a linked character, a library override is used.

    Raises
    ------
    BodyError
        It cannot be a body; names the bone.
    """
    armature = editable(armature, current)
    body_armature.world_frame(armature)  # refused before anything of it is changed
    refuse_moving_object(current, armature)
    fcurves.unlink_action(armature)
    with without_goals(armature) as goals:
        taken, remarks = _taken(current, armature)
        remarks = (*remarks, *freed_remarks(goals))
        if goals:
            remarks = (*remarks, *keep_freed_poses(taken, with_goals(taken, goals)))
    remarks = (*remarks, *keyed_on_body(current, taken))
    add_landmarks(taken)
    if taken.animation_data is not None:
        fcurves.show_action(taken)
    return taken, (*leave_rest_position(taken), *remarks)


def _taken(current: bpy.types.Scene, armature: bpy.types.Object) -> tuple[bpy.types.Object, tuple[str, ...]]:
    """Make an armature that can be edited a performer; see `use_as_body`."""
    if skinned_parts.carries_its_parts(armature) and not _parts_follow(armature):
        return performers.take_armature(current, armature), movable_root(armature)
    collection = scene.ensure_collection(current, "Performers")
    mechanism = _mechanism(armature)
    if is_generated(armature) and (mechanism is None or goes_on_four(armature, mechanism)):
        return _use_animal(current, armature, collection)
    if mechanism is None:
        found = _controls(armature)
        if found is not None:
            return _use_controls(current, armature, collection, found)
        return _use_posed(current, armature, collection)
    settings = preset_of(mechanism).settings
    with with_settings(armature, settings) as before:
        made = _with_shoulders(armature, collection, mechanism) or _parts_of(armature, collection, mechanism)
    try:
        taken = performers.take_armature(current, armature)
        return taken, (*made.remarks, *keep_key_poses(taken, settings, before))
    except BodyError:
        remove_parts(armature, made.parts)
        raise


def _parts_follow(armature: bpy.types.Object) -> bool:
    """Whether something else than its pose moves a bone that carries meshes: these count as a skin then."""
    return bool(set(following(armature)) & set(part_meshes.meshes_by_bone(armature)))


def _use_posed(
    current: bpy.types.Scene, armature: bpy.types.Object, collection: bpy.types.Collection
) -> tuple[bpy.types.Object, tuple[str, ...]]:
    """Make a character whose deforming bones are posed themselves a performer; see `use_as_body`. Drivers that pose
    these are muted.
    """
    followed, limbs = following(armature), limb_bones(armature)
    refuse_apart(armature, limbs)
    made = skinned_parts.add_parts(
        armature,
        collection,
        following={name: what for name, what in followed.items() if name not in limbs.names()},
        limbs=limbs_of(limbs),
        taken_in=taken_in(armature, limbs),
        carried={name: above for name, above in carried_along(armature, limbs).items() if name not in followed},
        head=next(iter(limbs.bones.get("head", ())), ""),
    )
    tied = tied_bones(armature, made.parts)
    with without_drivers(armature, tied, tied) as driven:
        refuse_following(armature, made.parts, following(armature))
        try:
            taken = performers.take_armature(current, armature)
            remarks = (*made.remarks, *movable_root(taken), *undriven(driven))
        except BodyError:
            remove_parts(armature, made.parts)
            raise
    if driven:
        remarks = (*remarks, *keep_freed_poses(taken, with_drivers(taken, driven)))
    return taken, remarks


def _with_shoulders(
    armature: bpy.types.Object, collection: bpy.types.Collection, mechanism: BoneMap
) -> skinned_parts.SkinnedParts | None:
    """Add the parts of a rig of controls, shoulders included; None if its arms do not move with them, or its bones
    cannot be told that they do.

    Rigify's arms hang on the chest, and follow the shoulders by constraints.
    """
    hung = {f"upper_arm.{side}": f"shoulder.{side}" for side in SIDES}
    there = {mechanism.bones[a][0]: mechanism.bones[s][0] for a, s in hung.items() if s in mechanism.bones}
    if not there or linked_file(armature.data):
        return None
    made = _parts_of(armature, collection, mechanism, (*PART_ROLES, "shoulder"))
    for arm, shoulder in there.items():
        if shoulder in made.parts:
            armature.data.bones[arm][body_armature.ABOVE] = shoulder
    try:
        fk_controls.refuse_otherwise_moved(armature, {})
    except BodyError:
        remove_parts(armature, made.parts)
        return None
    return made


def _parts_of(
    armature: bpy.types.Object,
    collection: bpy.types.Collection,
    mechanism: BoneMap,
    roles: Collection[str] = PART_ROLES,
) -> skinned_parts.SkinnedParts:
    """Add the parts that hang on the controls of some roles."""
    controls = [name for role, _, name in mechanism.items() if role.partition(".")[0] in roles]
    return skinned_parts.add_parts(armature, collection, _carriers(armature, controls), limbs=limbs_of(mechanism))


def _use_animal(
    current: bpy.types.Scene, armature: bpy.types.Object, collection: bpy.types.Collection
) -> tuple[bpy.types.Object, tuple[str, ...]]:
    """Make an animal's rig that Rigify has generated a performer through its FK controls; see `use_as_body`."""
    controls = animal_controls(armature, skinned_parts.leading_bones(armature), set(following(armature)))
    with with_settings(armature, controls.settings) as before:
        limbs = [name for name in controls.by_bone.values() if "_fk" in name]
        made = skinned_parts.add_parts(armature, collection, controls.by_bone, limbs=limbs)
        try:
            fk_controls.refuse_otherwise_moved(armature, {})
            taken = performers.take_armature(current, armature)
            return taken, (*made.remarks, *movable_root(armature), *keep_key_poses(taken, controls.settings, before))
        except BodyError:
            remove_parts(armature, made.parts)
            raise


def _controls(armature: bpy.types.Object) -> FkControls | None:
    """Return the controls of a rig that no preset knows; None where its deforming bones are posed themselves."""
    led = skinned_parts.leading_bones(armature)
    held = set(following(armature)) & set(led)
    loose = {n for n in led if not any(above.name in led for above in armature.data.bones[n].parent_recursive)}
    if not led or (not held and len(loose) < _APART * len(led)):
        return None
    roles = [name for name in limb_bones(armature).names() if name not in led]
    controls = fk_controls.find_controls(armature, [*led, *roles], held)
    concerned = held or loose  # deforming bones may hang each on a control of its own
    others = any(controls.by_bone.get(name, name) != name for name in concerned)
    return controls if others or controls.settings else None


def _use_controls(
    current: bpy.types.Scene, armature: bpy.types.Object, collection: bpy.types.Collection, controls: FkControls
) -> tuple[bpy.types.Object, tuple[str, ...]]:
    """Make a rig a performer through its controls; see `use_as_body`."""
    held, roles = following(armature), limb_bones(armature)
    of_skin = _of_skin(armature, controls)
    along = controls_along(armature, controls, of_skin.by_bone, roles)
    turned = fk_controls.with_halves_of_limbs(armature, of_skin, held, {*roles.names(), *along})
    carriers, remarks = _turning_controls(armature, turned, controls.carried, held, roles)
    with with_settings(armature, controls.settings) as before:
        made = skinned_parts.add_parts(
            armature,
            collection,
            carriers,
            limbs=[carriers.get(n, n) for n in limbs_of(roles)],
            carried={carriers[name]: above for name, above in along.items() if name in carriers},
        )
        try:
            fk_controls.refuse_otherwise_moved(armature, turned)
            taken = performers.take_armature(current, armature)
            remarks += [*made.remarks, *movable_root(armature)]
        except BodyError:
            remove_parts(armature, made.parts)
            raise
    for owner, values in controls.settings.items():
        for key, value in values.items():
            where = ", on all its keys" if has_keys(armature, owner, key) else ""
            remarks.append(
                f"{setting_name(owner)}: its property '{key}' is {value:g} now{where}: "
                f"the limb is turned by FK controls"
            )
    remarks += keep_key_poses(taken, controls.settings, before)
    keep_in_override(taken, controls.settings, current.frame_start)
    return taken, tuple(remarks)


def _of_skin(armature: bpy.types.Object, controls: FkControls) -> FkControls:
    """Return the controls without those of bones that lead no skin."""
    led = set(skinned_parts.leading_bones(armature))
    return replace(controls, by_bone={name: control for name, control in controls.by_bone.items() if name in led})


def _turning_controls(
    armature: bpy.types.Object,
    turned: Mapping[str, str],
    carried: Mapping[str, str],
    held: Mapping[str, str],
    roles: BoneMap,
) -> tuple[dict[str, str], list[str]]:
    """Return the control that moves each deforming bone, given those of bones that controls turn about their heads, and
    those that carry bones, and remarks on bones that follow the body.

    Raises
    ------
    BodyError
        A bone of a limb has none; names it and what moves it.
    """
    carriers, remarks = dict(turned), list[str]()
    led = skinned_parts.leading_bones(armature)
    for name in sorted(set(led) - set(carriers), key=lambda each: len(armature.data.bones[each].parent_recursive)):
        above = next((p.name for p in armature.data.bones[name].parent_recursive if p.name in carriers), None)
        if above is None and name in held and name in carried and name not in roles.names():
            carriers[name] = carried[name]  # half of a limb, stretched between points on its controls
            continue
        if above is None or name in roles.names():
            raise BodyError(
                f"no control was found that turns the bone about its head: it is moved by "
                f"{held.get(name, 'the one above')}",
                where=f"armature {armature.name}, bone {name}",
                todo="switch its limb to forward kinematics (FK), give its control the bone's own place and roll, "
                "or mute what moves it",
            )
        carriers[name] = carriers[above]
        if name in held and not says_twist(name):
            remarks.append(f"bone {name}: it is moved by {held[name]}, so it is left out, and follows the body")
    halves = taken_in(armature, roles)
    carriers |= {name: carriers[above] for name, above in halves.items() if name in carriers and above in carriers}
    return carriers, remarks


def _mechanism(armature: bpy.types.Object) -> BoneMap | None:
    """Return the controls of a rig whose deforming bones are not posed themselves, by its preset; None for other
    rigs.
    """
    try:
        bones = target_bones(armature)
    except BodyError:
        return None
    return bones if preset_of(bones).settings else None


def _carriers(armature: bpy.types.Object, controls: list[str]) -> dict[str, str]:
    """Return the control that moves each deforming bone: the last of those that it follows by half at least."""
    deforming = [bone.name for bone in armature.data.bones if bone.use_deform]
    found: dict[str, str] = {}
    depth: dict[str, int] = {}
    with at_rest(armature, controls):
        rest = posed_matrices(armature, [*deforming, *controls])
        moved = {name: moved_matrices(armature, name, [*deforming, *controls]) for name in controls}
    D = len(deforming)
    for name, matrices in moved.items():
        change = matrices[:, :3, :3] @ np.linalg.inv(rest[:, :3, :3])
        angles = np.linalg.norm(rotations.log(rotations.orthonormal(change)), axis=-1)
        followed = angles > _FOLLOWS * angles[D + controls.index(name)]
        below = int(followed[D:].sum())
        for bone in np.array(deforming)[followed[:D]]:
            if bone not in found or below < depth[found[bone]]:
                found[str(bone)] = name
        depth[name] = below
    return found
