"""Pictures of a skinned figure and boxes in a room, painted triangle by triangle from far to near; needs no Blender.

Far quicker than tracing rays, so that a benchmark of many shots is rendered in minutes: exposures with motion blur, a
sun with shadows on figure and floor, lenses, and a sensor with the noise of its light. Colours are linear light, 0..1.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from kfmocap.core.cameras.camera import Camera
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from .drawing import GAMMA, LIGHT_WORLD, pixel_rays, room

Array = NDArray[np.float64]
Picture = NDArray[np.float32]
Triangles = NDArray[np.int64]

SUBPIXELS, _BITS = 2, 4
SUN, SKY = 0.75, 0.38
CELL, BIAS = 0.02, 0.06
"""Size of a cell of the shadow maps and the depth behind which a point lies in shadow, metres."""
READING = 3.5
"""Noise of reading a pixel, photons."""
SHADE, CONTACT = 0.55, 0.25
"""How much darker the floor is in the sun's shadow, and below what is close to it."""


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles with colours: a figure or furniture.

    Attributes
    ----------
    vertices : ndarray, shape (V, 3)
        World, metres.
    triangles : ndarray of int, shape (N, 3)
        Counter-clockwise seen from outside.
    colours : ndarray, shape (V, 3)
        Blue, green, red, linear light.
    """

    vertices: Array
    triangles: Triangles
    colours: Array


def box(low: Sequence[float], high: Sequence[float], colour: Sequence[float], cell: float = 0.05) -> Surface:
    """A box with two opposite corners; colour is blue, green, red, linear light."""
    low_, high_ = np.array(low, float), np.array(high, float)
    vertices, triangles, count = [], [], 0
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        counts = [max(1, int(np.ceil((high_[k] - low_[k]) / cell))) for k in (u, v)]
        for end, corner in ((0, low_), (1, high_)):
            a, b = np.meshgrid(*(np.linspace(low_[k], high_[k], n + 1) for k, n in zip((u, v), counts, strict=True)))
            points = np.empty((*a.shape, 3))
            points[..., axis], points[..., u], points[..., v] = corner[axis], a, b
            number = count + np.arange(a.size).reshape(a.shape)
            p, q, r, s = number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]
            faces = np.concatenate([np.stack([p, q, r], -1).reshape(-1, 3), np.stack([p, r, s], -1).reshape(-1, 3)])
            vertices.append(points.reshape(-1, 3))
            triangles.append(faces if end else faces[:, ::-1])
            count += a.size
    places = np.concatenate(vertices)
    grain = 1 + 0.18 * np.sin(places @ [9.0, 7.0, 31.0])[:, None] * np.sin(places @ [3.0, 41.0, 5.0])[:, None]
    return Surface(places, np.concatenate(triangles), grain * np.array(colour))


def joined(surfaces: Sequence[Surface]) -> Surface:
    """Several surfaces as one."""
    starts = np.cumsum([0, *(len(s.vertices) for s in surfaces)])
    triangles = [s.triangles + start for s, start in zip(surfaces, starts[:-1], strict=True)]
    parts = [np.concatenate([getattr(s, name) for s in surfaces]) for name in ("vertices", "colours")]
    return Surface(parts[0], np.concatenate(triangles), parts[1])


def normals(vertices: Array, triangles: Triangles) -> Array:
    """Unit normals at the vertices, shape (V, 3)."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    n = np.cross(b - a, c - a)
    total = np.stack(
        [sum(np.bincount(triangles[:, k], n[:, d], len(vertices)) for k in range(3)) for d in range(3)], axis=1
    )
    return np.asarray(total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-12))


def lit(surface: Surface) -> Array:
    """Light that a surface sends out, shape (V, 3): sun with its own shadow, and sky."""
    n = normals(surface.vertices, surface.triangles)
    sun = np.clip(n @ LIGHT_WORLD, 0, 1) * (1 - _own_shadow(surface.vertices))
    return np.asarray(surface.colours * (SUN * sun + SKY * (0.65 + 0.35 * n[:, 2]))[:, None])


