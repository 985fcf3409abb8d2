"""The stages of solving a segment, each a function from values to values.

views -> SegmentData -> SegmentProblem -> SegmentState -> time offset -> refined SegmentState -> SegmentUncertainty
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...body.motion import Motion
from ...evidence.part_shapes import FittedShape, ShapeEvidence
from ...evidence.rendering.part_geometry import Geometry
from ...evidence.time_offset import Offset, key_frame_offset
from ...evidence.view_frames import ViewFrames, views_with_foreground
from ...evidence.view_work import ViewWork
from ...keypoints.keypoint_factor import KeypointFactor
from ...keypoints.observations import ShotKeypoints
from ...numerics.arrays import Array
from ...shot.acceleration_prior import usual_variances, variances_from_key_poses
from ...shot.fixed_degrees import fixed_degrees
from ...shot.segments import Segment, keyed_frames, posed_frames
from ...shot.shot import Shot
from ..footage_reading.appearance import key_frame_shape
from ..solvers.equations.contact_factor import ContactFactor
from ..solvers.equations.hold_factor import hold_factors, touching_parts
from ..solvers.equations.measurement import Workspace
from ..solvers.equations.problem import WIDEST_STEP, AccelerationSearch, SegmentProblem, SegmentSolution
from ..solvers.protocol import Solver
from ..track_state import EarlierTrack, TrackState


@dataclass(frozen=True, eq=False)
class SegmentData:
    """Everything that is known of a segment before it is solved.

    Attributes
    ----------
    segment : tuple of int
    views : tuple of ViewFrames
    fixed : tuple of ndarray of bool, shape (F, D)
        Per performer: the degrees of freedom that key poses fix.
    keypoints : tuple of KeypointFactor
        One per performer; empty without keypoints.
    shape : FittedShape or None
        Shapes of all performers' parts as estimated on the key frames.
    typical_variances : tuple of ndarray, shape (G,)
        Per performer: variances of the accelerations at which their estimation starts, from keypoints or key poses.
    """

    segment: Segment
    views: tuple[ViewFrames, ...]
    fixed: tuple[NDArray[np.bool_], ...]
    keypoints: tuple[KeypointFactor, ...] = ()
    shape: FittedShape | None = None
    typical_variances: tuple[Array, ...] | None = None


@dataclass(frozen=True, eq=False)
class SegmentState:
    """A solved segment.

    Attributes
    ----------
    data : SegmentData
    problem : SegmentProblem
        The problem that was solved last.
    solution : SegmentSolution
    earlier : tuple of SegmentSolution
        Solutions before that one.
    """

    data: SegmentData
    problem: SegmentProblem
    solution: SegmentSolution
    earlier: tuple[SegmentSolution, ...] = ()

    @property
    def iterations(self) -> int:
        """Iterations of all solutions together."""
        return sum(solution.iterations for solution in (*self.earlier, self.solution))


def segment_data(
    shot: Shot,
    segment: Segment,
    views: tuple[ViewFrames, ...],
    state: TrackState,
    observed: ShotKeypoints,
    *,
    by: ViewWork,
) -> SegmentData:
    """Collect what is known of a segment, and fit the shapes of the parts on its key frames.

    Parameters
    ----------
    shot : Shot
    segment : tuple of int
    views : tuple of ViewFrames
        Frames of the segment, one per view.
    state : TrackState
        What is known of the shot so far.
    observed : ShotKeypoints
        Keypoints of the whole shot.
    by : ViewWork
    """
    bodies, frames = [p.body for p in shot.performers], slice(segment[0], segment[1] + 1)
    keys = posed_frames(shot, *segment)
    return SegmentData(
        segment,
        views,
        tuple(fixed_degrees(performer, *segment) for performer in shot.performers),
        tuple(own.factor[frames] for own in observed.performers),
        key_frame_shape(views, bodies, state.motions, keys, state.footage_offset(shot), by=by),
        _typical_variances(shot, observed),
    )


def _typical_variances(shot: Shot, observed: ShotKeypoints) -> tuple[Array, ...] | None:
    """Return, per performer, the variances of accelerations at which their estimation starts; None without estimation.

    They come from keypoints, if there are any. Otherwise they are the usual ones or, if the settings switch the
    estimation on, those of the key poses. Nothing is estimated where the settings give accelerations.
    """
    settings = shot.settings
    if observed.performers:
        return tuple(own.typical_variances for own in observed.performers)
    if settings.estimate_smoothness is False or not settings.solver_estimates:
        return None
    if settings.estimate_smoothness is None:
        given = settings.joint_acceleration or settings.root_acceleration
        return None if given else tuple(usual_variances(p.body, shot.fps, settings) for p in shot.performers)
    return tuple(variances_from_key_poses(p.body, p.key_poses, shot.fps, settings) for p in shot.performers)


def _acceleration_search(shot: Shot, data: SegmentData) -> AccelerationSearch:
    """Choose which variances to estimate: two key poses alone do not show where an estimation of joints may start, and
    in a single view errors look like motion.
    """
    if data.keypoints or shot.settings.estimate_smoothness is not None:
        return AccelerationSearch.JOINTS
    return AccelerationSearch.SCALE_THEN_JOINTS if len(shot.views) == 1 else AccelerationSearch.SCALE


def segment_problem(shot: Shot, data: SegmentData, state: TrackState) -> SegmentProblem:
    """Make the problem of a segment, with the poses that are known beside it."""
    first, last = data.segment
    bodies = tuple(performer.body for performer in shot.performers)
    keeps_out = shot.settings.contact and len(bodies) > 1
    shape = None if data.shape is None else data.shape.geometry
    holds = hold_factors(shot.holds, shot.performers, first, last)
    return SegmentProblem(
        views=data.views,
        bodies=bodies,
        first=first,
        fps=shot.fps,
        fixed=data.fixed,
        before=state.poses_at(first - 1),
        after=state.poses_at(last + 1),
        beyond=(state.poses_before(first, WIDEST_STEP), state.poses_after(last, WIDEST_STEP)),
        shape=shape,
        keypoints=data.keypoints,
        footage_offset=state.footage_offset(shot),
        settings=shot.settings,
        typical_variances=data.typical_variances,
        contact=ContactFactor.of(shape or Geometry.of(bodies), bodies, touching_parts(holds, bodies))
        if keeps_out
        else None,
        search=_acceleration_search(shot, data),
        holds=holds,
    )


def solve_segment(
    shot: Shot, solver: Solver, data: SegmentData, state: TrackState, workspace: Workspace
) -> SegmentState:
    """Solve a segment.

    Parameters
    ----------
    shot : Shot
    solver : Solver
    data : SegmentData
    state : TrackState
        What is known of the shot so far, such as the motion before the segment.
    workspace : Workspace
    """
    problem = segment_problem(shot, data, state)
    return SegmentState(data, problem, solver.solve(problem, _on(data.segment, state.motions), workspace))


def resume_segment(
    shot: Shot, solver: Solver, data: SegmentData, earlier: EarlierTrack, workspace: Workspace
) -> SegmentState | None:
    """Solve a segment from an earlier result; parameters as in `solve_segment`.

    Returns
    -------
    SegmentState or None
        None if the images contradict the result, or the solver cannot resume.
    """
    if solver.resume is None:
        return None
    problem = segment_problem(shot.for_refinement(), data, earlier.carried)
    start, before = (_on(data.segment, motions) for motions in (earlier.carried.motions, earlier.motions))
    found = solver.resume(problem, start, workspace, before)
    return None if found is None else SegmentState(data, problem, found)


def refine_segment(
    shot: Shot, solver: Solver, data: SegmentData, solved: SegmentSolution, state: TrackState, *, workspace: Workspace
) -> SegmentState:
    """Refine a solved segment once the motion on both sides is known; parameters as in `solve_segment`."""
    problem = segment_problem(shot.for_refinement(), data, state)
    problem = replace(problem.with_smoothness(solved.variances), doubted=solved.doubted, polished=solved.polished)
    refined = (solver.refine or solver.solve)(problem, _on(data.segment, state.motions), workspace)
    return SegmentState(data, problem, refined, (solved,))


def with_shape_beside(data: SegmentData, beside: Sequence[ShapeEvidence]) -> SegmentData:
    """Return a segment whose parts also fit the key frames of the segments beside it."""
    return data if data.shape is None else replace(data, shape=data.shape.joined(beside))


def measured_offset(shot: Shot, data: SegmentData, state: TrackState) -> Offset | None:
    """Measure the offset between a solved segment's key poses and the footage; None where nothing shows it."""
    if shot.settings.footage_offset is not None or data.shape is None:
        return None
    bodies, first = [performer.body for performer in shot.performers], data.segment[0]
    keyed = keyed_frames(shot, *data.segment)
    return key_frame_offset(
        views_with_foreground(data.views),
        Geometry.of(bodies),
        bodies,
        _on(data.segment, state.motions),
        first=first,
        keys=(keyed.frames - first).tolist(),
        known=keyed.posed,
    )


def _on(segment: Segment, motions: Sequence[Motion]) -> list[Motion]:
    return [motion[segment[0] : segment[1] + 1] for motion in motions]
