"""Comparing cameras with one another by the 2D keypoints that they share.

If no point in space projects to the keypoints that all cameras found for a joint, a camera is off. The unknowns are the
cameras' poses and focal lengths and the positions of all joints on all frames; the positions are eliminated (B. Triggs
et al., Bundle adjustment - a modern synthesis, 2000, section 6.1). What a detector calls a hip is not the same point
from every side, and that error is the same on all frames. Only different kinds of joints therefore have independent
errors, and the uncertainty of the result is estimated by leaving out one kind at a time (the jackknife).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..cameras.camera import Camera
from ..keypoints.keypoint_rays import Keypoints
from ..keypoints.triangulation import triangulate
from ..numerics import rotations
from ..numerics.arrays import Array, Bools, Ints
from ..numerics.robust_kernels import RAYLEIGH_MEDIAN, GemanMcClure
from .camera_refinement import chance_quantile
from .resection import CAMERA, FOCAL, POSITION, ROTATION, adjusted

GROSS = 3.0
"""Residual, in standard deviations, at which a keypoint has a quarter of the full weight (Geman-McClure kernel)."""
LEAST_DEVIATION = 0.3
"""Least standard deviation of a keypoint, pixels."""
LEAST_KINDS = 6
"""Least number of kinds of joints from which a camera's seven unknowns are estimated."""
_PER_CORRELATED = 3  # frames used out of those with correlated errors; more add nothing
_ITERATIONS = 12
_SETTLED = 0.05  # pixels
_NEAREST = 0.1  # metres


@dataclass(frozen=True, eq=False)
class SharedKeypoints:
    """Keypoints of all performers on some frames.

    Attributes
    ----------
    rays : ndarray, shape (V, F, L, 2)
        See `Keypoints`.
    confidence : ndarray, shape (V, F, L)
        0 to 1, 0 where not found.
    R_cam_world, t_cam_world : ndarray, shape (V, F, 3, 3) and (V, F, 3)
    points_world : ndarray, shape (F, L, 3)
        Triangulated, metres; NaN where no two views agree.
    kind : ndarray of int, shape (L,)
        The kind of each joint. Joints of one kind, left and right and of all performers, have correlated errors.
    focal : ndarray, shape (V,)
        Pixels.
    correlated : float
        Number of neighbouring frames, of these F, whose errors are correlated and which count as one.
    """

    rays: Array
    confidence: Array
    R_cam_world: Array
    t_cam_world: Array
    points_world: Array
    kind: Ints
    focal: Array
    correlated: float

    @classmethod
    def of(cls, performers: Sequence[Keypoints], cameras: Sequence[Camera], correlated: float) -> SharedKeypoints:
        """Join the keypoints of all performers; `correlated` is a number of frames of the shot."""
        step = max(1, int(correlated / _PER_CORRELATED))
        chosen = [keypoints[::step] for keypoints in performers]
        kinds = [name[1:] if name[0] in "LR" else name for keypoints in chosen for name in keypoints.names]
        numbers = {kind: i for i, kind in enumerate(dict.fromkeys(kinds))}
        return cls(
            np.concatenate([keypoints.rays for keypoints in chosen], axis=2),
            np.concatenate([keypoints.confidence for keypoints in chosen], axis=2),
            chosen[0].R_cam_world,
            chosen[0].t_cam_world,
            np.concatenate([triangulate(keypoints)[0] for keypoints in chosen], axis=1),
            np.array([numbers[kind] for kind in kinds], np.int64),
            np.array([camera.matrix[[0, 1], [0, 1]].mean() for camera in cameras]),
            max(1.0, correlated / step),
        )

    def found(self) -> Bools:
        """Return which keypoints were found and can be triangulated, shape (V, F, L)."""
        known = np.isfinite(self.rays).all(axis=-1) & (self.confidence > 0)
        return np.asarray(known & np.isfinite(self.points_world).all(axis=-1))

    def kinds_seen(self) -> Ints:
        """Return how many kinds of joints each view shares with another, shape (V,)."""
        shared = self.found() & (self.found().sum(axis=0) >= 2)
        return np.array([len(np.unique(self.kind[view.any(axis=0)])) for view in shared])


