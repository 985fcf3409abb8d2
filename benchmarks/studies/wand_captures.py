"""Synthetic captures of an L-frame and a wand: points as from a detector, with faults, and with known truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...core.cameras.camera import Camera
from ...core.capture.capture import Capture, CaptureView, Markers
from ...core.numerics.arrays import Array

LFRAME = np.array([[0.0, 0, 0], [0.3, 0, 0], [0.6, 0, 0], [0, 0.2, 0]])
WAND_LENGTH = 0.5
"""The balls of the L-frame, shape (4, 3), and the distance between those of the wand, metres."""
SIZE = (1920, 1080)
FPS = 30.0
LFRAME_FRAMES = 60
"""Number of frames on which a camera sees the L-frame."""


@dataclass(frozen=True, eq=False)
class Faults:
    """The faults of detected points.

    Attributes
    ----------
    noise : float
        Standard deviation of each coordinate, pixels.
    outliers : float
        Fraction of the wand's balls that are found somewhere else in the picture.
    swaps : float
        Fraction of a view's frames on which the wand's ends are swapped.
    dropouts : float
        Fraction of a view's frames on which the wand is not found.
    """

    noise: float = 0.3
    outliers: float = 0.0
    swaps: float = 0.0
    dropouts: float = 0.0


HARD = Faults(outliers=0.2, swaps=0.05, dropouts=0.3)


def ring(count: int, seed: int = 0, radius: float = 4.0) -> list[Camera]:
    """Return different ordinary cameras around a stage of about two metres."""
    rng = np.random.default_rng([seed, 1])
    cameras = []
    for c in range(count):
        angle = 2 * np.pi * (c + rng.uniform(-0.2, 0.2)) / max(count, 3) + 0.4
        distance = radius * rng.uniform(0.9, 1.15)
        eye = np.array([distance * np.cos(angle), distance * np.sin(angle), rng.uniform(1.2, 2.6)])
        target = np.array([0, 0, 1.0]) + rng.normal(0, 0.12, 3)
        focal, k1 = rng.uniform(1050, 1500), rng.uniform(-0.12, 0.03)
        cameras.append(look_at(f"cam{c + 1:02d}", eye, target, focal, (k1, 0.0, 0.0, 0.0)))
    return cameras


def look_at(
    name: str, eye: Array, target: Array, focal: float, distortions: Sequence[float], *, size: tuple[int, int] = SIZE
) -> Camera:
    """Return a camera at one point that looks at another."""
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, [0.0, 0, 1])
    right /= np.linalg.norm(right)
    R = np.stack([right, np.cross(forward, right), forward])
    K = [[focal, 0, (size[0] - 1) / 2], [0, focal, (size[1] - 1) / 2], [0, 0, 1]]
    return Camera.create(name, size, K, R, -R @ eye, distortions=distortions)


def scattered(count: int, seed: int = 0, length: float = WAND_LENGTH) -> Array:
    """Return independent random positions of the wand's ends on the stage, metres, shape (count, 2, 3)."""
    rng = np.random.default_rng([seed, 2])
    angle, radius = rng.uniform(0, 2 * np.pi, count), 1.4 * np.sqrt(rng.uniform(0, 1, count))
    middle = np.stack([radius * np.cos(angle), radius * np.sin(angle), rng.uniform(0.3, 2.1, count)], axis=1)
    return ends(middle, rng.normal(0, 1, (count, 3)), length)


def waved(times: Array, seed: int = 0, length: float = WAND_LENGTH, speed: float = 1.0) -> Array:
    """Return the ends of a wand that is waved by somebody walking about, at times in seconds, metres, shape (n, 2,
    3).
    """
    rng = np.random.default_rng([seed, 3])
    rates = 2 * np.pi * speed * np.array([[0.07, 0.21, 0.5], [0.09, 0.25, 0.43], [0.13, 0.31, 0.6]])
    phases = rng.uniform(0, 2 * np.pi, (2, 3, 3))
    sizes = np.array([[0.75, 0.3, 0.1], [0.75, 0.3, 0.1], [0.5, 0.25, 0.1]])
    waves = np.sin(np.asarray(times)[:, None, None] * rates + phases[0])
    middle = (waves * sizes).sum(axis=-1) + [0, 0, 1.05]
    direction = np.sin(np.asarray(times)[:, None, None] * rates[:, ::-1] * 0.8 + phases[1]) @ [1.0, 0.6, 0.4]
    return ends(middle, direction + [0.1, 0.2, 0.3], length)


def ends(middle: Array, direction: Array, length: float) -> Array:
    """Return the ends (n, 2, 3) of a wand from its middle and direction, (n, 3) each; metres."""
    half = length / 2 * direction / np.linalg.norm(direction, axis=1, keepdims=True)
    return np.stack([middle + half, middle - half], axis=1)


def capture(
    cameras: Sequence[Camera],
    wand: Sequence[Array],
    faults: Faults | None = None,
    seed: int = 0,
    *,
    offsets: Sequence[float | None] | None = None,
    lframe: Array = LFRAME,
    length: float = WAND_LENGTH,
) -> Capture:
    """Return the capture of a wand and an L-frame by some cameras.

    Parameters
    ----------
    cameras : sequence of Camera
    wand : sequence of ndarray, shape (n, 2, 3)
        The wand's ends on each camera's own frames, metres.
    faults : Faults, optional
    seed : int
    offsets : sequence of float or None, optional
        The offsets stated in the capture; by default all are 0.
    lframe : ndarray, shape (4, 3)
        True positions of the L-frame's balls; the capture states `LFRAME`.
    length : float
        Length of the wand stated in the capture, metres.
    """
    faults = faults or Faults()
    rng = np.random.default_rng([seed, 4])
    known = [0.0] * len(cameras) if offsets is None else offsets
    views = tuple(
        CaptureView(
            camera.name,
            camera.size,
            FPS,
            seen(camera, np.tile(lframe, (LFRAME_FRAMES, 1, 1)), Faults(faults.noise), rng),
            seen(camera, positions, faults, rng),
            offset,
        )
        for camera, positions, offset in zip(cameras, wand, known, strict=True)
    )
    return Capture(LFRAME.copy(), length, views)


def seen(camera: Camera, positions: Array, faults: Faults, rng: np.random.Generator) -> Markers:
    """Return balls at positions (n, m, 3) as a detector finds them in one camera's video."""
    n, m = positions.shape[:2]
    uv = camera.project(positions)
    inside = ((uv > -0.5) & (uv < np.array(camera.size) - 0.5)).all(axis=-1)
    uv = uv + rng.normal(0, 1, uv.shape) * faults.noise
    wrong = rng.uniform(size=(n, m)) < faults.outliers
    uv = np.where(wrong[..., None], rng.uniform(0, 1, uv.shape) * camera.size, uv)
    swapped = rng.uniform(size=n) < faults.swaps
    uv[swapped] = uv[swapped, ::-1]
    found = inside & (rng.uniform(size=n) >= faults.dropouts)[:, None]
    uv = np.where(found[..., None], uv, np.nan)
    return Markers(np.arange(n), uv, np.where(found, faults.noise, np.nan))


def without(markers: Markers, frames: Array) -> Markers:
    """Return the markers without those on some frames (a mask)."""
    points, sigma = markers.points.copy(), markers.sigma.copy()
    points[frames], sigma[frames] = np.nan, np.nan
    return replace(markers, points=points, sigma=sigma)
