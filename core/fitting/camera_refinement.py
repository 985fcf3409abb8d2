"""Cameras refined from the performer: moved until the outlines of the key poses lie on those of the footage.

On the frames with a key pose it is known how the body stands, so its outline in a picture shows where the camera is.
Unknown beside the cameras are the shapes of the parts and small errors of the key poses, which all views share: what
every camera sees alike is not taken for an error of each. Coarse to fine, by Gauss-Newton over all of them at once;
the colours of performers and background are learned anew on the way. See `core.fitting.resection`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri, fdtri

from ..body.time_shift import poses_after
from ..cameras.camera import Camera
from ..errors import CalibrationError
from ..evidence.gradients import wrenches
from ..numerics.arrays import Array
from ..runtime.progress import Progress
from ..runtime.threads import one_library_thread
from ..shot.keypose_spline import spline
from ..shot.shot import Shot
from .key_frame_views import KeyFrameView, on_frames, posed_key_frames, read_key_frames
from .outline_fit import OutlineProblem, RefinementStage, coarse_to_fine
from .resection import CameraEquations, CameraState, camera_equations

SETTLED = 0.05
"""A stage ends when no camera moves the body's picture by more than this, pixels of the reduced frames."""
CHANCE = 1e-3
"""How rarely a camera that fits is called one that does not."""
LOST = 0.3
"""A view that shows the performers' outlines less clearly than this beside the model's stays as it was: they are
elsewhere."""


STAGES = (
    RefinementStage(0.40, 4.0, 8),
    RefinementStage(0.25, 4.0, 4),
    RefinementStage(0.15, 2.0, 4),
    RefinementStage(0.10, 1.0, 6),
)


@dataclass(frozen=True, eq=False)
class RefinedCamera:
    """How one camera came out.

    Attributes
    ----------
    camera : Camera
    shift : float
        How far its picture of the performers' joints on the key frames moved, root mean square, pixels.
    deviation : float
        Standard deviation of that picture, pixels; infinite where no joint is before the camera.
    position_deviation, rotation_deviation : float
        Standard deviations of the optical centre, metres, and of the orientation, radians, along and about the worst
        axis.
    focal_deviation : float
        Standard deviation of the focal length, relative.
    clearness : float
        How clearly it shows the performers' outlines where the key poses are, 0 to 1.
    limit : float
        Shifts up to this are what inexact key poses and outlines make of a camera that fits, pixels.
    """

    camera: Camera
    shift: float
    deviation: float
    position_deviation: float
    rotation_deviation: float
    focal_deviation: float
    clearness: float
    limit: float = np.inf

    @property
    def lost(self) -> bool:
        """Whether it shows the performers elsewhere than where the key poses are, or not at all; it is as it was."""
        return self.clearness < LOST

    @property
    def summary(self) -> str:
        """What became of the camera, in one line."""
        if self.lost:
            return f"{self.camera.name}: not changed: it does not show the performers where the key poses are"
        return f"{self.camera.name}: its picture moved by {self.shift:.1f} px, known to {self.deviation:.1f} px"


@dataclass(frozen=True, eq=False)
class Refinement:
    """Refined cameras.

    Attributes
    ----------
    views : tuple of RefinedCamera
        In the order of the shot's views.
    frames : ndarray of int
        Shot frames whose key poses were used.
    """

    views: tuple[RefinedCamera, ...]
    frames: NDArray[np.int64]

    @property
    def cameras(self) -> dict[str, Camera]:
        """The refined cameras by their names."""
        return {view.camera.name: view.camera for view in self.views}

    def applied(self, shot: Shot) -> Shot:
        """The shot with the refined cameras."""
        views = [replace(view, camera=found.camera) for view, found in zip(shot.views, self.views, strict=True)]
        return replace(shot, views=tuple(views))


@one_library_thread()
def refine_cameras(
    shot: Shot,
    progress: Progress | None = None,
    *,
    views: Sequence[KeyFrameView] | None = None,
    stages: Sequence[RefinementStage] = STAGES,
    settled: float = SETTLED,
) -> Refinement:
    """Refine the pose and the focal length of every camera of a shot from its key poses of the whole body.

    The key poses define the world: they stay as they are. A moving camera is moved and turned alike on all
    frames, in its own axes.

    Parameters
    ----------
    shot : Shot
    progress : callable, optional
        See `core.runtime.progress.Progress`; returning False cancels.
    views : sequence of KeyFrameView, optional
        What the views show of frames with key poses of the whole body; by default of all of these, read from the
        footage.
    stages : sequence of RefinementStage
    settled : float
        See `SETTLED`.

    Raises
    ------
    CalibrationError
        There is no key pose of the whole body, or no camera sees one.
    FootageError
        See `core.tracking.tracker.track`.
    CancelledError
    """
    if views is None:
        todo = "pose the whole body on some frames first"
        missing = CalibrationError("cameras are refined from key poses of the whole body, and there is none", todo=todo)
        views = read_key_frames(shot, posed_key_frames(shot, missing), progress)
    frames, shown = views[0].frames, views
    start = _start(shot, shown, frames)

    def linearise(state: CameraState, stage: RefinementStage) -> CameraEquations:
        return camera_equations(state, stage, shown)

    def largest_shift(before: CameraState, after: CameraState) -> float:
        return max(_shift(before, after, view, v) / view.factor for v, view in enumerate(shown))

    problem = OutlineProblem(
        linearise, CameraState.moved, lambda state, equations: equations.cost_at(state), largest_shift, settled
    )
    result = coarse_to_fine(start, problem, stages, "refining cameras", progress)
    equations = result.linearised()
    covariance = equations.factor().covariance()
    states = start, result.state
    refined = tuple(
        _described(states, view, v, float(equations.clearness[v]), covariance) for v, view in enumerate(shown)
    )
    if all(view.lost for view in refined):
        todo = "see that the key poses lie on the performers"
        raise CalibrationError("no camera shows the performers where the key poses are", todo=todo)
    return Refinement(refined, frames)