@dataclass(frozen=True, eq=False)
class CameraEstimate:
    """An estimate of cameras and joints.

    Attributes
    ----------
    change : ndarray, shape (V, 7)
        Change of every camera since the start, see `core.fitting.resection.adjusted`.
    points_world : ndarray, shape (F, L, 3)
        Positions of the joints, metres.
    """

    change: Array
    points_world: Array

    def cameras(self, before: Sequence[Camera]) -> list[Camera]:
        """Return the cameras after the change."""
        return [adjusted(camera, change) for camera, change in zip(before, self.change, strict=True)]


@dataclass(frozen=True)
class PictureShift:
    """How far a camera is off, measured in its picture.

    Attributes
    ----------
    shift : float
        Root mean square distance by which the performers' joints must move in the picture to fit, pixels.
    deviation : float
        Standard deviation of the shift, pixels.
    limit : float
        Largest shift that errors of the keypoints explain, pixels.
    """

    shift: float
    deviation: float
    limit: float

    @property
    def off(self) -> bool:
        """Whether the camera is off."""
        return self.shift > self.limit


@dataclass(frozen=True, eq=False)
class _ReducedSystem:
    """Normal equations of the cameras after the joints have been eliminated.

    Attributes
    ----------
    H : ndarray, shape (K, 7 V, 7 V)
        Per kind of joint.
    g : ndarray, shape (K, 7 V)
        Gradients of half the cost.
    rows : ndarray, shape (V, F, L, 2, 7)
        Derivatives of the joints' projections by the unknowns of their camera, pixels.
    seen : ndarray of bool, shape (V, F, L)
    size : ndarray, shape (V, F, L)
        Lengths of the residuals, pixels; NaN where there is none.
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
    seen: Bools
    size: Array
    coupling: Array
    inverse: Array
    gradient: Array

    def points_step(self, step: Array) -> Array:
        """Return the step of the joints (F, L, 3) that belongs to a step of the cameras (7 V,)."""
        gradient = self.gradient + np.einsum("flia,i->fla", self.coupling, step)
        return -np.einsum("flab,flb->fla", self.inverse, gradient)


def _prior(views: int) -> Array:
    """Return the prior's inverse variances of the cameras' changes, shape (7 V,)."""
    return np.tile(1 / np.array([POSITION] * 3 + [ROTATION] * 3 + [FOCAL]) ** 2, views)


def _columns(views: Sequence[int]) -> Ints:
    """Return the indices of some views' cameras in the system."""
    return (CAMERA * np.asarray(views, np.int64)[:, None] + np.arange(CAMERA)).ravel()


def _weights(shared: SharedKeypoints, size: Array) -> Array:
    """Return robust weights from the noise of every view's joints, pixels^-2, shape (V, F, L)."""
    known = np.isfinite(size)
    middle = np.nanmedian(np.where(known.any(axis=1, keepdims=True), size, 0.0), axis=1) / RAYLEIGH_MEDIAN
    usual = np.array([np.median(row[row > 0]) if (row > 0).any() else 0.0 for row in middle])
    deviation = np.maximum(np.maximum(middle, 0.5 * usual[:, None]), LEAST_DEVIATION)[:, None]
    kernel = GemanMcClure(GROSS).weight((np.nan_to_num(size) / deviation) ** 2)
    weights = np.where(known, shared.confidence * kernel / deviation**2, 0.0)
    return np.asarray(np.where((weights > 0).sum(axis=0) >= 2, weights, 0.0) / shared.correlated)


