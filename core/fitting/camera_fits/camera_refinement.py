"""Refining cameras from the performer: they are moved until the key poses' outlines lie on those of the footage.

On a key frame the pose is known, so the performer's outline in a picture shows where the camera is. The shapes of the
parts and small errors of the key poses are unknowns as well, shared by all views, so that an error which all cameras
see alike is not attributed to each of them. All unknowns are solved for together by Gauss-Newton, coarse to fine; the
colours of performers and background are learned again for each outline search, or once per stage. See
`core.fitting.camera_fits.resection`.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri, fdtri

from ...body.time_shift import poses_after
from ...cameras.camera import Camera
from ...errors import CalibrationError
from ...evidence.gradient_evidence.image_wrenches import wrenches
from ...numerics.arrays import Array
from ...runtime.progress import Progress
from ...runtime.threads import one_library_thread
from ...shot.keypose_spline import spline
from ...shot.shot import Shot
from ..key_frame_views import KeyFrameView, posed_key_frames, read_key_frames
from ..outline_fit import OutlineProblem, RefinementStage, coarse_to_fine
from .resection import CameraEquations, CameraState, camera_equations

CONVERGED_PIXELS = 0.05
"""A stage ends when no camera moves the body's picture by more than this, pixels of the reduced frames."""
SIGNIFICANCE = 1e-3
"""Probability that a camera that fits is reported as one that does not."""
MIN_OUTLINE_SHARE = 0.3
"""A camera is left unchanged if its view shows the performers' outlines less clearly than this near the model's: the
performers must be elsewhere in the picture."""
REFINEMENT_STAGES = (
    RefinementStage(0.40, 4.0, 8),
    RefinementStage(0.25, 4.0, 4),
    RefinementStage(0.15, 2.0, 4),
    RefinementStage(0.10, 1.0, 6),
)
"""From coarse to fine: the outlines are searched for up to 40 cm from the model, in the end up to 10 cm."""


@dataclass(frozen=True, eq=False)
class RefinedCamera:
    """A refined camera, and how much it changed.

    Attributes
    ----------
    camera : Camera
    shift : float
        Root mean square distance by which the projections of the performers' joints moved on the key frames, pixels.
    deviation : float
        Standard deviation of these projections, pixels; infinite if no joint is in front of the camera.
    clearness : float
        How clearly the view shows the performers' outlines at the key poses, 0 to 1.
    limit : float
        Largest shift that inexact key poses and outlines explain for a camera that fits, pixels.
    """

    camera: Camera
    shift: float
    deviation: float
    clearness: float
    limit: float = np.inf

    @property
    def lost(self) -> bool:
        """Whether the view does not show the performers at the key poses; the camera is then unchanged."""
        return self.clearness < MIN_OUTLINE_SHARE

    @property
    def summary(self) -> str:
        """One line on how the camera changed, for the user."""
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
        """Return the shot with the refined cameras."""
        views = [replace(view, camera=found.camera) for view, found in zip(shot.views, self.views, strict=True)]
        return replace(shot, views=tuple(views))

    def standing_as(self, shot: Shot, frame: int) -> Refinement:
        """Return the same with the pose on one shot frame for the cameras that stand still in a shot as given."""
        views = [
            replace(own, camera=own.camera.at([frame])) if view.camera.stands_still else own
            for own, view in zip(self.views, shot.views, strict=True)
        ]
        return replace(self, views=tuple(views))


