"""Posing by clicks: the pose that meets clicked joints with the least movement from a given pose.

A click is a 2D keypoint of one view. A joint clicked in several views lies where their rays meet. What a single view
does not show stays as it was: every degree of freedom is drawn to the given pose in proportion to the mass that it
moves, and landmarks clicked in one view alone keep their depth.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from ..body import Body, part_poses, point_jacobian
from ..body.inverse_kinematics import fit_poses
from ..body.joint_limits import posture_prior
from ..body.kinematics import Poses
from ..body.motion import Motion
from ..body.smoothness import limited
from ..cameras.camera import Camera
from ..errors import KeypointError
from ..keypoints.keypoint_factor import keypoint_system
from ..keypoints.keypoint_offsets import KeypointOffsets, has_keypoint
from ..keypoints.keypoint_rays import Keypoints
from ..keypoints.triangulation import triangulate
from ..numerics import rotations
from ..numerics.arrays import Array
from ..numerics.banded_blocks import BandedBlocks, block_diagonal, with_translation
from ..numerics.least_squares import Damping, StoppingRule, minimise
from ..numerics.normal_equations import BandedEquations
from ..runtime.threads import one_library_thread
from .standing import FLOATING_COST, FLOATING_HEIGHT, is_from_one_view, lowest_point, steps_to_floor

CLICK_SIGMA = 0.008
"""Standard deviation of a click, metres across the ray: a pixel or two if the person fills the picture."""
MOVEMENT_SIGMA = 0.05
"""Standard deviation of the whole body's movement from the given pose, metres. A joint's rotation is weighted by the
radius at which the whole body would have to turn to move as much."""
MIN_RADIUS = 0.03
"""Least such radius, metres, so that hands and feet, too, turn no more than necessary."""
DEPTH_SIGMA = 0.1
"""Standard deviation of the depth of a landmark clicked in one view alone, metres."""
MAX_STEPS, TRIAL_STEPS = 40, 10
"""Largest number of steps of a fit, and of a trial fit that is only compared with others."""
MIN_GAIN = 1e-4
"""A fit ends when a step lowers the energy by less than this, relative."""
MAX_CLICK_ENERGY = 10.0
"""Energy per click, in squared standard deviations, above which other starting poses are tried."""
MIN_CLICKS = 4
"""Number of clicks that is enough to show which way the body faces."""


@dataclass(frozen=True)
class Click:
    """The position of a landmark in a view: a pixel of the undistorted picture, integers at pixel centres."""

    camera: Camera
    landmark: str
    pixel: tuple[float, float]


@dataclass(frozen=True, eq=False)
class ClickFit:
    """A pose fitted to clicks.

    Attributes
    ----------
    pose : Motion
        One pose.
    given : Motion
        The pose from which it moved least: the solver's given pose, or that pose moved as a whole if it was far off.
    misfit : float
        Root mean square distance of the clicked landmarks from their rays, metres; 0 without clicks.
    energy : float
        Cost of clicks, joint limits and movement, in squared standard deviations.
    """

    pose: Motion
    given: Motion
    misfit: float = 0.0
    energy: float = 0.0


def click_keypoints(clicks: Sequence[Click], frame: int) -> Keypoints:
    """Return clicks as keypoints of one frame.

    Parameters
    ----------
    clicks : sequence of Click
        At most one per landmark and view; views are distinguished by the names of their cameras.
    frame : int
        Shot frame, which matters for moving cameras.
    """
    cameras = {click.camera.name: click.camera for click in clicks}
    views, names = list(cameras), list(dict.fromkeys(click.landmark for click in clicks))
    rays = np.full((len(views), 1, len(names), 2), np.nan)
    for click in clicks:
        rays[views.index(click.camera.name), 0, names.index(click.landmark)] = ray(click.camera.matrix, click.pixel)
    poses = [camera.pose(frame) for camera in cameras.values()]
    R = np.array([R for R, _ in poses]).reshape(-1, 1, 3, 3)
    t = np.array([t for _, t in poses]).reshape(-1, 1, 3)
    return Keypoints(tuple(names), rays, np.isfinite(rays).all(axis=-1).astype(float), R, t)


def ray(matrix: Array, pixel: Sequence[float]) -> Array:
    """Return the normalised image coordinates (x / z, y / z), shape (2,), of a pixel of the undistorted picture.

    Parameters
    ----------
    matrix : ndarray, shape (3, 3)
        The camera's intrinsic matrix.
    pixel : sequence of float, length 2
    """
    x, y, w = np.linalg.solve(matrix, [*pixel, 1.0])
    return np.asarray(np.array([x, y]) / w)


def pixel(matrix: Array, place: Sequence[float]) -> Array:
    """Return the pixel of the undistorted picture at normalised image coordinates, shape (2,); inverse of `ray`."""
    return (matrix @ [*place, 1.0])[:2]


class ClickSolver:
    """Fits poses of one body to clicks.

    Parameters
    ----------
    body : Body
    given : Motion
        One pose, from which fits move as little as possible.
    held : ndarray of bool, shape (D,), optional
        Degrees of freedom that must not change.
    floor : float, optional
        Height of the floor in the world frame, metres, where it is known: in one view, a pose that floats above it is
        put on its feet if that fits nearly as well.
    """

    def __init__(
        self, body: Body, given: Motion, held: NDArray[np.bool_] | None = None, floor: float | None = None
    ) -> None:
        self.body, self.given, self.floor = body, given, floor
        locked = np.zeros(body.dof, bool) if held is None else held.copy()
        locked[3:] |= (body.limits[..., 0] == body.limits[..., 1]).ravel()
        self._held = locked[None]
        self._precision = movement_precision(body)

    def fit(
        self, clicks: Keypoints, start: ClickFit | None = None, steps: int = MAX_STEPS, search: bool = True
    ) -> ClickFit:
        """Fit a pose to clicks.

        Parameters
        ----------
        clicks : Keypoints
            On one frame.
        start : ClickFit, optional
            An earlier fit to begin from; by default the given pose.
        steps : int
            Largest number of steps; a few are enough while a click is being dragged.
        search : bool
            Whether to try other starting poses if the fit is poor: facing other ways, and from triangulated landmarks.

        Raises
        ------
        KeypointError
            The body has no such landmark.
        """
        for name in clicks.names:
            if not has_keypoint(self.body, name):
                raise KeypointError(f"the body has no landmark '{name}'", todo="take its mark away")
        if not clicks.confidence.any():
            return ClickFit(self.given, self.given)
        with one_library_thread():
            return self._fitted(clicks, ClickFit(self.given, self.given) if start is None else start, steps, search)

    def _fitted(self, clicks: Keypoints, begin: ClickFit, steps: int, search: bool) -> ClickFit:
        problem = _Problem(self.body, clicks, self._held, begin.given, self._precision, 1 / DEPTH_SIGMA**2)
        best = problem.descended(begin.pose, steps)
        count = clicks.confidence.sum()
        if search and count >= MIN_CLICKS and best.energy > MAX_CLICK_ENERGY * count and not self._held[0, :6].any():
            others = [replace(problem, given=g).descended(g, TRIAL_STEPS) for g in self._elsewhere(problem)]
            other = min(others, key=lambda fit: fit.energy)
            if other.energy < best.energy:
                best = replace(problem, given=other.given).descended(other.pose, steps)
        return self._standing(problem, best, steps) if search and count >= MIN_CLICKS else best

    def _standing(self, problem: _Problem, fit: ClickFit, steps: int) -> ClickFit:
        """Return a fit in one view; if it floats above the floor, one that stands there and fits nearly as well."""
        if self.floor is None or self._held[0, :6].any() or not is_from_one_view(problem.clicks):
            return fit
        height = self._height(fit.pose)
        if height < FLOATING_HEIGHT:
            return fit
        found = []
        for step in steps_to_floor(self.body, problem.clicks, fit.pose, self.floor):
            given, pose = (replace(m, translations=m.translations + step) for m in (fit.given, fit.pose))
            found.append(replace(problem, given=given).descended(pose, steps))
        standing = [other for other in found if abs(self._height(other.pose)) < height / 2]
        best = min(standing, key=lambda other: other.energy, default=fit)
        return best if best.energy < fit.energy + FLOATING_COST else fit

    def _height(self, pose: Motion) -> float:
        """Return how high the lowest point of a pose is above the floor, metres."""
        return float(lowest_point(self.body, pose)[0] - (self.floor or 0.0))

    def _elsewhere(self, problem: _Problem) -> list[Motion]:
        """Return other starting poses: the given one moved as a whole and facing other ways, and one fitted to the
        landmarks that two or more views show.
        """
        stiff = np.ones_like(self._held)
        stiff[:, :6] = False
        rigid = replace(problem, held=stiff, precision=0 * self._precision, depth=0.0)
        upright = self.body.R_parent_rest[0]
        found = []
        for angle in np.pi * np.array([0.0, 0.5, 1.0, -0.5]):
            Q = self.given.rotations.copy()
            Q[:, 0] = upright.T @ rotations.exp(np.array([0.0, 0.0, angle])) @ upright @ Q[:, 0]
            found.append(rigid.descended(rigid.nearest(Motion(self.given.translations, Q)), TRIAL_STEPS).pose)
        points, _ = triangulate(problem.clicks)
        known = [i for i, name in enumerate(problem.clicks.names) if name in self.body.landmarks]
        if np.isfinite(points[0, known]).all(axis=-1).sum() >= MIN_CLICKS:
            found.append(fit_poses(self.body, [problem.clicks.names[i] for i in known], points[:, known]))
        # Held joints keep their given rotations, whatever the search proposes.
        return [self.given.moved(np.where(self._held, 0.0, self.given.difference(pose))) for pose in found]


@dataclass(frozen=True, eq=False)
class _Problem:
    """Least squares of clicks, joint limits and movement over the degrees of freedom that are not held.

    Attributes
    ----------
    body : Body
    clicks : Keypoints
        On one frame.
    held : ndarray of bool, shape (1, D)
    given : Motion
        The pose from which it moves as little as possible.
    precision : ndarray, shape (D,)
        Of this movement, see `movement_precision`.
    depth : float
        Inverse variance of the depth of landmarks clicked in one view alone, metres^-2.
    """

    body: Body
    clicks: Keypoints
    held: NDArray[np.bool_]
    given: Motion
    precision: Array
    depth: float

    def descended(self, pose: Motion, steps: int) -> ClickFit:
        """Run Levenberg-Marquardt from a pose."""
        stopping: StoppingRule[Motion] = StoppingRule(iterations=steps, relative_gain=MIN_GAIN)
        found = minimise(pose, self._linearised, _moved, damping=Damping(initial=1e-3), stopping=stopping)
        misses = np.linalg.norm(self._residuals(part_poses(self.body, found.state)), axis=-1)[self._seen]
        return ClickFit(found.state, self.given, float(np.sqrt(np.mean(misses**2))), found.cost)

    def nearest(self, pose: Motion) -> Motion:
        """Return the pose translated, not turned, to where its clicked landmarks are nearest to their rays."""
        across, seen = self.clicks.across(), self._seen.astype(float)
        x = np.einsum("vfab,flb->vfla", self.clicks.R_cam_world, self._places.world(part_poses(self.body, pose)))
        x += self.clicks.t_cam_world[:, :, None]
        residual = x[..., :2] - np.nan_to_num(self.clicks.rays) * x[..., 2:]
        H = np.einsum("vflka,vfl,vflkb->ab", across, seen, across)
        g = np.einsum("vflka,vfl,vflk->a", across, seen, residual)
        return replace(pose, translations=pose.translations - np.linalg.lstsq(H, g, rcond=1e-6)[0])

    @property
    def _places(self) -> KeypointOffsets:
        return KeypointOffsets.on(self.body, self.clicks.names)

    @property
    def _seen(self) -> NDArray[np.bool_]:
        return self.clicks.confidence > 0

    def _residuals(self, poses: Poses) -> Array:
        """Return the distances of landmarks from their rays, metres; infinite behind the camera."""
        return np.nan_to_num(self.clicks.residuals(self._places.world(poses)), nan=np.inf)

    def _linearised(self, pose: Motion) -> BandedEquations:
        poses = part_poses(self.body, pose)
        weights = self.clicks.confidence / CLICK_SIGMA**2
        blocks = keypoint_system(self.body, poses, self.clicks, self._places, weights).blocks
        blocks = blocks + posture_prior(self.body, pose, rest=False) + movement(self.given, pose, self.precision)
        blocks = blocks + self._depths(poses)
        in_front = np.isfinite(self._residuals(poses)[self._seen]).all()
        return BandedEquations(blocks if in_front else replace(blocks, energy=np.inf), self.held)

    def _depths(self, poses: Poses) -> BandedBlocks:
        """Return the equations that keep the depth of landmarks clicked in one view alone."""
        given, now = self._places.world(part_poses(self.body, self.given)), self._places.world(poses)
        weight = self.depth * (self._seen & (self._seen.sum(axis=0) == 1))
        axis = self.clicks.R_cam_world[:, :, 2]
        error = np.einsum("vfa,fla->vfl", axis, now - given)
        J = np.einsum("vfa,flad->vfld", axis, point_jacobian(self.body, *poses, self._places.parts, now))
        H, g = np.einsum("vfld,vfl,vfle->fde", J, weight, J), np.einsum("vfld,vfl,vfl->fd", J, weight, error)
        return _diagonal(H, g, float(np.sum(weight * error**2)))


def _moved(pose: Motion, step: Array) -> Motion:
    return pose.moved(limited(step))


def movement_precision(body: Body) -> Array:
    """Return the inverse variance of every degree of freedom's movement, shape (D,): the inertia of what it moves.

    The body's mass is its volume, spread over the vertices of each part's polyhedron. The inertia is about the joint in
    the rest pose, relative to the body's mass, and at least `MIN_RADIUS` squared.
    """
    volume = np.array([ConvexHull(part.vertices).volume for part in body.parts])
    volume /= volume.sum()
    inertia = np.zeros(len(body))
    for k, joint in enumerate(body.parts):
        for below in np.flatnonzero(body.ancestry[:, k]):
            part = body.parts[below]
            reach = part.vertices @ part.R_world_rest.T + part.head_world - joint.head_world
            inertia[k] += volume[below] * np.mean(np.sum(reach**2, axis=1))
    turns = np.maximum(inertia, MIN_RADIUS**2)
    return np.asarray(np.concatenate([np.ones(3), np.repeat(turns, 3)]) / MOVEMENT_SIGMA**2)


def movement(given: Motion, pose: Motion, precision: Array) -> BandedBlocks:
    """Return the normal equations of the weighted squared movement from a given pose."""
    moved = given.difference(pose)
    J = block_diagonal(with_translation(rotations.right_jacobian_inverse(moved[:, 3:].reshape(len(pose), -1, 3))))
    H, g = np.swapaxes(J, 1, 2) @ (precision[:, None] * J), np.einsum("frd,r,fr->fd", J, precision, moved)
    return _diagonal(H, g, float(np.sum(precision * moved**2)))


def _diagonal(H: Array, g: Array, energy: float) -> BandedBlocks:
    """Return a system without coupling between frames."""
    return replace(BandedBlocks.zeros(*g.shape), diagonal=H, gradient=g, energy=energy)