def _linearised(shared: SharedKeypoints, estimate: CameraEstimate) -> _ReducedSystem:
    """Return the reduced system at an estimate."""
    change, V = estimate.change, len(shared.focal)
    turn = rotations.exp(change[:, 3:6])
    R = turn[:, None] @ shared.R_cam_world
    turned = np.einsum("vfab,flb->vfla", R, estimate.points_world)
    turned += np.einsum("vab,vfb->vfa", turn, shared.t_cam_world)[:, :, None]
    x = turned + change[:, None, None, :3]
    known = shared.found() & (x[..., 2] > _NEAREST)
    turned, x = np.where(known[..., None], turned, 0.0), np.where(known[..., None], x, [0.0, 0.0, 1.0])
    focal = shared.focal[:, None, None, None]
    rays = np.where(known[..., None], shared.rays, 0.0) * np.exp(-change[:, 6])[:, None, None, None]
    residual = np.where(known[..., None], focal * (x[..., :2] / x[..., 2:] - rays), 0.0)
    size = np.where(known, np.linalg.norm(residual, axis=-1), np.nan)
    weights = _weights(shared, size)
    image = np.zeros((*x.shape[:3], 2, 3))
    image[..., 0, 0] = image[..., 1, 1] = 1 / x[..., 2]
    image[..., 2] = -x[..., :2] / x[..., 2:] ** 2
    image *= focal[..., None]
    rows = np.concatenate([image, -image @ rotations.skew(turned), (focal * rays)[..., None]], axis=-1)
    across = image @ R[:, :, None]
    weighted_rows, weighted_across = weights[..., None, None] * rows, weights[..., None, None] * across
    own = np.swapaxes(weighted_rows, -1, -2)
    blocks = np.asarray(own @ across, dtype=np.float64)
    coupling = np.moveaxis(blocks, 0, 2).reshape(*x.shape[1:3], CAMERA * V, 3)
    points = (np.swapaxes(weighted_across, -1, -2) @ across).sum(axis=0)
    points += np.eye(3) * (1e-9 * np.trace(points, axis1=-2, axis2=-1)[..., None, None] + 1e-9)
    gradient = (np.swapaxes(weighted_across, -1, -2) @ residual[..., None])[..., 0].sum(axis=0)
    inverse = np.linalg.inv(points)
    solved = coupling @ inverse
    stacked = [np.moveaxis(a, 0, 2).reshape(x.shape[2], CAMERA * V, -1) for a in (solved, coupling)]
    H = -stacked[0] @ np.swapaxes(stacked[1], 1, 2)
    for v, block in enumerate((own @ rows).sum(axis=1)):
        columns = _columns([v])
        H[:, columns[:, None], columns] += block
    by_camera = np.moveaxis((own @ residual[..., None])[..., 0].sum(axis=1), 0, 1).reshape(-1, CAMERA * V)
    g = by_camera - (solved @ gradient[..., None])[..., 0].sum(axis=0)
    kinds = (shared.kind == np.arange(shared.kind.max() + 1)[:, None]).astype(float)
    H_kinds = np.tensordot(kinds, H, axes=1)
    return _ReducedSystem(H_kinds, kinds @ g, rows, weights > 0, size, coupling, inverse, gradient)


def _fitted(
    shared: SharedKeypoints, estimate: CameraEstimate, free: Sequence[int]
) -> tuple[CameraEstimate, _ReducedSystem]:
    """Run Gauss-Newton for some cameras and all joints; returns the estimate and the system there."""
    columns, prior = _columns(free), _prior(len(shared.focal))
    system = _linearised(shared, estimate)
    for _ in range(_ITERATIONS):
        step = np.zeros(prior.size)
        gradient = system.g.sum(axis=0) + prior * estimate.change.ravel()
        H = system.H.sum(axis=0) + np.diag(prior)
        step[columns] = -np.linalg.solve(H[np.ix_(columns, columns)], gradient[columns])
        moved = system.points_step(step)
        estimate = CameraEstimate(estimate.change + step.reshape(-1, CAMERA), estimate.points_world + moved)
        shifts = [np.sqrt(step[_columns([v])] @ _picture(system, v) @ step[_columns([v])]) for v in free]
        system = _linearised(shared, estimate)
        if max(shifts, default=0.0) < _SETTLED:
            break
    return estimate, system


