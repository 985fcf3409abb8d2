"""Cameras and joints solved for together, from the 2D keypoints that the cameras share.

The unknowns are the cameras' poses and focal lengths and the positions of all joints on all frames; the positions are
eliminated (B. Triggs et al., Bundle adjustment - a modern synthesis, 2000, section 6.1).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor

from ...numerics import rotations
from ...numerics.arrays import Array, Bools, Ints
from ...numerics.least_squares import GAUSS_NEWTON, StoppingRule, minimise
from ...numerics.normal_equations import DenseFactor
from ...numerics.robust_kernels import RAYLEIGH_MEDIAN, GemanMcClure
from .resection import CAMERA_DOF, FOCAL_SIGMA, POSITION_SIGMA, ROTATION_SIGMA
from .shared_keypoints import CameraEstimate, SharedKeypoints

GEMAN_MCCLURE_SCALE = 3.0
"""Residual, in standard deviations, at which a keypoint has a quarter of the full weight (Geman-McClure kernel)."""
MIN_SIGMA = 0.3
"""Least standard deviation of a keypoint, pixels."""
_ITERATIONS = 12
_CONVERGED_PIXELS = 0.05  # pixels
_MIN_DEPTH = 0.1  # metres


@dataclass(frozen=True, eq=False)
class ReducedSystem:
    """Normal equations of the cameras after the joints have been eliminated.

    Attributes
    ----------
    H : ndarray, shape (K, 7 V, 7 V)
        Per kind of joint.
    g : ndarray, shape (K, 7 V)
        Gradients of half the cost.
    rows : ndarray, shape (V, F, L, 2, 7)
        Derivatives of the joints' projections by the unknowns of their camera, pixels.
    size : ndarray, shape (V, F, L)
        Lengths of the residuals, pixels; NaN where there is none.
    weights : ndarray, shape (V, F, L)
        Robust weights of the residuals, pixels^-2.
    coupling : ndarray, shape (F, L, 7 V, 3)
        Blocks of the normal equations between cameras and joints.
    inverse : ndarray, shape (F, L, 3, 3)
        Inverses of the joints' own blocks.
    gradient : ndarray, shape (F, L, 3)
        Gradient of half the cost by the joints.
    """

    H: Array
    g: Array
    rows: Array
    size: Array
    weights: Array
    coupling: Array
    inverse: Array
    gradient: Array

    @property
    def seen(self) -> Bools:
        """Return which keypoints count, shape (V, F, L)."""
        return self.weights > 0

    def points_step(self, step: Array) -> Array:
        """Return the step of the joints (F, L, 3) that belongs to a step of the cameras (7 V,)."""
        gradient = self.gradient + np.einsum("flia,i->fla", self.coupling, step)
        return -np.einsum("flab,flb->fla", self.inverse, gradient)


@dataclass(frozen=True, eq=False)
class FreeCameras:
    """Normal equations of some cameras and all joints, as the optimiser takes them (`NormalEquations`).

    A step is that of the cameras (7 V,) and that of the joints (F, L, 3). Damping shortens it.

    Attributes
    ----------
    system : ReducedSystem
    columns : ndarray of int, shape (n,)
        The unknowns of the cameras that are free.
    H : ndarray, shape (n, n)
        With the prior.
    g : ndarray, shape (n,)
    cost : float
    """

    system: ReducedSystem
    columns: Ints
    H: Array
    g: Array
    cost: float

    @classmethod
    def at(cls, shared: SharedKeypoints, estimate: CameraEstimate, free: Sequence[int]) -> FreeCameras:
        """Return the equations at an estimate."""
        system, columns, prior = _linearised(shared, estimate), camera_columns(free), camera_prior(len(shared.focal))
        H = system.H.sum(axis=0) + np.diag(prior)
        g = system.g.sum(axis=0) + prior * estimate.change.ravel()
        cost = _cost(system.weights, system.size, estimate)
        return cls(system, columns, H[np.ix_(columns, columns)], g[columns], cost)

    def cost_at(self, shared: SharedKeypoints, estimate: CameraEstimate) -> float:
        """Return the cost at another estimate, with the weights of these equations."""
        return _cost(self.system.weights, _projected(shared, estimate).size, estimate)

    def solve(self, damping: float) -> tuple[Array, Array]:
        """Return the step of Gauss-Newton, shortened by damping: of the cameras, (7 V,), and of the joints, (F, L,
        3).
        """
        cameras = np.zeros(self.system.g.shape[1])
        cameras[self.columns] = -np.linalg.solve(self.H, self.g)
        return cameras / (1 + damping), self.system.points_step(cameras) / (1 + damping)

    def slope(self, step: tuple[Array, Array]) -> float:
        """Return the derivative of the cost along a step."""
        cameras, points = step
        # g = g_cameras - coupling inverse gradient: what was eliminated comes back with the joints.
        apart = points - self.system.points_step(cameras) + self.system.points_step(np.zeros_like(cameras))
        return 2 * float(self.g @ cameras[self.columns] + (self.system.gradient * apart).sum())

    def factor(self) -> DenseFactor:
        """Return the factor of the cameras' matrix."""
        return DenseFactor(cho_factor(self.H, lower=True, check_finite=False))


