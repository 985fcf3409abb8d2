"""Edges along the sides of limbs: where an arm of the same colours as the trunk ends in front of it.

Neither foreground images nor colours show that. But across both sides of a limb, brightness changes more steeply than
elsewhere on a performer or in the room. The distributions of both are learned on the key frames, at the key poses and
at random poses around them. (H. Sidenbladh, M. J. Black, Learning image statistics for Bayesian tracking, ICCV 2001.)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..body import Part
from ..cameras.camera import Camera
from ..numerics.arrays import Bools
from ..numerics.repeatable import transformed
from ..runtime.processes.shared_arrays import collected, each_row
from .rendering.label_images import NEAR_PLANE
from .smoothed_images import smoothed_slopes

BONE_POSITIONS = np.array([0.2, 0.5, 0.8])
"""Positions along a part's bone at which its sides are sampled, as shares of the bone's length."""
WIDTH_DIRECTIONS = 16
"""Number of directions around the bone for which a part's width is stored."""
SEARCH_OFFSETS = (-1.5, 0.0, 1.5)
"""Offsets across a side at which the steepest change is searched for, pixels."""
SLOPE_BIN_EDGES = np.array([1.0, 2.0, 4.0, 6.0, 9.0, 13.0, 18.0, 25.0, 35.0, 50.0])
"""Limits between the bins of changes of brightness, grey levels (of 256) per pixel."""
_BIN_OF = np.searchsorted(SLOPE_BIN_EDGES, np.arange(SLOPE_BIN_EDGES[-1] + 1), side="right")
"""The bin of every whole change up to the last limit: all limits are whole."""
PRIOR_COUNT = 8.0
"""Number of prior observations with equal likelihoods, since a few sides teach little."""
_SMOOTHING = 1.0  # pixels
_SCALE = 2.0  # steps per grey level
_ZERO = 128


