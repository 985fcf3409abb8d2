"""Rigs of every preset made of one human, and motion on them, for the tests of retargeting."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from kfmocap.core.body import Body, human
from kfmocap.core.body.motion import Motion
from kfmocap.core.body.skeleton_motion import RestSkeleton, SkeletonMotion, motion_of_body
from kfmocap.core.numerics import rotations
from kfmocap.core.retargeting.bone_matching import by_preset
from kfmocap.core.retargeting.bone_roles.bone_presets import PRESETS
from kfmocap.core.retargeting.bone_roles.roles import PARENTS, BoneMap, parent_role
from kfmocap.core.retargeting.control_rig import ControlRig, RigPoses
from kfmocap.core.retargeting.retarget import grounded

JOINTS = {"pelvis": "hips", "spine": "spine", "chest": "spine", "head": "head"}
LONGER_LEGS = {"thigh": 1.2 * 0.245 * 1.75, "shin": 1.2 * 0.246 * 1.75}
SHORTER_ARMS = {"upper_arm": 0.85 * 0.172 * 1.75, "forearm": 0.85 * 0.150 * 1.75}


def joint_places(body: Body) -> dict[str, np.ndarray]:
    """Heads of the bones of a human by role, ends of spine and neck, and tails of the last bones."""
    part = {p.name: p for p in body.parts}
    found = {"root": np.zeros(3), "hips": part["pelvis"].head_world, "spine": part["spine"].head_world}
    found |= {"chest": part["chest"].head_world, "head": part["head"].head_world, "top": part["head"].tail_world}
    for side in "LR":
        for limb in ("upper_arm", "forearm", "hand", "thigh", "shin", "foot"):
            found[f"{limb}.{side}"] = part[f"{limb}.{side}"].head_world
        found[f"fingertip.{side}"] = part[f"hand.{side}"].tail_world
        found[f"tiptoe.{side}"] = part[f"foot.{side}"].tail_world
        found[f"shoulder.{side}"] = part[f"shoulder.{side}"].head_world
    return found


def made_rig(preset: str, body: Body, droop: float = 0.0, seed: int = 0, scale: float = 1.0) -> ControlRig:
    """A rig with a preset's names in the proportions of a body, its arms lowered by an angle, its rolls at random.

    It has neither toes nor fingers: those of the preset's bones that the human has.
    """
    at = joint_places(body)
    for side, sign in (("L", 1.0), ("R", -1.0)):
        turn = rotations.exp(np.array([0.0, sign * droop, 0.0]))
        pivot = at[f"upper_arm.{side}"]
        for joint in ("forearm", "hand", "fingertip"):
            at[f"{joint}.{side}"] = pivot + turn @ (at[f"{joint}.{side}"] - pivot)
    wanted = PRESETS[preset].bones
    heads: dict[str, np.ndarray] = {}
    tails: dict[str, np.ndarray] = {}
    parents: dict[str, str] = {}
    bones: dict[str, tuple[str, ...]] = {}
    for role in PARENTS:
        base, _, side = role.partition(".")
        if role not in wanted or base in ("root", "toe", "thumb", "index", "middle", "ring", "pinky"):
            continue
        names = wanted[role]
        above = parent_role(role, bones)
        last = bones[above][-1] if above else ""
        ends = _ends(role, base, side, at)
        points = np.linspace(*ends, len(names) + 1)
        for k, name in enumerate(names):
            heads[name], tails[name], parents[name] = points[k], points[k + 1], last
            last = name
        bones[role] = names
    order = list(heads)
    rest = RestSkeleton(
        tuple(order),
        tuple(order.index(parents[n]) if parents[n] else -1 for n in order),
        np.array([heads[n] for n in order]) * scale,
        np.array([tails[n] for n in order]) * scale,
    )
    dice = np.random.default_rng(seed)
    R = rotations.exp(dice.normal(0, 1, (len(order), 3)))
    found = BoneMap(bones, preset)
    return ControlRig(grounded(rest, found), found, rest.parents, R, R)


def _ends(role: str, base: str, side: str, at: Mapping[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    following = {"shoulder": "upper_arm", "upper_arm": "forearm", "forearm": "hand", "hand": "fingertip"}
    following |= {"thigh": "shin", "shin": "foot"}
    if base == "foot":
        return at[role], at[f"tiptoe.{side}"]
    if base in following:
        return at[role], at[f"{following[base]}.{side}"]
    neck = 0.85 * at["head"] + 0.15 * at["top"]
    ends = {"hips": ("hips", "spine"), "spine": ("spine", "head"), "head": ("head", "top"), "neck": ("head", "head")}
    first, last = (at[name] for name in ends[role])
    return (first, neck) if role == "neck" else (first, last)


def moved_body(body: Body, motion: Motion, fps: float = 30.0) -> SkeletonMotion:
    """A motion of a body as what retargeting reads."""
    return motion_of_body(body, motion, "man", fps)


def moved_rig(rig: ControlRig, poses: RigPoses, fps: float = 30.0) -> SkeletonMotion:
    """Poses of a rig as a source."""
    return SkeletonMotion("rig", rig.rest, poses.turns, poses.places, fps)


def wild_motion(frames: int = 5, seed: int = 0, *, collar_bones: bool = True) -> Motion:
    """Any poses of the default body."""
    parts = len(human(collar_bones=collar_bones))
    dice = np.random.default_rng(seed)
    path = np.cumsum(dice.normal(0, 0.1, (frames, 3)), axis=0) + [1.0, 2.0, 1.0]
    return Motion(path, rotations.exp(np.cumsum(dice.normal(0, 0.2, (frames, parts, 3)), axis=0)))


__all__ = ["by_preset", "joint_places", "made_rig", "moved_body", "moved_rig", "wild_motion"]
