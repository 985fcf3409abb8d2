"""Finding the FK controls of a rig without a preset: the bone that an animator rotates to move each deforming bone.

Constraints and drivers are not analysed but observed: each bone that may be a control is rotated a little, and the
bones that move rigidly with it follow it.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

from ....core.errors import BodyError
from ....core.numerics import rotations
from ....core.numerics.arrays import Array
from ....core.retargeting.bone_roles.roles import SIDES, BoneMap
from ...scene_io.body import body_armature
from ...scene_io.characters.followed_bones import following, solved_bones
from .carrying_controls import hung_on_controls
from .held_bones import without_limits
from .rig_at_rest import at_rest, posed_matrices, update
from .rig_reading import MIN_SCALE, moved_matrices, refuse_mirrored
from .rig_settings import (
    Owner,
    Settings,
    owner_of,
    property_ends,
    restore_settings,
    set_settings,
    switched_bones,
    switches,
    trying_settings,
)

_ENDS = (("hand", "forearm"), ("foot", "shin"))
_RIGID_TOLERANCE = 1e-3
"""Tolerance within which two bones move rigidly together, radians, and relative to the rig's size."""


@dataclass(frozen=True)
class FkControls:
    """The controls of deforming bones.

    Attributes
    ----------
    by_bone : mapping of str to str
        By deforming bone, the control that rotates it about its head. Bones without such a control are absent.
    settings : mapping
        By owner (see `rig_settings`), the values to which custom properties must be changed for that.
    carried : mapping of str to str
        By deforming bone, the lowest other control with which it moves, about any point.
    """

    by_bone: Mapping[str, str]
    settings: Settings
    carried: Mapping[str, str] = field(default_factory=dict)


def find_controls(armature: bpy.types.Object, bones: Sequence[str], held: Collection[str]) -> FkControls:
    """Find which bones are rotated to move deforming bones.

    If custom properties switch constraints (such as from IK to FK), the values with which controls move most bones are
    chosen.

    Parameters
    ----------
    armature : bpy.types.Object
    bones : sequence of str
        Deforming bones, including those that are posed directly.
    held : collection of str
        Bones moved by something other than their own pose, see `scene_io.characters.followed_bones`.
    """
    update()
    refuse_mirrored(armature, bones)
    fixed = (set(held) | solved_bones(armature)) - switched_bones(armature)
    candidates = [name for name in _upstream(armature, bones) if _may_be_turned(armature, name, bones, fixed)]
    with at_rest(armature, [bone.name for bone in armature.data.bones]), without_limits(armature):
        switched, moved = _switched(armature, bones, _moved(armature, bones, candidates))
    chosen = _chosen(armature, bones, moved)
    return FkControls(chosen, switched, _carried(armature, bones, moved, set(chosen.values())))


def with_halves_of_limbs(
    armature: bpy.types.Object, controls: FkControls, held: Collection[str], limbs: Collection[str]
) -> dict[str, str]:
    """Return the controls of deforming bones; children of a held bone are assigned to the control that moves it.

    Rigs that divide the skin of a thigh between two bones parent both to a third, which copies the controls: nothing
    but itself rotates the lower one about its own head.

    Parameters
    ----------
    armature : bpy.types.Object
    controls : FkControls
    held : collection of str
        All bones of the rig that are moved by something other than their own pose.
    limbs : collection of str
        Bones that remain separate parts.
    """
    found = dict(controls.by_bone)
    for name, control in controls.carried.items():
        locked = name not in held and all(armature.pose.bones[name].lock_rotation)
        alone = controls.by_bone.get(name, name if locked else "") == name and name not in limbs
        if alone and _is_led(armature, name, held, controls.by_bone):
            found[name] = control
    return found


