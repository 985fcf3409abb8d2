"""Whether the pictures show that a point of a performer stands still.

A tracked point that seems to stand drifts by a centimetre or two, as the evidence is not exact, and so does one that
creeps. The pictures tell them apart: what is around a standing point stays the same from the first frame to the last.
They are compared with their median over the frames, at the point's mean place, and again along its path. Neither
depends on the shape of the body, as no outline is looked for.

On single frames the tracked motion may be off altogether. Their pictures are compared with those on which the point
stands: there it stands still unless they show it displaced.
"""

from __future__ import annotations

import numpy as np

from ..numerics.arrays import Array, Bools, Ints
from .smoothed_images import SmoothedImages
from .view_frames import ViewFrames

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
    sound = view.sound(first, len(path))[0]
    path, frames = path[sound], first + np.flatnonzero(sound)
    if len(frames) < 2:
        return 0.0
    middle = path.mean(axis=0)
    stands, moves = (_projected(view, places, frames) for places in (np.broadcast_to(middle, path.shape), path))
    radius = max(RADIUS * view.camera.pixels_per_metre(middle, first), MIN_RADIUS)
    images = _pictures(view, frames, np.concatenate([stands, moves]), radius, SMOOTHING)
    if images is None:
        return 0.0
    around = _disc(radius, 1)
    still, moving = (_squared_changes(_sampled(images, places[:, None] + around)) for places in (stands, moves))
    noise = _noise(still, moving)
    return float(np.sum(_costs(moving / noise) - _costs(still / noise))) / (2 * PIXELS_PER_OBSERVATION)


def log_gain_by_displacement(view: ViewFrames, first: int, place: Array, stood: Bools) -> Array:
    """Return how much likelier a view's picture of each frame is if a point that stood has been displaced in it, by
    whatever suits the picture best within the surroundings that are compared, than if it stands there still.

    Unlike `log_odds_of_standing` this does not depend on how the point was tracked.

    Parameters
    ----------
    view : ViewFrames
    first : int
        Shot frame of the first of F consecutive frames.
    place : ndarray, shape (3,)
        Where the point stands, world frame, metres.
    stood : ndarray of bool, shape (F,)
        Frames on which it is known to stand: the others are compared with the median of their pictures.

    Returns
    -------
    ndarray, shape (F,)
        Logarithms, at least 0; 0 where it is known to stand, NaN on other frames on which the view does not show it.
    """
    gains = np.where(stood, 0.0, np.nan)
    shown = np.flatnonzero(view.sound(first, len(stood))[0])
    known = stood[shown]
    if known.sum() < 2:
        return gains
    radius = max(RADIUS * view.camera.pixels_per_metre(place, first), MIN_RADIUS)
    smoothing = max(SMOOTHING, radius / 4)
    pixels = _projected(view, np.broadcast_to(place, (len(shown), 3)), first + shown)
    images = _pictures(view, first + shown, pixels, 2 * radius, smoothing)
    if images is None:
        return gains
    stride = int(smoothing)
    around = _disc(radius, stride)
    brightness = _sampled(images, pixels[:, None] + around)
    usual = np.median(brightness[known], axis=0)
    noise = _noise(_squared_changes(brightness[known]))
    steps = np.arange(-(radius // (smoothing / 2)), radius // (smoothing / 2) + 1) * smoothing / 2
    displacements = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 1, 2)
    for row in np.flatnonzero(~known):
        displaced = _sampled(images, pixels[row] + displacements + around, np.full(len(displacements), row))
        costs = _costs((displaced - usual) ** 2 / noise).sum(axis=1)
        excess = _costs((brightness[row] - usual) ** 2 / noise).sum() - costs.min()
        gains[shown[row]] = max(excess, 0.0) * stride**2 / (8 * np.pi * smoothing**2)
    return gains


def _projected(view: ViewFrames, places: Array, frames: Ints) -> Array:
    """Places (F, 3) in a view's pictures of these frames, pixels (F, 2)."""
    if not view.camera.moving:
        return view.camera.project(places)
    pairs = zip(places, frames.tolist(), strict=True)
    return np.concatenate([view.camera.project(place[None], frame) for place, frame in pairs])


def _disc(radius: float, stride: int) -> Array:
    """Pixels within a radius, as offsets (K, 2)."""
    across = np.arange(-int(np.ceil(radius)), int(np.ceil(radius)) + 1, stride)
    around = np.stack(np.meshgrid(across, across), axis=-1).reshape(-1, 2)
    return np.asarray(around[np.hypot(*around.T) <= radius], float)


def _pictures(view: ViewFrames, frames: Ints, pixels: Array, radius: float, smoothing: float) -> SmoothedImages | None:
    """A view's pictures of these frames, as far as they show pixels (N, 2) and what is around them; None if they do
    not show all of it.
    """
    if not np.isfinite(pixels).all():
        return None
    margin = int(np.ceil(radius)) + int(np.ceil(4 * smoothing)) + 1
    low = np.floor(pixels.min(axis=0)).astype(int) - margin
    high = np.ceil(pixels.max(axis=0)).astype(int) + margin + 1
    height, width = view.grey.shape[1:]
    if (low < 0).any() or high[0] > width or high[1] > height:
        return None
    shown = view.grey[frames - view.first, low[1] : high[1], low[0] : high[0]]
    return SmoothedImages.brightness(shown, smoothing, (int(low[0]), int(low[1])))


def _sampled(images: SmoothedImages, pixels: Array, frames: Ints | None = None) -> Array:
    """Brightness (F, K) of images at pixels (F, K, 2), of the first F images unless they are given."""
    F, K, _ = pixels.shape
    frame = np.repeat(np.arange(F) if frames is None else frames, K)
    [brightness] = images.sample(frame, pixels.reshape(-1, 2).astype(np.float32))
    return brightness.reshape(F, K).astype(float)


def _noise(*squared: Array) -> float:
    """Variance of the noise of brightness: the least of several, each the median over frames of its changes (F, K)."""
    return float(max(min(np.median(each.mean(axis=1)) for each in squared), MIN_NOISE**2))


def _squared_changes(brightness: Array) -> Array:
    """Squared differences of brightness (F, K) from its median over the frames."""
    F = len(brightness)
    return np.asarray((brightness - np.median(brightness, axis=0)) ** 2 * F / (F - 1))


def _costs(squared: Array) -> Array:
    return np.asarray(OUTLIER_SCALE**2 * squared / (OUTLIER_SCALE**2 + squared))