def _own_shadow(points: Array) -> Array:
    """Share of the sun that is blocked at each point by the others, shape (N,)."""
    across = np.cross(LIGHT_WORLD, [0, 0, 1.0])
    across /= np.linalg.norm(across)
    plane = points @ np.stack([across, np.cross(LIGHT_WORLD, across)], axis=1)
    cells = np.floor((plane - plane.min(axis=0)) / CELL).astype(int)
    height = points @ LIGHT_WORLD
    nearest = np.full(cells.max(axis=0) + 1, -np.inf)
    np.maximum.at(nearest, (cells[:, 0], cells[:, 1]), height)
    blocked = (nearest[cells[:, 0], cells[:, 1]] > height + BIAS).astype(float)
    hits, seen = np.zeros_like(nearest), np.zeros_like(nearest)
    np.add.at(hits, (cells[:, 0], cells[:, 1]), blocked)
    np.add.at(seen, (cells[:, 0], cells[:, 1]), 1.0)
    # Both sides of the figure share a cell: only points that are blocked themselves take the softened share.
    soft = gaussian_filter(np.minimum(hits, 1.0), 1.0)[cells[:, 0], cells[:, 1]]
    return np.asarray(blocked * (0.4 + 0.6 * soft))


class Floor:
    """Shadows on the floor of a room."""

    EXTENT = 5.5

    def __init__(self, points: Array) -> None:
        ground = points - points[:, 2:] / LIGHT_WORLD[2] * LIGHT_WORLD
        self.sun = self._map(ground, 1.5)
        self.contact = self._map(points[points[:, 2] < 0.25], 4.0)

    def _map(self, points: Array, softness: float) -> Picture:
        n = int(2 * self.EXTENT / CELL)
        cells = np.floor((points[:, :2] + self.EXTENT) / CELL).astype(int)
        cells = cells[((cells >= 0) & (cells < n)).all(axis=1)]
        covered = np.zeros((n, n), np.float32)
        covered[cells[:, 1], cells[:, 0]] = 1
        return np.asarray(cv2.GaussianBlur(covered, (0, 0), softness), np.float32)

    def light(self, places: tuple[Picture, Picture]) -> Picture:
        """Factor on the light of each pixel of a picture of the empty room, shape (h, w, 1); see `floor_places`."""
        sun, contact = (cv2.remap(shadow, *places, cv2.INTER_LINEAR) for shadow in (self.sun, self.contact))
        light = (1 - SHADE * np.clip(sun, 0, 1)) * (1 - CONTACT * np.clip(contact, 0, 1))
        return np.asarray(light[..., None], np.float32)


def floor_places(camera: Camera) -> tuple[Picture, Picture]:
    """Column and row in the floor's shadow maps of each pixel of a camera, shape (h, w) each; far outside for walls."""
    rays = pixel_rays(camera) @ camera.R_cam_world[0].astype(np.float32)
    eye = camera.centre_world()
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = -eye[2] / rays[..., 2]
    x, y = (np.where(depth > 0, eye[k] + depth * rays[..., k], 99.0) for k in (0, 1))
    u, v = (((w + Floor.EXTENT) / CELL - 0.5).astype(np.float32) for w in (x, y))
    return u, v


@dataclass(frozen=True)
class Sensor:
    """How a camera records light.

    Attributes
    ----------
    gain : float
        Factor on the light of the scene that the picture shows.
    photons : float
        Counted in a white pixel: fewer are noisier.
    blur : float
        Standard deviation of the lens's blur, pixels.
    """

    gain: float = 1.0
    photons: float = 9000.0
    blur: float = 0.6

    def recorded(self, light: Picture, rng: np.random.Generator) -> NDArray[np.uint8]:
        """The picture of linear light."""
        level = self.gain * cv2.GaussianBlur(light, (0, 0), self.blur)
        deviation = np.sqrt(np.maximum(level, 0) / self.photons + READING**2 / self.photons**2)
        noisy = np.clip(level + deviation * rng.normal(size=level.shape), 0, 1)
        return np.asarray((255 * noisy ** (1 / GAMMA)).round(), np.uint8)


@dataclass(frozen=True, eq=False)
class Exposure:
    """What a camera recorded in a frame.

    Attributes
    ----------
    light : ndarray of float32, shape (h, w, 3)
    ids : ndarray of int32
        Numbers of the triangles seen at the middle moment, from 1, in subpixels of `window`; those of the furniture
        follow the figure's; 0 is the room.
    window : tuple of slice
        Rows and columns of a part of the picture.
    """

    light: Picture
    ids: NDArray[np.int32]
    window: tuple[slice, slice]


