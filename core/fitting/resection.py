"""Cameras, part shapes and key poses from the outlines of the key frames: one Gauss-Newton step over all of them.

A piece of outline that lies beside the model's is brought there by moving the camera, by its focal length, by
stretching and shifting the part, or by posing the body otherwise. All but two of these act through the wrench of the
piece: products of its row (wrench, radius, stretch, distance) are summed per view, frame and part, and then mapped to
the unknowns.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from ..body import Body, twist_jacobian
from ..body.kinematics import scene_poses
from ..body.motion import Motion
from ..cameras.camera import Camera
from ..evidence.contours import EDGE_DEVIATION, MODEL_DEVIATION, Lines, outline_lines
from ..evidence.foreground import foreground_images
from ..evidence.gradients import Poses, camera_twist
from ..evidence.label_images import Geometry, render_labels
from ..evidence.part_shapes import SHIFT, STRETCH, shape_columns, stretched
from ..evidence.view_frames import ViewFrames
from ..numerics import rotations

Array = NDArray[np.float64]
Columns = NDArray[np.intp]

POSITION = 0.1
"""Usual error of a camera's position along each axis, metres."""
ROTATION = 0.05
"""Usual error of a camera's orientation about each axis, radians."""
FOCAL = 0.02
"""Usual relative error of a focal length."""
POSED_ROOT = 0.01
"""Usual error of a key pose's root along each axis, metres."""
POSED_JOINT = 0.05
"""Usual error of a key pose's joint about each axis, radians."""
CAMERA = 7
"""Unknowns of a camera: a twist (v, omega) in its axes, metres and radians, and the logarithm of the focal length."""
_SHAPE = 6  # of a part: stretch and shift along its axes
_STRIDE = 2


@dataclass(frozen=True, eq=False)
class Look:
    """What a view shows of the K key frames.

    Attributes
    ----------
    frames : ndarray of int, shape (K,)
        Shot frames.
    pictures : ndarray of uint8, shape (K, h, w, 3)
        Reduced, with the lens's distortion; blue, green, red.
    factor : float
        How much they are reduced.
    delay : float
        See `core.body.time_shift`.
    """

    frames: NDArray[np.int64]
    pictures: NDArray[np.uint8]
    factor: float
    delay: float

    def rectified(self, camera: Camera) -> NDArray[np.uint8]:
        """The pictures as the camera would have taken them without distortion."""
        maps = camera.reduced(self.factor).rectify_maps()
        if maps is None:
            return self.pictures
        return np.stack([cv2.remap(p, *maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE) for p in self.pictures])

    def camera(self, camera: Camera) -> Camera:
        """The camera of the rectified pictures, whose frame k is the k-th key frame."""
        return on_frames(camera, self.frames).reduced(self.factor).rectified()


def on_frames(camera: Camera, frames: NDArray[np.int64]) -> Camera:
    """The camera whose frame k is the k-th of some frames."""
    if not camera.moving:
        return camera
    R, t = zip(*(camera.pose(int(f)) for f in frames), strict=True)
    return replace(camera, R_cam_world=np.stack(R), t_cam_world=np.stack(t))


