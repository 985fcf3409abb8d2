"""Bundle adjustment of cameras, clocks and a wand whose length is known.

The normal matrix is banded, because the wand is coupled between neighbouring frames only, with a border for the
cameras. If the cameras come last, factorising in the order of the unknowns eliminates the wand frame by frame and
leaves the Schur complement of the cameras; no other order has less fill-in. See B. Triggs et al., Bundle adjustment - a
modern synthesis (2000), section 6.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from ...numerics.arrays import Array, Bools
from ...numerics.least_squares import StoppingRule, minimise, moving_only
from ...numerics.normal_equations import SparseEquations, SparseFactor
from ...numerics.robust_kernels import RAYLEIGH_MEDIAN, Quadratic, RobustKernel
from .ball_observations import BallObservations
from .bundle_residuals import BundleResiduals, linearise, residuals
from .bundle_scene import BundleEvidence, Scene, first_camera, unknowns
from .camera_rig import CAMERA_DOF

LEAST_SQUARES: RobustKernel = Quadratic()
CONVERGED, NEARLY_CONVERGED = StoppingRule[Scene](), StoppingRule[Scene](relative_gain=1e-5)
"""The second for solutions that are only compared."""
_MIN_FREE_SHARE = 0.1  # least degrees of freedom that are assumed, as a share of the observations
_MAX_CORRELATION = 0.95  # upper limit of the correlation of neighbouring frames: at 1, a whole track counts as one


@dataclass(frozen=True, eq=False)
class BundleFit:
    """An adjusted scene.

    Attributes
    ----------
    scene : Scene
    free : ndarray of bool, shape (unknowns,)
        Which unknowns were solved for.
    cost : float
        Robust sum of squared residuals, in units of the variance.
    iterations : int
    residual : ndarray, shape (n, 2)
        Predicted minus observed positions of the balls, in standard deviations: those of the wand, then the L-frame's.
    """

    scene: Scene
    free: Bools
    cost: float
    iterations: int
    residual: Array

    @property
    def noise(self) -> float:
        """Noise of the observations as a multiple of their sigma, from the median residual.

        It is corrected for the number of unknowns that were fitted to the same residuals.
        """
        if not len(self.residual):
            return np.inf
        middle = float(np.median(np.linalg.norm(self.residual, axis=1))) / RAYLEIGH_MEDIAN
        left = 1 - self.free.sum() / self.residual.size
        return middle / float(np.sqrt(max(left, _MIN_FREE_SHARE)))


def adjust(
    scene: Scene,
    evidence: BundleEvidence,
    free_camera: Bools,
    *,
    kernel: RobustKernel = LEAST_SQUARES,
    stopping: StoppingRule[Scene] = CONVERGED,
    free_wand: bool = True,
    cancel: Callable[[], None] | None = None,
) -> BundleFit:
    """Minimise the robust sum of squared residuals of a scene.

    Parameters
    ----------
    scene : Scene
        The start.
    evidence : BundleEvidence
    free_camera : ndarray of bool, shape (C, 13)
        Which of the cameras' unknowns are solved for.
    kernel : RobustKernel
        Kernel on the residual of each ball, in standard deviations.
    stopping : StoppingRule
    free_wand : bool
        Whether to solve for the wand and the L-frame, too.
    cancel : callable, optional
        Called in every iteration; may raise.

    Returns
    -------
    BundleFit
    """
    free = np.full(unknowns(scene), free_wand)
    free[first_camera(scene) :] = free_camera.ravel()

    def cost(points: Array, others: Array) -> float:
        return float(kernel.cost((points**2).sum(axis=1)).sum() + (others**2).sum())

    def equations(state: Scene) -> SparseEquations:
        found = linearise(state, evidence)
        return SparseEquations(*_normal_equations(found, free, kernel), cost(found.points, found.others))

    result = minimise(
        scene,
        equations,
        moving_only(Scene.moved, free),
        trial_cost=lambda trial, _: cost(*residuals(trial, evidence)),
        stopping=stopping,
        on_iteration=None if cancel is None else lambda iteration, state: cancel(),
    )
    points, _ = residuals(result.state, evidence)
    return BundleFit(result.state, free, result.cost, result.iterations, points)


def _normal_equations(found: BundleResiduals, free: Bools, kernel: RobustKernel) -> tuple[sparse.csc_array, Array]:
    """Return the Gauss-Newton matrix and gradient of the free unknowns, with robust weights."""
    weight = np.ones(found.jacobian.shape[0])
    weight[: found.points.size] = np.repeat(kernel.weight((found.points**2).sum(axis=1)), 2)
    J = found.jacobian[:, np.flatnonzero(free)]
    rows = sparse.csr_array((J.data * np.repeat(weight, np.diff(J.indptr)), J.indices, J.indptr), J.shape)
    return (rows.T @ J).tocsc(), rows.T @ np.concatenate([found.points.ravel(), found.others])


def variance_inflation(seen: BallObservations, residual: Array) -> float:
    """Return the factor by which correlated errors of neighbouring frames increase variances.

    The same ball in front of almost the same background is measured with almost the same error. With a correlation r
    between neighbouring frames, n observations count as n (1 - r) / (1 + r), as in a first-order autoregressive series.

    Parameters
    ----------
    seen : BallObservations
        The n observations of the wand's balls.
    residual : ndarray, shape (n, 2)
        In standard deviations.
    """
    order = np.lexsort((seen.frame, seen.ball, seen.camera))
    track, frame, own = 2 * seen.camera[order] + seen.ball[order], seen.frame[order], residual[order]
    next_frame = (np.diff(track) == 0) & (np.diff(frame) == 1)
    before, after = own[:-1][next_frame], own[1:][next_frame]
    scale = float(np.sqrt((before**2).sum() * (after**2).sum()))
    r = float(np.clip((before * after).sum() / max(scale, 1e-12), 0.0, _MAX_CORRELATION))
    return (1 + r) / (1 - r)


def covariance(scene: Scene, evidence: BundleEvidence, free: Bools) -> Array:
    """Covariance of the cameras' unknowns, shape (13 C, 13 C), zero for those that are held.

    Parameters
    ----------
    scene : Scene
    evidence : BundleEvidence
    free : ndarray of bool, shape (unknowns,)
        Which unknowns are solved for, see `BundleFit.free`.
    """
    H, _ = _normal_equations(linearise(scene, evidence), free, Quadratic())
    diagonal = H.diagonal()
    # If only one end of the wand is seen, nothing measures its direction.
    ridge = sparse.diags_array(np.where(diagonal > 0, 1e-14 * diagonal, 1.0), format="csc")
    factor = SparseFactor.create(H + ridge)
    own = np.flatnonzero(free[first_camera(scene) :])
    unit = np.zeros((int(free.sum()), len(own)))
    unit[-len(own) :] = np.eye(len(own))
    out = np.zeros((len(scene.rig) * CAMERA_DOF,) * 2)
    out[np.ix_(own, own)] = factor.solve(unit)[-len(own) :]
    return out
