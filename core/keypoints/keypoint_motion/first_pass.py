"""A first pass: the motion of a whole shot by keypoints alone, before any picture is looked at."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...body import Body, human
from ...body.measures.body_measures import BodyMeasures
from ...body.measures.measures_from_landmarks import starting_height
from ...errors import KeypointError
from ...numerics.arrays import Array
from ...shot.keypose_spline import spline
from ...shot.shot import KeyPoses
from ..keypoint_rays import Keypoints
from ..seen_landmarks import resting_degrees, with_resting
from ..view_agreement import ViewAgreement
from .first_pose import posed_start, posing_frames, posing_points
from .keypoint_fit import STEPS_CONTINUED, FitProblem, KeypointFit, fit_motion
from .lifting import lone_view
from .limb_safeguard import repose_lost_limbs
from .person_depth import likely_height
from .single_view import corrected_fit, lifted_fit, lifted_start
from .single_view_turns import with_whole_turns


def first_pass(
    body: Body,
    keys: KeyPoses | None,
    keypoints: Keypoints,
    *,
    fixed: NDArray[np.bool_],
    precision: Array,
    fps: float,
    correlated: float,
) -> KeypointFit:
    """Fit the motion of a body to keypoints, from each of several starts, and return the best fit.

    One start is the curve through the key poses, another is posed on the keypoints alone. If a single view has
    keypoints, depths are lifted (`single_view`), and whole turns between the key poses are tried as well.

    Parameters
    ----------
    body : Body
    keys : KeyPoses or None
        The first start is the curve through them.
    keypoints : Keypoints
        On the F frames of the shot.
    fixed : ndarray of bool, shape (F, D)
        Degrees of freedom that key poses hold, or that are locked.
    precision : ndarray, shape (D,)
        Of accelerations.
    fps : float
    correlated : float
        See `FitProblem`.

    Raises
    ------
    KeypointError
        There is no start: no key pose is given, and two views have too few keypoints in common.
    """
    held = keys if keys is not None and keys.fixed.any() else None
    starts = [spline(held, len(keypoints))] if held is not None else []
    agreement = ViewAgreement.of(keypoints, fps)
    points = posing_points(agreement.keypoints, agreement.points_world, fps)
    if len(posing_frames(agreement.keypoints, points, fps)):
        start = posed_start(body, agreement.keypoints, points, fps)
        start = start.moved(np.where(fixed, start.difference(starts[0]), 0.0)) if starts else with_resting(start, fixed)
        starts.append(start)
    view = lone_view(body, keypoints)
    if view is not None and held is None:
        return lifted_fit(body, keypoints, view, fixed=fixed, precision=precision, fps=fps)
    if view is not None and keys is not None and len(keys.proposals()):
        return corrected_fit(body, starts[0], keypoints, view, fixed=fixed, precision=precision, fps=fps)
    if view is not None and held is not None:
        starts.append(lifted_start(body, held, keypoints, view, fixed=fixed, fps=fps))
    if not starts:
        todo = "give key poses, or keypoints of two views or more"
        raise KeypointError("no two views agree on a pose of the body", todo=todo)
    problem = FitProblem(agreement, fixed, precision, correlated)
    best = min((fit_motion(problem, body, start) for start in starts), key=lambda fit: fit.energy)
    if view is not None and held is not None:
        best = with_whole_turns(problem, body, starts[0], held.full().tolist(), best)
    return _with_lost_limbs_found(problem, best)


def scaled_first_pass(
    keypoints: Keypoints, *, fps: float, precision: Array, correlated: float, height: float | None = None
) -> KeypointFit:
    """Fit a motion and the measures of the body to keypoints.

    If only one view has keypoints, the body has average proportions, and depths follow from the lengths of its bones.

    Parameters
    ----------
    keypoints : Keypoints
        On the F frames of the shot.
    fps : float
    precision : ndarray, shape (D,)
        Of accelerations.
    correlated : float
        See `FitProblem`.
    height : float, optional
        Height of the body, metres; with several views only one to begin with, see `starting_height`. By default it is
        estimated from the keypoints; with a single view, from feet that stand on the floor.

    Raises
    ------
    KeypointError
        Two views have too few keypoints in common.
    """
    agreement = ViewAgreement.of(keypoints, fps)
    points = posing_points(agreement.keypoints, agreement.points_world, fps)
    if not len(posing_frames(agreement.keypoints, points, fps)):
        view = lone_view(human(), keypoints)
        if view is None:
            raise KeypointError("no two views agree on a pose of the body", todo="give key poses, or more views")
        body = human(likely_height(keypoints.of_views([view]), fps) if height is None else height)
        fixed = resting_degrees(body, keypoints)
        return lifted_fit(body, keypoints, view, fixed=fixed, precision=precision, fps=fps)
    measures = BodyMeasures.average(starting_height(keypoints.names, points, height))
    body = measures.body()
    fixed = resting_degrees(body, agreement.keypoints)
    start = with_resting(posed_start(body, agreement.keypoints, points, fps), fixed)
    problem = FitProblem(agreement, fixed, precision, correlated)
    return _with_lost_limbs_found(problem, fit_motion(problem, body, start, measures=measures))


def _with_lost_limbs_found(problem: FitProblem, fit: KeypointFit) -> KeypointFit:
    """Return a fit, or where limbs of it are farther from the images than what views agree on, the better of it and one
    that goes on with these limbs posed anew. Its changed sides are those since the detector.
    """
    best, agreement = fit, problem.agreement
    if agreement.sigma is not None:
        reposed = repose_lost_limbs(
            fit.body,
            fit.motion,
            fit.places,
            keypoints=fit.keypoints,
            points_world=agreement.averaged(),
            sigma=agreement.sigma,
            fps=agreement.fps,
        )
        if reposed is not None:
            held = np.where(problem.fixed, reposed.difference(fit.motion), 0.0)
            again = fit_motion(problem, fit.body, reposed.moved(held), steps=STEPS_CONTINUED, earlier=fit)
            best = min(fit, again, key=lambda one: one.energy)
    return replace(best, changed=best.changed ^ agreement.changed)
