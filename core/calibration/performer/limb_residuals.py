"""Residuals of a performer's joints in the pictures and of the lengths of its limbs, and their sparse Jacobian."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from scipy import sparse

from ...body.human import FRACTIONS
from ...body.limbs import MAIN_JOINTS
from ...numerics.arrays import Array, Bools, Ints
from ...numerics.normal_equations import SparseEquations
from ...numerics.robust_kernels import Cauchy
from ...numerics.rotations import skew
from ..solving.camera_rig import CAMERA_DOF, FOCAL, SHIFT, TURN, Rig

JOINTS = tuple(f"{side}{joint}" for joint in MAIN_JOINTS for side in "RL")
"""The joints that are used."""
LIMB_ENDS: Mapping[str, tuple[tuple[str, str], ...]] = MappingProxyType(
    {
        "shin": (("RKnee", "RAnkle"), ("LKnee", "LAnkle")),
        "thigh": (("RHip", "RKnee"), ("LHip", "LKnee")),
        "forearm": (("RElbow", "RWrist"), ("LElbow", "LWrist")),
        "upper_arm": (("RShoulder", "RElbow"), ("LShoulder", "LElbow")),
        "hip_width": (("RHip", "LHip"),),
        "shoulder_width": (("RShoulder", "LShoulder"),),
    }
)
"""Pairs of joints at a constant distance, by the measure of the body for this distance."""
LENGTH_SIGMA = 0.02
"""Standard deviation of a limb's length as detected, metres: a detector's joints do not lie exactly at its ends."""
PROPORTION_SIGMA = 0.08
"""Standard deviation of people's proportions, as a share."""
USUAL_FOCAL, LOG_FOCAL_SIGMA = 0.9, 0.35
"""Usual focal length of a camera, as a share of the picture's longer side, and the standard deviation of its logarithm.
"""
_ROBUST_SCALE = 3.0
"""Scale of the robust kernel, in standard deviations."""
_MIN_DEPTH = 0.1  # metres


@dataclass(frozen=True, eq=False)
class JointSightings:
    """The joints of one performer as seen by the views, on F frames.

    Attributes
    ----------
    cameras : tuple of str, length V
    sizes : ndarray of int, shape (V, 2)
        Width and height of the pictures, pixels.
    frames : ndarray of int, shape (F,)
        Shot frames, increasing.
    points : ndarray, shape (V, F, L, 2)
        Positions of `JOINTS`, pixels, without lens distortion if the lens is known; NaN where a joint was not found.
    confidence : ndarray, shape (V, F, L)
        0 to 1.
    correlated : float
        How many neighbouring frames (of the F) have the same error, and therefore count as one.
    """

    cameras: tuple[str, ...]
    sizes: Ints
    frames: Ints
    points: Array
    confidence: Array
    correlated: float = 1.0


@dataclass(frozen=True, eq=False)
class JointScene:
    """The unknowns of the adjustment: cameras, joints and lengths of limbs.

    Attributes
    ----------
    rig : Rig
    joints_world : ndarray, shape (F, L, 3)
        Metres; NaN where a joint is not seen by two views.
    lengths : ndarray, shape (K,)
        Lengths of the limbs in the order of `LIMB_ENDS`, metres.
    """

    rig: Rig
    joints_world: Array
    lengths: Array

    def moved(self, step: Array) -> JointScene:
        """Return the scene after a step, which has the order: known joints, logarithms of the lengths, cameras."""
        known = np.isfinite(self.joints_world).all(axis=-1)
        joints, lengths, cameras = np.split(step, np.cumsum([3 * known.sum(), len(self.lengths)]))
        points = self.joints_world.copy()
        points[known] += joints.reshape(-1, 3)
        rig = self.rig.moved(cameras.reshape(-1, CAMERA_DOF))
        return JointScene(rig, points, self.lengths * np.exp(lengths))


def usual_lengths(height: float) -> Array:
    """Lengths of an average person's limbs in the order of `LIMB_ENDS`, metres, shape (n,)."""
    return np.array([FRACTIONS[limb] * height for limb in LIMB_ENDS])


def pictured(scene: JointScene, seen: JointSightings) -> tuple[Array, Array, Array]:
    """View, frame and joint (n, 3) of every sighting of a known joint, its position in camera axes, and its
    residual.
    """
    known = np.isfinite(scene.joints_world).all(axis=-1)
    there = np.isfinite(seen.points).all(axis=-1) & (seen.confidence > 0) & known
    v, f, j = np.nonzero(there)
    rig = scene.rig
    x = np.einsum("nij,nj->ni", rig.R_cam_world[v], scene.joints_world[f, j]) + rig.t_cam_world[v]
    x[:, 2] = np.maximum(x[:, 2], _MIN_DEPTH)
    residual = rig.focal[v] * x[:, :2] / x[:, 2:] + rig.centre[v] - seen.points[v, f, j]
    return np.stack([v, f, j], axis=1), x, residual


@dataclass(frozen=True, eq=False)
class _ResidualRows:
    """Residuals in standard deviations, multiplied by the square roots of their robust weights.

    Attributes
    ----------
    residual : ndarray, shape (m,)
    columns : ndarray of int, shape (m, k)
        The unknowns on which each residual depends.
    derivatives : ndarray, shape (m, k)
    cost : float
    """

    residual: Array
    columns: Ints
    derivatives: Array
    cost: float

    def matrix(self, unknowns: int) -> sparse.csr_array:
        """Return the Jacobian, shape (m, unknowns)."""
        m, k = self.columns.shape
        starts = k * np.arange(m + 1)
        return sparse.csr_array((self.derivatives.ravel(), self.columns.ravel(), starts), (m, unknowns))