def camera_prior(views: int) -> Array:
    """Return the prior's inverse variances of the cameras' changes, shape (7 V,)."""
    return np.tile(1 / np.array([POSITION_SIGMA] * 3 + [ROTATION_SIGMA] * 3 + [FOCAL_SIGMA]) ** 2, views)


def camera_columns(views: Sequence[int]) -> Ints:
    """Return the indices of some views' cameras in the system."""
    return (CAMERA_DOF * np.asarray(views, np.int64)[:, None] + np.arange(CAMERA_DOF)).ravel()


def _weights(shared: SharedKeypoints, size: Array) -> Array:
    """Return robust weights from the noise of every view's joints, pixels^-2, shape (V, F, L)."""
    known = np.isfinite(size)
    middle = np.nanmedian(np.where(known.any(axis=1, keepdims=True), size, 0.0), axis=1) / RAYLEIGH_MEDIAN
    usual = np.array([np.median(row[row > 0]) if (row > 0).any() else 0.0 for row in middle])
    deviation = np.maximum(np.maximum(middle, 0.5 * usual[:, None]), MIN_SIGMA)[:, None]
    kernel = GemanMcClure(GEMAN_MCCLURE_SCALE).weight((np.nan_to_num(size) / deviation) ** 2)
    weights = np.where(known, shared.confidence * kernel / deviation**2, 0.0)
    return np.asarray(np.where((weights > 0).sum(axis=0) >= 2, weights, 0.0) / shared.correlated)


@dataclass(frozen=True, eq=False)
class _Projected:
    """The joints in the pictures of all cameras at an estimate; zero where a keypoint was not found.

    Attributes
    ----------
    R : ndarray, shape (V, F, 3, 3)
        Rotations from the world to the cameras.
    turned, x : ndarray, shape (V, F, L, 3)
        The joints in camera axes, before and after the cameras' shifts, metres.
    rays : ndarray, shape (V, F, L, 2)
        The keypoints, at the cameras' focal lengths.
    residual : ndarray, shape (V, F, L, 2)
        Pixels.
    size : ndarray, shape (V, F, L)
        Lengths of the residuals, pixels; NaN where there is none.
    """

    R: Array
    turned: Array
    x: Array
    rays: Array
    residual: Array
    size: Array


def _projected(shared: SharedKeypoints, estimate: CameraEstimate) -> _Projected:
    """Project the joints."""
    change = estimate.change
    turn = rotations.exp(change[:, 3:6])
    R = turn[:, None] @ shared.R_cam_world
    turned = np.einsum("vfab,flb->vfla", R, estimate.points_world)
    turned += np.einsum("vab,vfb->vfa", turn, shared.t_cam_world)[:, :, None]
    x = turned + change[:, None, None, :3]
    known = shared.found() & (x[..., 2] > _MIN_DEPTH)
    turned, x = np.where(known[..., None], turned, 0.0), np.where(known[..., None], x, [0.0, 0.0, 1.0])
    rays = np.where(known[..., None], shared.rays, 0.0) * np.exp(-change[:, 6])[:, None, None, None]
    residual = shared.focal[:, None, None, None] * (x[..., :2] / x[..., 2:] - rays)
    residual = np.where(known[..., None], residual, 0.0)
    return _Projected(R, turned, x, rays, residual, np.where(known, np.linalg.norm(residual, axis=-1), np.nan))


def _cost(weights: Array, size: Array, estimate: CameraEstimate) -> float:
    """Return the weighted squares of residuals, and of the cameras' changes by the prior."""
    change = estimate.change.ravel()
    return float((weights * np.nan_to_num(size) ** 2).sum() + camera_prior(len(estimate.change)) @ change**2)


