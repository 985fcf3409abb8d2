"""Where on a body keypoints are: near the landmarks, with offsets that are solved for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..body import Body
from ..body.kinematics import Poses
from ..formats.keypoint_layouts import is_sided, mirrored_name
from ..numerics.arrays import Array

HIP_OFFSET_SIGMA = 0.045
"""Standard deviation of the offset of a hip's keypoint along each axis, metres: hips lie deep in the body."""
OFFSET_SIGMA = 0.03
"""Standard deviation of the offsets of shoulders and of keypoints on the head and the feet, metres."""
LIMB_OFFSET_SIGMA = 0.02
"""Standard deviation of the offsets of a limb's joints along the limb, metres."""
THINNESS = (2.0, 1.0, 2.0)
"""Divisors of a limb's offset deviation along the x, y and z axes of the part: across a thin limb, offsets are smaller.
"""
OFFSET_ASYMMETRY = 0.3
"""Standard deviation of an offset from the mirror image of the other side's, as a share of the offset's own."""
_LIMB = ("Elbow", "Wrist", "Knee", "Ankle")
_TRUNK = ("LShoulder", "RShoulder", "LHip", "RHip")
FACE = {"Eye": (0.11, 0.62, 0.17), "Ear": (0.26, 0.55, 0.0)}
"""Left, up and forward in a head's frame, in lengths of the head."""


@dataclass(frozen=True, eq=False)
class KeypointOffsets:
    """Positions of the keypoints on the body.

    Attributes
    ----------
    parts : ndarray of int, shape (L,)
    local : ndarray, shape (L, 3)
        Positions of the landmarks in the frames of their parts, metres.
    offsets : ndarray, shape (L, 3)
        From the landmarks to the points that the detector finds, in the same frames, metres.
    """

    parts: NDArray[np.int64]
    local: Array
    offsets: Array

    @classmethod
    def on(cls, body: Body, names: Sequence[str]) -> KeypointOffsets:
        """Return the positions of keypoints on a body, without offsets from their landmarks."""
        placed = [keypoint_on_body(body, name) for name in names]
        local = np.array([point for _, point in placed], float).reshape(-1, 3)
        return cls(np.array([part for part, _ in placed], np.int64), local, np.zeros_like(local))

    def on_body(self, body: Body, names: Sequence[str]) -> KeypointOffsets:
        """Return the same offsets on another body."""
        return replace(KeypointOffsets.on(body, names), offsets=self.offsets)

    def world(self, poses: Poses) -> Array:
        """World positions of the keypoints, metres, shape (F, L, 3)."""
        R, T = poses
        return np.asarray(np.einsum("flab,lb->fla", R[:, self.parts], self.local + self.offsets) + T[:, self.parts])


def keypoint_on_body(body: Body, name: str) -> tuple[int, Array]:
    """Return the part that carries a keypoint, and the keypoint's landmark in its frame, metres.

    What a detector calls a shoulder or a hip is a point of the part that the limb hangs on, collar bone or trunk: it
    does not turn with the limb.
    """
    if name not in body.landmarks and name[1:] in FACE and "Head" in body.landmarks:
        part, top = body.landmarks["Head"]
        left, up, forward = FACE[name[1:]]
        return part, float(np.linalg.norm(top)) * np.array([left if name[0] == "L" else -left, up, forward])
    part, point = body.landmarks[name]
    if name.endswith(_TRUNK) and not point.any() and body.parents[part] >= 0:
        return int(body.parents[part]), body.offsets[part]
    return part, point


def has_keypoint(body: Body, name: str) -> bool:
    """Whether the body has a place for a keypoint."""
    return name in body.landmarks or (name[1:] in FACE and "Head" in body.landmarks)


def offset_sigma(name: str) -> float:
    """Standard deviation of a keypoint's offset from its landmark along each axis, metres."""
    if name.endswith("Hip"):
        return HIP_OFFSET_SIGMA
    return LIMB_OFFSET_SIGMA if name.endswith(_LIMB) else OFFSET_SIGMA


def offset_precision(names: Sequence[str]) -> Array:
    """Inverse covariance of the offsets' prior, (3 L, 3 L): offsets are small, left and right mirror each other."""
    L, axes = len(names), np.arange(3)
    precision = np.zeros((L, 3, L, 3))
    mirror = np.array([-1.0, 1.0, 1.0])  # the x axes of a left part and its right one point to the same side
    for i, name in enumerate(names):
        paired = is_sided(name) and mirrored_name(name) in names
        other = names.index(mirrored_name(name)) if paired else i
        usual = offset_sigma(name) ** 2
        if not paired:
            precision[i, axes, i, axes] = 1 / usual
        elif i < other:
            apart = OFFSET_ASYMMETRY**2 * usual
            (own, cross), _ = np.linalg.inv([[usual + apart, usual], [usual, usual + apart]])
            precision[i, axes, i, axes] = precision[other, axes, other, axes] = own
            precision[i, axes, other, axes] = precision[other, axes, i, axes] = cross * mirror
    scale = np.array([THINNESS if name.endswith(_LIMB) else (1.0, 1.0, 1.0) for name in names]).reshape(-1, 3)
    return np.asarray((precision * scale[:, :, None, None] * scale).reshape(3 * L, 3 * L))
