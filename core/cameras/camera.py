"""Cameras: pinhole with OpenCV's lens distortion, fixed or with a pose per frame.

Convention (OpenCV): x_cam = R x_world + t, x right, y down, z forward; integer pixel coordinates lie at pixel
centres. Metres and pixels throughout.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from numbers import Real
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import CalibrationError
from ..numerics import rotations
from ..numerics.arrays import Array, Bools
from .lens_turns import split, zooming

_MIN_DEPTH = 0.5  # metres before the camera: nearer points have the scale of this distance
_SAME_PLACE = 1e-4
"""Distance between the places of a camera that only turns, metres."""
MAX_TURN_SHARE = 0.1
"""How far pictures of a camera that only turns may be displaced to be turned to those of one that stands still, in
terms of their longer side: they lose as much at their edges."""


@dataclass(frozen=True, eq=False)
class Camera:
    """A calibrated camera.

    Attributes
    ----------
    name : str
    size : tuple of int
        Width and height of the footage it describes, pixels.
    matrix : ndarray, shape (3, 3)
        Intrinsic matrix K, pixels.
    distortions : ndarray, shape (n,)
        OpenCV's distortion coefficients (k1, k2, p1, p2, ...), or the four of its fisheye model.
    R_cam_world : ndarray, shape (N, 3, 3)
        World to camera rotation; N is 1 for a fixed camera, else one per shot frame.
    t_cam_world : ndarray, shape (N, 3)
        World to camera translation, metres.
    fisheye : bool
    zooms : ndarray, shape (N,), optional
        How many times as long as in the matrix the focal lengths are at each of the poses; 1 by default. Pictures are
        shown as by the shortest of them, see `rectified`.
    """

    name: str
    size: tuple[int, int]
    matrix: Array
    distortions: Array
    R_cam_world: Array
    t_cam_world: Array
    fisheye: bool = False
    zooms: Array | None = None

    @classmethod
    def create(
        cls,
        name: str,
        size: tuple[int, int],
        matrix: ArrayLike,
        R_cam_world: ArrayLike,
        t_cam_world: ArrayLike,
        *,
        distortions: ArrayLike = (0.0, 0.0, 0.0, 0.0),
        fisheye: bool = False,
    ) -> Camera:
        """Build a camera from array-likes.

        Parameters
        ----------
        name : str
        size : tuple of int
            Width and height, pixels.
        matrix : array-like, shape (3, 3)
            Pixels; the focal lengths are positive, and the last row is 0 0 1.
        R_cam_world : array-like, shape (3, 3) or (F, 3, 3)
            Rotation from world to camera axes: one of a fixed camera, or one per shot frame.
        t_cam_world : array-like, shape (3,) or (F, 3)
            The world's origin in camera axes, metres.
        distortions : array-like, shape (k,)
            OpenCV's coefficients.
        fisheye : bool
            The coefficients are those of OpenCV's fisheye model.

        Raises
        ------
        CalibrationError
            Shapes or values that are not a camera's.
        """
        where = f"camera {name}"
        R, t = _poses(R_cam_world, t_cam_world, where)
        K, dist = np.asarray(matrix, float), np.asarray(distortions, float).ravel()
        if K.shape != (3, 3) or not (K[0, 0] > 0 and K[1, 1] > 0):
            raise CalibrationError("the matrix must be 3x3 with positive focal lengths", where=where)
        if not np.allclose(K[2], (0, 0, 1)):
            todo = "the principal point is in the last column; transpose it if yours is in the last row"
            raise CalibrationError(f"the last row of the matrix is {K[2]}, not 0 0 1", where=where, todo=todo)
        if not all(np.isfinite(a).all() for a in (K, dist, R, t)):
            raise CalibrationError("a value is not a finite number", where=where)
        if not rotations.are_rotations(R).all():
            todo = "matrices that scale or mirror are not rotations"
            raise CalibrationError("a rotation matrix is not a rotation", where=where, todo=todo)
        if np.shape(size) != (2,) or not all(isinstance(n, Real) and 1 <= n < np.inf for n in size):
            todo = "give width and height in pixels"
            raise CalibrationError(f"the size of its pictures is {size!r}", where=where, todo=todo)
        return cls(
            name=name,
            size=(int(size[0]), int(size[1])),
            matrix=K,
            distortions=dist,
            R_cam_world=R,
            t_cam_world=t,
            fisheye=fisheye,
        )

    @property
    def moving(self) -> bool:
        """Whether it has a pose for every frame."""
        return len(self.R_cam_world) > 1

    @property
    def stands_still(self) -> bool:
        """Whether all its poses, one or one per frame, are the same, and it does not zoom."""
        moves = np.ptp(self.R_cam_world, axis=0).any() or np.ptp(self.t_cam_world, axis=0).any()
        return self.zooms is None and not moves

    def standing(self) -> Camera | None:
        """Return the camera with the one of its poses to which all its pictures can be turned, and without zooms; None
        if it stands still, or moves from its place, or turns farther than `MAX_TURN_SHARE`.
        """
        if self.stands_still or np.ptp(self.centres_world(0, len(self.R_cam_world)), axis=0).max() > _SAME_PLACE:
            return None
        axes = self.R_cam_world[:, 2]
        middle = int(np.argmax(axes @ axes.mean(axis=0)))
        stood = self.unzoomed()
        stood = replace(stood, R_cam_world=self.R_cam_world[[middle]], t_cam_world=self.t_cam_world[[middle]])
        way = self.displacements(stood.R_cam_world[0] @ np.swapaxes(self.R_cam_world, 1, 2)).max()
        return stood if way <= MAX_TURN_SHARE * max(self.size) else None

    def displacements(self, turns: Array) -> Array:
        """Return how far turns of its axes (N, 3, 3) displace its picture, without distortion: on average over the
        corners, the middles of the edges and the centre, pixels, shape (N,); infinite where one comes to lie behind it.
        """
        width, height = self.size
        places = np.array([[x * width, y * height, 1] for x in (0, 0.5, 1) for y in (0, 0.5, 1)])
        turned = np.einsum("nab,cb->nca", turns, places @ np.linalg.inv(self.matrix).T) @ self.matrix.T
        with np.errstate(divide="ignore", invalid="ignore"):
            way = np.linalg.norm(turned[..., :2] / turned[..., 2:] - places[:, :2], axis=-1).mean(axis=1)
        return np.where((turned[..., 2] > 0).all(axis=1), way, np.inf)

    def turns_to(self, other: Camera) -> Array:
        """Return the turns, shape (N, 3, 3), from its axes at each of its poses to those of a camera that stands still;
        zooms are undone.
        """
        rotations = np.asarray(other.R_cam_world[0] @ np.swapaxes(self.R_cam_world, 1, 2))
        undone = self.unzooming(range(len(rotations)))
        return rotations if undone is None else rotations @ undone

    def turns_since(self, other: Camera) -> Array:
        """Return the turns, shape (N, 3, 3), from a camera that stands still to its axes at each of its poses, and its
        zooms; the inverse of `turned`.
        """
        rotations = np.asarray(self.R_cam_world @ other.R_cam_world[0].T)
        return rotations if self.zooms is None else zooming(self.zooms) @ rotations

    def unzooming(self, frames: Sequence[int]) -> Array | None:
        """Return the turns, shape (n, 3, 3), that undo its zooms on some shot frames; None if it does not zoom."""
        if self.zooms is None:
            return None
        return zooming(1 / self.zooms[np.clip(np.asarray(frames, int), 0, len(self.zooms) - 1)])

    def turned(self, turns: Array) -> Camera:
        """Return this camera, which stands still, turned about its place by turns of its axes (F, 3, 3), which may zoom
        (`core.cameras.lens_turns`).
        """
        R, zooms = split(turns)
        return replace(
            self,
            R_cam_world=R @ self.R_cam_world[0],
            t_cam_world=R @ self.t_cam_world[0],
            zooms=None if (zooms == 1).all() else zooms,
        )

    def pose(self, frame: int) -> tuple[Array, Array]:
        """Return the world to camera rotation (3, 3) and translation (3,), metres, at a shot frame."""
        i = min(max(frame, 0), len(self.R_cam_world) - 1) if self.moving else 0
        return self.R_cam_world[i], self.t_cam_world[i]

    def poses(self, first: int, count: int) -> tuple[Array, Array]:
        """Return the world to camera rotations (n, 3, 3) and translations (n, 3), metres, of consecutive shot
        frames.
        """
        i = np.clip(np.arange(first, first + count), 0, len(self.R_cam_world) - 1)
        return self.R_cam_world[i], self.t_cam_world[i]

    def at(self, frames: Sequence[int]) -> Camera:
        """Return the camera of some shot frames, which become its frames 0, 1, 2, ..."""
        if not self.moving:
            return self
        i = np.clip(np.asarray(frames, int), 0, len(self.R_cam_world) - 1)
        zooms = None if self.zooms is None or (self.zooms[i] == 1).all() else self.zooms[i]
        return replace(self, R_cam_world=self.R_cam_world[i], t_cam_world=self.t_cam_world[i], zooms=zooms)

    def between(self, first: int, last: int) -> Camera:
        """Return the camera of an excerpt of its shot, shot frames first to last."""
        return self.at(range(first, last + 1))

    def centre_world(self, frame: int = 0) -> Array:
        """Return the optical centre in the world frame, metres, shape (3,)."""
        R, t = self.pose(frame)
        return -R.T @ t

    def centres_world(self, first: int, count: int) -> Array:
        """Return the optical centres on consecutive shot frames in the world frame, metres, shape (n, 3)."""
        R, t = self.poses(first, count)
        return np.asarray(-(np.swapaxes(R, 1, 2) @ t[..., None])[..., 0])

    def pixels_per_metre(self, point_world: Array, frame: int = 0) -> float:
        """Return the length in pixels of a metre that faces the camera at a point (3,) on a shot frame; points behind
        it count as in front of it.
        """
        R, t = self.pose(frame)
        return float(self.matrix[[0, 1], [0, 1]].mean() / max((R @ point_world + t)[2], _MIN_DEPTH))

    def shows(self, pixels: Array) -> Bools:
        """Return which pixels (..., 2) are in the picture, up to the edges of its outermost pixels; NaN is not."""
        with np.errstate(invalid="ignore"):
            return np.asarray(((pixels >= -0.5) & (pixels < np.array(self.size) - 0.5)).all(axis=-1))

    def project(self, points_world: ArrayLike, frame: int = 0) -> Array:
        """Project points (..., 3), world frame, metres, to distorted pixels (..., 2); NaN for points behind the
        camera.
        """
        points = np.asarray(points_world, float)
        R, t = self.pose(frame)
        x = (points @ R.T + t).reshape(-1, 3)
        if self.zooms is not None:
            x[:, :2] *= self.zooms[min(max(frame, 0), len(self.zooms) - 1)]
        uv = np.full((len(x), 2), np.nan)
        front = x[:, 2] > 1e-9
        if front.any():
            model = cv2.fisheye if self.fisheye else cv2
            zero = np.zeros(3)
            uv[front] = model.projectPoints(x[front, None], zero, zero, self.matrix, self.distortions)[0][:, 0]
        return uv.reshape(*points.shape[:-1], 2)

    def rectified(self) -> Camera:
        """Return the same camera without lens distortion and zooms (the geometry of `rectify_maps`)."""
        return replace(self.unzoomed(), distortions=np.zeros(4), fisheye=False)

    def unzoomed(self) -> Camera:
        """Return the same camera with the shortest of its focal lengths on all frames."""
        if self.zooms is None:
            return self
        return replace(self, matrix=self.matrix @ zooming(self.zooms.min()), zooms=None)

    def reduced(self, factor: float) -> Camera:
        """Return the camera of footage reduced by `factor`, with pixel centres at integers."""
        return self.resized(reduced_size(self.size, factor))

    def resized(self, size: tuple[int, int]) -> Camera:
        """Return the camera of footage resized to a width and height, with pixel centres at integers."""
        width, height = size
        sx, sy = width / self.size[0], height / self.size[1]
        K = self.matrix.copy()
        K[0] *= sx
        K[1] *= sy
        K[0, 2] += (sx - 1) / 2
        K[1, 2] += (sy - 1) / 2
        return replace(self, size=(width, height), matrix=K)

    def subsampled(self, stride: int) -> Camera:
        """Return the camera of every stride-th pixel in both directions, beginning with the first."""
        K = self.matrix.copy()
        K[:2] /= stride
        width, height = (-(-n // stride) for n in self.size)
        return replace(self, size=(width, height), matrix=K)

    def field(self, parity: int) -> Camera:
        """Return the camera of a field of interlaced footage: line i of the field is line 2 i + parity of the frame.

        Its distortion coefficients are the same, as they do not depend on pixels.

        Parameters
        ----------
        parity : int
            0 for the field of lines 0, 2, 4 ..., 1 for that of lines 1, 3, 5 ...
        """
        size = self.size[0], len(range(parity, self.size[1], 2))
        return replace(self, size=size, matrix=field_of_frame(parity) @ self.matrix)

    def rectify_maps(self, turn: Array | None = None) -> tuple[NDArray[Any], NDArray[Any]] | None:
        """Return maps for `cv2.remap` from an image of this camera to `rectified()`, in its fixed-point form (h, w, 2)
        and (h, w), with axes that are turned (3, 3), if given; None without distortion and turn.
        """
        # OpenCV's fisheye model is not a pinhole even with zero coefficients.
        if turn is None and not self.fisheye and not self.distortions.any():
            return None
        init = cv2.fisheye.initUndistortRectifyMap if self.fisheye else cv2.initUndistortRectifyMap
        rotation = np.eye(3) if turn is None else turn
        map1, map2 = init(self.matrix, self.distortions, rotation, self.rectified().matrix, self.size, cv2.CV_16SC2)
        return map1, map2


def same_proportions(size: tuple[int, int], other: tuple[int, int]) -> bool:
    """Whether two sizes have the same proportions, to within a pixel of the smaller."""
    (width, height), (other_width, other_height) = size, other
    return abs(width * other_height - height * other_width) <= max(*size, *other)


def reduced_size(size: tuple[int, int], factor: float) -> tuple[int, int]:
    """Return the width and height of an image reduced by `factor`, at least one pixel each."""
    return max(1, round(size[0] / factor)), max(1, round(size[1] / factor))


def field_of_frame(parity: int) -> Array:
    """Return the homography (3, 3) from the pixels of a frame to those of its field: v becomes (v - parity) / 2."""
    return np.array([[1, 0, 0], [0, 1 / 2, -parity / 2], [0, 0, 1]])


def _poses(R_cam_world: ArrayLike, t_cam_world: ArrayLike, where: str) -> tuple[Array, Array]:
    """Return rotations (N, 3, 3) and translations (N, 3) of the shapes that `Camera.create` takes.

    Raises
    ------
    CalibrationError
        They have other shapes, there is none, or there are more of one than of the other.
    """
    R, t = np.asarray(R_cam_world, float), np.asarray(t_cam_world, float)
    if R.shape[-2:] != (3, 3) or t.size % 3 or not t.size:
        what = f"a rotation of shape {R.shape} and a translation of shape {t.shape}"
        todo = "give a 3x3 matrix, which cv2.Rodrigues makes of a vector, and three numbers"
        raise CalibrationError(what, where=where, todo=todo)
    R, t = R.reshape(-1, 3, 3), t.reshape(-1, 3)
    if len(R) != len(t):
        raise CalibrationError(f"{len(R)} rotations but {len(t)} translations", where=where)
    return R, t
