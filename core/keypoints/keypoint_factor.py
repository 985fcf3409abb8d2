"""2D keypoints as evidence: where a detector saw points of the body, by wrench accumulation.

A keypoint is a point of a part. Its two residuals in the image, times its depth, are metres across the ray; their rows
against the part's twist are the wrenches of the image's two axes, and add to the sums of the other evidence. What a
detector calls a hip is not the joint's centre: every keypoint has a constant offset from its landmark in the part's
frame, unknown like the motion and solved for with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..body import Body, twist_jacobian
from ..body.joint_blocks import joint_blocks
from ..body.joint_limits import habitual_prior
from ..body.kinematics import Poses, motion_of_poses
from ..formats.keypoint_layouts import is_sided, mirrored_name
from ..numerics.arrays import Array
from ..numerics.banded_blocks import BandedBlocks
from ..numerics.robust_kernels import RAYLEIGH_MEDIAN, GemanMcClure

LEAST_DEVIATION = 0.006
"""No keypoint is surer than this, metres."""
USUAL_DEVIATION = 0.02
"""Deviation of keypoints of which too little is seen to estimate it, metres."""
PRIOR_COUNT = 10.0
"""Keypoints of usual deviation that count beside those found, for each view and joint."""
LIFTED_DEVIATION = 0.3
"""What depths that follow from the lengths of bones are worth, metres: they err alike for many frames."""
GROSS = 3.0
"""Standard deviations at which a keypoint counts for a quarter of one that is right (Geman and McClure's error)."""
HIP_OFFSET_DEVIATION = 0.045
"""Usual distance of a hip's keypoint from the joint along each axis, metres: hips lie deep in the body."""
OFFSET_DEVIATION = 0.03
"""Usual distance from their landmarks of shoulders and of keypoints on the head and the feet, metres."""
LIMB_OFFSET_DEVIATION = 0.02
"""Usual distance of keypoints from the joints of a limb along the limb, metres."""
THINNESS = (2.0, 1.0, 2.0)
"""Limbs are thin: along these axes of the part offsets are so many times smaller."""
OFFSET_ASYMMETRY = 0.3
"""Share of its usual size by which an offset departs from the mirror image of the other side's."""
_LIMB = ("Elbow", "Wrist", "Knee", "Ankle")
_TRUNK = ("LShoulder", "RShoulder", "LHip", "RHip")


@dataclass(frozen=True, eq=False)
class Keypoints:
    """Keypoints of one performer on F frames, in V views.

    Attributes
    ----------
    names : tuple of str, length L
    rays : ndarray, shape (V, F, L, 2)
        Places in the images at a distance of one: (x / z, y / z) in camera axes, without lens distortion. NaN where a
        keypoint was not found.
    confidence : ndarray, shape (V, F, L)
        0 to 1.
    R_cam_world, t_cam_world : ndarray, shape (V, F, 3, 3) and (V, F, 3)
        Poses of the cameras.
    """

    names: tuple[str, ...]
    rays: Array
    confidence: Array
    R_cam_world: Array
    t_cam_world: Array

    def __len__(self) -> int:
        return self.rays.shape[1]

    def __getitem__(self, frames: slice | Sequence[int] | NDArray[Any]) -> Keypoints:
        """Return the keypoints of some of the frames."""
        return replace(
            self,
            rays=self.rays[:, frames],
            confidence=self.confidence[:, frames],
            R_cam_world=self.R_cam_world[:, frames],
            t_cam_world=self.t_cam_world[:, frames],
        )

    def of_views(self, views: list[int]) -> Keypoints:
        """Return the keypoints of some of the views."""
        R, t = self.R_cam_world[views], self.t_cam_world[views]
        return Keypoints(self.names, self.rays[views], self.confidence[views], R, t)

    def residuals(self, points_world: Array) -> Array:
        """Metres across the rays from the keypoints to points (F, L, 3), shape (V, F, L, 2); NaN where not found."""
        x = np.einsum("vfab,flb->vfla", self.R_cam_world, points_world) + self.t_cam_world[:, :, None]
        z = np.where(x[..., 2] > 0.1, x[..., 2], np.nan)
        return np.asarray(x[..., :2] - self.rays * z[..., None])

    def across(self) -> Array:
        """Derivatives of the residuals by the points, shape (V, F, L, 2, 3): each image axis, less what moving along
        the ray takes away, in the world; as of a ray along the optical axis where a keypoint was not found.
        """
        R = self.R_cam_world[:, :, None]
        return R[..., :2, :] - np.nan_to_num(self.rays)[..., None] * R[..., 2:, :]


@dataclass(frozen=True, eq=False)
class Places:
    """Places of the keypoints on the body.

    Attributes
    ----------
    parts : ndarray of int, shape (L,)
    local : ndarray, shape (L, 3)
        The landmarks in the frames of their parts, metres.
    offsets : ndarray, shape (L, 3)
        From there to what the detector means.
    """

    parts: NDArray[np.int64]
    local: Array
    offsets: Array

    @classmethod
    def on(cls, body: Body, names: Sequence[str]) -> Places:
        """Return the places of keypoints at their landmarks on a body."""
        placed = [keypoint_on_body(body, name) for name in names]
        local = np.array([point for _, point in placed], float).reshape(-1, 3)
        return cls(np.array([part for part, _ in placed], np.int64), local, np.zeros_like(local))

    def on_body(self, body: Body, names: Sequence[str]) -> Places:
        """Return the same offsets on another body."""
        return replace(Places.on(body, names), offsets=self.offsets)

    def world(self, poses: Poses) -> Array:
        """The keypoints in the world, metres, shape (F, L, 3)."""
        R, T = poses
        return np.asarray(np.einsum("flab,lb->fla", R[:, self.parts], self.local + self.offsets) + T[:, self.parts])


_FACE = {"Eye": (0.11, 0.62, 0.17), "Ear": (0.26, 0.55, 0.0)}
"""Left, up and forward in a head's frame, in lengths of the head."""


def keypoint_on_body(body: Body, name: str) -> tuple[int, Array]:
    """Return the part that carries a keypoint, and the keypoint's landmark in its frame, metres.

    What a detector calls a shoulder or a hip is a point of what the limb hangs on, collar bone or trunk: it does not
    turn about the joint with the limb.
    """
    if name[1:] in _FACE and "Head" in body.landmarks:
        part, top = body.landmarks["Head"]
        left, up, forward = _FACE[name[1:]]
        return part, float(np.linalg.norm(top)) * np.array([left if name[0] == "L" else -left, up, forward])
    part, point = body.landmarks[name]
    if name.endswith(_TRUNK) and not point.any() and body.parents[part] >= 0:
        return int(body.parents[part]), body.offsets[part]
    return part, point


def has_keypoint(body: Body, name: str) -> bool:
    """Whether the body has a place for a keypoint."""
    return name in body.landmarks or (name[1:] in _FACE and "Head" in body.landmarks)


def offset_deviation(name: str) -> float:
    """Usual distance of a keypoint from its landmark along each axis, metres."""
    if name.endswith("Hip"):
        return HIP_OFFSET_DEVIATION
    return LIMB_OFFSET_DEVIATION if name.endswith(_LIMB) else OFFSET_DEVIATION


def offset_precision(names: Sequence[str]) -> Array:
    """Inverse covariance of the offsets before anything is seen, shape (3 L, 3 L): their size, and that a detector's
    left mirrors its right.
    """
    L, axes = len(names), np.arange(3)
    precision = np.zeros((L, 3, L, 3))
    mirror = np.array([-1.0, 1.0, 1.0])  # the x axes of a left part and its right one point to the same side
    for i, name in enumerate(names):
        paired = is_sided(name) and mirrored_name(name) in names
        other = names.index(mirrored_name(name)) if paired else i
        usual = offset_deviation(name) ** 2
        if not paired:
            precision[i, axes, i, axes] = 1 / usual
        elif i < other:
            apart = OFFSET_ASYMMETRY**2 * usual
            (own, cross), _ = np.linalg.inv([[usual + apart, usual], [usual, usual + apart]])
            precision[i, axes, i, axes] = precision[other, axes, other, axes] = own
            precision[i, axes, other, axes] = precision[other, axes, i, axes] = cross * mirror
    scale = np.array([THINNESS if name.endswith(_LIMB) else (1.0, 1.0, 1.0) for name in names])
    return np.asarray((precision * scale[:, :, None, None] * scale).reshape(3 * L, 3 * L))


@dataclass(frozen=True, eq=False)
class KeypointSystem:
    """Normal equations of the keypoints of one performer: of the poses, the offsets, and both.

    Attributes
    ----------
    blocks : BandedBlocks
        F frames of D degrees of freedom.
    border : ndarray, shape (F, D, 3 L)
        Poses against offsets.
    corner : ndarray, shape (3 L, 3 L)
    gradient : ndarray, shape (3 L,)
        Of half the energy by the offsets.
    """

    blocks: BandedBlocks
    border: Array
    corner: Array
    gradient: Array


def deviations(residuals: Array, confidence: Array) -> Array:
    """Robust standard deviation of every view's keypoints over the frames, metres, shape (V, L)."""
    return deviations_of_lengths(np.linalg.norm(residuals, axis=-1), confidence)


def deviations_of_lengths(lengths: Array, confidence: Array) -> Array:
    """The same from the lengths of the residuals, shape (V, F, L), NaN where there are none."""
    lengths = np.where(confidence > 0, lengths, np.nan)
    seen = np.isfinite(lengths).sum(axis=1)
    medians = np.nanquantile(np.where(seen[:, None] > 0, lengths, 0.0), 0.5, axis=1)
    own = np.nan_to_num(medians) / RAYLEIGH_MEDIAN
    mean = (seen * own + PRIOR_COUNT * USUAL_DEVIATION) / (seen + PRIOR_COUNT)
    return np.asarray(np.maximum(mean, LEAST_DEVIATION))


def robust_energy(residuals: Array, confidence: Array, deviation: Array) -> float:
    """Return the sum of Geman and McClure's errors, in variances.

    Parameters
    ----------
    residuals : ndarray, shape (V, F, L, 2)
        Metres; NaN where a keypoint was not found, or its point is behind the camera: then it counts in full.
    confidence : ndarray, shape (V, F, L)
    deviation : ndarray, shape (V, L)
        Metres.
    """
    kernel = GemanMcClure(GROSS)
    error = np.sum(residuals**2, axis=-1) / deviation[:, None] ** 2
    return float(np.sum(confidence * np.where(np.isfinite(error), kernel.cost(error), kernel.scale**2)))


def robust_weights(residuals: Array, confidence: Array, deviation: Array, tolerance: float = 1.0) -> Array:
    """Return the weights that belong to `robust_energy`, over the variance, shape (V, F, L); 0 for NaN."""
    error = np.sum(residuals**2, axis=-1) / deviation[:, None] ** 2
    weight = confidence * GemanMcClure(GROSS * tolerance).weight(error) / deviation[:, None] ** 2
    return np.nan_to_num(weight)


def trusted_weights(residuals: Array, agreed: Array, deviation: Array, tolerance: float = 1.0) -> Array:
    """Return Huber's weights over the variance, shape (V, F, L), of keypoints that views agree on; 0 for NaN.

    They are no outliers, however far a motion is from them so far, and go on to pull where Geman and McClure's weights
    would let go.

    Parameters
    ----------
    residuals : ndarray, shape (V, F, L, 2)
    agreed : ndarray, shape (V, F, L)
        Confidence of the keypoints that agree with those of other views, else 0.
    deviation : ndarray, shape (V, L)
    tolerance : float
    """
    size = np.linalg.norm(residuals, axis=-1) / deviation[:, None]
    with np.errstate(invalid="ignore", divide="ignore"):
        huber = np.minimum(1.0, GROSS * tolerance / size)
    return np.nan_to_num(agreed * huber / deviation[:, None] ** 2)


def keypoint_system(
    body: Body, poses: Poses, keypoints: Keypoints, places: Places, weights: Array, *, prior_weight: float = 1.0
) -> KeypointSystem:
    """Sum the evidence of keypoints around poses and offsets.

    Parameters
    ----------
    body : Body
    poses : tuple
        (R, T) of its P parts, F frames.
    keypoints : Keypoints
    places : Places
    weights : ndarray, shape (V, F, L)
    prior_weight : float
        Factor of what is known of the offsets beforehand.
    """
    R, T = poses
    F, L, D = len(T), len(keypoints.names), body.dof
    points = places.world(poses)
    residual = np.nan_to_num(keypoints.residuals(points))
    across = keypoints.across()
    wrench = np.concatenate([across, np.cross(points[None, :, :, None], across)], axis=-1)
    weighted = wrench * weights[..., None, None]
    H = np.einsum("vflka,vflkb->flab", weighted, wrench)
    g = np.einsum("vflka,vflk->fla", weighted, residual)
    shift = np.einsum("vflkb,flbc->vflkc", across, R[:, places.parts])
    cross = np.einsum("vflka,vflkc->flac", weighted, shift)
    corner = np.einsum("vflka,vflkb->lab", shift * weights[..., None, None], shift)
    c = np.einsum("vflka,vflk,vfl->la", shift, residual, weights)

    carrier = (places.parts == np.arange(len(body))[:, None]).astype(float)  # which part carries which keypoint
    per_part = np.einsum("pl,flab->fpab", carrier, H), np.einsum("pl,fla->fpa", carrier, g)
    blocks = joint_blocks(body, poses, *per_part, float(np.sum(weights[..., None] * residual**2)))
    J = twist_jacobian(body, R, T)[:, places.parts]  # (F, L, 6, D)
    border = np.moveaxis(np.swapaxes(J, 2, 3) @ cross, 1, 2).reshape(F, D, 3 * L)
    prior = prior_weight * offset_precision(keypoints.names)
    full = np.zeros((L, 3, L, 3))
    full[np.arange(L), :, np.arange(L)] = corner
    gradient = c.ravel() + prior @ places.offsets.ravel()
    return KeypointSystem(blocks, border, full.reshape(3 * L, 3 * L) + prior, gradient)


@dataclass(frozen=True, eq=False)
class KeypointFactor:
    """The evidence of one performer's keypoints, with known offsets from the landmarks.

    Attributes
    ----------
    keypoints : Keypoints
        On F frames.
    places : Places
    correlated : float
        How many neighbouring frames err together and count as one.
    deviation : ndarray, shape (V, L), optional
        The detector's standard deviations, metres. By default they are found from the residuals of whatever motion the
        keypoints are compared with: a motion that is too smooth then passes for a detector that is inexact.
    agreed : ndarray, shape (V, F, L), optional
        Confidence of the keypoints that agree with those of other views, else 0: see `trusted_weights`.
    habit : tuple of ndarray, shape (F, P) and (P, 3, 3), optional
        Precision, 1/radians^2, with which parts that keypoints do not show are turned as usual, and how that is.
    imagined : Keypoints, optional
        Of an imagined view that holds the depths of a single view's keypoints, see `core.keypoints.lifting`.
    """

    keypoints: Keypoints
    places: Places
    correlated: float
    deviation: Array | None = None
    agreed: Array | None = None
    habit: tuple[Array, Array] | None = None
    imagined: Keypoints | None = None

    def __getitem__(self, frames: slice) -> KeypointFactor:
        """Return the evidence of some of the frames."""
        agreed = None if self.agreed is None else self.agreed[:, frames]
        habit = None if self.habit is None else (self.habit[0][frames], self.habit[1])
        imagined = None if self.imagined is None else self.imagined[frames]
        return replace(self, keypoints=self.keypoints[frames], agreed=agreed, habit=habit, imagined=imagined)

    def of_views(self, views: list[int]) -> KeypointFactor:
        """Return the evidence of some of the views."""
        deviation = None if self.deviation is None else self.deviation[views]
        agreed = None if self.agreed is None else self.agreed[views]
        return replace(self, keypoints=self.keypoints.of_views(views), deviation=deviation, agreed=agreed)

    def agreement(self, poses: Poses) -> float:
        """Return the mean weight of the keypoints, 0 to 1: how far they agree with poses."""
        residual, confidence = self.keypoints.residuals(self.places.world(poses)), self.keypoints.confidence
        usual = np.full((confidence.shape[0], confidence.shape[2]), USUAL_DEVIATION)
        weights = robust_weights(residual, confidence, usual) * USUAL_DEVIATION**2
        return float(weights.sum() / max(confidence.sum(), 1e-9))

    def views_near(self, poses: Poses) -> Array:
        """Return how many views have each keypoint near its place on a body, shape (F, L)."""
        residual = self.keypoints.residuals(self.places.world(poses))
        with np.errstate(invalid="ignore"):
            near = np.linalg.norm(residual, axis=-1) < GROSS * USUAL_DEVIATION
        return np.asarray((near & (self.keypoints.confidence > 0)).sum(axis=0))

    def blocks(self, body: Body, poses: Poses, tolerance: float) -> BandedBlocks:
        """The evidence around the poses; far from the solution, with a tolerance above 1, large errors still pull."""
        keypoints = self.keypoints
        residual = keypoints.residuals(self.places.world(poses))
        deviation = deviations(residual, keypoints.confidence) if self.deviation is None else self.deviation
        weights = robust_weights(residual, keypoints.confidence, deviation, tolerance)
        if self.agreed is not None:
            weights = np.maximum(weights, trusted_weights(residual, self.agreed, deviation, tolerance))
        blocks = keypoint_system(body, poses, keypoints, self.places, weights / self.correlated).blocks
        if self.imagined is not None:
            blocks = blocks + self._depth_blocks(body, poses, self.imagined, tolerance)
        if self.habit is not None and self.habit[0].any():
            blocks = blocks + habitual_prior(motion_of_poses(body, poses), *self.habit)
        return blocks

    def _depth_blocks(self, body: Body, poses: Poses, imagined: Keypoints, tolerance: float) -> BandedBlocks:
        """The evidence of the imagined view around the poses."""
        residual = imagined.residuals(self.places.world(poses))
        usual = np.full((1, len(imagined.names)), LIFTED_DEVIATION)
        weights = trusted_weights(residual, imagined.confidence, usual, tolerance)
        return keypoint_system(body, poses, imagined, self.places, weights).blocks
