"""The keypoints of a shot: detections without lens distortion, assigned to the performers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from ..body import part_poses
from ..body.motion import Motion
from ..cameras.camera import Camera
from ..numerics.arrays import Array
from ..shot.acceleration_prior import acceleration_precision, variances_from_key_poses
from ..shot.detections import Detections
from ..shot.frame_numbers import footage_delay, shot_frames
from ..shot.keypose_spline import spline
from ..shot.settings import Settings
from ..shot.shot import Performer, Shot, View
from .association.assignment import NOT_LOOKED_FOR, Identity, PerformerClues, assign_detections
from .association.tracks import ViewDetections
from .keypoint_factor import KeypointFactor
from .keypoint_motion.first_pass import first_pass
from .keypoint_offsets import KeypointOffsets, has_keypoint
from .keypoint_rays import Keypoints
from .seen_landmarks import habit_precision, usual_turns, with_usual_confidence, without_guesses


def image_rays(camera: Camera, pixels: Array) -> Array:
    """Normalized image coordinates (x / z, y / z) of distorted pixels, shape (..., 2); NaN stays NaN."""
    known = np.isfinite(pixels).all(axis=-1)
    out = np.full(pixels.shape, np.nan)
    if known.any():
        undistort = cv2.fisheye.undistortPoints if camera.fisheye else cv2.undistortPoints
        out[known] = undistort(pixels[known][:, None], camera.matrix, camera.distortions)[:, 0]
    return out


@dataclass(frozen=True, eq=False)
class PerformerKeypoints:
    """The keypoints of one performer over a whole shot, and the motion fitted to them.

    Attributes
    ----------
    motion : Motion
        F poses, from keypoints and key poses alone.
    factor : KeypointFactor
        The same keypoints as evidence.
    changed : ndarray of bool, shape (V, F, L)
        Where left and right were exchanged.
    weights : ndarray, shape (V, F, L)
        Robust weight of each keypoint beside the motion times its confidence, 0 to 1.
    typical_variances : ndarray, shape (G,)
        Typical variances of accelerations, see `core.body.smoothness_estimate`.
    identity : Identity
        Which of the detected people the performer is.
    """

    motion: Motion
    factor: KeypointFactor
    changed: NDArray[np.bool_]
    weights: Array
    typical_variances: Array
    identity: Identity

    @property
    def is_lifted(self) -> bool:
        """Whether a single view shows the performer, so that depths follow from the lengths of its bones."""
        return self.factor.imagined is not None

    def agreements(self) -> list[float | None]:
        """Return which share of each view's keypoints agrees with the other views and the motion, 0 to 1; None if there
        are none.
        """
        found = zip(self.weights, self.factor.keypoints.confidence, strict=True)
        return [float(weights.sum() / confidence.sum()) if confidence.any() else None for weights, confidence in found]

    def of_views(self, views: list[int]) -> PerformerKeypoints:
        """Return the same of some views, in that order."""
        return replace(
            self, factor=self.factor.of_views(views), changed=self.changed[views], weights=self.weights[views]
        )


@dataclass(frozen=True, eq=False)
class ShotKeypoints:
    """The keypoints of a shot.

    Attributes
    ----------
    performers : tuple of PerformerKeypoints
    skipped : tuple of tuple of str
        Per view: the files that could not be read, each with the reason.
    frames_off : tuple of float or None
        Per view: see `core.keypoints.keypoint_delay.frames_off`; empty before pictures were read.
    """

    performers: tuple[PerformerKeypoints, ...] = ()
    skipped: tuple[tuple[str, ...], ...] = ()
    frames_off: tuple[float | None, ...] = ()

    def of_views(self, views: Sequence[int]) -> ShotKeypoints:
        """Return the same of some views, in that order."""
        order = list(views)
        if not self.performers:
            return self
        return ShotKeypoints(
            tuple(p.of_views(order) for p in self.performers),
            tuple(self.skipped[v] for v in order),
            tuple(self.frames_off[v] for v in order) if self.frames_off else (),
        )


def fit_keypoints(shot: Shot, detections: Sequence[Detections], fixed: Sequence[NDArray[np.bool_]]) -> ShotKeypoints:
    """Assign the detections of a shot to its performers, and fit a motion to the keypoints of each.

    Parameters
    ----------
    shot : Shot
    detections : sequence of Detections
        Per view; see `core.formats.keypoint_files.read_shot_keypoints`.
    fixed : sequence of ndarray of bool, shape (F, D)
        Per performer: the degrees of freedom that are held.

    Raises
    ------
    KeypointError
        The keypoints are too few to start from.
    """
    found, identities = identified_keypoints(shot, detections)
    performers = []
    for performer, held, keypoints, identity in zip(shot.performers, fixed, found, identities, strict=True):
        body, correlated = performer.body, correlated_frames(shot.settings, shot.fps)
        if not keypoints.names:
            performers.append(_unseen(shot, performer, keypoints, identity))
            continue
        precision = acceleration_precision(body, shot.fps, shot.settings)
        fit = first_pass(
            body,
            performer.key_poses,
            keypoints,
            fixed=held,
            precision=precision,
            fps=shot.fps,
            correlated=correlated,
        )
        if fit.agreed is None:
            factor = KeypointFactor(fit.keypoints, fit.places, correlated, imagined=fit.imagined)
        else:
            # Errors that last over many frames shift the constants (offsets and measures), but the first pass has
            # settled these. They give no reason to doubt a movement that views agree on, so every frame counts in full.
            factor = KeypointFactor(fit.keypoints, fit.places, 1.0, fit.sigma, fit.agreed)
        habit = habit_precision(body, fit.keypoints, shot.fps)
        factor = replace(factor, habit=(habit, usual_turns(fit.motion, habit)))
        performers.append(
            PerformerKeypoints(fit.motion, factor, fit.changed, fit.weights, fit.variances.typical, identity)
        )
    return ShotKeypoints(tuple(performers), tuple(one.skipped for one in detections))


def _unseen(shot: Shot, performer: Performer, keypoints: Keypoints, identity: Identity) -> PerformerKeypoints:
    """Return the keypoints of a performer that no detector looks for, such as a prop or an animal."""
    body, keys = performer.body, performer.key_poses
    factor = KeypointFactor(keypoints, KeypointOffsets.on(body, ()), 1.0, np.zeros((len(shot.views), 0)))
    nothing = np.zeros(keypoints.confidence.shape)
    typical = variances_from_key_poses(body, keys, shot.fps, shot.settings)
    return PerformerKeypoints(spline(keys, shot.length), factor, nothing > 0, nothing, typical, identity)


def correlated_frames(settings: Settings, fps: float) -> float:
    """Return how many neighbouring frames count as one, because a detector has the same error on them."""
    return max(1.0, settings.keypoint_correlation * fps)


def performer_keypoints(shot: Shot, detections: Sequence[Detections]) -> list[Keypoints]:
    """Return the keypoints of every performer of a shot, on its frames."""
    return identified_keypoints(shot, detections)[0]


def identified_keypoints(shot: Shot, detections: Sequence[Detections]) -> tuple[list[Keypoints], list[Identity]]:
    """Return the keypoints of every performer of a shot, on its frames, and which of the detected people each one is.

    Raises
    ------
    KeypointError
        The person chosen for a performer does not exist; see `assign_detections`.
    """
    known_names = dict.fromkeys(name for found in detections for name in found.names)
    shown = [i for i, p in enumerate(shot.performers) if any(has_keypoint(p.body, name) for name in known_names)]
    bodies = [shot.performers[i].body for i in shown]
    names = tuple(name for name in known_names if bodies and all(has_keypoint(body, name) for body in bodies))
    empty = _no_keypoints(shot, names)
    founds = [on_shot_frames(view, found, names, shot) for view, found in zip(shot.views, detections, strict=True)]
    clues = [
        PerformerClues(p.name, _key_places(p, names, shot.length), p.person, not p.key_poses.fixed.any())
        for p in (shot.performers[i] for i in shown)
    ]
    assigned = assign_detections(founds, empty, clues, shot.fps) if names else ([], [])
    delays = [footage_delay(view) for view in shot.views]
    owned = dict(zip(shown if names else (), zip(*assigned, strict=True), strict=True))
    found = [owned.get(i, (_no_keypoints(shot), NOT_LOOKED_FOR)) for i in range(len(shot.performers))]
    own = [without_guesses(with_usual_confidence(on_time(one, delays))) for one, _ in found]
    return own, [identity for _, identity in found]


def _no_keypoints(shot: Shot, names: tuple[str, ...] = ()) -> Keypoints:
    """Return keypoints of some names of which none is found in any view."""
    V, F, L = len(shot.views), shot.length, len(names)
    R, t = (np.stack(all_views) for all_views in zip(*(v.camera.poses(0, F) for v in shot.views), strict=True))
    return Keypoints(names, np.full((V, F, L, 2), np.nan), np.zeros((V, F, L)), R, t)


def on_shot_frames(view: View, detections: Detections, names: Sequence[str], shot: Shot) -> ViewDetections:
    """Return the detections of a view that lie on the shot's frames, reduced to the keypoints of these names."""
    frames = shot_frames(view, detections.frames) - shot.frames[0]
    rows = np.flatnonzero((frames >= 0) & (frames < shot.length))
    rays = np.full((len(rows), len(names), 2), np.nan)
    confidence = np.zeros((len(rows), len(names)))
    columns = [names.index(name) if name in names else -1 for name in detections.names]
    used = [i for i, column in enumerate(columns) if column >= 0]
    kept = [columns[i] for i in used]
    pixels = detections.points[rows][:, used]
    inside = view.camera.shows(pixels)
    # Some detectors guess the rest of a person beyond the edge of the picture, where they see nothing.
    rays[:, kept] = image_rays(view.camera, np.where(inside[..., None], pixels, np.nan))
    if view.camera.zooms is not None:
        rays /= view.camera.zooms[frames[rows], None, None]
    confidence[:, kept] = np.where(inside, detections.confidence[rows][:, used], 0.0)
    return ViewDetections(frames[rows], rays, confidence, detections.tracks[rows])


