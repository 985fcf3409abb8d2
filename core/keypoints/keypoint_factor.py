"""2D keypoints as evidence of poses: their normal equations are summed part by part, like those of the images.

A keypoint is an image of a point that is fixed to a part of the body. Its two residuals in the image, multiplied by its
depth, are distances across the ray in metres. The derivatives of these by the part's twist are wrenches, so keypoints
add to the same sums over each part as the other evidence. What a detector calls a hip is not the centre of the joint:
every keypoint has an offset from its landmark, constant in the frame of the part, which is solved for with the motion.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..body import Body, twist_jacobian
from ..body.joint_blocks import joint_blocks
from ..body.joint_limits import habitual_prior
from ..body.kinematics import Poses, motion_of_poses
from ..numerics.arrays import Array, Ints
from ..numerics.banded_blocks import BandedBlocks
from .keypoint_offsets import KeypointOffsets, offset_precision
from .keypoint_rays import Keypoints
from .keypoint_sigmas import GEMAN_MCCLURE_SCALE, LIFTED_SIGMA, USUAL_SIGMA, robust_weights, sigmas, trusted_weights


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


def keypoint_system(
    body: Body,
    poses: Poses,
    keypoints: Keypoints,
    places: KeypointOffsets,
    weights: Array,
    *,
    prior_weight: float = 1.0,
) -> KeypointSystem:
    """Sum the evidence of keypoints around poses and offsets.

    Parameters
    ----------
    body : Body
    poses : tuple
        (R, T) of its P parts, F frames.
    keypoints : Keypoints
    places : KeypointOffsets
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
    places : KeypointOffsets
    correlated : float
        How many neighbouring frames have the same error, and therefore count as one.
    sigma : ndarray, shape (V, L), optional
        The detector's standard deviations, metres. By default they are estimated from the residuals of the motion that
        the keypoints are compared with; if that motion is too smooth, the detector seems worse than it is.
    agreed : ndarray, shape (V, F, L), optional
        Confidence of the keypoints that agree with those of other views, else 0: see `trusted_weights`.
    habit : tuple of ndarray, shape (F, P) and (P, 3, 3), optional
        For parts that keypoints do not show: the precision of their usual rotation, 1/radians^2, and that rotation.
    imagined : Keypoints, optional
        The keypoints of an imagined view that holds the depths of a single view's, see `keypoint_motion.lifting`.
    """

    keypoints: Keypoints
    places: KeypointOffsets
    correlated: float
    sigma: Array | None = None
    agreed: Array | None = None
    habit: tuple[Array, Array] | None = None
    imagined: Keypoints | None = None

    def __getitem__(self, frames: slice | Ints) -> KeypointFactor:
        """Return the evidence of some of the frames."""
        agreed = None if self.agreed is None else self.agreed[:, frames]
        habit = None if self.habit is None else (self.habit[0][frames], self.habit[1])
        imagined = None if self.imagined is None else self.imagined[frames]
        return replace(self, keypoints=self.keypoints[frames], agreed=agreed, habit=habit, imagined=imagined)

    def on_frames(self, frames: Ints, every: int) -> KeypointFactor:
        """Return the evidence of some of the frames, which usually are `every` frames apart."""
        return replace(self[frames], correlated=max(self.correlated / every, 1.0))

    def of_views(self, views: list[int]) -> KeypointFactor:
        """Return the evidence of some of the views."""
        sigma = None if self.sigma is None else self.sigma[views]
        agreed = None if self.agreed is None else self.agreed[views]
        return replace(self, keypoints=self.keypoints.of_views(views), sigma=sigma, agreed=agreed)

    def agreement(self, poses: Poses) -> float:
        """Return the mean robust weight of the keypoints, from 0 to 1 (all agree with the poses)."""
        residual, confidence = self.keypoints.residuals(self.places.world(poses)), self.keypoints.confidence
        usual = np.full((confidence.shape[0], confidence.shape[2]), USUAL_SIGMA)
        weights = robust_weights(residual, confidence, usual) * USUAL_SIGMA**2
        return float(weights.sum() / max(confidence.sum(), 1e-9))

    def views_near(self, poses: Poses) -> Array:
        """Return in how many views each keypoint is near its position on the posed body, shape (F, L)."""
        residual = self.keypoints.residuals(self.places.world(poses))
        with np.errstate(invalid="ignore"):
            near = np.linalg.norm(residual, axis=-1) < GEMAN_MCCLURE_SCALE * USUAL_SIGMA
        return np.asarray((near & (self.keypoints.confidence > 0)).sum(axis=0))

    def blocks(self, body: Body, poses: Poses, tolerance: float) -> BandedBlocks:
        """Normal equations at the poses. With a tolerance above 1, large errors still pull, far from the solution."""
        keypoints = self.keypoints
        residual = keypoints.residuals(self.places.world(poses))
        sigma = sigmas(residual, keypoints.confidence) if self.sigma is None else self.sigma
        weights = robust_weights(residual, keypoints.confidence, sigma, tolerance)
        if self.agreed is not None:
            weights = np.maximum(weights, trusted_weights(residual, self.agreed, sigma, tolerance))
        blocks = keypoint_system(body, poses, keypoints, self.places, weights / self.correlated).blocks
        if self.imagined is not None:
            blocks = blocks + self._depth_blocks(body, poses, self.imagined, tolerance)
        if self.habit is not None and self.habit[0].any():
            blocks = blocks + habitual_prior(motion_of_poses(body, poses), *self.habit)
        return blocks

    def _depth_blocks(self, body: Body, poses: Poses, imagined: Keypoints, tolerance: float) -> BandedBlocks:
        """Normal equations of the imagined view at the poses."""
        residual = imagined.residuals(self.places.world(poses))
        usual = np.full((1, len(imagined.names)), LIFTED_SIGMA)
        weights = trusted_weights(residual, imagined.confidence, usual, tolerance)
        return keypoint_system(body, poses, imagined, self.places, weights).blocks
