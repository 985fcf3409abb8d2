"""Fitting bodies to their key poses: lengths and widths of the parts are changed until the model lies on the performer.

On a key frame the pose is roughly known; how long and how wide the parts are is not. Every part is stretched along its
axes, together with the parts that hang on it, and its solid is shifted. The key poses were set with a body of other
proportions, so they are free to change a little, too. The evidence is the performers' outlines against the background
(`core.evidence.outline_evidence`) and, where views have them, 2D keypoints. As priors, both sides of a body are nearly
alike, and parts that are not seen grow with the rest. All unknowns are solved for by Gauss-Newton, coarse to fine.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..body import Body, part_poses, point_jacobian, twist_jacobian
from ..body.joint_limits import posture_prior
from ..body.kinematics import Poses, scene_poses
from ..body.measures.shaping import joint_jacobian
from ..body.motion import Motion
from ..body.time_shift import poses_after
from ..cameras.camera import Camera
from ..errors import BodyError
from ..evidence.gradient_evidence.image_wrenches import camera_twist
from ..evidence.outline_evidence.held_outlines import HeldOutlines
from ..evidence.rendering.part_geometry import Geometry
from ..formats.keypoint_files import read_shot_keypoints
from ..keypoints.keypoint_offsets import KeypointOffsets
from ..keypoints.keypoint_rays import Keypoints
from ..keypoints.keypoint_sigmas import USUAL_SIGMA, robust_weights
from ..keypoints.left_and_right.left_right import correct_sides
from ..keypoints.observations import performer_keypoints
from ..numerics.arrays import Array, slices_of
from ..numerics.normal_equations import DenseEquations, IndependentEquations
from ..runtime.progress import Progress
from ..runtime.threads import one_library_thread
from ..shot.keypose_spline import spline
from ..shot.shot import Shot
from .body_estimate import PART_DOF, BodyEstimate
from .key_frame_views import KeyFrameView, posed_key_frames, read_key_frames
from .outline_fit import OutlineProblem, RefinementStage, coarse_to_fine, key_foreground, key_outlines, outline_products

POSED_ROOT_SIGMA, POSED_JOINT_SIGMA = 0.03, 0.08
"""Standard deviation of a key pose that was set with a body of other proportions, metres and radians."""
FIT_STAGES = (
    RefinementStage(0.25, 4.0, 8, excess=0.4),
    RefinementStage(0.15, 2.0, 6, excess=0.2),
    RefinementStage(0.10, 1.0, 8, excess=0.1),
)
"""From coarse to fine; the body may be up to 40 % wider than the performer at first."""
CONVERGED_MOVE = 0.001
"""A stage ends when no joint moves by more than this, metres."""
_ROWS = 9  # of an outline's row: wrench in camera axes, and by the part's stretches


@dataclass(frozen=True, eq=False)
class BodyFit:
    """Bodies fitted to their performers.

    Attributes
    ----------
    bodies : tuple of Body
        Per performer, with fitted joints and solids; the root's joint in the rest pose has not moved.
    poses : tuple of Motion
        Per performer: the key poses, fitted to the footage together with the body.
    frames : ndarray of int, shape (K,)
        Shot frames of these poses.
    growth : tuple of float
        Per performer: the relative change of the body's size.
    """

    bodies: tuple[Body, ...]
    poses: tuple[Motion, ...]
    frames: NDArray[np.int64]
    growth: tuple[float, ...]


@one_library_thread()
def fit_bodies(shot: Shot, progress: Progress | None = None) -> BodyFit:
    """Fit the bodies of a shot's performers to its key poses of the whole body.

    Raises
    ------
    BodyError
        No frame has a key pose of the whole body of every performer.
    FootageError, KeypointError
        See `core.tracking.tracker.track`.
    CancelledError
    """
    todo = "pose the whole body over the footage on some frames first"
    missing = BodyError("bodies are fitted to key poses of the whole body, and there is none", todo=todo)
    frames = posed_key_frames(shot, missing)
    views = read_key_frames(shot, frames, progress)

    def linearise(state: Estimates, stage: RefinementStage) -> BodyEquations:
        return _equations(state, stage, shot, views)

    problem = OutlineProblem(
        linearise, _moved, lambda state, equations: equations.cost_at(state), _largest_movement, CONVERGED_MOVE
    )
    estimates = coarse_to_fine(_start(shot, views, frames), problem, FIT_STAGES, "fitting the body", progress).state
    return BodyFit(
        tuple(estimate.body for estimate in estimates),
        tuple(estimate.motions[0.0] for estimate in estimates),
        frames,
        tuple(float(estimate.shape[0]) for estimate in estimates),
    )


Estimates = tuple[BodyEstimate, ...]


def _start(shot: Shot, views: Sequence[KeyFrameView], frames: NDArray[np.int64]) -> Estimates:
    curves = [spline(performer.key_poses, shot.length) for performer in shot.performers]
    delays = {0.0} | {view.delay for view in views}
    motions = {delay: poses_after(curves, delay, frames) for delay in delays}
    found = performer_keypoints(shot, read_shot_keypoints(shot))
    estimates = []
    for i, (performer, keypoints) in enumerate(zip(shot.performers, found, strict=True)):
        body, names = performer.body, keypoints.names
        places = KeypointOffsets.on(body, names)
        shape = np.zeros(1 + PART_DOF * len(body) + 3 * len(names))
        posed = np.zeros((len(frames), body.dof))
        own = {delay: performers[i] for delay, performers in motions.items()}
        estimates.append(BodyEstimate(body, own, keypoints[frames], places, shape, posed))
    return tuple(estimates)


def _moved(estimates: Estimates, steps: Sequence[Array]) -> Estimates:
    return tuple(estimate.moved(step) for estimate, step in zip(estimates, steps, strict=True))


def _largest_movement(before: Estimates, after: Estimates) -> float:
    """Return the largest distance that a joint has moved, metres."""
    return max(float(np.abs(a.joints() - b.joints()).max()) for a, b in zip(after, before, strict=True))


@dataclass(frozen=True, eq=False)
class BodyEquations(IndependentEquations):
    """Normal equations of all performers at some estimates, which also determine who hides whom.

    Attributes
    ----------
    estimates : tuple of BodyEstimate
        The estimates.
    cost_at : callable
        Returns the cost of other estimates with the same outlines, and the same sides and weights of keypoints.
    """

    estimates: Estimates
    cost_at: Callable[[Estimates], float]

    @property
    def cost(self) -> float:
        """Robust sum of squared residuals of all performers."""
        return self.cost_at(self.estimates)


def _equations(
    estimates: Estimates, stage: RefinementStage, shot: Shot, views: Sequence[KeyFrameView]
) -> BodyEquations:
    """Sum the equations of outlines, keypoints and priors."""
    geometry = Geometry.of([estimate.body for estimate in estimates])
    own_parts = slices_of(len(estimate.body) for estimate in estimates)
    parts = [_prior(estimate) for estimate in estimates]
    precision = stage.precision()
    held = []
    for view, seen in zip(shot.views, views, strict=True):
        poses, camera = _scene_poses(estimates, seen.delay), seen.camera(view.camera)
        foreground = key_foreground(seen.rectified(view.camera), camera, geometry, poses, stage)
        lines = key_outlines(foreground, camera, geometry, poses, stage)
        held.append((HeldOutlines.at(lines, camera, poses, precision), camera, seen.delay))
        products = precision * outline_products(lines, camera, poses)
        products = np.delete(np.delete(products, 6, axis=-1), 6, axis=-2)  # the focal length is known
        for estimate, own, span in zip(estimates, parts, own_parts, strict=True):
            B = _outline_rows(estimate, camera, (poses[0][:, span], poses[1][:, span]))
            B_t, S = np.swapaxes(B, -1, -2), products[:, span]
            H, g = (B_t @ S[..., :-1, :-1] @ B).sum(axis=1), -(B_t @ S[..., :-1, -1:])[..., 0].sum(axis=1)
            _add(own, H, g, estimate)
    keypoints = [_HeldKeypoints.at(estimate, stage.tolerance) for estimate in estimates]
    for estimate, own, tracked in zip(estimates, parts, keypoints, strict=True):
        _add(own, *tracked.normal_equations(estimate), estimate)

    def cost_at(others: Estimates) -> float:
        changes = [e.part_changes(other.shape - e.shape) for other, e in zip(others, estimates, strict=True)]
        cost = sum(
            outlines.cost(camera, _scene_poses(others, delay), np.concatenate(changes))
            for outlines, camera, delay in held
        )
        return cost + sum(k.cost(other) + _prior(other).cost for k, other in zip(keypoints, others, strict=True))

    return BodyEquations(parts, estimates, cost_at)


def _scene_poses(estimates: Estimates, delay: float) -> Poses:
    return scene_poses([e.body for e in estimates], [e.motions[delay] for e in estimates])


def _prior(estimate: BodyEstimate) -> DenseEquations:
    """Return the equations of the priors: shape, poses, joint limits."""
    n, (K, D) = len(estimate.shape), estimate.posed.shape
    H, g = np.zeros((n + K * D, n + K * D)), np.zeros(n + K * D)
    H[:n, :n] = estimate.prior()
    g[:n] = H[:n, :n] @ estimate.shape
    weight = 1 / np.tile([POSED_ROOT_SIGMA] * 3 + [POSED_JOINT_SIGMA] * (D - 3), K) ** 2
    posed = np.arange(n, n + K * D)
    H[posed, posed], g[n:] = weight, weight * estimate.posed.ravel()
    limits = posture_prior(estimate.body, estimate.motions[0.0], rest=False)
    for k, own in enumerate(posed.reshape(K, D)):
        H[np.ix_(own, own)] += limits.diagonal[k]
        g[own] += limits.gradient[k]
    change = np.concatenate([estimate.shape, estimate.posed.ravel()])
    cost = estimate.shape @ H[:n, :n] @ estimate.shape + weight @ change[n:] ** 2 + limits.energy
    return DenseEquations(H, g, float(cost))


def _add(equations: DenseEquations, H_frames: Array, g_frames: Array, estimate: BodyEstimate) -> None:
    """Add the equations of every frame, (K, n + D, n + D): n unknowns of the shape, which all share, and D of its
    pose.
    """
    n, D = len(estimate.shape), estimate.posed.shape[1]
    for k, (own_H, own_g) in enumerate(zip(H_frames, g_frames, strict=True)):
        columns = np.concatenate([np.arange(n), n + k * D + np.arange(D)])
        equations.matrix[np.ix_(columns, columns)] += own_H
        equations.gradient[columns] += own_g


def _outline_rows(estimate: BodyEstimate, camera: Camera, poses: Poses) -> Array:
    """Return the derivatives of an outline's row by the shape and the pose of its frame, shape (K, P, 9, n + D)."""
    body, (R, T), (Rc, tc) = estimate.body, poses, camera.poses(0, len(poses[0]))
    K, P = T.shape[:2]
    n = len(estimate.shape)
    B = np.zeros((K, P, _ROWS, n + body.dof))
    joints = np.einsum("kab,kpbqc->kpaqc", Rc, joint_jacobian(body, R))
    each = B[..., 1 : 1 + PART_DOF * P].reshape(K, P, _ROWS, P, PART_DOF)
    each[..., :3, :, :3] = joints
    for p in range(P):
        each[:, p, 6:9, p, :3] = np.eye(3)
        each[:, p, :3, p, 3:] = Rc @ R[:, p]
    B[..., 1 : 1 + PART_DOF * P] = each.reshape(K, P, _ROWS, -1)
    B[..., 0] = each[..., :3].sum(axis=(-1, -2))
    B[..., :6, n:] = camera_twist(Rc, tc)[:, None] @ twist_jacobian(body, R, T)
    return B


