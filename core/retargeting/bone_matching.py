"""Matching bones to roles: by a preset's names, else by words in the names, else by their positions at rest."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from ..body.skeleton_motion import RestSkeleton
from ..errors import BodyError
from .bone_roles.bone_names import completed, roles_by_name
from .bone_roles.bone_positions import roles_by_position
from .bone_roles.bone_presets import PRESETS, BonePreset
from .bone_roles.bone_words import NAMESPACE, read_name
from .bone_roles.roles import FINGERS, SIDES, BoneMap, parent_role
from .bone_roles.skeleton_tree import SkeletonTree
from .rest_poses.rest_alignment import feet_point_back

_ENDS = {"forearm": "hand", "shin": "foot"}
_CALLED_END = re.compile(r"(?<![a-z])end(?![a-z])", re.IGNORECASE)
_LEAST_LIMB = 0.5
"""Least length of a forearm or shin, in that of the bone above it."""
_STRAIGHT = 0.87
"""Cosine of the largest angle at a bone that divides a limb's segment."""


def match_bones(rest: RestSkeleton, preset: str | None = None, where: str = "skeleton") -> BoneMap:
    """Find which bones play which roles.

    Parameters
    ----------
    rest : RestSkeleton
        Z up, facing any direction.
    preset : str, optional
        Name of the preset to use; by default the one that matches most of the bones, else names, else positions.
    where : str
        What the bones belong to, for error messages.

    Raises
    ------
    BodyError
        The preset is unknown, or bones that it needs are missing; or the required roles cannot be found.
    """
    if preset is not None:
        if preset not in PRESETS:
            raise BodyError(f"there is no preset '{preset}'", where=where, todo=f"choose {', '.join(PRESETS)}")
        return by_preset(rest.names, preset).checked(rest.names, where)
    return _facing_forward(_found(rest, where), rest)


def _found(rest: RestSkeleton, where: str) -> BoneMap:
    """Return the roles by the preset that fits best, names or positions; see `match_bones`."""
    found = [by_preset(rest.names, name) for name in PRESETS]
    whole = [one for one in found if not one.missing() and _carries_legs(one, rest)]
    if whole:
        best = max(whole, key=lambda one: len(one.names()))
        return best if preset_of(best).follows else completed(best, roles_by_name(rest), rest)
    by_names, places = roles_by_name(rest), roles_by_position(rest)
    if not by_names.missing():
        return _with_placed(by_names, places, rest)
    if not places or _contradicted(places, by_names):
        return by_names.checked(rest.names, where)
    return _with_named(BoneMap(places, found_by="places"), by_names, rest).checked(rest.names, where)


def _contradicted(places: Mapping[str, tuple[str, ...]], names: BoneMap) -> bool:
    """Whether the names of feet or hands say that what seems to be a shin or a forearm is the end of a limb of one bone
    only.
    """
    limbs = [(limb, end) for limb, end in _ENDS.items() if all(f"{end}.{side}" in names.bones for side in SIDES)]
    return any(all(places.get(f"{limb}.{s}") == names.bones[f"{end}.{s}"] for s in SIDES) for limb, end in limbs)


def _facing_forward(bones: BoneMap, rest: RestSkeleton) -> BoneMap:
    """Return a map with left and right exchanged where a skeleton that stands has its toes behind its feet: its sides
    are named as seen from the front.
    """
    toes = all(f"toe.{side}" in bones.bones for side in SIDES)
    knee, shoulder = (rest.heads[rest.indices(bones.bones[f"{role}.L"])[0]] for role in ("shin", "upper_arm"))
    rise = shoulder - knee
    if not toes or rise[2] < np.abs(rise[:2]).max() or not feet_point_back(rest, bones):
        return bones
    other = {"L": "R", "R": "L"}
    exchanged = {
        ".".join([role.partition(".")[0], other[side]]) if (side := role.partition(".")[2]) else role: names
        for role, names in bones.bones.items()
    }
    return BoneMap(exchanged, bones.preset, bones.found_by)


def sides_exchanged(bones: BoneMap) -> bool:
    """Whether both thighs have the side of the other in their names."""
    sides = [side_of_bone(bones.bones[f"thigh.{side}"][0]) for side in SIDES]
    return sides == [*SIDES][::-1]