@dataclass(frozen=True, eq=False)
class State:
    """An estimate of all that is unknown.

    Attributes
    ----------
    cameras : tuple of Camera
        Of the whole footage, one per view.
    bodies : tuple of Body
    geometry : Geometry
        The shapes of all performers' P parts.
    motions : mapping of float to tuple of Motion
        Per performer the K key poses, by the delay of the views that show them.
    change : ndarray, shape (n,)
        Increments since the start: `CAMERA` for every view, six for every part (stretch and shift), D for every key
        pose of every performer.
    """

    cameras: tuple[Camera, ...]
    bodies: tuple[Body, ...]
    geometry: Geometry
    motions: Mapping[float, tuple[Motion, ...]]
    change: Array

    @classmethod
    def start(
        cls, cameras: Sequence[Camera], bodies: Sequence[Body], motions: Mapping[float, tuple[Motion, ...]]
    ) -> State:
        """The estimate to begin with: cameras, the bodies' own shapes, and key poses as they are."""
        frames = len(next(iter(motions.values()))[0])
        size = CAMERA * len(cameras) + sum(_SHAPE * len(body) + frames * body.dof for body in bodies)
        return cls(tuple(cameras), tuple(bodies), Geometry.of(bodies), motions, np.zeros(size))

    @property
    def frames(self) -> int:
        """K."""
        return len(next(iter(self.motions.values()))[0])

    def spans(self) -> list[slice]:
        """The parts of each performer in arrays over all performers' parts."""
        ends = np.cumsum([0] + [len(body) for body in self.bodies]).tolist()
        return [slice(a, b) for a, b in pairwise(ends)]

    def camera_columns(self, view: int) -> Columns:
        """Where a view's camera is in the change, shape (7,)."""
        return CAMERA * view + np.arange(CAMERA)

    def shape_columns(self) -> Columns:
        """Of all parts, shape (P, 6)."""
        first, P = CAMERA * len(self.cameras), len(self.geometry.spans)
        return first + np.arange(_SHAPE * P).reshape(P, _SHAPE)

    def pose_columns(self) -> list[Columns]:
        """Of every performer, shape (K, D)."""
        first = CAMERA * len(self.cameras) + _SHAPE * len(self.geometry.spans)
        ends = first + np.cumsum([0] + [self.frames * body.dof for body in self.bodies])
        return [np.arange(a, b).reshape(self.frames, -1) for a, b in pairwise(ends.tolist())]

    def prior(self) -> Array:
        """Inverse variances of the change, shape (n,)."""
        deviation = np.empty(len(self.change))
        deviation[: CAMERA * len(self.cameras)] = np.tile([POSITION] * 3 + [ROTATION] * 3 + [FOCAL], len(self.cameras))
        deviation[self.shape_columns()] = [STRETCH] * 3 + [SHIFT] * 3
        for columns in self.pose_columns():
            deviation[columns[:, :3]], deviation[columns[:, 3:]] = POSED_ROOT, POSED_JOINT
        return 1 / deviation**2

    def moved(self, step: Array) -> State:
        """The estimate after increments of the unknowns, shape (n,)."""
        cameras = tuple(adjusted(camera, step[self.camera_columns(v)]) for v, camera in enumerate(self.cameras))
        poses = [step[columns] for columns in self.pose_columns()]
        motions = {
            delay: tuple(motion.moved(own) for motion, own in zip(performers, poses, strict=True))
            for delay, performers in self.motions.items()
        }
        geometry = stretched(self.geometry, step[self.shape_columns()])
        return State(cameras, self.bodies, geometry, motions, self.change + step)

    def joints(self, delay: float) -> Array:
        """Joints of all parts on the key frames in the world, shape (K, P, 3)."""
        return scene_poses(self.bodies, self.motions[delay])[1]


def adjusted(camera: Camera, step: Array) -> Camera:
    """A camera that sees the world moved by a twist in its axes, through a longer lens; see `CAMERA`."""
    turn = rotations.exp(step[3:6])
    K = camera.matrix.copy()
    K[:2, :2] *= np.exp(step[6])
    return replace(
        camera,
        matrix=K,
        R_cam_world=rotations.orthonormal(turn @ camera.R_cam_world),
        t_cam_world=camera.t_cam_world @ turn.T + step[:3],
    )


@dataclass(frozen=True, eq=False)
class System:
    """Normal equations of a step, without the prior.

    Attributes
    ----------
    H : ndarray, shape (n, n)
    g : ndarray, shape (n,)
        Less the gradient of half the energy.
    clearness : ndarray, shape (V,)
        How clearly each view shows the performers' outlines beside the model's: what they tell over what sharp ones
        would, 0 to 1.
    """

    H: Array
    g: Array
    clearness: Array

    def step(self, state: State) -> Array:
        """The increments of the unknowns, shape (n,)."""
        prior = state.prior()
        return np.linalg.solve(self.H + np.diag(prior), self.g - prior * state.change)

    def covariance(self, state: State) -> Array:
        """Of the unknowns, shape (n, n)."""
        return np.linalg.inv(self.H + np.diag(state.prior()))