class PaintedView:
    """What one camera sees of a room with furniture, and of a figure in it; `empty` may stand for the empty room."""

    def __init__(self, camera: Camera, furniture: Surface | None, empty: Picture | None = None) -> None:
        self.camera, self.furniture = camera, furniture
        self._empty, self._floor = (room(camera) if empty is None else empty).copy(), floor_places(camera)
        if furniture is None:
            return
        self._empty *= Floor(furniture.vertices).light(self._floor)
        width, height = camera.size
        ids = self._painted(furniture, (slice(0, height), slice(0, width)))
        self._furniture_light = _triangle_light(furniture, lit(furniture))
        self._empty = _composed(self._empty, [(ids, self._furniture_light)])
        shown = (ids > 0).reshape(height, SUBPIXELS, width, SUBPIXELS).any(axis=(1, 3))
        self._floor[0][shown] = -99.0  # the figure's shadow does not fall on furniture

    def exposed(self, moments: Sequence[Surface], light: Array, floor: Floor) -> Exposure:
        """Expose a frame.

        Parameters
        ----------
        moments : sequence of Surface
            The figure at times spread evenly over the exposure.
        light : ndarray, shape (V, 3)
            What its vertices send out, as at the middle of the exposure.
        floor : Floor
            Its shadow.
        """
        image = self._empty * floor.light(self._floor)
        window = self._window([m.vertices for m in moments])
        sent, things = [_triangle_light(moments[0], light)], [[moment] for moment in moments]
        if self.furniture is not None:
            sent.append(self._furniture_light)
            things = [[*seen, self.furniture] for seen in things]
        layers = [self._painted(joined(seen), window) for seen in things]
        image[window] = _composed(image[window], [(ids, np.concatenate(sent)) for ids in layers])
        return Exposure(image, layers[len(layers) // 2], window)

    def _window(self, vertices: Sequence[Array], margin: int = 4) -> tuple[slice, slice]:
        uv = np.concatenate([self.camera.project(v[::5]) for v in vertices])
        width, height = self.camera.size
        low = np.clip(np.floor(uv.min(axis=0)).astype(int) - margin, 0, [width, height])
        high = np.clip(np.ceil(uv.max(axis=0)).astype(int) + margin + 1, 0, [width, height])
        return slice(int(low[1]), int(high[1])), slice(int(low[0]), int(high[0]))

    def _painted(self, surface: Surface, window: tuple[slice, slice]) -> NDArray[np.int32]:
        """Numbers from 1 of the triangles seen in the subpixels of a window; 0 where there is none."""
        R, t = self.camera.pose(0)
        points_cam = surface.vertices @ R.T + t
        uv = self.camera.project(surface.vertices)
        a, b, c = (uv[surface.triangles[:, k]] for k in range(3))
        facing = np.cross(b - a, c - a) < 0
        depth = points_cam[surface.triangles, 2].mean(axis=1)
        seen = np.flatnonzero(facing & (depth > 0.2))
        seen = seen[np.argsort(-depth[seen])]
        corner = np.array([window[1].start, window[0].start])
        fixed = (((uv - corner + 0.5) * SUBPIXELS - 0.5) * 2**_BITS).round().astype(np.int32)
        polygons = np.ascontiguousarray(fixed[surface.triangles[seen]])
        rows, columns = (SUBPIXELS * (s.stop - s.start) for s in window)
        ids = np.zeros((max(rows, 1), max(columns, 1)), np.int32)
        fill = cv2.fillConvexPoly
        for number, polygon in zip((seen + 1).tolist(), polygons, strict=True):
            fill(ids, polygon, number, 8, _BITS)
        return ids


def exposures(views: Sequence[PaintedView], skins: Array, triangles: Triangles, colours: Array) -> Iterator[Exposure]:
    """Expose a frame in several views.

    Parameters
    ----------
    views : sequence of PaintedView
    skins : ndarray, shape (M, V, 3)
        A figure's vertices in the world at times spread evenly over the exposure.
    triangles : ndarray of int, shape (N, 3)
    colours : ndarray, shape (V, 3)
        As a surface's.
    """
    moments = [Surface(skin, triangles, colours) for skin in skins]
    middle = moments[len(moments) // 2]
    light, floor = lit(middle), Floor(middle.vertices)
    for view in views:
        yield view.exposed(moments, light, floor)


def _triangle_light(surface: Surface, light: Array) -> Picture:
    return np.asarray(light[surface.triangles].mean(axis=1), np.float32)


def _composed(under: Picture, layers: Sequence[tuple[NDArray[np.int32], Picture]]) -> Picture:
    """Lay painted triangles over a picture, averaged over subpixels and moments."""
    h, w = under.shape[:2]
    total, cover = np.zeros((h, w, 3), np.float32), np.zeros((h, w, 1), np.float32)
    for ids, light in layers:
        table = np.concatenate([np.zeros((1, 3), np.float32), light])
        grouped = (h, SUBPIXELS, w, SUBPIXELS)
        total += table[ids].reshape(*grouped, 3).mean(axis=(1, 3))
        cover += (ids > 0).reshape(grouped).mean(axis=(1, 3), dtype=np.float32)[..., None]
    return under * (1 - cover / len(layers)) + total / len(layers)