def _linearised(shared: SharedKeypoints, estimate: CameraEstimate) -> ReducedSystem:
    """Return the reduced system at an estimate."""
    V, focal, at = len(shared.focal), shared.focal[:, None, None, None], _projected(shared, estimate)
    R, turned, x, rays, residual = at.R, at.turned, at.x, at.rays, at.residual
    weights = _weights(shared, at.size)
    image = np.zeros((*x.shape[:3], 2, 3))
    image[..., 0, 0] = image[..., 1, 1] = 1 / x[..., 2]
    image[..., 2] = -x[..., :2] / x[..., 2:] ** 2
    image *= focal[..., None]
    rows = np.concatenate([image, -image @ rotations.skew(turned), (focal * rays)[..., None]], axis=-1)
    across = image @ R[:, :, None]
    weighted_rows, weighted_across = weights[..., None, None] * rows, weights[..., None, None] * across
    own = np.swapaxes(weighted_rows, -1, -2)
    blocks = np.asarray(own @ across, dtype=np.float64)
    coupling = np.moveaxis(blocks, 0, 2).reshape(*x.shape[1:3], CAMERA_DOF * V, 3)
    points = (np.swapaxes(weighted_across, -1, -2) @ across).sum(axis=0)
    points += np.eye(3) * (1e-9 * np.trace(points, axis1=-2, axis2=-1)[..., None, None] + 1e-9)
    gradient = (np.swapaxes(weighted_across, -1, -2) @ residual[..., None])[..., 0].sum(axis=0)
    inverse = np.linalg.inv(points)
    solved = coupling @ inverse
    stacked = [np.moveaxis(a, 0, 2).reshape(x.shape[2], CAMERA_DOF * V, -1) for a in (solved, coupling)]
    H = -stacked[0] @ np.swapaxes(stacked[1], 1, 2)
    for v, block in enumerate((own @ rows).sum(axis=1)):
        columns = camera_columns([v])
        H[:, columns[:, None], columns] += block
    by_camera = np.moveaxis((own @ residual[..., None])[..., 0].sum(axis=1), 0, 1).reshape(-1, CAMERA_DOF * V)
    g = by_camera - (solved @ gradient[..., None])[..., 0].sum(axis=0)
    kinds = (shared.kind == np.arange(shared.kind.max() + 1)[:, None]).astype(float)
    H_kinds = np.tensordot(kinds, H, axes=1)
    return ReducedSystem(
        H=H_kinds,
        g=kinds @ g,
        rows=rows,
        size=at.size,
        weights=weights,
        coupling=coupling,
        inverse=inverse,
        gradient=gradient,
    )


def fitted_cameras(
    shared: SharedKeypoints, estimate: CameraEstimate, free: Sequence[int]
) -> tuple[CameraEstimate, ReducedSystem]:
    """Run Gauss-Newton for some cameras and all joints; returns the estimate and the system there.

    The weights change from state to state, so steps are tested with those they were computed with.
    """
    first = FreeCameras.at(shared, estimate, free)
    pictures = [picture_matrix(first.system, v) for v in free]

    def trial_cost(trial: CameraEstimate, equations: FreeCameras) -> float:
        return equations.cost_at(shared, trial)

    def shift(before: CameraEstimate, after: CameraEstimate) -> float:
        steps = after.change[list(free)] - before.change[list(free)]
        return max((float(np.sqrt(x @ M @ x)) for x, M in zip(steps, pictures, strict=True)), default=0.0)

    found = minimise(
        estimate,
        lambda state: first if state is estimate else FreeCameras.at(shared, state, free),
        CameraEstimate.moved,
        trial_cost=trial_cost,
        damping=GAUSS_NEWTON,
        stopping=StoppingRule(
            iterations=_ITERATIONS, small_step=_CONVERGED_PIXELS, step_size=shift, small_refused=True
        ),
    )
    return found.state, found.linearised().system


def picture_matrix(system: ReducedSystem, view: int) -> Array:
    """Return the matrix M (7, 7) for which x^T M x is the mean square shift of the joints in the picture, pixels^2,
    that a change x of the camera causes.
    """
    rows = system.rows[view][system.seen[view]]
    return np.asarray(np.einsum("nki,nkj->ij", rows, rows) / max(len(rows), 1))
