"""Where a first solution of the cameras expects the balls in their videos, and how large."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from ..numerics.arrays import Array, Bools
from .calibration_result import CalibrationResult
from .solving.camera_rig import Rig
from .solving.wand_motion import Wand
from .solving.wand_triangulation import projected
from .video_markers import VideoMarkers

_MAX_GAP = 15  # frames: longest gap over which the wand's path is interpolated
_MAX_RADIUS = 5.0
"""Largest radius of a ball that is measured by a model of its image, pixels; for larger ones the outline is as good."""
MIN_WAND_FRAMES = 4
"""Least number of frames with the wand from which its path, or the colours of its balls, are determined."""


@dataclass(frozen=True, eq=False)
class ExpectedBalls:
    """Balls as a solution predicts them in a camera's video.

    Attributes
    ----------
    centres : ndarray, shape (n, m, 2)
        Pixels; NaN where no ball is predicted.
    velocities : ndarray, shape (n, m, 2)
        Pixels per frame.
    radii : ndarray, shape (n, m)
        Pixels.
    places_cam : ndarray, shape (n, m, 3)
        Metres, in the camera's frame.
    """

    centres: Array
    velocities: Array
    radii: Array
    places_cam: Array

    @classmethod
    def of(cls, rig: Rig, c: int, places_world: Array, diameter: float) -> ExpectedBalls:
        """Project points (n, m, 3) of every frame into a camera's video."""
        centres = projected(rig, c, places_world)
        places_cam = places_world @ rig.R_cam_world[c].T + rig.t_cam_world[c]
        depth = places_cam[..., 2]
        with np.errstate(invalid="ignore", divide="ignore"):
            radii = np.where(depth > diameter, rig.focal[c].mean() * diameter / 2 / depth, np.nan)
        steps = np.full((len(centres) + 1, *centres.shape[1:]), np.nan)
        steps[1:-1] = np.diff(centres, axis=0)
        around = np.stack([steps[:-1], steps[1:]])
        velocities = np.nan_to_num(around).sum(axis=0) / np.maximum(np.isfinite(around).sum(axis=0), 1)
        return cls(centres, velocities, radii, places_cam)

    @property
    def small(self) -> Bools:
        """Which balls are small, shape (n, m)."""
        return np.asarray(self.radii < _MAX_RADIUS) & np.isfinite(self.centres).all(axis=-1)

    def rods(self, row: int, ball: int, others: Sequence[int]) -> tuple[Array, Array]:
        """Return the rods from a ball to others, see `BallGuess.rods` and `BallGuess.starts`."""
        ways, starts = [], []
        place = self.places_cam[row, ball]
        for other in others:
            across = self.centres[row, other] - self.centres[row, ball]
            along = self.places_cam[row, other] - place
            nearer = -float(along @ place) / float(np.linalg.norm(along) * np.linalg.norm(place))
            apart = float(np.linalg.norm(across))
            if apart > 2 * self.radii[row, ball]:
                ways.append(across / apart)
                starts.append(np.sqrt(1 - nearer**2) if nearer > 0 else 1.0)
        return np.array(ways).reshape(-1, 2), np.array(starts)


def wand_path(wand: Wand, times: Array) -> Array:
    """Return the wand's ends at some times, shape (n, 2, 3); NaN in longer gaps."""
    ends = np.full((len(times), 2, 3), np.nan)
    if len(wand) < MIN_WAND_FRAMES:
        return ends
    after = np.clip(np.searchsorted(wand.frames, times), 1, len(wand) - 1)
    known = (times >= wand.frames[0]) & (times <= wand.frames[-1])
    known &= wand.frames[after] - wand.frames[after - 1] <= _MAX_GAP
    middle, direction = (CubicSpline(wand.frames, x)(times[known]) for x in (wand.middle, wand.direction))
    half = wand.length / 2 * direction / np.linalg.norm(direction, axis=1, keepdims=True)
    ends[known] = np.stack([middle + half, middle - half], axis=1)
    return ends


def ball_diameter(found: VideoMarkers, solution: CalibrationResult, given: float | None, *, wand: bool) -> float:
    """Return the balls' diameter in metres, as given or else estimated from their size in the pictures."""
    if given is not None:
        return given
    shares = []
    for c, view in enumerate(found.views):
        balls = view.wand if wand else view.lframe
        times = solution.rig.times(np.full(len(balls.markers), c), balls.markers.frames.astype(float))
        places = wand_path(solution.wand, times) if wand else solution.lframe_world[None]
        expected = ExpectedBalls.of(solution.rig, c, np.broadcast_to(places, (len(times), *places.shape[1:])), 1.0)
        shares.append((balls.radii / expected.radii).ravel())
    sizes = np.concatenate(shares)
    return float(np.nanmedian(sizes)) if np.isfinite(sizes).any() else np.nan