def through_controls(armature: bpy.types.Object, bones: BoneMap) -> tuple[BoneMap, FkControls]:
    """Replace bones of a map that follow controls, or are descendants of bones that do, by these controls; returns the
    map and the controls.
    """
    held = following(armature)
    bones, hung = hung_on_controls(armature, bones, held)
    names = bones.names()
    led = {name for name in names if _is_led(armature, name, held, names)}
    if not led:
        return bones, FkControls(hung, {})
    found = _without_loose_ends(armature, bones, find_controls(armature, names, held))
    used = [found.by_bone.get(name, name) if name in led else name for name in names]
    by_bone = {
        name: control for name, control in zip(names, used, strict=True) if name != control and used.count(control) == 1
    }
    roles = {role: tuple(by_bone.get(name, name) for name in played) for role, played in bones.bones.items()}
    needed = by_bone or any(found.by_bone.get(name) == name for name in led)  # these are posed once they are switched
    by_bone |= {name: by_bone.get(control, control) for name, control in hung.items()}
    return replace(bones, bones=roles), FkControls(by_bone, found.settings if needed else {})


def _without_loose_ends(armature: bpy.types.Object, bones: BoneMap, found: FkControls) -> FkControls:
    """Leave out controls of hands and feet that do not move with the limb, as goals of inverse kinematics do not: where
    the limb has no FK controls, its own bones are posed, freed of their constraints.
    """
    loose = set()
    with (
        at_rest(armature, [bone.name for bone in armature.data.bones]),
        trying_settings(armature, found.settings),
    ):
        for end, above in ((f"{a}.{side}", f"{b}.{side}") for a, b in _ENDS for side in SIDES):
            if end not in bones.bones or above not in bones.bones:
                continue
            [name], [limb] = bones.bones[end], bones.bones[above]
            pair = [found.by_bone.get(limb, limb), found.by_bone.get(name, name)]
            rest = posed_matrices(armature, pair)
            size = float(armature.data.bones[limb].length) or 1.0
            change = moved_matrices(armature, pair[0], pair) @ np.linalg.inv(rest)
            update()
            if name in found.by_bone and not alike(change, change[0], rest, size)[1]:
                loose.add(name)
    return replace(found, by_bone={name: control for name, control in found.by_bone.items() if name not in loose})


def _is_led(armature: bpy.types.Object, name: str, held: Collection[str], roles: Collection[str]) -> bool:
    """Whether a bone is held, or hangs on a held one that stands between it and the next bone with a role above."""
    bone: Any = armature.pose.bones[name]
    while bone is not None:
        if bone.name in held:
            return True
        bone = bone.parent
        if bone is not None and bone.name in roles:
            return False
    return False


def refuse_otherwise_moved(armature: bpy.types.Object, carriers: Mapping[str, str]) -> None:
    """Raise a BodyError if rotating the bones of a body's parts does not move the skin with them.

    Parameters
    ----------
    carriers : mapping of str to str
        The bone of the part, by the deforming bone.
    """
    parts = body_armature.body_bones(armature)
    names = [bone.name for bone in parts]
    above = body_armature.parents_of(parts)
    bones = [bone for bone in carriers if carriers[bone] in names]
    dice = np.random.default_rng(0)
    with at_rest(armature, [bone.name for bone in armature.data.bones]), without_limits(armature):
        for name in names:
            armature.pose.bones[name].scale = (1.0, 1.0, 1.0)  # the parts have that of the skin at rest
        update()
        standing, _ = body_armature.standing_frames(armature, parts)
        rest = posed_matrices(armature, [*names, *bones])
        size = float(np.ptp(rest[:, :3, 3], axis=0).max()) or 1.0
        posed: list[Array] = []
        for i, name in enumerate(names):
            own = np.eye(4)
            own[:3, :3] = rotations.exp(dice.normal(0, 0.3, 3))
            start = standing[i] if above[i] < 0 else posed[above[i]] @ np.linalg.inv(standing[above[i]]) @ standing[i]
            posed.append(start @ own)
            armature.pose.bones[name].matrix_basis = Matrix(own.tolist())
        update()
        shown = posed_matrices(armature, [*names, *bones])
    wanted = [*posed, *(posed[names.index(carriers[bone])] for bone in bones)]
    frames = [*standing, *(standing[names.index(carriers[bone])] for bone in bones)]
    for k, name in enumerate([*names, *bones]):
        goal = wanted[k] @ np.linalg.inv(frames[k]) @ rest[k]
        turn = rotations.log(rotations.orthonormal(goal[:3, :3].T @ shown[k][:3, :3]))
        apart = np.linalg.norm(goal[:3, 3] - shown[k][:3, 3])
        if np.linalg.norm(turn) > 10 * _RIGID_TOLERANCE or apart > 10 * _RIGID_TOLERANCE * size:
            part = above[k] if k < len(names) else names.index(carriers[name])
            with_whom = f" with {names[part]}" if part >= 0 else ""
            raise BodyError(
                f"it does not move{with_whom} alone, as a part of a body does{_held_by(armature, name)}",
                where=f"armature {armature.name}, bone {name}",
                todo="mute what frees it from the bone above, or give the character a rig of plain bones",
            )