def normal_equations(state: State, looks: Sequence[Look], reach: float, tolerance: float, correlation: float) -> System:
    """Sum the outlines of all views and key frames.

    Parameters
    ----------
    state : State
    looks : sequence of Look
        One per view.
    reach : float
        How far from the model's outlines the body's are looked for, metres.
    tolerance : float
        See `outline_lines`.
    correlation : float
        How long a piece of outline counts as one, metres.
    """
    n = len(state.change)
    H, g, clearness = np.zeros((n, n)), np.zeros(n), np.zeros(len(looks))
    for v, look in enumerate(looks):
        camera, (R, T) = look.camera(state.cameras[v]), scene_poses(state.bodies, state.motions[look.delay])
        lines = key_outlines(look.rectified(state.cameras[v]), camera, state.geometry, (R, T), reach, tolerance)
        clearness[v] = _clearness(lines, camera)
        sums = outline_products(lines, camera, (R, T)) / (correlation * tolerance**2)
        for body, span, pose in zip(state.bodies, state.spans(), state.pose_columns(), strict=True):
            B = _jacobian(body, camera, (R[:, span], T[:, span]))
            B_t, own = np.swapaxes(B, -1, -2), sums[:, span]
            columns = _columns(state.camera_columns(v), state.shape_columns()[span], pose)
            np.add.at(H, (columns[..., :, None], columns[..., None, :]), B_t @ own[..., :-1, :-1] @ B)
            np.add.at(g, columns, (B_t @ own[..., :-1, -1:])[..., 0])
    return System(H, g, clearness)


def _columns(camera: Columns, shape: Columns, pose: Columns) -> Columns:
    """The unknowns that the rows of every frame and part depend on, shape (K, P, 13 + D)."""
    K, P = len(pose), len(shape)
    parts = [np.broadcast_to(a, (K, P, a.shape[-1])) for a in (camera, shape, pose[:, None])]
    return np.concatenate(parts, axis=-1)


def key_outlines(
    pictures: NDArray[np.uint8],
    camera: Camera,
    geometry: Geometry,
    poses: Poses,
    reach: float,
    tolerance: float,
    sure: Geometry | None = None,
) -> Lines:
    """The outlines in the key frames' pictures, by the colours that the poses show now.

    Parameters
    ----------
    sure : Geometry, optional
        Solids that are all within the performers', for their colours; by default they are those of `geometry`.
    """
    body = render_labels(geometry, camera, 0, *poses).part >= 0
    core = body if sure is None else render_labels(sure, camera, 0, *poses).part >= 0
    scale = ViewFrames(camera, pictures[..., 0], 0).pixels_per_metre(poses[1].mean(axis=(0, 1)), 0)
    still, masks = camera.stands_still, dict(enumerate(body))
    foreground = foreground_images(pictures, masks, scale, still, dict(enumerate(core)))
    labels = render_labels(geometry, camera.subsampled(_STRIDE), 0, *poses)
    half = max(4, round(reach * scale))
    return outline_lines(camera, foreground, labels, stride=_STRIDE, reach=half, tolerance=tolerance)


def _clearness(lines: Lines, camera: Camera) -> float:
    """What outlines tell over what sharp edges in their places would."""
    model = MODEL_DEVIATION * camera.matrix[[0, 1], [0, 1]].mean() / lines.points_cam[:, 2]
    sharp = lines.length / (model**2 + EDGE_DEVIATION**2)
    return float((lines.weight * lines.length).sum() / sharp.sum()) if len(sharp) else 0.0


def outline_products(lines: Lines, camera: Camera, poses: Poses) -> Array:
    """Products of the lines' rows per frame and part, shape (K, P, 11, 11).

    A row is the wrench in camera axes (6), the shift by the focal length's logarithm, that by the part's stretches (3),
    and the shift itself.
    """
    wrench = lines.wrenches(camera)
    radial = ((lines.uv - camera.matrix[:2, 2]) * lines.normal).sum(axis=1)
    stretch, _ = shape_columns(lines, wrench, camera, poses)
    return lines.products(np.column_stack([wrench, radial, stretch, lines.shift]), *poses[1].shape[:2])


def _jacobian(body: Body, camera: Camera, poses: Poses) -> Array:
    """A row's first ten by camera, part shape and key pose of one performer, shape (K, P, 10, 13 + D)."""
    (R, T), (Rc, tc) = poses, camera.poses(0, len(poses[0]))
    known = CAMERA + 3
    B = np.zeros((*T.shape[:2], known, CAMERA + _SHAPE + body.dof))
    B[..., range(known), range(known)] = 1
    B[..., :3, known : known + 3] = Rc[:, None] @ R
    B[..., :6, known + 3 :] = camera_twist(Rc, tc)[:, None] @ twist_jacobian(body, R, T)
    return B