def _key_places(performer: Performer, names: Sequence[str], frames: int) -> Array:
    """World positions of the keypoints by the performer's key poses, metres, (F, L, 3); NaN on other frames."""
    places = np.full((frames, len(names), 3), np.nan)
    keys, body = performer.key_poses, performer.body
    places[keys.frames] = KeypointOffsets.on(body, names).world(part_poses(body, keys.poses))
    return places


def on_time(keypoints: Keypoints, delays: Sequence[float]) -> Keypoints:
    """Return the keypoints at the shot's instants: views with a delay are interpolated between two of their frames."""
    rays, confidence = keypoints.rays.copy(), keypoints.confidence.copy()
    for v, delay in enumerate(delays):
        if delay:
            near, share = (1 if delay < 0 else -1), abs(delay)
            other, sure = _shifted(rays[v], near, np.nan), _shifted(confidence[v], near, 0.0)
            between = (1 - share) * rays[v] + share * other
            both = np.isfinite(between).all(axis=-1)
            rays[v] = np.where(both[..., None], between, np.nan)
            confidence[v] = np.where(both, np.minimum(confidence[v], sure), 0.0)
    return replace(keypoints, rays=rays, confidence=confidence)


def _shifted(values: Array, frames: int, fill: float) -> Array:
    """Row f is row f + frames (1 or -1) of the values."""
    out = np.roll(values, -frames, axis=0)
    out[-1 if frames > 0 else 0] = fill
    return out
