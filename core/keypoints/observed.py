"""The keypoints of a shot: read, freed of lens distortion, and given to the performers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ..cameras import Camera
from ..evidence.keypoints import Keypoints, carried
from ..formats.keypoints import read_keypoints
from ..motion import Motion
from ..shot import Settings, Shot
from ..solvers.gauss_newton import acceleration_precision
from ..solvers.problem import Pointers
from .first_pass import first_pass

Array = NDArray[np.float64]


def image_rays(camera: Camera, pixels: Array) -> Array:
    """Places in the image at a distance of one, (x / z, y / z), of distorted pixels, shape (..., 2); NaN stays NaN."""
    known = np.isfinite(pixels).all(axis=-1)
    out = np.full(pixels.shape, np.nan)
    if known.any():
        undistort = cv2.fisheye.undistortPoints if camera.fisheye else cv2.undistortPoints
        out[known] = undistort(pixels[known][:, None], camera.matrix, camera.distortions)[:, 0]
    return out


@dataclass(frozen=True, eq=False)
class Sighting:
    """What keypoints say of one performer over a whole shot.

    Attributes
    ----------
    motion : Motion
        F poses, from keypoints and key poses alone.
    pointers : Pointers
        The same keypoints as evidence.
    changed : ndarray of bool, shape (V, F, L)
        Where left and right were changed.
    weights : ndarray, shape (V, F, L)
        0 to 1: how far each keypoint agrees with the motion, times its confidence.
    """

    motion: Motion
    pointers: Pointers
    changed: NDArray[np.bool_]
    weights: Array


def observe_keypoints(shot: Shot, fixed: Sequence[NDArray[np.bool_]]) -> tuple[Sighting, ...]:
    """Read the keypoints of a shot's views, and fit every performer's motion to those that are theirs.

    Parameters
    ----------
    shot : Shot
    fixed : sequence of ndarray of bool, shape (F, D)
        Per performer: the degrees of freedom that are held.

    Raises
    ------
    KeypointError
        Files cannot be read, or do not show enough to begin with.
    """
    found = assigned(shot)
    sightings = []
    for performer, held, keypoints in zip(shot.performers, fixed, found, strict=True):
        body, together = performer.body, frames_together(shot.settings, shot.fps)
        precision = acceleration_precision(body, shot.fps, shot.settings)
        fit = first_pass(body, performer.key_poses, keypoints, held, precision, shot.fps, together)
        pointers = Pointers(fit.keypoints, fit.places, together)
        sightings.append(Sighting(fit.motion, pointers, fit.changed, fit.weights))
    return tuple(sightings)


def frames_together(settings: Settings, fps: float) -> float:
    """How many neighbouring frames' keypoints count as one."""
    return max(1.0, settings.keypoint_correlation * fps)


def assigned(shot: Shot) -> list[Keypoints]:
    read = [load(view, shot.settings) for view in shot.views]
    names = [n for n in dict.fromkeys(n for d in read for n in d.names) if carried(shot.performers[0].body, n)]
    F, L = shot.length, len(names)
    rays, conf, Rs, ts = [], [], [], []
    for view, d in zip(shot.views, read):
        ray, c = np.full((F, L, 2), np.nan), np.zeros((F, L))
        r = image_rays(view.camera, d.points)
        for row, frame in enumerate(d.frames):
            f = int(frame - view.offset - shot.frames[0])
            if 0 <= f < F:
                for i, n in enumerate(d.names):
                    if n in names:
                        ray[f, names.index(n)] = r[row, i]
                        c[f, names.index(n)] = d.confidence[row, i]
        R, t = view.camera.poses(0, F)
        rays.append(ray), conf.append(c), Rs.append(R), ts.append(t)
    return [Keypoints(tuple(names), np.stack(rays), np.stack(conf), np.stack(Rs), np.stack(ts))]

def load(view, settings):
    return read_keypoints(view.keypoints, view.camera.size, settings.broken_keypoints == "skip")
