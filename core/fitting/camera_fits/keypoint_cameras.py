"""Comparing cameras with one another by the 2D keypoints that they share.

If no point in space projects to the keypoints that all cameras found for a joint, a camera is off: cameras and joints
are solved for together (`shared_cameras`). Only different kinds of joints have independent errors (`shared_keypoints`),
and the uncertainty of the result is estimated by leaving out one kind at a time (the jackknife).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...numerics.robust_kernels import RAYLEIGH_MEDIAN, GemanMcClure
from .camera_refinement import chance_quantile
from .resection import CAMERA_DOF
from .shared_cameras import (
    GEMAN_MCCLURE_SCALE,
    ReducedSystem,
    camera_columns,
    camera_prior,
    fitted_cameras,
    picture_matrix,
)
from .shared_keypoints import CameraEstimate, SharedKeypoints

MIN_JOINTS = 6  # of joints, from which a camera's seven unknowns are estimated


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


def _shift(system: ReducedSystem, estimate: CameraEstimate, free: Sequence[int], view: int) -> PictureShift:
    """Return how far a free camera is off, and how far errors of the keypoints alone could move it."""
    columns, prior = camera_columns(free), camera_prior(len(estimate.change))
    H, g = system.H[:, columns][:, :, columns], system.g[:, columns]
    kinds = [k for k in range(len(H)) if H[k].any()]
    total = H.sum(axis=0) + np.diag(prior[columns])
    gradient = g.sum(axis=0) + (prior * estimate.change.ravel())[columns]
    without = np.array([-np.linalg.solve(total - H[k], gradient - g[k]) for k in kinds])
    spread = without - without.mean(axis=0)
    own = CAMERA_DOF * list(free).index(view) + np.arange(CAMERA_DOF)
    covariance = (len(kinds) - 1) / len(kinds) * (spread.T @ spread)[np.ix_(own, own)]
    picture = picture_matrix(system, view)
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
    able = [v for v, count in enumerate(shared.kinds_seen()) if count >= MIN_JOINTS]
    estimate = CameraEstimate(np.zeros((len(shared.focal), CAMERA_DOF)), np.nan_to_num(shared.points_world))
    shifts: dict[int, PictureShift] = {}
    if len(able) < 3:
        return {}, estimate
    estimate, start = fitted_cameras(shared, estimate, [])
    scale = np.nanmedian(start.size[start.seen]) / RAYLEIGH_MEDIAN
    off: list[int] = []
    # At least two cameras must stay: one alone does not determine the scale.
    while len(off) < len(able) - 2:
        best: tuple[float, int, PictureShift, CameraEstimate] | None = None
        for view in able:
            if view in off:
                continue
            moved, system = fitted_cameras(shared, estimate, [*off, view])
            found = _shift(system, moved, [*off, view], view)
            if not off or found.off:
                shifts[view] = found
            cost = float(np.nansum(GemanMcClure(GEMAN_MCCLURE_SCALE).cost((system.size / scale) ** 2)))
            if best is None or cost < best[0]:
                best = cost, view, found, moved
        if best is None or not best[2].off:
            break
        _, view, shifts[view], estimate = best
        off.append(view)
    for view in shifts.keys() - set(off):
        shifts[view] = replace(shifts[view], limit=max(shifts[view].limit, shifts[view].shift))
    return dict(sorted(shifts.items())), estimate
