"""The result of a shot, put together from its finished segments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...body.kinematics import part_poses
from ...body.motion import Motion
from ...body.soles import Soles
from ...body.unknown_parts import resting_parts, unknown_reach, unshown_parts
from ...evidence.occlusion import unseen
from ...keypoints.observations import ShotKeypoints
from ...keypoints.seen_landmarks import found_landmarks
from ...numerics.arrays import Array, Bools, slices_of
from ...shot.motion_warping import with_keys
from ...shot.shot import Performer, Shot
from ..expected_errors.body_uncertainty import body_covariances
from ..expected_errors.uncertainty import joint_errors
from ..solvers.registry import solver_named
from ..track_state import TrackState
from .journal import FinishedSegment
from .late_views import late_views
from .limb_rolls import with_likely_rolls
from .track_result import TrackResult


def result_of_segments(
    shot: Shot,
    state: TrackState,
    done: Sequence[FinishedSegment],
    observed: ShotKeypoints,
    torn: tuple[tuple[int, ...], ...],
) -> TrackResult:
    """Put the result of a shot together, without times, pictures and what decoding the footage has shown.

    Parameters
    ----------
    shot : Shot
    state : TrackState
        With all segments refined.
    done : sequence of FinishedSegment
        All segments of the shot.
    observed : ShotKeypoints
    torn : tuple of tuple of int
        See `TrackResult`.
    """
    late = late_views([(one.result.first, one.delays) for one in done], torn)
    return replace(_with_unknown_parts(_joined(shot, state, done, observed), shot), torn=torn, late=late)


def _joined(shot: Shot, state: TrackState, done: Sequence[FinishedSegment], observed: ShotKeypoints) -> TrackResult:
    """Join the results of all segments."""
    performers = shot.performers
    share = np.ones((len(shot.views), shot.length, sum(len(p.body) for p in performers)))
    residual = np.zeros(shot.length)
    for one in done:
        frames = slice(one.result.first, one.result.last + 1)
        share[:, frames], residual[frames] = one.share, one.residual
    errors = []
    eye = shot.views[0].camera.centres_world(0, shot.length) if len(shot.views) == 1 else None
    for i, (performer, motion) in enumerate(zip(performers, state.motions, strict=True)):
        own = observed.performers[i] if observed.performers else None
        beside = body_covariances(performer, motion, shot.fps, own, eye)
        uncertainties = [one.uncertainties[i] for one in done]
        errors.append(joint_errors(performer.body, uncertainties, beside, one_view=eye is not None and own is None))
    return TrackResult(
        motions=tuple(handed_out(shot, state, i) for i in range(len(performers))),
        seconds={},
        camera_frames=len(shot.views) * shot.length,
        segments=tuple(one.result for one in done),
        visible=tuple(share[..., own] for own in slices_of(len(performer.body) for performer in performers)),
        residual=tuple(residual for _ in performers),
        errors=tuple(errors),
        unknown=tuple(performer.unknown for performer in performers),
        observed=observed,
        planted=tuple(_planted(shot, motion, done, i) for i, motion in enumerate(state.motions)),
        footage_offset=state.footage_offset(shot),
    )


def handed_out(shot: Shot, state: TrackState, number: int) -> Motion:
    """Return a performer's motion as it is handed out: with exactly the key poses, and with likely rolls of its limbs.

    The relaxation's motion stays as in paper 1. Where poses beside the shot are known, its ends stay as the solver has
    joined them to these: rolls there do not know what those poses were rolled by.
    """
    performer = shot.performers[number]
    exact = with_keys(state.motions[number], performer.key_poses)
    if solver_named(shot.settings.solver).refine is None:
        return exact
    beside = zip((0, shot.length - 1), state.around, strict=True)
    ends = sorted({frame for frame, poses in beside if poses is not None})
    tied = _tied_parts(shot, performer)
    return with_likely_rolls(performer.body, exact, performer.key_poses, shot.fps, tied=tied, ends=ends)


def _tied_parts(shot: Shot, performer: Performer) -> Bools:
    """Return on which frames each part of a performer must not be rolled, (F, P): it holds a prop, or it rests on its
    parent, or another part does so on it, which would not be rolled with it.
    """
    body = performer.body
    tied = np.zeros((shot.length, len(body)), bool)
    for part in resting_parts(body, performer.unknown):
        tied[:, [part, body.parents[part]]] = True
    for hold in shot.holds:
        if hold.holder == performer.name:
            tied[max(hold.frames[0], 0) : hold.frames[1] + 1, body.index(hold.part)] = True
    return tied


def _planted(shot: Shot, motion: Motion, done: Sequence[FinishedSegment], performer: int) -> Bools | None:
    """Return when points of a performer's soles stood, see `Soles.standing`: segments hold those that stand or roll."""
    body, held = shot.performers[performer].body, None
    for one in done:
        if (own := one.planted[performer]) is not None:
            held = np.zeros((shot.length, own.shape[1]), bool) if held is None else held
            held[one.result.first : one.result.last + 1] |= own
    soles = Soles.of(body)
    return held if held is None or soles is None else soles.standing(held, part_poses(body, motion), shot.fps)


def _with_unknown_parts(tracked: TrackResult, shot: Shot) -> TrackResult:
    """Mark unknown parts in a result: no view sees them, and they may be anywhere within reach."""
    unknown, seen, errors = [], [], []
    for i, performer in enumerate(shot.performers):
        visible = tracked.visible[i].copy()
        visible[..., np.isin(performer.body.names, performer.unknown)] = 0.0
        unknown.append(_unknown_parts(performer, visible, tracked.observed, i))
        seen.append(visible)
        errors.append(tracked.errors[i].with_reach(unknown_reach(performer.body, unknown[-1])))
    return replace(tracked, unknown=tuple(unknown), visible=tuple(seen), errors=tuple(errors))


def _unknown_parts(performer: Performer, visible: Array, observed: ShotKeypoints, number: int) -> tuple[str, ...]:
    """Return the parts that rest, and those that no picture, key pose or keypoint shows on any frame."""
    body, keys = performer.body, performer.key_poses
    keyed = keys.fixed_axes.any(axis=(0, 2))
    hidden = unseen(visible).all(axis=0) & ~keyed
    if observed.performers:
        hidden &= np.isin(
            body.names, unshown_parts(body, found_landmarks(observed.performers[number].factor.keypoints))
        )
    resting = np.isin(body.names, performer.unknown)
    return tuple(name for name, is_unknown in zip(body.names, hidden | resting, strict=True) if is_unknown)
