"""Bodies fitted to their key poses: lengths and widths of the parts, until the model lies on the performers.

On the frames with a key pose it is known roughly how the body stands. What is not known is how long and how wide its
parts are: every part is stretched along its axes, with all that hangs on it, and its solid is shifted. Key poses were
set with a body of other proportions, so they may give way, too. Evidence are the performers' outlines against the
background (`core.evidence.contours`) and, where views have them, 2D keypoints. Both sides of a body are nearly alike,
and what is not seen grows with the rest. Gauss-Newton over all of it, coarse to fine.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..body import Body, part_poses, point_jacobian, twist_jacobian
from ..body.kinematics import scene_poses
from ..body.motion import Motion
from ..body.shaping import joint_jacobian, mirrored_parts, shaped
from ..body.time_shift import poses_after
from ..cameras.camera import Camera
from ..errors import BodyError
from ..evidence.gradients import Poses, camera_twist
from ..evidence.label_images import Geometry
from ..evidence.part_shapes import SHIFT, STRETCH, stretched
from ..formats.keypoint_files import read_shot_keypoints
from ..keypoints.keypoint_factor import USUAL_DEVIATION, Keypoints, Places, offset_deviation, robust_weights
from ..keypoints.left_right import correct_sides
from ..keypoints.observations import performer_keypoints
from ..numerics import rotations
from ..runtime.progress import Progress, report_progress
from ..runtime.threads import one_blas_thread
from ..shot.keypose_spline import spline
from ..shot.shot import Shot
from ..tracking.segments import whole_keys
from .camera_refinement import Stage, look_at_keys
from .resection import Look, key_outlines, outline_products

Array = NDArray[np.float64]

GROWTH = 0.08
"""Usual departure of a performer's size from the body's, as a share."""
LENGTH = 0.08
"""Usual departure of a part's length from what the size tells, as a share; of widths see `evidence.shape.STRETCH`."""
SIDES_STRETCH, SIDES_SHIFT = 0.02, 0.004
"""Usual difference between the sides of a body, as a share and in metres."""
POSED_ROOT, POSED_JOINT = 0.03, 0.08
"""Usual error of a key pose that was set with a body of other proportions, metres and radians."""
BEYOND_LIMITS = 0.05
"""How far a joint may go beyond its limits, radians."""
STAGES = ((Stage(0.25, 4.0, 8), 0.4), (Stage(0.15, 2.0, 6), 0.2), (Stage(0.10, 1.0, 8), 0.1))
"""From coarse to fine, each with how much wider the solids may still be than the performers, as a share: what is within
the rest tells their colours."""
SETTLED = 0.001
"""A stage ends when no joint moves by more than this, metres."""
_PART = 6  # unknowns of a part: stretch and shift along its axes
_ROWS = 9  # of an outline's row: wrench in camera axes, and by the part's stretches


@dataclass(frozen=True, eq=False)
class BodyFit:
    """Bodies that lie on their performers.

    Attributes
    ----------
    bodies : tuple of Body
        Per performer, with its joints and solids; the root's joint of the rest pose is where it was.
    poses : tuple of Motion
        Per performer: the key poses as they lie on the footage with that body.
    frames : ndarray of int, shape (K,)
        Shot frames of these poses.
    growth : tuple of float
        Per performer: how much larger the body became, as a share.
    """

    bodies: tuple[Body, ...]
    poses: tuple[Motion, ...]
    frames: NDArray[np.int64]
    growth: tuple[float, ...]


@one_blas_thread()
def fit_bodies(shot: Shot, progress: Progress | None = None) -> BodyFit:
    """Fit the bodies of a shot's performers to its key poses of the whole body.

    Raises
    ------
    BodyError
        There is no frame on which the whole body of every performer is posed.
    FootageError, KeypointError
        See `core.tracking.tracker.track`.
    CancelledError
    """
    frames = whole_keys(shot, 0, shot.length - 1)
    if not len(frames):
        todo = "pose the whole body over the footage on some frames first"
        raise BodyError("bodies are fitted to key poses of the whole body, and there is none", todo=todo)
    looks = look_at_keys(shot, frames, progress)
    people = _start(shot, looks, frames)
    for s, (stage, doubt) in enumerate(STAGES):
        for i in range(stage.iterations):
            report_progress(progress, "fitting the body", (s + i / stage.iterations) / len(STAGES))
            before = [person.joints() for person in people]
            people = _step(people, shot, looks, stage, doubt)
            moved = max(float(np.abs(p.joints() - b).max()) for p, b in zip(people, before, strict=True))
            if moved < SETTLED:
                break
    report_progress(progress, "fitting the body", 1.0)
    return BodyFit(
        tuple(person.body for person in people),
        tuple(person.motions[0.0] for person in people),
        frames,
        tuple(float(person.shape[0]) for person in people),
    )


