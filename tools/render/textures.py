"""Procedural textures as arrays: smooth noise, plaster, planks, a poster. Colours are sRGB, 0..1."""

from __future__ import annotations

import numpy as np
from kfmocap.core.numerics.arrays import Array
from scipy.ndimage import map_coordinates


def noise(points: Array, seed: int = 1) -> Array:
    """Smooth noise with mean 0, standard deviation about 0.4 and features of size 1 at points (..., 3), shape (...)."""
    lattice = np.random.default_rng(seed).standard_normal((24, 24, 24))
    return 0.6 * map_coordinates(lattice, np.moveaxis(points, -1, 0), order=3, mode="grid-wrap")


def _plane(width: float, height: float, pixel: float) -> tuple[Array, Array]:
    """Metres across and up of the pixels of an image, row 0 at the bottom, as in Blender's images."""
    columns, rows = round(width / pixel), round(height / pixel)
    return np.meshgrid((np.arange(columns) + 0.5) * pixel, (np.arange(rows) + 0.5) * pixel)


def _noise_plane(x: Array, y: Array, size: float, seed: int) -> Array:
    return noise(np.stack([x / size, y / size, np.zeros_like(x)], axis=-1), seed)


def plaster(width: float, height: float, seed: int, pixel: float = 0.01) -> Array:
    """A stained wall with a skirting board and framed prints, shape (rows, columns, 3)."""
    x, y = _plane(width, height, pixel)
    shade = 0.05 * _noise_plane(x, y, 0.5, seed) + 0.035 * _noise_plane(x, y, 0.06, seed + 1)
    image = np.array([0.62, 0.62, 0.57]) + shade[..., None]
    image[y < 0.12] = [0.36, 0.28, 0.22]
    rng = np.random.default_rng(seed)
    for slot in np.arange(0.5, width - 1.0, 1.7):
        left, low = slot + rng.uniform(0, 0.5), rng.uniform(0.7, 1.5)
        wide, high = rng.uniform(0.4, 0.8), rng.uniform(0.4, 0.8)
        frame = (x > left) & (x < left + wide) & (y > low) & (y < low + high)
        inner = (np.abs(x - left - wide / 2) < wide / 2 - 0.03) & (np.abs(y - low - high / 2) < high / 2 - 0.03)
        image[frame] = rng.uniform(0.2, 0.35)
        hue = rng.uniform(0.35, 0.7, 3)
        blots = _noise_plane(x, y, rng.uniform(0.08, 0.2), int(rng.integers(1000)))
        image[inner] = hue + 0.22 * blots[inner, None]
    return np.clip(image, 0, 1)


def planks(width: float, height: float, seed: int, pixel: float = 0.01) -> Array:
    """A wooden floor, boards along x, shape (rows, columns, 3)."""
    x, y = _plane(width, height, pixel)
    rng = np.random.default_rng(seed)
    row = (y / 0.14).astype(int)
    board = ((x + rng.uniform(0, 1.6, row.max() + 1)[row]) / 1.6).astype(int) + 50 * row
    tone = rng.uniform(-0.09, 0.09, board.max() + 1)[board]
    grain = 0.05 * noise(np.stack([x / 0.35, y / 0.02, board * 0.37], axis=-1), seed)
    image = np.array([0.56, 0.42, 0.30]) + (tone + grain)[..., None]
    image[np.mod(y, 0.14) < pixel] *= 0.6
    return np.clip(image, 0, 1)