@one_library_thread()
def refine_cameras(
    shot: Shot,
    progress: Progress | None = None,
    *,
    views: Sequence[KeyFrameView] | None = None,
    stages: Sequence[RefinementStage] = REFINEMENT_STAGES,
    settled: float = CONVERGED_PIXELS,
) -> Refinement:
    """Refine the pose and the focal length of every camera of a shot from its key poses of the whole body.

    The key poses define the world frame and do not change. A moving camera gets the same correction on all frames, in
    its own axes.

    Parameters
    ----------
    shot : Shot
    progress : callable, optional
        See `core.runtime.progress.Progress`; returning False cancels.
    views : sequence of KeyFrameView, optional
        The views' pictures of frames with key poses of the whole body; by default all such frames are read from the
        footage.
    stages : sequence of RefinementStage
    settled : float
        See `CONVERGED_PIXELS`.

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
    learned: dict[RefinementStage, dict[int, NDArray[np.uint8]]] = defaultdict(dict)

    def linearise(state: CameraState, stage: RefinementStage) -> CameraEquations:
        return camera_equations(state, stage, shown, learned[stage])

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
    """Return the state before refinement."""
    curves = [spline(performer.key_poses, shot.length) for performer in shot.performers]
    motions = {view.delay: tuple(poses_after(curves, view.delay, frames)) for view in views}
    bodies = [performer.body for performer in shot.performers]
    return CameraState.start([view.camera for view in shot.views], bodies, motions)


def _shift(before: CameraState, after: CameraState, view: KeyFrameView, v: int) -> float:
    """Return the root mean square distance between the projections of the same joints in two states, pixels."""
    joints = before.joints(view.delay)
    cameras = [state.cameras[v].rectified().at(view.frames.tolist()) for state in (before, after)]
    one, other = (np.stack([c.project(points, k) for k, points in enumerate(joints)]) for c in cameras)
    squared = np.sum((one - other) ** 2, axis=-1)
    squared = squared[np.isfinite(squared)]  # of joints before both cameras
    return float(np.sqrt(squared.mean())) if len(squared) else 0.0


def _described(
    states: tuple[CameraState, CameraState], view: KeyFrameView, v: int, clearness: float, covariance: Array
) -> RefinedCamera:
    """Describe how camera v changed from the first state to the last."""
    start, end = states
    state = start if clearness < MIN_OUTLINE_SHARE else end
    columns = state.camera_columns(v)
    own = covariance[np.ix_(columns, columns)]
    rows = _picture_rows(state.cameras[v].rectified().at(view.frames.tolist()), state.joints(view.delay))
    picture = np.einsum("nij,nik->jk", rows, rows) / max(len(rows), 1)
    shares = np.maximum(np.linalg.eigvals(picture @ own).real, 0)
    variance = float(shares.sum()) if len(rows) else np.inf
    return RefinedCamera(
        camera=state.cameras[v],
        shift=_shift(start, state, view, v),
        deviation=float(np.sqrt(variance)),
        clearness=clearness,
        limit=float(np.sqrt(variance * chance_quantile(shares))),
    )


def chance_quantile(shares: Array, samples: int | None = None) -> float:
    """Return the ratio of a squared shift to its mean that chance exceeds with probability `SIGNIFICANCE`.

    The sum of squares of independent normal errors is distributed nearly as a multiple of chi-squared with fewer
    degrees of freedom (F. E. Satterthwaite, An approximate distribution of estimates of variance components,
    Biometrics Bulletin 2, 1946), or of F if the variances were themselves estimated from few samples.

    Parameters
    ----------
    shares : ndarray, shape (n,)
        Variances of the errors, in any unit.
    samples : int, optional
        Number of samples that the variances were estimated from.
    """
    degrees = max(float(shares.sum()) ** 2 / max(float((shares**2).sum()), 1e-300), 1.0)
    if samples is None:
        return float(chdtri(degrees, SIGNIFICANCE)) / degrees
    return float(fdtri(degrees, samples - 1, 1 - SIGNIFICANCE))


def _picture_rows(camera: Camera, points_world: Array) -> Array:
    """Return the derivatives of the projections of points (K, N, 3) by a camera's unknowns, shape (M, 2, 7), for the M
    points in front of it.
    """
    Rc, tc = camera.poses(0, len(points_world))
    points = (points_world @ np.swapaxes(Rc, 1, 2) + tc[:, None]).reshape(-1, 3)
    points = points[points[:, 2] > 0].astype(np.float32)
    focal = camera.matrix[[0, 1], [0, 1]].astype(np.float32)
    along = np.eye(2, dtype=np.float32)[..., None]
    twist = np.stack([wrenches(points, slope, focal) for slope in along], axis=1)
    radial = focal * points[:, :2] / points[:, 2:]
    return np.asarray(np.concatenate([twist, radial[..., None]], axis=2).astype(float))