@dataclass(frozen=True, eq=False)
class Person:
    """An estimate of one performer.

    Attributes
    ----------
    body : Body
        P parts.
    motions : mapping of float to Motion
        The K key poses, by the delay of the views that show them.
    keypoints : Keypoints
        On the K frames; L of them, none where there are none.
    places : Places
        Of the keypoints on the body.
    shape : ndarray, shape (1 + 6 P + 3 L,)
        Changes since the start: growth, every part's stretch beyond it and shift, the keypoints' offsets.
    posed : ndarray, shape (K, D)
        The same of the key poses.
    """

    body: Body
    motions: Mapping[float, Motion]
    keypoints: Keypoints
    places: Places
    shape: Array
    posed: Array

    def joints(self) -> Array:
        """In the world, metres, shape (K, P, 3)."""
        return part_poses(self.body, self.motions[0.0])[1]

    def moved(self, step: Array) -> Person:
        """The estimate after increments of the shape and then the poses."""
        n, P, names = len(self.shape), len(self.body), self.keypoints.names
        each = step[1 : 1 + _PART * P].reshape(P, _PART)
        body = shaped(self.body, np.clip(step[0] + each[:, :3], -0.15, 0.15), each[:, 3:])
        offsets = self.places.offsets + step[1 + _PART * P : n].reshape(-1, 3)
        places = replace(Places.on(body, names), offsets=offsets)
        poses = step[n:].reshape(self.posed.shape)
        motions = {delay: motion.moved(poses) for delay, motion in self.motions.items()}
        return Person(body, motions, self.keypoints, places, self.shape + step[:n], self.posed + poses)

    def prior(self) -> Array:
        """Inverse covariance of the shape, shape (n, n)."""
        P = len(self.body)
        deviation = np.full(len(self.shape), GROWTH)
        deviation[1 : 1 + _PART * P] = np.tile([STRETCH, LENGTH, STRETCH, SHIFT, SHIFT, SHIFT], P)
        names = self.keypoints.names
        deviation[1 + _PART * P :] = np.repeat([offset_deviation(name) for name in names], 3)
        H = np.diag(1 / deviation**2)
        for left, right in mirrored_parts(self.body):
            for k, sign in enumerate((1, 1, 1, -1, 1, 1)):  # a bone's frame is mirrored along its x axis
                row = np.zeros(len(H))
                row[1 + _PART * left + k], row[1 + _PART * right + k] = 1, -sign
                H += np.outer(row, row) / (SIDES_STRETCH if k < 3 else SIDES_SHIFT) ** 2
        return H


def _start(shot: Shot, looks: Sequence[Look], frames: NDArray[np.int64]) -> list[Person]:
    curves = [spline(performer.key_poses, shot.length) for performer in shot.performers]
    delays = {0.0} | {look.delay for look in looks}
    motions = {delay: poses_after(curves, delay, frames) for delay in delays}
    found = performer_keypoints(shot, read_shot_keypoints(shot))
    people = []
    for i, (performer, keypoints) in enumerate(zip(shot.performers, found, strict=True)):
        body, names = performer.body, keypoints.names
        places = Places.on(body, names)
        shape = np.zeros(1 + _PART * len(body) + 3 * len(names))
        posed = np.zeros((len(frames), body.dof))
        own = {delay: performers[i] for delay, performers in motions.items()}
        people.append(Person(body, own, keypoints[frames], places, shape, posed))
    return people


def _step(people: Sequence[Person], shot: Shot, looks: Sequence[Look], stage: Stage, doubt: float) -> list[Person]:
    """One step of Gauss-Newton for every performer; who hides whom is as before it."""
    geometry = Geometry.of([person.body for person in people])
    slim = stretched(geometry, np.tile([-doubt, -doubt / 2, -doubt, 0, 0, 0], (len(geometry.spans), 1)))
    ends = np.cumsum([0] + [len(person.body) for person in people])
    systems = [_prior_system(person) for person in people]
    for view, look in zip(shot.views, looks, strict=True):
        poses = scene_poses([p.body for p in people], [p.motions[look.delay] for p in people])
        camera = look.camera(view.camera)
        lines = key_outlines(look.rectified(view.camera), camera, geometry, poses, stage.reach, stage.tolerance, slim)
        products = outline_products(lines, camera, poses)
        products = np.delete(np.delete(products, 6, axis=-1), 6, axis=-2)  # the focal length is known
        products /= shot.settings.outline_correlation * stage.tolerance**2
        for person, (H, g), a, b in zip(people, systems, ends[:-1], ends[1:], strict=True):
            own = poses[0][:, a:b], poses[1][:, a:b]
            B = _outline_rows(person, camera, own)
            S = products[:, a:b]
            B_t = np.swapaxes(B, -1, -2)
            _add(H, g, (B_t @ S[..., :-1, :-1] @ B).sum(axis=1), (B_t @ S[..., :-1, -1:])[..., 0].sum(axis=1), person)
    people_after = []
    for person, (H, g) in zip(people, systems, strict=True):
        if person.keypoints.names:
            _add_keypoints(H, g, person, stage.tolerance)
        people_after.append(person.moved(np.linalg.solve(H, g)))
    return people_after


