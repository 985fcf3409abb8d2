"""Draws balls and rods with lens distortion and motion blur. Needs no Blender.

Colours are linear light, 0..1. Every pixel is traced through the lens, so that a ball's outline is exact.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, lru_cache

import cv2
import numpy as np
from kfmocap.core.cameras.camera import Camera
from kfmocap.core.numerics.arrays import Array
from numpy.typing import ArrayLike, NDArray

from .textures import planks, plaster

LIGHT_WORLD = np.array([0.4, -0.5, 0.77]) / np.linalg.norm([0.4, -0.5, 0.77])
AMBIENT, DIFFUSE, GLOSS = 0.35, 0.65, 0.12
ROOM = ((-4.6, -5.2), (4.6, 4.6), 3.2)
"""Two corners of the floor and the height, metres."""
GAMMA = 2.2
_BITS = 4


@dataclass(frozen=True, eq=False)
class Ball:
    """A ball that moves during one exposure.

    Attributes
    ----------
    centres : ndarray, shape (T, 3)
        Its positions at times spread evenly over the exposure, metres.
    radius : float
    colour : ndarray, shape (3,)
        Blue, green, red.
    """

    centres: Array
    radius: float
    colour: Array


@dataclass(frozen=True, eq=False)
class Rod:
    """A rod with round ends that moves during one exposure; `starts` and `ends` have shape (T, 3)."""

    starts: Array
    ends: Array
    radius: float
    colour: Array


def linear(levels: ArrayLike) -> Array:
    """Linear light of grey levels, 0..1."""
    return np.asarray(levels, float) ** GAMMA


class Canvas:
    """Draws what a camera sees of a room and the objects in it."""

    def __init__(self, camera: Camera, still: Sequence[Ball | Rod] = ()) -> None:
        self.camera = camera
        self.rays = pixel_rays(camera)
        self._light_cam = camera.R_cam_world[0] @ LIGHT_WORLD
        self._background = room(camera)
        self._background = self.drawn(still)

    def drawn(self, things: Sequence[Ball | Rod]) -> NDArray[np.float32]:
        """Draw objects in front of the background: the picture in linear light, shape (h, w, 3)."""
        image = self._background.copy()
        for thing in sorted(things, key=self._distance, reverse=True):
            if isinstance(thing, Ball):
                self._draw_ball(image, thing)
            else:
                self._draw_rod(image, thing)
        return image

    def _distance(self, thing: Ball | Rod) -> float:
        middle = thing.centres if isinstance(thing, Ball) else (thing.starts + thing.ends) / 2
        return float(np.linalg.norm(middle.mean(axis=0) - self.camera.centre_world()))

    def _draw_ball(self, image: NDArray[np.float32], ball: Ball) -> None:
        R, t = self.camera.pose(0)
        C = ball.centres @ R.T + t
        if (C[:, 2] < 2 * ball.radius).any():
            return
        box = self._box(self._pixels(outline(C, ball.radius)))
        if box is None:
            return
        inside, shade = _ball_pixels(self.rays[box], C[:, None, None], ball.radius, self._light_cam)
        light = shade[..., None] * ball.colour + GLOSS * shade[..., None] ** 40
        _lay_over(image[box], inside.mean(axis=0), (inside[..., None] * light).mean(axis=0))

    def _draw_rod(self, image: NDArray[np.float32], rod: Rod) -> None:
        R, t = self.camera.pose(0)
        ends = np.stack([rod.starts, rod.ends], axis=1) @ R.T + t
        if (ends[..., 2] < 2 * rod.radius).any():
            return
        outlines = self._pixels(outline(ends, rod.radius)).reshape(len(ends), -1, 2)
        box = self._box(outlines)
        if box is None:
            return
        corner = [box[1].start, box[0].start]
        inside = np.zeros(image[box].shape[:2])
        for outlined in outlines:
            covered = np.zeros(inside.shape, np.uint8)
            fixed = ((outlined - corner) * 2**_BITS).round().astype(np.int32)
            cv2.fillConvexPoly(covered, cv2.convexHull(fixed), 255, cv2.LINE_AA, _BITS)
            inside += covered / (255 * len(outlines))
        _lay_over(image[box], inside, inside[..., None] * (AMBIENT + 0.5 * DIFFUSE) * rod.colour)

    def _pixels(self, points_cam: Array) -> Array:
        """Pixels, shape (..., 2), of points in the camera's frame, shape (..., 3)."""
        zero, K = np.zeros(3), self.camera.matrix
        flat = points_cam.reshape(-1, 1, 3)
        return cv2.projectPoints(flat, zero, zero, K, self.camera.distortions)[0].reshape(*points_cam.shape[:-1], 2)

    def _box(self, pixels: Array, margin: int = 3) -> tuple[slice, slice] | None:
        width, height = self.camera.size
        pixels = pixels.reshape(-1, 2)
        low = np.clip(np.floor(pixels.min(axis=0)).astype(int) - margin, 0, [width, height])
        high = np.clip(np.ceil(pixels.max(axis=0)).astype(int) + margin + 1, 0, [width, height])
        return None if (high - low < 3).any() else (slice(low[1], high[1]), slice(low[0], high[0]))


