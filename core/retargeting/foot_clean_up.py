"""Cleaning up the feet of a tracked motion: planted points stand still, and key poses are not changed.

The method is that of `core.retargeting.contacts.foot_keeping`, with the body as its own target.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..body.body import Body
from ..body.kinematics import motion_of_poses
from ..body.motion import Motion
from ..body.skeleton_motion import motion_of_body
from ..errors import BodyError
from ..numerics.arrays import Array, Bools
from ..shot.shot import KeyPoses
from .bone_roles.roles import BoneMap
from .control_rig import ControlRig
from .retarget import prepared, retarget
from .transfer import RetargetOptions


def with_clean_feet(
    body: Body,
    motion: Motion,
    fps: float,
    keys: KeyPoses,
    planted: Mapping[str, Bools] | None = None,
) -> Motion:
    """Return a motion whose planted feet stand still, flat where heel and ball are planted.

    Parameters
    ----------
    body : Body
        A human body; its parts may have any names.
    motion : Motion
        F frames.
    fps : float
        Frames per second.
    keys : KeyPoses
        The degrees of freedom that they fix do not change. The corrections that they would get are subtracted from the
        frames between, so that a foot stands where the key poses have it, and moves between these places if they
        differ.
    planted : mapping of str to ndarray of bool, shape (F,), optional
        See `core.retargeting.contacts.foot_paths.foot_paths`.

    Raises
    ------
    BodyError
        The body is not human, or its hips are not its first part.
    """
    source, bones = prepared(motion_of_body(body, motion, "body", fps))
    R_rest = np.stack([part.R_world_rest for part in body.parts])
    parents = tuple(body.parents)
    rig = ControlRig(source.rest, _without_root(bones), parents, R_rest, R_rest)
    poses = retarget(source, bones, rig, RetargetOptions(feet="clean", scale=1.0), planted).poses
    if rig.index("hips") != 0:
        raise BodyError("the hips hang on another part", where=f"part {rig.bones.bones['hips'][0]}")
    driven = poses.driven
    turns = np.where(driven[:, None, None], poses.turns, source.turns)
    cleaned = motion_of_poses(body, (turns @ R_rest, poses.places))
    step = motion.difference(Motion(cleaned.translations, cleaned.rotations))
    step[:, np.repeat(~np.append(True, driven), 3)] = 0.0
    return motion.moved(step - _of_keys(step, keys))


def _without_root(bones: BoneMap) -> BoneMap:
    return BoneMap({role: names for role, names in bones.bones.items() if role != "root"}, bones.preset)


def _of_keys(step: Array, keys: KeyPoses) -> Array:
    """Interpolate the corrections of key poses, rows of `step` (F, D), to all frames, shape (F, D)."""
    found = np.zeros_like(step)
    frames = np.arange(len(step))
    for d, fixed in enumerate(keys.fixed.T):
        keyed = np.asarray(keys.frames)[fixed]
        if len(keyed):
            found[:, d] = np.interp(frames, keyed, step[keyed, d])
    return found
