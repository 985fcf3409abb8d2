"""Cameras, part shapes and key poses as the unknowns of one fit to the outlines of the key frames.

A distance between an outline and the model's is removed by moving the camera, changing its focal length, stretching or
shifting the part, or changing the pose. All of these but focal length and stretch act through the wrench of the piece
of outline. The products of its row (wrench, radius, stretch, distance) are therefore summed per view, frame and part,
and then mapped to the unknowns.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, MutableMapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ...body import Body, twist_jacobian
from ...body.kinematics import Poses, scene_poses
from ...body.motion import Motion
from ...cameras.camera import Camera
from ...evidence.gradient_evidence.image_wrenches import camera_twist
from ...evidence.outline_evidence.held_outlines import HeldOutlines
from ...evidence.outline_evidence.outline_lines import EDGE_SIGMA, MODEL_SIGMA, Lines
from ...evidence.part_shapes import SHIFT_SIGMA, STRETCH_SIGMA, stretched
from ...evidence.rendering.part_geometry import Geometry
from ...numerics import rotations
from ...numerics.arrays import Array, slices_of
from ...numerics.normal_equations import DenseEquations
from ...runtime.threads import worker_count
from ..body_estimate import PART_DOF
from ..key_frame_views import KeyFrameView
from ..outline_fit import RefinementStage, key_foreground, key_outlines, outline_products

Columns = NDArray[np.intp]

POSITION_SIGMA = 0.1
"""Prior standard deviation of a camera's position along each axis, metres."""
ROTATION_SIGMA = 0.05
"""Prior standard deviation of a camera's orientation about each axis, radians."""
FOCAL_SIGMA = 0.02
"""Prior standard deviation of a focal length, relative."""
POSED_ROOT_SIGMA = 0.01
"""Prior standard deviation of a key pose's root along each axis, metres."""
POSED_JOINT_SIGMA = 0.05
"""Prior standard deviation of a key pose's joint about each axis, radians."""
CAMERA_DOF = 7
"""Number of unknowns of a camera: a twist (v, omega) in its axes, metres and radians, and the logarithm of its focal
length."""