def _start(shot: Shot, views: Sequence[KeyFrameView], frames: NDArray[np.int64]) -> CameraState:
    """The cameras, bodies and key poses as they are."""
    curves = [spline(performer.key_poses, shot.length) for performer in shot.performers]
    motions = {view.delay: tuple(poses_after(curves, view.delay, frames)) for view in views}
    bodies = [performer.body for performer in shot.performers]
    return CameraState.start([view.camera for view in shot.views], bodies, motions)


def _shift(before: CameraState, after: CameraState, view: KeyFrameView, v: int) -> float:
    """How far apart two states' cameras show the same joints, root mean square, pixels."""
    joints = before.joints(view.delay)
    cameras = [on_frames(state.cameras[v].rectified(), view.frames) for state in (before, after)]
    one, other = (np.stack([c.project(points, k) for k, points in enumerate(joints)]) for c in cameras)
    squared = np.sum((one - other) ** 2, axis=-1)
    squared = squared[np.isfinite(squared)]  # of joints before both cameras
    return float(np.sqrt(squared.mean())) if len(squared) else 0.0


def _described(
    states: tuple[CameraState, CameraState], view: KeyFrameView, v: int, clearness: float, covariance: Array
) -> RefinedCamera:
    """Describe how camera v came out between the first and the last state."""
    start, end = states
    state = start if clearness < LOST else end
    columns = state.camera_columns(v)
    own = covariance[np.ix_(columns, columns)]
    rows = _picture_rows(on_frames(state.cameras[v].rectified(), view.frames), state.joints(view.delay))
    picture = np.einsum("nij,nik->jk", rows, rows) / max(len(rows), 1)
    shares = np.maximum(np.linalg.eigvals(picture @ own).real, 0)
    variance = float(shares.sum()) if len(rows) else np.inf
    return RefinedCamera(
        state.cameras[v],
        _shift(start, state, view, v),
        float(np.sqrt(variance)),
        float(np.sqrt(np.linalg.eigvalsh(own[:3, :3])[-1])),
        float(np.sqrt(np.linalg.eigvalsh(own[3:6, 3:6])[-1])),
        float(np.sqrt(own[6, 6])),
        clearness,
        float(np.sqrt(variance * chance_quantile(shares))),
    )


def chance_quantile(shares: Array, samples: int | None = None) -> float:
    """How many times its mean a squared shift is at most by chance, in all but `CHANCE` of the cases.

    The sum of squares of independent normal errors with these variances is distributed nearly as a multiple of chi
    squared with fewer degrees of freedom (F. E. Satterthwaite, An approximate distribution of estimates of variance
    components, Biometrics Bulletin 2, 1946); of F where the variances were estimated from few samples themselves.
    """
    degrees = max(float(shares.sum()) ** 2 / max(float((shares**2).sum()), 1e-300), 1.0)
    if samples is None:
        return float(chdtri(degrees, CHANCE)) / degrees
    return float(fdtri(degrees, samples - 1, 1 - CHANCE))


def _picture_rows(camera: Camera, points_world: Array) -> Array:
    """Derivatives of the pictures of points (K, N, 3) by a camera's unknowns, shape (M, 2, 7), of those before it."""
    Rc, tc = camera.poses(0, len(points_world))
    points = (points_world @ np.swapaxes(Rc, 1, 2) + tc[:, None]).reshape(-1, 3)
    points = points[points[:, 2] > 0].astype(np.float32)
    focal = camera.matrix[[0, 1], [0, 1]].astype(np.float32)
    along = np.eye(2, dtype=np.float32)[..., None]
    twist = np.stack([wrenches(points, slope, focal) for slope in along], axis=1)
    radial = focal * points[:, :2] / points[:, 2:]
    return np.asarray(np.concatenate([twist, radial[..., None]], axis=2).astype(float))
