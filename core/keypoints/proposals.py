"""Performers whose body and key poses come from keypoints alone: proposals that the animator can then change."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..body.motion import Motion
from ..errors import KeypointError, located
from ..numerics.arrays import Array
from ..runtime.progress import Progress, report_progress
from ..shot.acceleration_prior import acceleration_precision
from ..shot.detections import Detections
from ..shot.fixed_degrees import fixed_degrees
from ..shot.performer_request import PerformerRequest
from ..shot.shot import KeyPoses, Performer, Shot
from .association.assignment import Identity
from .keypoint_motion.first_pass import first_pass, scaled_first_pass
from .keypoint_motion.keypoint_fit import KeypointFit
from .observations import correlated_frames, identified_keypoints, performer_keypoints
from .seen_landmarks import unseen_parts

KEY_INTERVAL = 0.6
"""Seconds between proposed key poses, about."""


def propose_performers(
    shot: Shot, detections: Sequence[Detections], requests: Sequence[PerformerRequest | None]
) -> tuple[Performer, ...]:
    """Make the requested performers from keypoints: their bodies, and proposed key poses.

    Parameters
    ----------
    shot : Shot
        The requested performers stand in it as `PerformerRequest.placeholder`.
    detections : sequence of Detections
        Per view.
    requests : sequence of PerformerRequest or None
        One per performer of the shot; None for performers that exist already.

    Returns
    -------
    tuple of Performer
        All performers of the shot.

    Raises
    ------
    KeypointError
        The keypoints do not show a performer well enough.
    """
    performers = []
    found = performer_keypoints(shot, detections)
    for performer, request, keypoints in zip(shot.performers, requests, found, strict=True):
        if request is None:
            performers.append(performer)
            continue
        precision = acceleration_precision(performer.body, shot.fps, shot.settings)
        with located(f"performer '{request.name}'"):
            if not keypoints.confidence.any():
                raise KeypointError("no keypoints are left for it", todo="there may be fewer people than performers")
            correlated = correlated_frames(shot.settings, shot.fps)
            fit = scaled_first_pass(
                keypoints, fps=shot.fps, precision=precision, correlated=correlated, height=request.height
            )
        frames = chosen_frames(fit, shot.fps) if request.frames is None else np.array(sorted(request.frames), np.int64)
        keys = KeyPoses.proposed(frames, fit.motion[frames])
        unknown = unseen_parts(fit.body, keypoints)
        performers.append(Performer(request.name, fit.body, keys, request.person, unknown, given_height=request.height))
    return tuple(performers)


@dataclass(frozen=True, eq=False)
class KeypointPoses:
    """The motion of one performer by its keypoints, and frames for key poses.

    Attributes
    ----------
    motion : Motion
        F poses; existing key poses are kept.
    frames : ndarray of int, shape (K,)
        Shot frames for key poses, as requested or as chosen.
    identity : Identity
        Which of the detected people the performer is.
    """

    motion: Motion
    frames: NDArray[np.int64]
    identity: Identity

    def key_poses(self) -> KeyPoses:
        """Return the poses on these frames as proposals, which hold no degree of freedom."""
        return KeyPoses.proposed(self.frames, self.motion[self.frames])


def poses_from_keypoints(
    shot: Shot,
    detections: Sequence[Detections],
    frames: Sequence[int] | None,
    progress: Progress | None,
) -> tuple[KeypointPoses, ...]:
    """Fit the motion of every performer of a shot to keypoints; bodies and key poses stay as they are.

    Parameters
    ----------
    shot : Shot
    detections : sequence of Detections
        Per view.
    frames : sequence of int or None
        Shot frames for the poses. With None they are chosen, at some distance from existing key poses.
    progress : callable or None

    Raises
    ------
    KeypointError
        The keypoints do not show a performer well enough.
    CancelledError
        `progress` returned False.
    """
    found = []
    owned, identities = identified_keypoints(shot, detections)
    for i, (performer, keypoints) in enumerate(zip(shot.performers, owned, strict=True)):
        report_progress(progress, performer.name, i / len(owned))
        body, keys = performer.body, performer.key_poses
        with located(f"performer '{performer.name}'"):
            if not keypoints.confidence.any():
                raise KeypointError("it has no keypoints", todo="give the views keypoints that show it")
            fit = first_pass(
                body,
                keys,
                keypoints,
                fixed=fixed_degrees(performer, 0, shot.length - 1),
                precision=acceleration_precision(body, shot.fps, shot.settings),
                fps=shot.fps,
                correlated=correlated_frames(shot.settings, shot.fps),
            )
        if frames is None:
            chosen = away_from_keys(chosen_frames(fit, shot.fps), keys.frames, shot.fps)
        else:
            chosen = np.array(sorted(set(frames)), np.int64)
        found.append(KeypointPoses(fit.motion, chosen, identities[i]))
    return tuple(found)


def away_from_keys(chosen: NDArray[np.int64], keys: NDArray[np.int64], fps: float) -> NDArray[np.int64]:
    """Return those of the chosen frames (n,) that are not near one of the key frames (K,)."""
    apart = KEY_INTERVAL * fps / 2
    return np.array([f for f in chosen if not len(keys) or abs(keys - f).min() > apart], np.int64)


def chosen_frames(fit: KeypointFit, fps: float) -> NDArray[np.int64]:
    """Return, for every interval of `KEY_INTERVAL` seconds, the frame in its middle half that keypoints show best."""
    return best_frames(seen_quality(fit), fps)


def best_frames(quality: Array, fps: float) -> NDArray[np.int64]:
    """Return, for every interval of `KEY_INTERVAL` seconds, the frame in its middle half with the highest quality
    (F,).
    """
    if not len(quality):
        return np.zeros(0, np.int64)
    count = max(1, round(len(quality) / (KEY_INTERVAL * fps)))
    edges = np.linspace(0, len(quality), count + 1)
    frames = []
    for start, stop in pairwise(edges):
        quarter = (stop - start) / 4
        middle = np.arange(int(start + quarter), max(int(start + quarter) + 1, round(stop - quarter)))
        frames.append(middle[np.argmax(quality[middle])])
    return np.array(frames, np.int64)


def seen_quality(fit: KeypointFit) -> Array:
    """Return the share of keypoints on which at least two views agree with the motion, 0 to 1, shape (F,)."""
    two_best = np.sort(fit.weights, axis=0)[-2:]
    return np.asarray(two_best.sum(axis=0).mean(axis=-1) / 2)
