"""Performers whose body and key poses come from keypoints alone: a first pass that the animator then owns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..body.motion import Motion
from ..errors import KeypointError
from ..formats.toml_tables import named
from ..runtime.progress import Progress, report_progress
from ..shot.acceleration_prior import acceleration_precision
from ..shot.shot import KeyPoses, Performer, PerformerRequest, Shot, fixed_degrees
from .first_pass import first_pass, scaled_first_pass
from .keypoint_fit import KeypointFit
from .observations import assigned, frames_together, read_views

Array = NDArray[np.float64]

EVERY = 0.6
"""Seconds between proposed key poses, about."""


def proposed(shot: Shot, wanted: Sequence[PerformerRequest | None]) -> tuple[Performer, ...]:
    """The performers of a shot, those wanted made from keypoints: body, and proposed key poses.

    Parameters
    ----------
    shot : Shot
        Its performers stand in the places of those wanted as `Wanted.unknown`.
    wanted : sequence of Wanted or None
        One per performer of the shot; None for those that are known already.

    Raises
    ------
    KeypointError
        The keypoints do not show a performer well enough.
    """
    performers = []
    for performer, wish, keypoints in zip(shot.performers, wanted, assigned(shot, read_views(shot)), strict=True):
        if wish is None:
            performers.append(performer)
            continue
        precision = acceleration_precision(performer.body, shot.fps, shot.settings)
        with named(f"performer '{wish.name}'"):
            if not keypoints.confidence.any():
                raise KeypointError("no keypoints are left for it", todo="there may be fewer people than performers")
            together = frames_together(shot.settings, shot.fps)
            fit = scaled_first_pass(keypoints, shot.fps, together, precision, wish.height)
        frames = chosen_frames(fit, shot.fps) if wish.frames is None else np.array(sorted(wish.frames), np.int64)
        performers.append(Performer(wish.name, fit.body, KeyPoses.proposed(frames, fit.motion[frames])))
    return tuple(performers)


@dataclass(frozen=True, eq=False)
class SeenPoses:
    """What keypoints say of one performer of a shot.

    Attributes
    ----------
    motion : Motion
        F poses, held to the key poses that there are.
    frames : ndarray of int, shape (K,)
        Shot frames asked for, or chosen.
    """

    motion: Motion
    frames: NDArray[np.int64]

    def key_poses(self) -> KeyPoses:
        """The poses of these frames; they fix nothing."""
        return KeyPoses.proposed(self.frames, self.motion[self.frames])


def seen_poses(
    shot: Shot, frames: Sequence[int] | None = None, progress: Progress | None = None
) -> tuple[SeenPoses, ...]:
    """Fit the motion of every performer of a shot to keypoints; bodies and key poses stay as they are.

    Parameters
    ----------
    shot : Shot
    frames : sequence of int, optional
        Shot frames on which poses are wanted; by default some are chosen beside the key poses that there are.
    progress : callable, optional

    Raises
    ------
    KeypointError
        The keypoints do not show a performer well enough.
    CancelledError
        `progress` returned False.
    """
    found = []
    report_progress(progress, "keypoints", 0.0)
    owned = assigned(shot, read_views(shot))
    for i, (performer, keypoints) in enumerate(zip(shot.performers, owned, strict=True)):
        report_progress(progress, performer.name, (1 + i) / (1 + len(owned)))
        body, keys = performer.body, performer.key_poses
        with named(f"performer '{performer.name}'"):
            if not keypoints.confidence.any():
                raise KeypointError("no keypoints are its", todo="give the views keypoints that show it")
            fit = first_pass(
                body,
                keys,
                keypoints,
                fixed_degrees(performer, 0, shot.length - 1),
                acceleration_precision(body, shot.fps, shot.settings),
                shot.fps,
                frames_together(shot.settings, shot.fps),
            )
        chosen = beside(chosen_frames(fit, shot.fps), keys.frames, shot.fps) if frames is None else sorted(set(frames))
        found.append(SeenPoses(fit.motion, np.array(chosen, np.int64)))
    return tuple(found)


def with_proposals(shot: Shot) -> Shot:
    """A shot with proposed key poses beside those that it has; these, and the bodies, stay as they are.

    Raises
    ------
    KeypointError
        The keypoints do not show a performer well enough.
    """
    performers = [
        replace(performer, key_poses=performer.key_poses.joined(seen.key_poses()))
        for performer, seen in zip(shot.performers, seen_poses(shot), strict=True)
    ]
    return replace(shot, performers=tuple(performers))


def beside(chosen: NDArray[np.int64], keys: NDArray[np.int64], fps: float) -> NDArray[np.int64]:
    """Those of some frames that are not near a key pose."""
    apart = EVERY * fps / 2
    return np.array([f for f in chosen if not len(keys) or abs(keys - f).min() > apart], np.int64)


def chosen_frames(fit: KeypointFit, fps: float) -> NDArray[np.int64]:
    """Of every stretch of `EVERY` seconds, the frame in its middle half that keypoints show best."""
    return best_frames(seen_quality(fit), fps)


def best_frames(quality: Array, fps: float) -> NDArray[np.int64]:
    """Of every stretch of `EVERY` seconds, the frame in its middle half with the greatest quality (F,)."""
    if not len(quality):
        return np.zeros(0, np.int64)
    count = max(1, round(len(quality) / (EVERY * fps)))
    edges = np.linspace(0, len(quality), count + 1)
    frames = []
    for start, stop in pairwise(edges):
        quarter = (stop - start) / 4
        middle = np.arange(int(start + quarter), max(int(start + quarter) + 1, round(stop - quarter)))
        frames.append(middle[np.argmax(quality[middle])])
    return np.array(frames, np.int64)


def seen_quality(fit: KeypointFit) -> Array:
    """Share of the keypoints that two views or more agree on with the motion, by frame, 0 to 1, shape (F,)."""
    two_best = np.sort(fit.weights, axis=0)[-2:]
    return two_best.sum(axis=0).mean(axis=-1) / 2