def outline(centres: Array, radius: float, points: int = 24) -> Array:
    """Points of the circle that outlines a ball as seen from the origin; centres (..., 3) give (..., points, 3)."""
    distance = np.linalg.norm(centres, axis=-1, keepdims=True)
    axis = centres / distance
    across = np.cross(axis, [0.0, 1.0, 0.0])
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    up = np.cross(across, axis)
    sine = radius / distance
    angles = np.linspace(0, 2 * np.pi, points, endpoint=False)[:, None]
    round_it = np.cos(angles) * across[..., None, :] + np.sin(angles) * up[..., None, :]
    ring = radius * np.sqrt(1 - sine**2)
    return (centres * (1 - sine**2))[..., None, :] + ring[..., None, :] * round_it


def _ball_pixels(rays: Array, centres: Array, radius: float, light: Array) -> tuple[Array, Array]:
    """Coverage of each pixel by a ball, and its shading there, at every time, shape (T, h, w) each."""
    along = np.sum(rays * centres, axis=-1)
    length2 = np.sum(rays * rays, axis=-1)
    g = along**2 - (np.sum(centres**2, axis=-1) - radius**2) * length2  # positive inside the tangent cone
    slope = np.hypot(*np.gradient(g, axis=(1, 2)))
    inside = np.clip(g / np.maximum(slope, 1e-12) + 0.5, 0, 1)
    depth = (along - np.sqrt(np.maximum(g, 0))) / length2
    normal = (depth[..., None] * rays - centres) / radius
    return inside, AMBIENT + DIFFUSE * np.clip(normal @ light, 0, 1)


def _lay_over(image: NDArray[np.float32], cover: Array, light: Array) -> None:
    image *= (1 - cover)[..., None].astype(np.float32)
    image += light.astype(np.float32)


@lru_cache(maxsize=2)
def pixel_rays(camera: Camera, scale: int = 1) -> NDArray[np.float32]:
    """Rays (x, y, 1) through the centres of scale x scale subpixels of every pixel, (h, w, 3), camera frame."""
    width, height = camera.size
    u, v = ((np.arange(n * scale) + 0.5) / scale - 0.5 for n in (width, height))
    grid = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 1, 2)
    criteria = (cv2.TERM_CRITERIA_COUNT, 10, 0)  # to a millionth of a pixel
    xy = cv2.undistortPointsIter(grid, camera.matrix, camera.distortions, None, None, criteria)[:, 0]
    return np.column_stack([xy, np.ones(len(xy))]).reshape(height * scale, width * scale, 3).astype(np.float32)


@lru_cache(maxsize=1)
def room(camera: Camera) -> NDArray[np.float32]:
    """The empty room as a camera sees it, shape (h, w, 3)."""
    R, _ = camera.pose(0)
    rays = pixel_rays(camera, 2) @ R.astype(np.float32)
    nearest = np.full(rays.shape[:2], np.inf, np.float32)
    image = np.full(rays.shape, 0.7, np.float32)
    for corners, picture in _panels():
        _paint_panel(image, nearest, rays, camera.centre_world(), corners=corners, picture=picture)
    return cv2.resize(image, camera.size, interpolation=cv2.INTER_AREA)


@cache
def _panels(pixel: float = 0.025) -> list[tuple[Array, NDArray[np.float32]]]:
    """Corners (lower left, lower right, upper left) and picture of the floor and the walls."""
    (x0, y0), (x1, y1), height = ROOM
    panels = [([(x0, y0, 0), (x1, y0, 0), (x0, y1, 0)], planks(x1 - x0, y1 - y0, seed=3))]
    corners = [(x0, y1), (x1, y1), (x1, y0), (x0, y0)]
    for i, ((ax, ay), (bx, by)) in enumerate(zip(corners, corners[1:] + corners[:1], strict=True)):
        wall = plaster(float(np.hypot(bx - ax, by - ay)), height, seed=20 + 10 * i, pixel=pixel)
        panels.append(([(ax, ay, 0), (bx, by, 0), (ax, ay, height)], wall))
    return [(np.array(c, float), linear(picture[..., ::-1]).astype(np.float32)) for c, picture in panels]


def _paint_panel(
    image: NDArray[np.float32],
    nearest: NDArray[np.float32],
    rays: NDArray[np.float32],
    eye: Array,
    *,
    corners: Array,
    picture: NDArray[np.float32],
) -> None:
    """Paint a rectangle with a picture where it is the nearest thing."""
    a, b = corners[1] - corners[0], corners[2] - corners[0]
    normal = np.cross(a, b)
    slant = rays @ normal.astype(np.float32)
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = ((corners[0] - eye) @ normal / slant).astype(np.float32)
        s, t = (((eye - corners[0]) @ e + depth * (rays @ e.astype(np.float32))) / (e @ e) for e in (a, b))
    on = (depth > 0) & (depth < nearest) & (s >= 0) & (s <= 1) & (t >= 0) & (t <= 1)
    rows, columns = picture.shape[:2]
    u, v = (np.where(on, x * n - 0.5, 0).astype(np.float32) for x, n in ((s, columns), (t, rows)))
    image[on] = cv2.remap(picture, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)[on]
    nearest[on] = depth[on]
