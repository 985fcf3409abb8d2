"""2D keypoints as evidence of poses: their normal equations are summed part by part, like those of the images.

A keypoint is an image of a point that is fixed to a part of the body. Its two residuals in the image, multiplied by its
depth, are distances across the ray in metres. The derivatives of these by the part's twist are wrenches, so keypoints
add to the same sums over each part as the other evidence. What a detector calls a hip is not the centre of the joint:
every keypoint has an offset from its landmark, constant in the frame of the part, which is solved for with the motion.
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
"""Lower bound of the standard deviation of keypoints, metres."""
USUAL_DEVIATION = 0.02
"""Standard deviation of keypoints that are seen too seldom to estimate it, metres."""
PRIOR_COUNT = 10.0
"""Weight of `USUAL_DEVIATION` in each estimate, as a number of keypoints that are added to those found."""
LIFTED_DEVIATION = 0.3
"""Standard deviation of depths that follow from the lengths of bones, metres. It is large because their errors last for
many frames, over which they do not average out."""
GROSS = 3.0
"""Residual, in standard deviations, at which a keypoint has a quarter of its full weight (Geman and McClure's
kernel)."""
HIP_OFFSET_DEVIATION = 0.045
"""Standard deviation of the offset of a hip's keypoint along each axis, metres: hips lie deep in the body."""
OFFSET_DEVIATION = 0.03
"""Standard deviation of the offsets of shoulders and of keypoints on the head and the feet, metres."""
LIMB_OFFSET_DEVIATION = 0.02
"""Standard deviation of the offsets of a limb's joints along the limb, metres."""
THINNESS = (2.0, 1.0, 2.0)
"""Divisors of a limb's offset deviation along the x, y and z axes of the part: across a thin limb, offsets are smaller.
"""
OFFSET_ASYMMETRY = 0.3
"""Standard deviation of an offset from the mirror image of the other side's, as a share of the offset's own."""
_LIMB = ("Elbow", "Wrist", "Knee", "Ankle")
_TRUNK = ("LShoulder", "RShoulder", "LHip", "RHip")


@dataclass(frozen=True, eq=False)
class Keypoints:
    """Keypoints of one performer on F frames, in V views.

    Attributes
    ----------
    names : tuple of str, length L
    rays : ndarray, shape (V, F, L, 2)
        Normalized image coordinates (x / z, y / z) in camera axes, without lens distortion; NaN where a keypoint was
        not found.
    confidence : ndarray, shape (V, F, L)
        0 to 1.
    R_cam_world, t_cam_world : ndarray, shape (V, F, 3, 3) and (V, F, 3)
        Poses of the cameras: X_cam = R_cam_world X_world + t_cam_world, metres.
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
        """Distances of points (F, L, 3) from the rays along both image axes, metres, (V, F, L, 2); NaN if not found."""
        x = np.einsum("vfab,flb->vfla", self.R_cam_world, points_world) + self.t_cam_world[:, :, None]
        z = np.where(x[..., 2] > 0.1, x[..., 2], np.nan)
        return np.asarray(x[..., :2] - self.rays * z[..., None])

    def across(self) -> Array:
        """Derivatives of the residuals by the points' world coordinates, shape (V, F, L, 2, 3).

        Where a keypoint was not found, the derivatives are those of a ray along the optical axis.
        """
        R = self.R_cam_world[:, :, None]
        return R[..., :2, :] - np.nan_to_num(self.rays)[..., None] * R[..., 2:, :]


@dataclass(frozen=True, eq=False)
class Places:
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
    def on(cls, body: Body, names: Sequence[str]) -> Places:
        """Return the positions of keypoints on a body, without offsets from their landmarks."""
        placed = [keypoint_on_body(body, name) for name in names]
        local = np.array([point for _, point in placed], float).reshape(-1, 3)
        return cls(np.array([part for part, _ in placed], np.int64), local, np.zeros_like(local))

    def on_body(self, body: Body, names: Sequence[str]) -> Places:
        """Return the same offsets on another body."""
        return replace(Places.on(body, names), offsets=self.offsets)

    def world(self, poses: Poses) -> Array:
        """World positions of the keypoints, metres, shape (F, L, 3)."""
        R, T = poses
        return np.asarray(np.einsum("flab,lb->fla", R[:, self.parts], self.local + self.offsets) + T[:, self.parts])


_FACE = {"Eye": (0.11, 0.62, 0.17), "Ear": (0.26, 0.55, 0.0)}
"""Left, up and forward in a head's frame, in lengths of the head."""


def keypoint_on_body(body: Body, name: str) -> tuple[int, Array]:
    """Return the part that carries a keypoint, and the keypoint's landmark in its frame, metres.

    What a detector calls a shoulder or a hip is a point of the part that the limb hangs on, collar bone or trunk: it
    does not turn with the limb.
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
    """Standard deviation of a keypoint's offset from its landmark along each axis, metres."""
    if name.endswith("Hip"):
        return HIP_OFFSET_DEVIATION
    return LIMB_OFFSET_DEVIATION if name.endswith(_LIMB) else OFFSET_DEVIATION


def offset_precision(names: Sequence[str]) -> Array:
    """Inverse covariance of the offsets' prior, (3 L, 3 L): offsets are small, left and right mirror each other."""
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
    """Normal equations of one performer's keypoints in the poses and the offsets.

    Attributes
    ----------
    blocks : BandedBlocks
        The equations of the poses: F frames of D degrees of freedom.
    border : ndarray, shape (F, D, 3 L)
        The block that couples poses and offsets.
    corner : ndarray, shape (3 L, 3 L)
        The block of the offsets.
    gradient : ndarray, shape (3 L,)
        Derivative of half the energy by the offsets.
    """

    blocks: BandedBlocks
    border: Array
    corner: Array
    gradient: Array


