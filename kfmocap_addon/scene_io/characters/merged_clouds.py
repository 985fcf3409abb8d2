"""Which bones of a skinned character are worth a part of a body, and whose skin belongs to another bone's part."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import bpy
import numpy as np

from ....core.numerics.arrays import Array

_TWIST = ("twist", "roll")
"""Words in the names of bones that divide the twist of the one above; importers lose where bones point."""
_SIMULATED_WORDS = (
    "breast", "bust", "pectoral", "jiggle", "skirt", "dress", "coat", "cape", "cloak", "cloth", "sleeve", "ribbon",
    "hair", "j_sec", "スカート", "マント", "リボン", "髪", "胸", "袖", "falda", "jupe", "gonna", "saia", "umhang",
    "юбк", "плащ", "волос", "裙", "披风", "头发",
)  # fmt: skip
"""Words in the names of bones that a simulation moves, which follow the body."""
_REACH = 1.5
"""Of a part's own radius: farther off, hair, skirts and hats are left out, as a convex solid would span what is
between."""
_STRAIGHT = np.cos(np.radians(15))
"""Cosine of the angle within which a bone goes on as the one above, so that it may only divide its twist."""


def with_taken_in(
    armature: bpy.types.Object,
    clouds: Mapping[str, Array],
    taken_in: Mapping[str, str],
    loose: Collection[str],
    limbs: Collection[str],
) -> dict[str, Array]:
    """Add the points (V, 3) of some bones to those of others.

    Parameters
    ----------
    armature : bpy.types.Object
    clouds : mapping of str to ndarray, shape (V, 3)
        Points of the skin by the bone that moves them, in the armature's axes.
    taken_in : mapping of str to str
        The bone to which a bone's points are added.
    loose : collection of str
        Bones of which only points near the other bone's are added.
    limbs : collection of str
        Bones that are parts of their own, however small they are.
    """
    found: dict[str, list[Array]] = {name: [cloud] for name, cloud in clouds.items() if name not in taken_in}
    for name in [name for name in clouds if name in taken_in]:
        cloud, above = clouds[name], taken_in[name]
        if name in loose and above in clouds:
            cloud = cloud[_within_reach(armature.data.bones[above], clouds[above], cloud, limbs)]
        found.setdefault(above, []).append(cloud)
    return {name: np.concatenate(each) for name, each in found.items()}


def _within_reach(bone: bpy.types.Bone, own: Array, cloud: Array, limbs: Collection[str]) -> Array:
    """Return which points of a cloud (V, 3) are near a part with points `own` (W, 3), shape (V,): near its middle, or
    near the line from joint to joint if it is a segment of a limb.
    """
    next_joint = next((child for child in bone.children_recursive if child.name in limbs), None)
    if bone.name not in limbs or next_joint is None:
        middle = own.mean(axis=0)
        apart, reach = (np.linalg.norm(points - middle, axis=1) for points in (cloud, own))
        return np.asarray(apart < _REACH * reach.max())
    start, line = np.array(bone.head_local), np.array(next_joint.head_local - bone.head_local)
    apart, reach = (_from_line(points - start, line) for points in (cloud, own))
    return np.asarray(apart < _REACH * reach.max())


def _from_line(points: Array, line: Array) -> Array:
    """Return the distances (V,) of points (V, 3) from a line that begins at the origin and ends somewhere (3,)."""
    share = np.clip(points @ line / max(float(line @ line), 1e-12), 0.0, 1.0)
    return np.asarray(np.linalg.norm(points - share[:, None] * line, axis=1))


def merged_clouds(
    armature: bpy.types.Object,
    clouds: Mapping[str, Array],
    small: float,
    following: Collection[str],
    limbs: Collection[str],
) -> tuple[dict[str, Array], list[str]]:
    """Return the clouds of the bones that are worth a part, and the names of bones that were left out.

    The skin of small and of twist bones is added to what they hang on, as is that of bones that something else moves
    and no part hangs on. These are named, if they are not small.
    """
    found, left_out = dict(clouds), list[str]()
    for bone in sorted(armature.data.bones, key=lambda each: -len(each.parent_recursive)):
        name = bone.name
        if name not in found or bone.parent is None:
            continue
        last = not any(child.name in found for child in bone.children_recursive)
        twist = last and name not in limbs and (says_twist(name) or says_simulated(name) or _is_twist(bone, found))
        follows = last and name in following
        slight = name not in limbs and np.linalg.norm(np.ptp(found[name], axis=0)) < 2 * small
        above = next((p.name for p in bone.parent_recursive if p.name in found), None)
        if (twist and bone.parent.use_deform) or (follows and bone.parent.name in limbs):
            above = bone.parent.name  # where twist bones lead all of a limb's skin, its own bone leads none
        if above is not None and (slight or twist or follows):
            cloud = found.pop(name)
            found[above] = np.concatenate([found[above], cloud]) if above in found else cloud
            left_out += [] if slight or twist else [name]
    return found, sorted(left_out)


def says_twist(name: str) -> bool:
    """Whether a bone's name says that it divides the twist of the one above."""
    return any(word in name.casefold() for word in _TWIST)


def says_simulated(name: str) -> bool:
    """Whether a bone's name says that a simulation moves it."""
    return any(word in name.casefold() for word in _SIMULATED_WORDS)


def _is_twist(bone: bpy.types.Bone, found: Mapping[str, Array]) -> bool:
    """A bone that lies within the one above, has nothing below, and so only divides its twist."""
    parent = bone.parent
    if parent is None or any(child.name in found for child in bone.children):
        return False
    along = (bone.tail_local - bone.head_local).normalized() @ (parent.tail_local - parent.head_local).normalized()
    way = (bone.head_local - parent.head_local) @ (parent.tail_local - parent.head_local).normalized()
    beside = [child for child in parent.children if child != bone and child.name in found]
    return bool(beside) and along > _STRAIGHT and -0.05 * parent.length <= way < 0.9 * parent.length
