"""When a foot stands on the ground: plants of points of the sole, from their motion alone.

A point of the sole is either planted or swinging. While it is planted, its speed is noise and its height that of the
floor; while it swings, both are those of a step. The typical speeds and heights of both states are estimated from the
motion itself (expectation maximisation of a two-state model), and Viterbi's algorithm finds the most likely sequence of
states.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..numerics.arrays import Array, Bools
from ..numerics.frame_ranges import runs

_MEAN_DWELL = 0.25  # seconds: mean time in a state that transitions are as likely as
MIN_DURATION = 0.08
"""Shorter plants and swings are noise, seconds."""
_ITERATIONS = 12
# In legs, and legs per second: bounds of what is estimated.
_SPEED_PLANTED, _SPEED_SWINGING = (0.015, 0.2), (0.6, 4.0)
_HEIGHT_PLANTED, _HEIGHT_SWINGING = (0.008, 0.04), 0.12
_MEDIAN_LENGTH = 1.5382  # of a vector of three normal components; slow parts of steps do not shift the median much
_STILL_RATIO = 3.0  # times the typical speed of planted points: the largest speed of points that stand still
_MAX_HEIGHT_COST = 4.0  # limit of what height contributes against a plant: steps and stairs are above the floor


@dataclass(frozen=True, eq=False)
class Plants:
    """When points of a foot are planted, and on what floor.

    Attributes
    ----------
    planted : ndarray of bool, shape (F, C)
    floor : float
        Height of the floor at these points while they are planted, in the unit of the points.
    speed : float
        Typical speed of a planted point, in that unit per second: the motion's own noise.
    """

    planted: Bools
    floor: float
    speed: float


def find_plants(points: Array, fps: float, leg: float, sigma: Array | None = None, *, by_height: bool = True) -> Plants:
    """Find when points of one sole stand still on the ground.

    Parameters
    ----------
    points : ndarray, shape (F, C, 3)
        World positions of heel and ball, or of other points of the sole, Z up.
    fps : float
        Frames per second.
    leg : float
        Length of the leg in the same unit: speeds and heights are measured in it.
    sigma : ndarray, shape (F, C), optional
        Standard deviation of each point's position. Frames on which it is larger than the median have less influence;
        the median itself is part of the noise that is estimated from the motion.
    by_height : bool
        Whether planted points are all at one height. If not, they may be anywhere, like hands on tables and walls.

    Returns
    -------
    Plants
        Without some of the first and last frames of plants, see `with_ends`.
    """
    if len(points) < 3:
        return Plants(np.zeros(points.shape[:2], bool), float(points[..., 2].min(initial=0.0)), 0.0)
    x = points / leg
    speed = np.linalg.norm(np.gradient(x, axis=0), axis=2) * fps
    doubt = np.zeros(speed.shape) if sigma is None else _excess_sigma(sigma / leg)
    height = x[..., 2] if by_height else np.zeros(speed.shape)
    sizes = _Sizes(0.05, 1.2, 0.02, float(np.quantile(height, 0.05)))
    for _ in range(_ITERATIONS):
        weight = 1 / (1 + np.exp(-np.clip(_log_ratios(speed, height, sizes, doubt, fps), -50, 50)))
        renewed = sizes.renewed(speed, height, weight)
        if np.allclose(renewed.values(), sizes.values(), rtol=1e-3, atol=1e-5):
            break
        sizes = renewed
    gain = _log_ratios(speed, height, sizes, doubt, fps)
    change = np.log(_MEAN_DWELL * fps)
    planted = np.stack([_most_likely(column, change) for column in gain.T], axis=1)
    shortest = round(MIN_DURATION * fps)
    planted = np.stack([without_short(without_short(c, shortest, False), shortest, True) for c in planted.T], axis=1)
    return Plants(planted, sizes.floor * leg, sizes.planted * leg)


def with_ends(planted: Bools, points: Array, speed: float, fps: float) -> Bools:
    """Return plants (F, C) together with the frames before and after, if the points (F, C, 3) hardly move to them.

    Speeds are found across two frames: those of the first and the last frame of a plant are partly of the swing.

    Parameters
    ----------
    speed : float
        Typical speed of a planted point, in the unit of the points per second.
    """
    found = planted.copy()
    near = np.linalg.norm(np.diff(points, axis=0), axis=2) < _STILL_RATIO * speed / fps
    found[:-1] |= planted[1:] & near
    found[1:] |= planted[:-1] & near
    return found


def _excess_sigma(sigma: Array) -> Array:
    """By how much standard deviations exceed their median over the frames, as the deviation of an independent error."""
    return np.asarray(np.sqrt(np.maximum(sigma**2 - np.median(sigma, axis=0) ** 2, 0.0)))


@dataclass(frozen=True)
class _Sizes:
    """Typical speeds and heights of planted and of swinging points, in leg lengths (per second)."""

    planted: float
    swinging: float
    height: float
    floor: float

    def values(self) -> tuple[float, ...]:
        return self.planted, self.swinging, self.height, self.floor

    def renewed(self, speed: Array, height: Array, weight: Array) -> _Sizes:
        """Return the sizes that explain speeds and heights (F, C) best, each weighted by how likely it is a plant."""
        on, off = weight.sum() + 1e-9, (1 - weight).sum() + 1e-9
        floor = _weighted_median(height.ravel(), weight.ravel()) if on > 1 else self.floor
        near = weight * (np.abs(height - floor) < 3 * _HEIGHT_PLANTED[1])
        return _Sizes(
            float(np.clip(_weighted_median(speed.ravel(), weight.ravel()) / _MEDIAN_LENGTH, *_SPEED_PLANTED)),
            float(np.clip(np.sqrt(((1 - weight) * speed**2).sum() / (3 * off)), *_SPEED_SWINGING)),
            float(np.clip(np.sqrt((near * (height - floor) ** 2).sum() / (near.sum() + 1e-9)), *_HEIGHT_PLANTED)),
            floor,
        )


def _log_ratios(speed: Array, height: Array, sizes: _Sizes, doubt: Array, fps: float) -> Array:
    """Log likelihood ratio of planted to swinging, by frame and point; it is small where `doubt` is large."""
    blur = doubt * fps / np.sqrt(2)  # of a speed from the frame before to the frame after
    a, b = (np.sqrt(size**2 + blur**2) for size in (sizes.planted, sizes.swinging))
    by_speed = 3 * np.log(b / a) - speed**2 / 2 * (1 / a**2 - 1 / b**2)
    narrow = np.sqrt(sizes.height**2 + doubt**2)
    wide = np.sqrt(_HEIGHT_SWINGING**2 + doubt**2)
    by_height = np.log(wide / narrow) - (height - sizes.floor) ** 2 / 2 * (1 / narrow**2 - 1 / wide**2)
    return np.asarray(by_speed + np.maximum(by_height, -_MAX_HEIGHT_COST))


def _weighted_median(values: Array, weights: Array) -> float:
    order = np.argsort(values)
    below = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(below, below[-1] / 2)])


def _most_likely(gain: Array, change: float) -> Bools:
    """Return the most likely sequence of states, if a planted frame gains `gain` (F,) and every change costs
    `change`.
    """
    swinging, standing = 0.0, 0.0
    came = []
    for step in gain.tolist():  # plain numbers: arrays of two would take ten times as long
        to_stand, to_swing = swinging - change, standing - change
        came.append((int(to_swing > swinging), int(to_stand <= standing)))
        swinging, standing = max(swinging, to_swing), max(standing, to_stand) + step
    states = [int(standing > swinging)]
    for before in reversed(came[1:]):
        states.append(before[states[-1]])
    return np.array(states[::-1]) == 1


def without_short(flags: Bools, shortest: int, state: bool) -> Bools:
    """Flip runs of a state that are shorter than a number of frames, except those at either end."""
    kept = flags.copy()
    for a, b in runs(flags == state):
        if b - a + 1 < shortest and a > 0 and b < len(flags) - 1:
            kept[a : b + 1] = not state
    return kept