@dataclass(frozen=True, eq=False)
class Columns:
    """Indices of the unknowns: the joints' positions, the lengths, the cameras.

    Attributes
    ----------
    joint : ndarray of int, shape (F, L)
        Index of the first of a joint's three; -1 where the joint is not known.
    length, camera : int
        Index of the first length and of the first camera's first unknown.
    count : int
    """

    joint: Ints
    length: int
    camera: int
    count: int

    @classmethod
    def of(cls, scene: JointScene) -> Columns:
        """Return the indices of a scene's unknowns."""
        known = np.isfinite(scene.joints_world).all(axis=-1)
        joint = np.where(known, 3 * (np.cumsum(known.ravel()).reshape(known.shape) - 1), -1)
        length = 3 * int(known.sum())
        camera = length + len(scene.lengths)
        return cls(joint, length, camera, camera + CAMERA_DOF * len(scene.rig))

    def places(self, frames: Ints, joints: Ints | int) -> Ints:
        """Columns of joints on frames, shape (n, 3)."""
        return np.asarray(self.joint[frames, joints][:, None] + np.arange(3))


def joint_equations(
    scene: JointScene, seen: JointSightings, height: float, *, noise: Array, free: Bools
) -> SparseEquations:
    """Return the Gauss-Newton equations of the free unknowns at a scene, with its robust sum of squares as their cost.

    Parameters
    ----------
    scene : JointScene
    seen : JointSightings
    height : float
        Of the performer, metres.
    noise : ndarray, shape (V,)
        Standard deviation of each view's joints, pixels.
    free : ndarray of bool, shape (unknowns,)
        In the order of `JointScene.moved`.
    """
    columns = Columns.of(scene)
    usual = usual_lengths(height)
    rows = [_sighting_rows(scene, seen, noise, columns), *_limb_rows(scene, usual, seen.correlated, columns)]
    build = np.log(scene.lengths / usual) / PROPORTION_SIGMA
    own = columns.length + np.arange(len(usual))[:, None]
    rows.append(_ResidualRows(build, own, np.full(own.shape, 1 / PROPORTION_SIGMA), float((build**2).sum())))
    lens = np.log(scene.rig.focal.mean(axis=1) / (USUAL_FOCAL * seen.sizes.max(axis=1))) / LOG_FOCAL_SIGMA
    own = (columns.camera + CAMERA_DOF * np.arange(len(lens)) + FOCAL)[:, None]
    rows.append(_ResidualRows(lens, own, np.full(own.shape, 1 / LOG_FOCAL_SIGMA), float((lens**2).sum())))
    J = sparse.vstack([block.matrix(columns.count) for block in rows]).tocsc()[:, np.flatnonzero(free)]
    residual = np.concatenate([block.residual for block in rows])
    return SparseEquations((J.T @ J).tocsc(), J.T @ residual, sum(block.cost for block in rows))


def _sighting_rows(scene: JointScene, seen: JointSightings, noise: Array, columns: Columns) -> _ResidualRows:
    """Residuals of joints in the pictures."""
    kernel, rig = Cauchy(_ROBUST_SCALE), scene.rig
    index, x, off = pictured(scene, seen)
    v, f, j = index.T
    sigma = (noise[v] * np.sqrt(seen.correlated / seen.confidence[v, f, j]))[:, None]
    image = np.zeros((len(v), 2, 3))
    image[:, [0, 1], [0, 1]] = rig.focal[v] / x[:, 2:]
    image[:, :, 2] = -rig.focal[v] * x[:, :2] / x[:, 2:] ** 2
    camera = np.zeros((len(v), 2, CAMERA_DOF))
    camera[:, :, TURN] = -image @ skew(x)
    camera[:, :, SHIFT] = image
    camera[:, :, FOCAL] = rig.focal[v] * x[:, :2] / x[:, 2:]
    derivatives = np.concatenate([image @ rig.R_cam_world[v], camera], axis=2) / sigma[..., None]
    own = columns.camera + CAMERA_DOF * v[:, None] + np.arange(CAMERA_DOF)
    places = np.concatenate([columns.places(f, j), own], axis=1)
    scaled = off / sigma
    squared = (scaled**2).sum(axis=1)
    root = np.sqrt(kernel.weight(squared))[:, None]
    return _ResidualRows(
        np.ravel(root * scaled),
        np.repeat(places, 2, axis=0),
        np.concatenate(list(root[..., None] * derivatives)) if len(v) else np.zeros((0, places.shape[1])),
        float(kernel.cost(squared).sum()),
    )


def _limb_rows(scene: JointScene, usual: Array, correlated: float, columns: Columns) -> Iterator[_ResidualRows]:
    """Residuals of the limbs' lengths, relative to the lengths: in metres, a smaller scene would fit better."""
    kernel = Cauchy(_ROBUST_SCALE)
    for k, pairs in enumerate(LIMB_ENDS.values()):
        sigma = LENGTH_SIGMA / usual[k] * np.sqrt(correlated)
        for pair in pairs:
            a, b = (JOINTS.index(name) for name in pair)
            both = np.flatnonzero((columns.joint[:, [a, b]] >= 0).all(axis=1))
            apart = scene.joints_world[both, a] - scene.joints_world[both, b]
            length = np.maximum(np.linalg.norm(apart, axis=1), 1e-6)
            off = np.log(length / scene.lengths[k]) / sigma
            way = apart / (length**2 * sigma)[:, None]
            own = np.full((len(both), 1), columns.length + k)
            places = np.concatenate([columns.places(both, a), columns.places(both, b), own], axis=1)
            derivatives = np.concatenate([way, -way, np.full(own.shape, -1 / sigma)], axis=1)
            root = np.sqrt(kernel.weight(off**2))
            yield _ResidualRows(root * off, places, root[:, None] * derivatives, float(kernel.cost(off**2).sum()))