@dataclass(frozen=True, eq=False)
class CameraState:
    """An estimate of all unknowns.

    Attributes
    ----------
    cameras : tuple of Camera
        One per view, for all frames of the footage.
    bodies : tuple of Body
    geometry : Geometry
        The shapes of all performers' P parts.
    motions : mapping of float to tuple of Motion
        The K key poses per performer, by the delay of the views that show them.
    change : ndarray, shape (n,)
        Change of the unknowns since the start: `CAMERA_DOF` for every view, six for every part (stretch and shift), D
        for every key pose of every performer.
    """

    cameras: tuple[Camera, ...]
    bodies: tuple[Body, ...]
    geometry: Geometry
    motions: Mapping[float, tuple[Motion, ...]]
    change: Array

    @classmethod
    def start(
        cls, cameras: Sequence[Camera], bodies: Sequence[Body], motions: Mapping[float, tuple[Motion, ...]]
    ) -> CameraState:
        """Return the estimate before any change."""
        frames = len(next(iter(motions.values()))[0])
        size = CAMERA_DOF * len(cameras) + sum(PART_DOF * len(body) + frames * body.dof for body in bodies)
        return cls(tuple(cameras), tuple(bodies), Geometry.of(bodies), motions, np.zeros(size))

    @property
    def frames(self) -> int:
        """Number K of key frames."""
        return len(next(iter(self.motions.values()))[0])

    def spans(self) -> list[slice]:
        """Return the slice of each performer in arrays over all performers' parts."""
        return slices_of(len(body) for body in self.bodies)

    def camera_columns(self, view: int) -> Columns:
        """Return the columns of a view's camera, shape (7,)."""
        return CAMERA_DOF * view + np.arange(CAMERA_DOF)

    def shape_columns(self) -> Columns:
        """Return the columns of the shapes of all parts, shape (P, 6)."""
        first, P = CAMERA_DOF * len(self.cameras), len(self.geometry.spans)
        return first + np.arange(PART_DOF * P).reshape(P, PART_DOF)

    def pose_columns(self) -> list[Columns]:
        """Return the columns of every performer's key poses, shape (K, D) each."""
        first = CAMERA_DOF * len(self.cameras) + PART_DOF * len(self.geometry.spans)
        ends = first + np.cumsum([0] + [self.frames * body.dof for body in self.bodies])
        return [np.arange(a, b).reshape(self.frames, -1) for a, b in pairwise(ends.tolist())]

    def prior(self) -> Array:
        """Return the prior's inverse variances of the change, shape (n,)."""
        deviation = np.empty(len(self.change))
        deviation[: CAMERA_DOF * len(self.cameras)] = np.tile(
            [POSITION_SIGMA] * 3 + [ROTATION_SIGMA] * 3 + [FOCAL_SIGMA], len(self.cameras)
        )
        deviation[self.shape_columns()] = [STRETCH_SIGMA] * 3 + [SHIFT_SIGMA] * 3
        for columns in self.pose_columns():
            deviation[columns[:, :3]], deviation[columns[:, 3:]] = POSED_ROOT_SIGMA, POSED_JOINT_SIGMA
        return 1 / deviation**2

    def moved(self, step: Array) -> CameraState:
        """Return the estimate after a step of the unknowns, shape (n,)."""
        cameras = tuple(adjusted(camera, step[self.camera_columns(v)]) for v, camera in enumerate(self.cameras))
        poses = [step[columns] for columns in self.pose_columns()]
        motions = {
            delay: tuple(motion.moved(own) for motion, own in zip(performers, poses, strict=True))
            for delay, performers in self.motions.items()
        }
        geometry = stretched(self.geometry, step[self.shape_columns()])
        return CameraState(cameras, self.bodies, geometry, motions, self.change + step)

    def joints(self, delay: float) -> Array:
        """Return the joints of all parts on the key frames, world frame, metres, shape (K, P, 3)."""
        return scene_poses(self.bodies, self.motions[delay])[1]


def adjusted(camera: Camera, step: Array) -> Camera:
    """Return a camera after a change of its seven unknowns, see `CAMERA_DOF`; the twist moves the world in its axes."""
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
class CameraEquations(DenseEquations):
    """Normal equations at a `CameraState`, with the priors.

    Attributes
    ----------
    clearness : ndarray, shape (V,)
        How clearly each view shows the performers' outlines near the model's: their information relative to that of
        sharp outlines, 0 to 1.
    cost_at : callable
        Returns the cost of another state with the same outlines.
    """

    clearness: Array
    cost_at: Callable[[CameraState], float]


@dataclass(frozen=True, eq=False)
class _SeenOutlines:
    """The outlines that a view shows near the model's.

    Attributes
    ----------
    camera : Camera
        The view's, on the key frames.
    poses : tuple of ndarray
        Of all parts on the key frames, as the view shows them.
    lines : Lines
    products : ndarray, shape (K, P, 11, 11)
        See `outline_products`; divided by the variance of the distances.
    """

    camera: Camera
    poses: Poses
    lines: Lines
    products: Array


def camera_equations(
    state: CameraState,
    stage: RefinementStage,
    views: Sequence[KeyFrameView],
    learned: MutableMapping[int, NDArray[np.uint8]],
) -> CameraEquations:
    """Sum the outlines of all views and key frames.

    Parameters
    ----------
    state : CameraState
    stage : RefinementStage
    views : sequence of KeyFrameView
    learned : mapping of int to ndarray of uint8, shape (K, h, w)
        Foreground images by the index of the view; those that are missing are made, and added if the stage learns once.
    """
    n, precision = len(state.change), stage.precision()
    with ThreadPoolExecutor(worker_count()) as pool:
        seen = list(pool.map(lambda v: _seen_outlines(state, stage, v, views[v], learned), range(len(views))))
    H, g = np.zeros((n, n)), np.zeros(n)
    for v, outlines in enumerate(seen):
        _add_outlines(H, g, state, v, outlines)
    prior = state.prior()
    held = [HeldOutlines.at(own.lines, own.camera, own.poses, precision) for own in seen]
    cost_at = partial(_cost, state, views, held)
    clearness = np.array([_clearness(own.lines, own.camera) for own in seen])
    return CameraEquations(H + np.diag(prior), g + prior * state.change, cost_at(state), clearness, cost_at)


