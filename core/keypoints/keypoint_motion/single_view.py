"""A motion from the keypoints of a single view: two hypotheses about the depths, and the choice between them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...body import Body, part_poses
from ...body.motion import Motion
from ...numerics.arrays import Array, Bools
from ...shot.motion_warping import bent
from ...shot.shot import KeyPoses
from ..keypoint_offsets import KeypointOffsets
from ..keypoint_rays import Keypoints
from ..keypoint_sigmas import USUAL_SIGMA
from ..seen_landmarks import with_resting
from ..view_agreement import ViewAgreement, without_midpoints
from .first_pose import posed_start
from .keypoint_fit import FitProblem, KeypointFit, fit_motion
from .lifting import lifted_points, with_imagined_view


def lifted_fit(
    body: Body, keypoints: Keypoints, view: int, *, fixed: Bools, precision: Array, fps: float
) -> KeypointFit:
    """Fit a body's motion to the keypoints of one view, with depths from the lengths of the bones.

    There are two hypotheses: the cheapest path of the trunk, and one with the trunk turned to the other side of the
    image plane. The one with the lower cost of trunk and limbs together is fitted. Collar bones rest: in one view,
    their rotation cannot be distinguished from one of the trunk.

    Parameters
    ----------
    body : Body
        The default body, of the person's height.
    keypoints : Keypoints
    view : int
        Index of the view that has keypoints.
    fixed : ndarray of bool, shape (F, D)
    precision : ndarray, shape (D,)
        See `FitProblem`.
    fps : float
    """
    fixed = fixed | _collar_bones(body)
    start, agreement = _lifted(body, keypoints, view, fixed=fixed, fps=fps)
    return _fitted(body, start, keypoints, view, agreement, fixed=fixed, precision=precision)


def lifted_start(body: Body, keys: KeyPoses, keypoints: Keypoints, view: int, *, fixed: Bools, fps: float) -> Motion:
    """Return the motion lifted from the keypoints of one view, bent to pass through the key poses, as a start.

    Its depths are wrong by decimetres, but each limb follows its own keypoints. The curve through the key poses, the
    other possible start, may have one leg in the place of the other.

    Parameters are those of `lifted_fit`.
    """
    return bent(_lifted(body, keypoints, view, fixed=fixed, fps=fps)[0], keys)


def _lifted(body: Body, keypoints: Keypoints, view: int, *, fixed: Bools, fps: float) -> tuple[Motion, ViewAgreement]:
    """Return the motion of the likelier hypothesis, and the agreement of the view with an imagined one that holds its
    depths.
    """
    own = without_midpoints(keypoints.of_views([view]))
    hypotheses = [lifted_points(body, own, fps, mirrored=mirrored) for mirrored in (False, True)]
    points, _ = min(hypotheses, key=lambda one: one[1])
    agreement = with_imagined_view(own, points, fps)
    return with_resting(posed_start(body, agreement.keypoints, points, fps), fixed), agreement


def corrected_fit(
    body: Body, start: Motion, keypoints: Keypoints, view: int, *, fixed: Bools, precision: Array, fps: float
) -> KeypointFit:
    """Fit a body's motion to the keypoints of one view; depths and collar bones are held where they are at the start.

    Parameters are those of `lifted_fit`.
    """
    own = without_midpoints(keypoints.of_views([view]))
    points = KeypointOffsets.on(body, own.names).world(part_poses(body, start))
    agreement = with_imagined_view(own, points, fps)
    fixed = fixed | _collar_bones(body)
    return _fitted(body, start, keypoints, view, agreement, fixed=fixed, precision=precision)


def _collar_bones(body: Body) -> Bools:
    """Return the degrees of freedom of the default body's collar bones, shape (D,); none where it has none."""
    return np.repeat([False] + [name.startswith("shoulder.") for name in body.names], 3)


def _fitted(
    body: Body,
    start: Motion,
    keypoints: Keypoints,
    view: int,
    agreement: ViewAgreement,
    *,
    fixed: Bools,
    precision: Array,
) -> KeypointFit:
    fit = fit_motion(FitProblem(agreement, fixed, precision), body, start)
    return _as_of_all_views(fit, keypoints, view, agreement.fps)


def _as_of_all_views(fit: KeypointFit, keypoints: Keypoints, view: int, fps: float) -> KeypointFit:
    """Return a fit to one view and an imagined one, expressed as a fit to all views of the shot, in which others are
    empty.
    """

    def spread(values: NDArray[Any]) -> NDArray[Any]:
        everywhere = np.zeros((len(keypoints.confidence), *values.shape[1:]), values.dtype)
        everywhere[view] = values[0]
        return everywhere

    rays = keypoints.rays.copy()
    rays[view] = fit.keypoints.rays[0]
    points = fit.places.world(part_poses(fit.body, fit.motion))
    return replace(
        fit,
        keypoints=replace(keypoints, rays=rays, confidence=spread(fit.keypoints.confidence)),
        changed=spread(fit.changed),
        sigma=np.full((len(rays), len(keypoints.names)), USUAL_SIGMA),
        weights=spread(fit.weights),
        agreed=None,
        imagined=with_imagined_view(fit.keypoints.of_views([0]), points, fps).keypoints.of_views([1]),
    )