def _picture(system: _ReducedSystem, view: int) -> Array:
    """Return the matrix M (7, 7) for which x^T M x is the mean square shift of the joints in the picture, pixels^2,
    that a change x of the camera causes.
    """
    rows = system.rows[view][system.seen[view]]
    return np.asarray(np.einsum("nki,nkj->ij", rows, rows) / max(len(rows), 1))


def _shift(system: _ReducedSystem, estimate: CameraEstimate, free: Sequence[int], view: int) -> PictureShift:
    """Return how far a free camera is off, and how far errors of the keypoints alone could move it."""
    columns, prior = _columns(free), _prior(len(estimate.change))
    H, g = system.H[:, columns][:, :, columns], system.g[:, columns]
    kinds = [k for k in range(len(H)) if H[k].any()]
    total = H.sum(axis=0) + np.diag(prior[columns])
    gradient = g.sum(axis=0) + (prior * estimate.change.ravel())[columns]
    without = np.array([-np.linalg.solve(total - H[k], gradient - g[k]) for k in kinds])
    spread = without - without.mean(axis=0)
    own = CAMERA * list(free).index(view) + np.arange(CAMERA)
    covariance = (len(kinds) - 1) / len(kinds) * (spread.T @ spread)[np.ix_(own, own)]
    picture = _picture(system, view)
    shares = np.maximum(np.linalg.eigvals(picture @ covariance).real, 0)
    variance = max(float(shares.sum()), 1e-12)
    chance = variance * chance_quantile(shares, len(kinds))
    # An error that all joints of a view have in common may be as large as the error of any one of them.
    sizes = [system.size[system.seen], system.size[view][system.seen[view]]]
    error = np.sqrt(2) / RAYLEIGH_MEDIAN * max(float(np.median(found)) for found in sizes if len(found))
    change = estimate.change[view]
    shift = float(np.sqrt(change @ picture @ change))
    return PictureShift(shift, variance**0.5, limit=float(np.sqrt(chance + error**2)))


def contradictions(shared: SharedKeypoints) -> tuple[dict[int, PictureShift], CameraEstimate]:
    """Find the cameras that contradict the others, one at a time.

    Each camera in turn is moved to agree with the others. The one whose movement makes all agree best is off if its
    picture moves by more than errors of the keypoints explain; it then stays free while the next one is looked for.

    Returns
    -------
    shifts : dict of int to PictureShift
        By index of the views that could be compared, in order; empty if these are fewer than three, because nothing
        shows which of two cameras is off, or by how much.
    CameraEstimate
        The estimate in which the cameras that are off have been moved.
    """
    able = [v for v, count in enumerate(shared.kinds_seen()) if count >= LEAST_KINDS]
    estimate = CameraEstimate(np.zeros((len(shared.focal), CAMERA)), np.nan_to_num(shared.points_world))
    shifts: dict[int, PictureShift] = {}
    if len(able) < 3:
        return {}, estimate
    estimate, start = _fitted(shared, estimate, [])
    scale = np.nanmedian(start.size[start.seen]) / RAYLEIGH_MEDIAN
    off: list[int] = []
    # At least two cameras must stay: one alone does not determine the scale.
    while len(off) < len(able) - 2:
        best: tuple[float, int, PictureShift, CameraEstimate] | None = None
        for view in able:
            if view in off:
                continue
            moved, system = _fitted(shared, estimate, [*off, view])
            found = _shift(system, moved, [*off, view], view)
            if not off or found.off:
                shifts[view] = found
            cost = float(np.nansum(GemanMcClure(GROSS).cost((system.size / scale) ** 2)))
            if best is None or cost < best[0]:
                best = cost, view, found, moved
        if best is None or not best[2].off:
            break
        _, view, shifts[view], estimate = best
        off.append(view)
    for view in shifts.keys() - set(off):
        shifts[view] = replace(shifts[view], limit=max(shifts[view].limit, shifts[view].shift))
    return dict(sorted(shifts.items())), estimate
