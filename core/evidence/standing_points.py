"""Whether the pictures show that a point of a performer stands still.

A tracked point that seems to stand drifts by a centimetre or two, as the evidence is not exact, and so does one that
creeps. The pictures tell them apart: what is around a standing point stays the same from the first frame to the last.
They are compared with their median over the frames, at the point's mean place, and again along its path. Neither
depends on the shape of the body, as no outline is looked for.
"""

from __future__ import annotations

import numpy as np

from ..numerics.arrays import Array
from .view_frames import GradientImages, ViewFrames

RADIUS = 0.025
"""Radius of the surroundings of the point that are compared, metres."""
MIN_RADIUS = 2.5
"""The same at least, pixels."""
SMOOTHING = 1.0
"""Standard deviation of the Gaussian that smooths the pictures, pixels: between pixels they are interpolated."""
PIXELS_PER_OBSERVATION = 4 * np.pi * SMOOTHING**2
"""Number of pixels that have one observation's worth of independent noise, after smoothing."""
MIN_NOISE = 1.0 / 255
"""Least standard deviation of the noise of brightness, from 0 to 1."""
OUTLIER_SCALE = 3.0
"""Residual, in standard deviations, at which its influence begins to fade (Geman-McClure): shadows and limbs pass."""


def log_odds_of_standing(view: ViewFrames, first: int, path: Array) -> float:
    """Return the logarithm of how much likelier a view's pictures are if a point stands than if it moves.

    Parameters
    ----------
    view : ViewFrames
    first : int
        Shot frame of the first place. The view's delay does not matter to a point that moves this slowly.
    path : ndarray, shape (F, 3)
        The point's places on consecutive frames, as they are if it moves, world frame, metres. If it stands, it is at
        their mean.

    Returns
    -------
    float
        Zero where the view does not show the point.
    """
    start = first - view.first
    sound = view.sound(first, len(path))[0]
    path, frames = path[sound], first + np.flatnonzero(sound)
    if len(frames) < 2:
        return 0.0
    middle = path.mean(axis=0)
    stands, moves = (
        np.concatenate([view.camera.project(place[None], f) for place, f in zip(places, frames.tolist(), strict=True)])
        for places in (np.broadcast_to(middle, path.shape), path)
    )
    if not (np.isfinite(stands).all() and np.isfinite(moves).all()):
        return 0.0
    radius = max(RADIUS * view.pixels_per_metre(middle, first), MIN_RADIUS)
    half = int(np.ceil(radius))
    across = np.arange(-half, half + 1)
    around = np.stack(np.meshgrid(across, across), axis=-1).reshape(-1, 2)
    around = around[np.hypot(*around.T) <= radius]
    margin = half + int(np.ceil(4 * SMOOTHING)) + 1
    low = np.floor(np.minimum(stands, moves).min(axis=0)).astype(int) - margin
    high = np.ceil(np.maximum(stands, moves).max(axis=0)).astype(int) + margin + 1
    height, width = view.grey.shape[1:]
    if (low < 0).any() or high[0] > width or high[1] > height:
        return 0.0
    shown = view.grey[start : start + len(sound), low[1] : high[1], low[0] : high[0]][sound]
    images = GradientImages.of(shown, SMOOTHING, (int(low[0]), int(low[1])))
    still, moving = (_squared_changes(images, places[:, None] + around) for places in (stands, moves))
    noise = max(min(np.median(each.mean(axis=1)) for each in (still, moving)), MIN_NOISE**2)
    return float(np.sum(_costs(moving / noise) - _costs(still / noise))) / (2 * PIXELS_PER_OBSERVATION)


def _squared_changes(images: GradientImages, pixels: Array) -> Array:
    """Squared differences of brightness from its median over the frames, at pixels of shape (F, K, 2); shape (F, K)."""
    F, K, _ = pixels.shape
    frame = np.repeat(np.arange(F), K)
    brightness = images.sample(frame, pixels.reshape(-1, 2).astype(np.float32))[0].reshape(F, K).astype(float)
    return np.asarray((brightness - np.median(brightness, axis=0)) ** 2 * F / (F - 1))


def _costs(squared: Array) -> Array:
    return np.asarray(OUTLIER_SCALE**2 * squared / (OUTLIER_SCALE**2 + squared))