def _held_by(armature: bpy.types.Object, name: str) -> str:
    """Return what besides their own pose moves a bone, or one above it."""
    moved = following(armature)
    for bone in (armature.pose.bones[name], *armature.pose.bones[name].parent_recursive):
        if bone.name in moved:
            return f": {'it' if bone.name == name else bone.name} is moved by {moved[bone.name]}"
        if not bone.bone.use_inherit_rotation:
            return f": {'it' if bone.name == name else bone.name} does not inherit rotation"
    return ""


def _upstream(armature: bpy.types.Object, bones: Iterable[str]) -> list[str]:
    """Bones that others hang on, by parents and constraints, and these themselves."""
    found: dict[str, None] = {}
    waiting = list(bones)
    while waiting:
        name = waiting.pop()
        bone: Any = armature.pose.bones.get(name)
        if bone is None or name in found:
            continue
        found[name] = None
        if bone.parent is not None:
            waiting.append(bone.parent.name)
        for constraint in list[Any](bone.constraints):
            targets = [constraint, *getattr(constraint, "targets", ())]
            waiting += [getattr(t, "subtarget", "") for t in targets if getattr(t, "target", None) == armature]
            if getattr(constraint, "pole_target", None) == armature:
                waiting.append(constraint.pole_subtarget)
    return list(found)


def _may_be_turned(armature: bpy.types.Object, name: str, bones: Collection[str], held: Collection[str]) -> bool:
    bone = armature.pose.bones[name]
    hangs = any(above.name in held and above.name in bones for above in bone.parent_recursive)
    flat = abs(bone.matrix.determinant()) < MIN_SCALE**3
    return name not in held and not all(bone.lock_rotation) and not hangs and not flat


def _moved(armature: bpy.types.Object, bones: Sequence[str], candidates: Sequence[str]) -> dict[str, set[str]]:
    """Return the bones that move rigidly with each candidate."""
    rest, standing = posed_matrices(armature, bones), posed_matrices(armature, candidates)
    size = float(np.ptp(rest[:, :3, 3], axis=0).max()) or 1.0
    back = np.linalg.inv(rest)
    found = {}
    for name, own in zip(candidates, standing, strict=True):
        matrices = moved_matrices(armature, name, [name, *bones])
        change = matrices[1:] @ back
        turned = matrices[0] @ np.linalg.inv(own)
        found[name] = {bone for bone, one in zip(bones, alike(change, turned, rest, size), strict=True) if one}
    update()
    return found