def deviations(residuals: Array, confidence: Array) -> Array:
    """Robust standard deviations (V, L) of the keypoints over the frames, metres, from residuals (V, F, L, 2)."""
    return deviations_of_lengths(np.linalg.norm(residuals, axis=-1), confidence)


def deviations_of_lengths(lengths: Array, confidence: Array) -> Array:
    """Robust standard deviations as of `deviations`, from the lengths of the residuals (V, F, L); NaN where none."""
    lengths = np.where(confidence > 0, lengths, np.nan)
    seen = np.isfinite(lengths).sum(axis=1)
    medians = np.nanquantile(np.where(seen[:, None] > 0, lengths, 0.0), 0.5, axis=1)
    own = np.nan_to_num(medians) / RAYLEIGH_MEDIAN
    mean = (seen * own + PRIOR_COUNT * USUAL_DEVIATION) / (seen + PRIOR_COUNT)
    return np.asarray(np.maximum(mean, LEAST_DEVIATION))


def robust_energy(residuals: Array, confidence: Array, deviation: Array) -> float:
    """Return the sum of Geman and McClure's robust errors, in units of the variance.

    Parameters
    ----------
    residuals : ndarray, shape (V, F, L, 2)
        Metres. NaN where a keypoint was not found, or if its point is behind the camera; the latter has the full error.
    confidence : ndarray, shape (V, F, L)
    deviation : ndarray, shape (V, L)
        Metres.
    """
    kernel = GemanMcClure(GROSS)
    error = np.sum(residuals**2, axis=-1) / deviation[:, None] ** 2
    return float(np.sum(confidence * np.where(np.isfinite(error), kernel.cost(error), kernel.scale**2)))


def robust_weights(residuals: Array, confidence: Array, deviation: Array, tolerance: float = 1.0) -> Array:
    """Return the weights of `robust_energy` in iteratively reweighted least squares, 1/m^2, shape (V, F, L); 0 for NaN.

    Parameters as in `robust_energy`.
    """
    error = np.sum(residuals**2, axis=-1) / deviation[:, None] ** 2
    weight = confidence * GemanMcClure(GROSS * tolerance).weight(error) / deviation[:, None] ** 2
    return np.nan_to_num(weight)


def trusted_weights(residuals: Array, agreed: Array, deviation: Array, tolerance: float = 1.0) -> Array:
    """Return Huber's weights, 1/m^2, shape (V, F, L), of keypoints that views agree on; 0 for NaN.

    Such keypoints are not outliers, however far the motion is from them at present. With Huber's weights they still
    pull from where Geman and McClure's weights would be close to zero.

    Parameters
    ----------
    residuals : ndarray, shape (V, F, L, 2)
    agreed : ndarray, shape (V, F, L)
        Confidence of the keypoints that agree with those of other views, else 0.
    deviation : ndarray, shape (V, L)
        Metres.
    tolerance : float
        Factor of the deviation, above 1 while the motion is far from the solution.
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
        Factor of the prior of the offsets.
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
        How many neighbouring frames have the same error, and therefore count as one.
    deviation : ndarray, shape (V, L), optional
        The detector's standard deviations, metres. By default they are estimated from the residuals of the motion that
        the keypoints are compared with; if that motion is too smooth, the detector seems worse than it is.
    agreed : ndarray, shape (V, F, L), optional
        Confidence of the keypoints that agree with those of other views, else 0: see `trusted_weights`.
    habit : tuple of ndarray, shape (F, P) and (P, 3, 3), optional
        For parts that keypoints do not show: the precision of their usual rotation, 1/radians^2, and that rotation.
    imagined : Keypoints, optional
        The keypoints of an imagined view that holds the depths of a single view's, see `core.keypoints.lifting`.
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
        """Return the mean robust weight of the keypoints, from 0 to 1 (all agree with the poses)."""
        residual, confidence = self.keypoints.residuals(self.places.world(poses)), self.keypoints.confidence
        usual = np.full((confidence.shape[0], confidence.shape[2]), USUAL_DEVIATION)
        weights = robust_weights(residual, confidence, usual) * USUAL_DEVIATION**2
        return float(weights.sum() / max(confidence.sum(), 1e-9))

    def views_near(self, poses: Poses) -> Array:
        """Return in how many views each keypoint is near its position on the posed body, shape (F, L)."""
        residual = self.keypoints.residuals(self.places.world(poses))
        with np.errstate(invalid="ignore"):
            near = np.linalg.norm(residual, axis=-1) < GROSS * USUAL_DEVIATION
        return np.asarray((near & (self.keypoints.confidence > 0)).sum(axis=0))

    def blocks(self, body: Body, poses: Poses, tolerance: float) -> BandedBlocks:
        """Normal equations at the poses. With a tolerance above 1, large errors still pull, far from the solution."""
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
        """Normal equations of the imagined view at the poses."""
        residual = imagined.residuals(self.places.world(poses))
        usual = np.full((1, len(imagined.names)), LIFTED_DEVIATION)
        weights = trusted_weights(residual, imagined.confidence, usual, tolerance)
        return keypoint_system(body, poses, imagined, self.places, weights).blocks