@dataclass(frozen=True, eq=False)
class _HeldKeypoints:
    """A performer's keypoints, with the left and right sides and the weights that belong to one state.

    Attributes
    ----------
    keypoints : Keypoints
    weights : ndarray, shape (V, K, L)
    """

    keypoints: Keypoints
    weights: Array

    @classmethod
    def at(cls, estimate: BodyEstimate, tolerance: float) -> _HeldKeypoints:
        points = estimate.keypoint_places()
        keypoints, _ = correct_sides(estimate.keypoints, points)
        residual = keypoints.residuals(points)
        usual = np.full((residual.shape[0], residual.shape[2]), USUAL_SIGMA)
        return cls(keypoints, robust_weights(residual, keypoints.confidence, usual, tolerance))

    def cost(self, estimate: BodyEstimate) -> float:
        residual = np.nan_to_num(self.keypoints.residuals(estimate.keypoint_places()))
        return float(np.sum(self.weights[..., None] * residual**2))

    def normal_equations(self, estimate: BodyEstimate) -> tuple[Array, Array]:
        """Return the equations of the distances from the keypoints' rays: H (K, n + D, n + D) and g (K, n + D)."""
        body, places = estimate.body, estimate.places
        R, T = part_poses(body, estimate.motions[0.0])
        points = places.world((R, T))
        K, L, P, n = len(R), len(places.parts), len(body), len(estimate.shape)
        A = np.zeros((K, L, 3, n + body.dof))
        each = np.zeros((K, L, 3, P, PART_DOF))
        each[..., :3] = joint_jacobian(body, R)[:, places.parts]
        offsets = np.zeros((K, L, 3, L, 3))
        for i, part in enumerate(places.parts):
            each[:, i, :, part, :3] += R[:, part] * places.local[i]
            offsets[:, i, :, i] = R[:, part]
        A[..., 0] = each[..., :3].sum(axis=(-1, -2))
        A[..., 1 : 1 + PART_DOF * P] = each.reshape(K, L, 3, PART_DOF * P)
        A[..., 1 + PART_DOF * P : n] = offsets.reshape(K, L, 3, 3 * L)
        A[..., n:] = point_jacobian(body, R, T, places.parts, points)
        root = np.sqrt(self.weights)[..., None]
        rows = np.einsum("vklra,klan->vklrn", self.keypoints.across(), A) * root[..., None]
        residual = np.nan_to_num(self.keypoints.residuals(points)) * root
        rows, residual = (np.moveaxis(a, 1, 0).reshape(K, 2 * len(a) * L, *a.shape[4:]) for a in (rows, residual))
        return np.swapaxes(rows, 1, 2) @ rows, np.einsum("krn,kr->kn", rows, residual)