def alike(changes: Array, change: Array, rest: Array, size: float) -> Array:
    """Return which of some changes (B, 4, 4) of bones that stand at `rest` are one and the same change (4, 4), of any
    size.
    """
    apart = rotations.orthonormal(change[:3, :3]).T @ rotations.orthonormal(changes[:, :3, :3])
    heads = rest[:, :3, 3]
    goals = heads @ change[:3, :3].T + change[:3, 3]
    places = np.einsum("bij,bj->bi", changes[:, :3, :3], heads) + changes[:, :3, 3]
    turned = np.linalg.norm(rotations.log(rotations.orthonormal(change[:3, :3]))) > _RIGID_TOLERANCE
    still = np.linalg.norm(rotations.log(apart), axis=-1) < _RIGID_TOLERANCE
    return np.asarray(turned & still & (np.linalg.norm(places - goals, axis=-1) < _RIGID_TOLERANCE * size))


def _switched(
    armature: bpy.types.Object, bones: Sequence[str], moved: Mapping[str, set[str]]
) -> tuple[Settings, dict[str, set[str]]]:
    """Return the values of properties that switch constraints with which controls move more bones than they do now, and
    the bones that each candidate moves then.

    Parameters
    ----------
    moved : mapping of str to set of str
        The bones that each candidate moves now.
    """
    found: dict[Owner, dict[str, float]] = {}
    known = dict(moved)
    first: dict[tuple[Owner, str], Any] = {}
    for (name, key), owners in switches(armature).items():
        owner = owner_of(armature, name)
        before = first[name, key] = owner[key]
        concerned = [other for other in _upstream(armature, owners) if other in moved]
        for value in sorted({*property_ends(owner, key)} - {float(before)}):
            set_settings(armature, {name: {key: value}})
            tried = _moved(armature, bones, concerned)
            if sum(map(len, tried.values())) > sum(len(known[other]) for other in concerned):
                found[name] = {**found.get(name, {}), key: value}
                known |= tried
        set_settings(armature, {name: {key: found.get(name, {}).get(key, before)}})
    restore_settings(armature, first)
    update()
    return found, known


def _carried(
    armature: bpy.types.Object, bones: Sequence[str], moved: Mapping[str, set[str]], chosen: Collection[str]
) -> dict[str, str]:
    """The lowest of the chosen controls, besides itself, that each bone moves with: that which moves fewest."""
    found = {}
    for name in bones:
        able = [control for control in moved if name in moved[control] and control != name and control in chosen]
        if able:
            rest = armature.data.bones
            found[name] = min(able, key=lambda each: (len(moved[each]), -len(rest[each].parent_recursive)))
    return found


def _is_visible(armature: bpy.types.Object, bone: bpy.types.Bone) -> bool:
    """Whether an animator can see a bone in pose mode."""
    posed: Any = armature.pose.bones[bone.name]  # hides bones since Blender 5.0
    shown = not bone.collections or any(each.is_visible_effectively for each in bone.collections)
    return shown and not bone.hide and not getattr(posed, "hide", False)


def _chosen(armature: bpy.types.Object, bones: Sequence[str], moved: Mapping[str, set[str]]) -> dict[str, str]:
    """Return the control of each bone: of those that it moves with and that turn about its head, one that has a shape,
    and moves most; of equals one that is not hidden, the one that lies on the bone, or the lowest.
    """
    rest = armature.data.bones
    size = float(np.ptp([bone.head_local for bone in rest], axis=0).max()) or 1.0

    def rank(bone: bpy.types.Bone, control: bpy.types.Bone) -> tuple[object, ...]:
        shaped = armature.pose.bones[control.name].custom_shape is not None
        along = (bone.tail_local - control.tail_local).length < _RIGID_TOLERANCE * size and not control.use_deform
        return shaped, len(moved[control.name]), _is_visible(armature, control), along, len(control.parent_recursive)

    found = {}
    for name in bones:
        bone = rest[name]
        able = [rest[c] for c in moved if name in moved[c]]
        able = [c for c in able if (c.head_local - bone.head_local).length < _RIGID_TOLERANCE * size]
        if able:
            found[name] = max(able, key=lambda control: rank(bone, control)).name
    return found