@dataclass(frozen=True, eq=False)
class PartSides:
    """The two sides that a part shows from any direction.

    Attributes
    ----------
    length : float
        Length of its bone, metres.
    half_width : ndarray of float32, shape (WIDTH_DIRECTIONS, n)
        Distance of the part's surface from the bone in each direction, at `BONE_POSITIONS`, metres.
    """

    length: float
    half_width: NDArray[np.float32]

    @classmethod
    def of(cls, part: Part) -> PartSides:
        """Compute the sides of a part's polyhedron."""
        length = float(np.linalg.norm(part.tail_world - part.head_world))
        angle = 2 * np.pi * np.arange(WIDTH_DIRECTIONS) / WIDTH_DIRECTIONS
        across = np.stack([np.cos(angle), np.zeros(WIDTH_DIRECTIONS), np.sin(angle)], axis=1)
        width = np.zeros((WIDTH_DIRECTIONS, len(BONE_POSITIONS)), np.float32)
        for k, y in enumerate(BONE_POSITIONS * length):
            below, above = (part.vertices[side] for side in (part.vertices[:, 1] <= y, part.vertices[:, 1] > y))
            if len(below) and len(above):
                share = (y - below[:, None, 1]) / (above[None, :, 1] - below[:, None, 1])
                section = below[:, None] + share[..., None] * (above - below[:, None])
                width[:, k] = (section.reshape(-1, 3) @ across.T).max(axis=0)
        return cls(length, width)

    def seen_from(
        self, centre: NDArray[np.float32], R: NDArray[np.float32], T: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return points along both sides as seen from a camera, and the direction from one side to the other.

        Parameters
        ----------
        centre : ndarray, shape (m, 3)
            The camera's centre on each of m frames, in the world.
        R, T : ndarray, shapes (m, K, 3, 3) and (m, K, 3)
            K world poses of the part on each frame.

        Returns
        -------
        points_world : ndarray of float32, shape (m, 3, 2, n, K)
        across : ndarray of float32, shape (m, 3, K)
            Unit vectors.
        """
        turned, head = np.moveaxis(R, 1, 3), np.moveaxis(T, 1, 2)  # coordinates first: long rows are fast
        axis = np.ascontiguousarray(turned[:, :, 1])
        view = head + np.float32(self.length / 2) * axis - centre[:, :, None]
        across = np.stack([axis[:, i - 2] * view[:, i - 1] - axis[:, i - 1] * view[:, i - 2] for i in range(3)], axis=1)
        across /= np.maximum(np.sqrt((across**2).sum(axis=1, keepdims=True)), np.float32(1e-9))
        x, z = ((turned[:, :, k] * across).sum(axis=1) for k in (0, 2))
        direction = np.rint(np.arctan2(z, x) * np.float32(WIDTH_DIRECTIONS / (2 * np.pi))).astype(np.intp)
        both = np.stack([direction, direction + WIDTH_DIRECTIONS // 2], axis=1) % WIDTH_DIRECTIONS
        reach = np.moveaxis(self.half_width[both], 3, 2) * np.array([1, -1], np.float32)[:, None, None]
        along = (self.length * BONE_POSITIONS).astype(np.float32)[:, None]
        bone = head[:, :, None] + along * axis[:, :, None]
        return bone[:, :, None] + reach[:, None] * across[:, :, None, None], across


@dataclass(frozen=True, eq=False)
class SlopeImages:
    """How brightness changes at every pixel of consecutive frames of a view.

    Attributes
    ----------
    camera : Camera
    first : int
        Shot frame of the first of them.
    slopes : ndarray of uint8, shape (F, h, w, 2)
        By u and v, half grey levels per pixel, from 128.
    origin : tuple of int
        The frames' pixel (u, v) that is the first of these.
    """

    camera: Camera
    first: int
    slopes: NDArray[np.uint8]
    origin: tuple[int, int] = (0, 0)

    @classmethod
    def of(cls, camera: Camera, first: int, grey: NDArray[np.uint8], origin: tuple[int, int] = (0, 0)) -> SlopeImages:
        """Compute the slopes of windows of 8-bit frames (F, h, w), whose first pixel is (u, v) of the frames."""
        slopes = (_in_steps(*each) for each in smoothed_slopes(grey, _SMOOTHING))
        return cls(camera, first, collected(slopes, (*grey.shape, 2)), origin)

    def steepest(
        self, frames: slice, points_world: NDArray[np.float32], across: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return the steepest change of brightness across sides on m consecutive frames.

        Parameters
        ----------
        frames : slice
        points_world, across : ndarray, shapes (m, 3, 2, n, K) and (m, 3, K)
            As `PartSides.seen_from` returns them.

        Returns
        -------
        change : ndarray of float32, shape (m, 2, n, K)
            Grey levels per pixel.
        seen : ndarray of float32, shape (m, 3, 2, n, K)
            The places' pixels in the frames (u, v) and their depth, metres.
        """
        Rc, tc = self.camera.poses(self.first + frames.start, len(points_world))
        to_picture = (self.camera.matrix @ Rc).astype(np.float32)
        seen = transformed(to_picture, points_world.reshape(len(points_world), 3, -1)).reshape(points_world.shape)
        seen += (tc @ self.camera.matrix.T).astype(np.float32)[:, :, None, None, None]
        np.maximum(seen[:, 2], np.float32(NEAR_PLANE), out=seen[:, 2])
        seen[:, :2] /= seen[:, 2:]
        # The direction in the picture in which a point moves that moves across the bone.
        turned = transformed(to_picture, across)[:, :, None, None]
        way = turned[:, :2] - seen[:, :2] * turned[:, 2:]
        way /= np.maximum(np.sqrt((way**2).sum(axis=1, keepdims=True)), np.float32(1e-9))
        corner = np.array(self.origin, np.float32)[:, None, None, None]
        places = np.stack([seen[:, :2] - corner + np.float32(step) * way for step in SEARCH_OFFSETS], axis=2)
        change = np.empty(way[:, 0].shape, np.float32)
        for image, place, (du, dv), out in zip(each_row(self.slopes[frames]), places, way, change, strict=True):
            u, v = place.reshape(2, -1, place.shape[-1])
            found = cv2.remap(image, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=(_ZERO, _ZERO))
            slopes = found.reshape(*place.shape[1:], 2).astype(np.float32) - np.float32(_ZERO)
            np.abs(slopes[..., 0] * du + slopes[..., 1] * dv).max(axis=0, out=out)
        return change / np.float32(_SCALE), seen


def _in_steps(*slopes: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Encode slopes by u and v, (h, w) each, as bytes, (h, w, 2)."""
    cut = (cv2.max(values, -_ZERO / (255 * _SCALE)) for values in slopes)
    return np.asarray(cv2.merge([cv2.convertScaleAbs(values, None, 255 * _SCALE, _ZERO) for values in cut]))


@dataclass(frozen=True, eq=False)
class SideRatios:
    """Log likelihood ratios (across a limb's side against elsewhere) of changes of brightness.

    Attributes
    ----------
    ratio : ndarray of float32, shape (L + 1,)
        Ratio for each bin between the L limits `SLOPE_BIN_EDGES`.
    """

    ratio: NDArray[np.float32]

    @classmethod
    def learned(cls, sides: NDArray[np.floating[Any]], elsewhere: NDArray[np.floating[Any]]) -> SideRatios:
        """Learn the ratios from changes of brightness at sides and elsewhere, grey levels per pixel."""
        bins = len(SLOPE_BIN_EDGES) + 1
        right, wrong = (
            np.bincount(np.digitize(found, SLOPE_BIN_EDGES), minlength=bins) for found in (sides, elsewhere)
        )
        usual = (wrong + 1) / (wrong + 1).sum()
        own = (right + PRIOR_COUNT * usual) / (right.sum() + PRIOR_COUNT)
        return cls(np.log(own / usual).astype(np.float32))

    def of(self, change: NDArray[np.float32], visible: Bools) -> NDArray[np.float32]:
        """Look up the log likelihood ratios of changes, same shape; 0 for hidden ones."""
        whole = np.minimum(change, np.float32(SLOPE_BIN_EDGES[-1])).astype(np.intp)
        return np.asarray(self.ratio[_BIN_OF].take(whole) * visible)