def _prior_system(person: Person) -> tuple[Array, Array]:
    """Normal matrix and right side of what is known beforehand: shape, poses, joint limits."""
    n, (K, D) = len(person.shape), person.posed.shape
    H, g = np.zeros((n + K * D, n + K * D)), np.zeros(n + K * D)
    H[:n, :n] = person.prior()
    g[:n] = -H[:n, :n] @ person.shape
    deviation = np.tile([POSED_ROOT] * 3 + [POSED_JOINT] * (D - 3), K)
    weight = 1 / deviation**2
    turns = rotations.log(person.motions[0.0].rotations)
    limits = person.body.limits
    beyond = (turns - np.clip(turns, limits[..., 0], limits[..., 1])).reshape(K, -1)
    stop = np.concatenate([np.zeros((K, 6)), (beyond != 0)[:, 3:] / BEYOND_LIMITS**2], axis=1).ravel()
    over = np.concatenate([np.zeros((K, 3)), beyond], axis=1).ravel()
    diagonal = np.arange(n, n + K * D)
    H[diagonal, diagonal] = weight + stop
    g[n:] = -weight * person.posed.ravel() - stop * over
    return H, g


def _add(H: Array, g: Array, H_frames: Array, g_frames: Array, person: Person) -> None:
    """Add normal equations of every frame's unknowns, (K, n + D, n + D): the shape, shared, and that frame's pose."""
    n, D = len(person.shape), person.posed.shape[1]
    for k, (own_H, own_g) in enumerate(zip(H_frames, g_frames, strict=True)):
        columns = np.concatenate([np.arange(n), n + k * D + np.arange(D)])
        H[np.ix_(columns, columns)] += own_H
        g[columns] += own_g


def _outline_rows(person: Person, camera: Camera, poses: Poses) -> Array:
    """An outline's row by the shape and the pose of its frame, shape (K, P, 9, n + D)."""
    body, (R, T), (Rc, tc) = person.body, poses, camera.poses(0, len(poses[0]))
    K, P = T.shape[:2]
    n = len(person.shape)
    B = np.zeros((K, P, _ROWS, n + body.dof))
    joints = np.einsum("kab,kpbqc->kpaqc", Rc, joint_jacobian(body, R))
    each = B[..., 1 : 1 + _PART * P].reshape(K, P, _ROWS, P, _PART)
    each[..., :3, :, :3] = joints
    for p in range(P):
        each[:, p, 6:9, p, :3] = np.eye(3)
        each[:, p, :3, p, 3:] = Rc @ R[:, p]
    B[..., 1 : 1 + _PART * P] = each.reshape(K, P, _ROWS, -1)
    B[..., 0] = each[..., :3].sum(axis=(-1, -2))
    B[..., :6, n:] = camera_twist(Rc, tc)[:, None] @ twist_jacobian(body, R, T)
    return B


def _add_keypoints(H: Array, g: Array, person: Person, tolerance: float) -> None:
    """Add the keypoints' rows: how far their places are from the rays that they were seen along."""
    body, places = person.body, person.places
    R, T = part_poses(body, person.motions[0.0])
    points = places.world((R, T))
    keypoints, _ = correct_sides(person.keypoints, points)
    residual = keypoints.residuals(points)
    usual = np.full((residual.shape[0], residual.shape[2]), USUAL_DEVIATION)
    weights = robust_weights(residual, keypoints.confidence, usual, tolerance)
    K, L, P, n = len(R), len(places.parts), len(body), len(person.shape)
    A = np.zeros((K, L, 3, n + body.dof))
    each = np.zeros((K, L, 3, P, _PART))
    each[..., :3] = joint_jacobian(body, R)[:, places.parts]
    offsets = np.zeros((K, L, 3, L, 3))
    for i, part in enumerate(places.parts):
        each[:, i, :, part, :3] += R[:, part] * places.local[i]
        offsets[:, i, :, i] = R[:, part]
    A[..., 0] = each[..., :3].sum(axis=(-1, -2))
    A[..., 1 : 1 + _PART * P] = each.reshape(K, L, 3, -1)
    A[..., 1 + _PART * P : n] = offsets.reshape(K, L, 3, -1)
    A[..., n:] = point_jacobian(body, R, T, places.parts, points)
    rows = np.einsum("vklra,klan->vklrn", keypoints.across(), A) * np.sqrt(weights)[..., None, None]
    short = -np.nan_to_num(residual) * np.sqrt(weights)[..., None]
    rows, short = (np.moveaxis(a, 1, 0).reshape(K, -1, *a.shape[4:]) for a in (rows, short))
    _add(H, g, np.swapaxes(rows, 1, 2) @ rows, np.einsum("krn,kr->kn", rows, short), person)
