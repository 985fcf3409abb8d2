"""The quality of solved cameras, in numbers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..capture.capture import Markers
from ..numerics.arrays import Array
from .solving.ball_observations import BallObservations
from .solving.camera_rig import CAMERA_DOF, CENTRE, DRIFT, FOCAL, K1, K2, OFFSET, SHIFT, Rig
from .solving.wand_tracks import picked, sampled
from .solving.wand_triangulation import rays, triangulated
from .wand_matching import matched

if TYPE_CHECKING:
    from .calibration_result import CalibrationResult


_QUANTILES = (0.05, 0.5, 0.95)  # of what is near, in the middle and far
_BLOCK_BALLS = 40
"""Number of consecutive balls by which it is tested whether a camera was moved."""
_SIGNIFICANT_SIGMAS = 8.0  # standard deviations
_MIN_SHIFT = 1.5
"""Shift, in standard deviations of a ball, from which a camera is reported as moved."""
_EDGE = 0.9
"""Share of the used balls that are nearer to the middle of the picture than what is at its edges."""
_MAX_DISTANCE = 100.0
"""Distance from its expected position within which a ball may still be the wand's, pixels."""


def measured_lengths(rig: Rig, seen: BallObservations, frames: NDArray[np.int64]) -> Array:
    """Return lengths of the wand, shape (n,), metres, between independently triangulated ends, where both are seen."""
    points, sigma = np.full((len(rig), len(frames), 2, 2), np.nan), np.ones((len(rig), len(frames), 2))
    for c in range(len(rig)):
        own = seen.take(seen.camera == c)
        if len(own):
            points[c], sigma[c] = _at(_track(own), rig.rate[c] * (1 + rig.drift[c]) * frames + rig.offset[c])
    directions, centres = rays(rig, points), rig.centres_world
    ends = triangulated(centres, directions)
    distance = np.linalg.norm(ends - centres[:, None, None], axis=-1)
    weight = (rig.focal.mean(axis=1)[:, None, None] / (distance * sigma)) ** 2
    ends = triangulated(centres, directions, np.nan_to_num(weight))
    lengths = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    return np.asarray(lengths[np.isfinite(lengths)])


def _track(seen: BallObservations) -> Markers:
    """Return one camera's balls as markers."""
    frames, row = np.unique(seen.frame.astype(np.int64), return_inverse=True)
    points, sigma = np.full((len(frames), 2, 2), np.nan), np.full((len(frames), 2), np.nan)
    points[row, seen.ball], sigma[row, seen.ball] = seen.uv, seen.sigma
    return Markers(frames, points, sigma)


def _at(track: Markers, frames: Array) -> tuple[Array, Array]:
    """Return balls and their sigma at frames, interpolated unless the frames are integers."""
    whole = np.round(frames).astype(np.int64)
    return picked(track, whole) if np.abs(frames - whole).max(initial=0.0) < 1e-6 else sampled(track, frames)


def depths(solution: CalibrationResult) -> Array:
    """Return the depths (`_QUANTILES`) of the wand's balls in each camera, shape (C, 3), metres."""
    rig, out = solution.rig, np.full((len(solution.rig), 3), np.nan)
    for c in range(len(rig)):
        points = seen_points(solution, c)
        if len(points):
            out[c] = np.quantile(points @ rig.R_cam_world[c, 2] + rig.t_cam_world[c, 2], _QUANTILES)
    return out


def _state(solution: CalibrationResult) -> NDArray[np.int64]:
    """Return for each observed ball the index of the wand's nearest frame."""
    frames, seen = solution.wand.frames, solution.seen
    times = np.floor(solution.rig.times(seen.camera, seen.frame) + 0.5)
    return np.asarray(np.clip(np.searchsorted(frames, times), 0, len(frames) - 1))


def seen_points(solution: CalibrationResult, c: int) -> Array:
    """Return the wand's balls that a camera sees, world frame, metres, shape (n, 3)."""
    own = solution.seen.camera == c
    return np.asarray(solution.wand.ends_world[_state(solution)[own], solution.seen.ball[own]])


def thickness(points: Array) -> float:
    """Return the ratio of thickness to width of a cloud of points (n, 3)."""
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return float(spread[2] / spread[0])


def coverage(solution: CalibrationResult) -> Array:
    """Return the fraction of each picture within the convex hull of the wand's balls, shape (C,)."""
    out = np.zeros(len(solution.rig))
    for c, size in enumerate(solution.rig.sizes):
        uv = solution.seen.uv[solution.seen.camera == c]
        if len(uv) > 2:
            out[c] = cv2.contourArea(cv2.convexHull(uv.astype(np.float32))) / float(size[0] * size[1])
    return out


@dataclass(frozen=True)
class PathError:
    """By how many pixels the wand is shifted in a camera's picture, on which frames (first and last), and whether only
    far from the picture's middle.
    """

    pixels: float
    first: int
    last: int
    at_edges: bool