def _carries_legs(bones: BoneMap, rest: RestSkeleton) -> bool:
    """Whether the legs found by a preset are children of its hips or siblings of them. If not, and these are not
    controls, the preset has taken the spine for the hips, which have another name in the rig.
    """
    if preset_of(bones).follows:
        return True
    [hips, *_] = rest.indices(bones.bones["hips"])
    tree = SkeletonTree(rest)
    carrier = tree.common(rest.indices([bones.bones[f"thigh.{side}"][0] for side in SIDES]))
    return carrier < 0 or not tree.is_above(carrier, hips) or rest.names[carrier] in bones.names()


def _with_named(places: BoneMap, names: BoneMap, rest: RestSkeleton) -> BoneMap:
    """Return roles found by position, together with those of bones below them that only names show: fingers, or the
    head of a bird, which is not above its body.
    """
    tree, bones = SkeletonTree(rest), dict(places.bones)
    for role, named in names.bones.items():
        above = bones.get(parent_role(role, bones), ())
        free = not set(named) & {name for played in bones.values() for name in played}
        if role not in bones and above and free:
            top, *_ = rest.indices(named)
            if tree.is_above(rest.indices(above)[-1], top):
                bones[role] = named
    return BoneMap(bones, found_by="places")


def _with_placed(names: BoneMap, places: Mapping[str, tuple[str, ...]], rest: RestSkeleton) -> BoneMap:
    """Return roles found by names, together with head, neck and fingers that only positions show; and hands and
    feet, as they may be called the end of a limb. Where the ankle is called so, what is called foot are toes.
    """
    bones = dict(names.bones)
    for limb, end, toe in ((f"{limb}.{s}", f"{end}.{s}", f"toe.{s}") for s in SIDES for limb, end in _ENDS.items()):
        if end not in places or bones[limb] != places.get(limb) or not _may_end(rest, *bones[limb], *places[end]):
            continue
        named = bones.get(end)
        if named is None:
            bones[end] = places[end]
        elif toe not in bones and _bends(rest, (*bones[limb], *places[end], *named)):
            bones |= {end: places[end], toe: named}
    used = [name for played in bones.values() for name in played]
    found = names if len(set(used)) < len(used) else BoneMap(bones, found_by=names.found_by)
    named_hands = {role.partition(".")[2] for role in found.bones if role.partition(".")[0] in FINGERS}
    more = {
        role: played
        for role, played in places.items()
        if role in ("neck", "head") or (role.partition(".")[0] in FINGERS and role.partition(".")[2] not in named_hands)
    }
    return completed(found, BoneMap({**more, **found.bones}), rest)


def _may_end(rest: RestSkeleton, limb: str, end: str) -> bool:
    """Whether a bone below that of a limb may be where it ends: it is no twist bone, and as far as the limb is long."""
    if read_name(end).kind == "helper" and not _CALLED_END.search(end):
        return False
    [own, last] = rest.indices([limb, end])
    before = rest.heads[rest.parents[own]]
    return bool(
        np.linalg.norm(rest.heads[last] - rest.heads[own]) > _LEAST_LIMB * np.linalg.norm(rest.heads[own] - before)
    )


def _bends(rest: RestSkeleton, chain: Sequence[str]) -> bool:
    """Whether three bones, each below the one before, are not on one line, as knee, ankle and ball are not."""
    tree, [a, b, c] = SkeletonTree(rest), rest.indices(chain)
    if not (tree.is_above(a, b) and tree.is_above(b, c)):
        return False
    one, other = rest.heads[b] - rest.heads[a], rest.heads[c] - rest.heads[b]
    return bool(one @ other < _STRAIGHT * np.linalg.norm(one) * np.linalg.norm(other))


def preset_of(bones: BoneMap) -> BonePreset:
    """Return the preset of a bone map; one without settings if it has none."""
    return PRESETS.get(bones.preset, BonePreset("", "", {}))


def by_preset(names: Iterable[str], preset: str) -> BoneMap:
    """Return the bones that a preset names, ignoring namespace and case."""
    known: dict[str, str] = {}
    for name in reversed(list(names)):
        known[_plain(name)] = name
        known[name] = name
    bones = {}
    for role, wanted in PRESETS[preset].bones.items():
        there = [known.get(one, known.get(_plain(one))) for one in wanted]
        played = tuple(name for name in there if name is not None)
        if played:
            bones[role] = played
    return BoneMap(bones, preset)


def _plain(name: str) -> str:
    return NAMESPACE.sub("", name).casefold()


def side_of_bone(name: str) -> str:
    """Return the side in a bone's name ("L", "R" or empty), however the rig writes it."""
    return read_name(name).side


def described(bones: BoneMap) -> Mapping[str, Sequence[str]]:
    """Return a map as plain lists by role, for reports and files."""
    return {role: list(bones.bones[role]) for role in bones.bones}