def _seen_outlines(
    state: CameraState,
    stage: RefinementStage,
    v: int,
    view: KeyFrameView,
    learned: MutableMapping[int, NDArray[np.uint8]],
) -> _SeenOutlines:
    """Look for the outlines that view v shows."""
    camera, poses = view.camera(state.cameras[v]), scene_poses(state.bodies, state.motions[view.delay])
    if (foreground := learned.get(v)) is None:
        pictures = view.rectified(state.cameras[v])
        foreground = key_foreground(pictures, camera, state.geometry, poses, stage)
        if stage.learns_once:
            learned[v] = foreground
    lines = key_outlines(foreground, camera, state.geometry, poses, stage)
    return _SeenOutlines(camera, poses, lines, stage.precision() * outline_products(lines, camera, poses))


def _add_outlines(H: Array, g: Array, state: CameraState, v: int, outlines: _SeenOutlines) -> None:
    """Add what view v shows to the matrix, shape (n, n), and the gradient, shape (n,), of the normal equations."""
    R, T = outlines.poses
    for body, span, pose in zip(state.bodies, state.spans(), state.pose_columns(), strict=True):
        B = _jacobian(body, outlines.camera, (R[:, span], T[:, span]))
        B_t, own = np.swapaxes(B, -1, -2), outlines.products[:, span]
        columns = _columns(state.camera_columns(v), state.shape_columns()[span], pose)
        np.add.at(H, (columns[..., :, None], columns[..., None, :]), B_t @ own[..., :-1, :-1] @ B)
        np.add.at(g, columns, -(B_t @ own[..., :-1, -1:])[..., 0])


def _cost(state: CameraState, views: Sequence[KeyFrameView], held: Sequence[HeldOutlines], other: CameraState) -> float:
    """Return the cost of another state with the outlines that were found at this one."""
    parts = (other.change - state.change)[state.shape_columns()]
    cost = float(other.prior() @ other.change**2)
    for outlines, view, camera in zip(held, views, other.cameras, strict=True):
        cost += outlines.cost(view.camera(camera), scene_poses(other.bodies, other.motions[view.delay]), parts)
    return cost


def _columns(camera: Columns, shape: Columns, pose: Columns) -> Columns:
    """Return the columns that the rows of every frame and part depend on, shape (K, P, 13 + D)."""
    K, P = len(pose), len(shape)
    parts = [np.broadcast_to(a, (K, P, a.shape[-1])) for a in (camera, shape, pose[:, None])]
    return np.concatenate(parts, axis=-1)


def _clearness(lines: Lines, camera: Camera) -> float:
    """Return the information in outlines, relative to that of sharp edges in their places."""
    model = MODEL_SIGMA * camera.matrix[[0, 1], [0, 1]].mean() / lines.points_cam[:, 2]
    sharp = lines.length / (model**2 + EDGE_SIGMA**2)
    return float((lines.weight * lines.length).sum() / sharp.sum()) if len(sharp) else 0.0


def _jacobian(body: Body, camera: Camera, poses: Poses) -> Array:
    """Return the derivatives of a row's first ten values by camera, part shape and key pose of one performer, shape
    (K, P, 10, 13 + D).
    """
    (R, T), (Rc, tc) = poses, camera.poses(0, len(poses[0]))
    known = CAMERA_DOF + 3
    B = np.zeros((*T.shape[:2], known, CAMERA_DOF + PART_DOF + body.dof))
    B[..., range(known), range(known)] = 1
    B[..., :3, known : known + 3] = Rc[:, None] @ R
    B[..., :6, known + 3 :] = camera_twist(Rc, tc)[:, None] @ twist_jacobian(body, R, T)
    return B