def path_error(solution: CalibrationResult, c: int) -> PathError | None:
    """Return the error of the wand's path in a camera's picture, None if it is not significant.

    All balls near the wand's are considered, used or not: the median of many consecutive ones is hardly affected by
    noise.
    """
    markers, rig = solution.capture.views[c].wand, solution.rig
    near = matched(solution.scene, c, markers, np.full((len(markers), 2), _MAX_DISTANCE))
    count = len(near.row) // _BLOCK_BALLS
    if count == 0:
        return None
    sigma = float(np.nanmedian(markers.sigma)) * max(solution.noise, 1.0)
    least = max(_MIN_SHIFT, _SIGNIFICANT_SIGMAS * 1.25 / np.sqrt(_BLOCK_BALLS)) * sigma
    sizes = [float(np.linalg.norm(np.median(aside, axis=0))) for aside in np.array_split(near.aside, count)]
    bad = [k for k, size in enumerate(sizes) if size > least]
    if not bad:
        return None
    frames = np.array_split(markers.frames[near.row], count)
    radii = np.array_split(np.linalg.norm(markers.points[near.row, near.ball] - rig.centre[c], axis=-1), count)
    used = np.linalg.norm(solution.seen.uv[solution.seen.camera == c] - rig.centre[c], axis=-1)
    at_edges = min(np.median(radii[k]) for k in bad) > np.quantile(used, _EDGE)
    return PathError(max(sizes), int(frames[bad[0]][0]), int(frames[bad[-1]][-1]), bool(at_edges))


def quality_numbers(solution: CalibrationResult) -> dict[str, Any]:
    """Return the numbers of the report as plain values for JSON, in pixels, metres and frames; sigma is a standard
    deviation.
    """
    lengths = measured_lengths(solution.rig, solution.seen, solution.wand.frames)
    return {
        "cameras": [_camera(solution, c) for c in range(len(solution.rig))],
        "wand": {
            "length": solution.wand.length,
            "frames": len(solution.wand),
            "measured": _lengths(lengths, solution.wand.length),
            "held_out": _lengths(solution.held_out, solution.wand.length),
        },
        "lframe": {"scale": _number(solution.lframe_scale), "reprojection": _pixels(_lframe_residual(solution))},
        "noise": _number(solution.noise),
        "findings": [vars(finding) for finding in solution.findings],
    }


def _lframe_residual(solution: CalibrationResult) -> Array:
    return solution.residual[len(solution.seen) :]


def _camera(solution: CalibrationResult, c: int) -> dict[str, Any]:
    rig, sigma, free = solution.rig, solution.sigma[c], solution.free[c]
    own = solution.residual[: len(solution.seen)][solution.seen.camera == c]

    def known(index: int) -> float | None:
        """Return a standard deviation, None for unknowns that were not solved for."""
        return _number(sigma[index]) if free[index] else None

    near, middle, far = depths(solution)[c]
    own_unknowns = slice(CAMERA_DOF * c, CAMERA_DOF * (c + 1))
    shift = solution.covariance[own_unknowns, own_unknowns][SHIFT, SHIFT]
    return {
        "camera": rig.names[c],
        "size": [int(n) for n in rig.sizes[c]],
        "balls": len(own),
        "used": _number(solution.used[c]),
        "reprojection": _pixels(own),
        "coverage": _number(coverage(solution)[c]),
        "depth": {"near": _number(near), "middle": _number(middle), "far": _number(far)},
        "focal": _number(rig.focal[c].mean()),
        "focal_sigma": _number(sigma[FOCAL] * rig.focal[c].mean()) if free[FOCAL] else None,
        "centre": [_number(x) for x in rig.centre[c]],
        "centre_sigma": [known(i) for i in range(CENTRE.start, CENTRE.stop)],
        "k1": _number(rig.distortions[c, 0]),
        "k1_sigma": known(K1),
        "k2": _number(rig.distortions[c, 1]),
        "k2_sigma": known(K2),
        "position": [_number(x) for x in rig.centres_world[c]],
        "position_sigma": _number(np.sqrt(np.trace(shift))),
        "offset": _number(rig.offset[c]),
        "offset_sigma": known(OFFSET),
        "drift": _number(rig.drift[c]),
        "drift_sigma": known(DRIFT),
    }


def _pixels(residual: Array) -> dict[str, float | None]:
    """Return the root mean square of both coordinates, and the median and 95 % quantile of the distances."""
    if not len(residual):
        return {"rms": None, "median": None, "most": None}
    off = np.linalg.norm(residual, axis=1)
    return {
        "rms": _number(np.sqrt(np.mean(residual**2))),
        "median": _number(np.median(off)),
        "most": _number(np.quantile(off, 0.95)),
    }


def _lengths(lengths: Array, length: float) -> dict[str, Any]:
    """Return mean, standard deviation, and root mean square error of measured lengths."""
    if not len(lengths):
        return {"count": 0, "mean": None, "spread": None, "error": None}
    return {
        "count": len(lengths),
        "mean": _number(lengths.mean()),
        "spread": _number(lengths.std()),
        "error": _number(np.sqrt(np.mean((lengths - length) ** 2))),
    }


def _number(value: Any) -> float | None:
    """Return a plain number for JSON, None if it is not finite."""
    return float(value) if np.isfinite(value) else None
