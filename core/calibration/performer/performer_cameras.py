"""Cameras from the 2D keypoints of a performer who moves about, and from the performer's height.

Limbs are wands of constant length. Initial cameras are found as from a wand (`first_cameras`), for each kind of limb,
and the best solution is kept; then all joints and cameras are adjusted together (`limb_bundle`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...cameras.camera import Camera
from ...errors import CaptureError, located
from ...formats.keypoint_files import read_keypoints
from ...keypoints.observations import correlated_frames
from ...runtime.progress import Progress, report_progress
from ...shot.footage import probe
from ...shot.frame_numbers import FIRST_PARITY
from ...shot.shot_spec import ShotSpec, ViewSpec
from ..solving.assumed_lens import Lens
from ..solving.camera_rig import Rig
from ..solving.first_cameras import first_rig
from ..solving.view_links import MIN_LINK_FRAMES, Cancel, find_links
from ..solving.wand_tracks import Tracks
from ..solving.wand_triangulation import rays, triangulated
from .limb_bundle import SINGLE_BONES, adjust_joints, cost_of_joints
from .limb_residuals import JOINTS, LIMB_ENDS, JointScene, JointSightings, usual_lengths
from .performer_views import USUAL_CORRELATION, PerformerView, joint_sightings
from .performer_world import in_performers_world
from .single_camera import SingleViewCalibration, camera_by_performer

TRIED_FOCALS = (0.6, 0.9, 1.35)
"""Focal lengths that are tried if the lens is not known, as shares of the picture's longer side."""
MAX_FOCAL_SIGMA = 0.1
"""Standard deviation of a focal length above which the user is warned, as a share of it."""
_USUAL_NOISE = 3.0  # pixels


@dataclass(frozen=True, eq=False)
class PerformerCalibration:
    """Cameras that were found from a performer, and how well they fit.

    Attributes
    ----------
    cameras : dict of str to Camera
        Metres, z up from the floor, the origin below the performer's hips on the first frame, x to their left.
    noise : dict of str to float
        By camera, the median distance of the joints from their keypoints, pixels.
    seen : dict of str to int
        By camera, the number of joints that it sees, over all frames that are used.
    lengths : dict of str to float
        Lengths of the performer's limbs, metres.
    focal_deviation : dict of str to float
        By camera, the standard deviation of the focal length, as a share of it; 0 if the lens is known.
    """

    cameras: dict[str, Camera]
    noise: dict[str, float]
    seen: dict[str, int]
    lengths: dict[str, float]
    focal_deviation: dict[str, float]

    @property
    def summary_lines(self) -> list[str]:
        """Return the lines that tell the user about the result."""
        rows = []
        for name, camera in self.cameras.items():
            lens = f"focal length {camera.matrix[0, 0]:.0f} px"
            if self.focal_deviation[name]:
                lens += f" within {100 * self.focal_deviation[name]:.0f} %"
            rows.append(f"{name}: {lens}, {self.seen[name]} joints, {self.noise[name]:.1f} px off")
        rows.append("scale from the performer's height; z is up as the performer and the cameras stand")
        if vague := [name for name, share in self.focal_deviation.items() if share > MAX_FOCAL_SIGMA]:
            rows.append(
                f"the focal length of {', '.join(vague)} is vague, and with it how far away the camera is: let the "
                "performer walk towards and away from the cameras, or give the lenses"
            )
        return rows


def cameras_of_shot(
    spec: ShotSpec, lenses: Mapping[str, Camera], progress: Progress | None
) -> PerformerCalibration | SingleViewCalibration:
    """Solve for the cameras of a shot from the keypoints and the height of its first performer.

    Parameters
    ----------
    spec : ShotSpec
        Its calibration is not read.
    lenses : mapping of str to Camera
        By camera: the known lenses.
    progress : callable or None

    Raises
    ------
    CaptureError
        The performer's height is missing, a view has no keypoints, a lens belongs to another picture size, or the
        keypoints do not determine the cameras.
    FootageError, KeypointError
        Footage or keypoints cannot be read.
    CancelledError
        `progress` returned False.
    """
    performer = spec.performers[0]
    if performer.height is None:
        todo = "give it in metres, with shoes: the scale of everything follows from it"
        raise CaptureError("the performer's height is missing", where=f"{performer.where} height", todo=todo)
    correlated = correlated_frames(spec.settings, spec.fps)
    return cameras_of_views(spec.views, performer.height, spec.frames, progress, lenses=lenses, correlated=correlated)


def cameras_of_views(
    specs: Sequence[ViewSpec],
    height: float,
    frames: tuple[int, int],
    progress: Progress | None = None,
    *,
    lenses: Mapping[str, Camera],
    correlated: float,
) -> PerformerCalibration | SingleViewCalibration:
    """Solve for the cameras of one or more views from the files of their keypoints.

    Parameters
    ----------
    specs : sequence of ViewSpec
    height : float
        Height of the performer, metres, which gives the scale.
    frames : tuple of int
        First and last frame of the shot, in the shot's count.
    progress : callable, optional
    lenses : mapping of str to Camera
        By camera: the known lenses.
    correlated : float
        How many neighbouring frames have the same error of the detector, and therefore count as one.

    Raises
    ------
    CaptureError, FootageError, KeypointError, CancelledError
        See `cameras_of_shot`.
    """
    report_progress(progress, "keypoints", 0.0)
    views = [_view(view, lenses) for view in specs]
    if len(views) == 1:
        return camera_by_performer(views[0], height, frames, correlated=correlated)
    return cameras_by_performer(views, height, frames, progress, correlated=correlated)


def _view(view: ViewSpec, lenses: Mapping[str, Camera]) -> PerformerView:
    if view.keypoints is None:
        todo = "let a pose detector find them, or film a wand"
        raise CaptureError("there are no keypoints of this view", where=f"{view.where} keypoints", todo=todo)
    footage = probe(view.footage)
    with located(f"keypoints of camera '{view.camera}'"):
        pictures = view.footage if view.fields not in FIRST_PARITY else None
        detections = read_keypoints(view.keypoints, footage.size, footage=pictures)
    lens = lenses.get(view.camera)
    if lens is not None and lens.size != footage.size:
        raise CaptureError(
            f"its lens is of pictures of {lens.size[0]} x {lens.size[1]}, "
            f"the footage has {footage.size[0]} x {footage.size[1]}",
            where=f"camera '{view.camera}'",
            todo="give the calibration of this footage",
        )
    return PerformerView(view.camera, footage.size, detections, view.offset, lens, view.every or 1)


def cameras_by_performer(
    views: Sequence[PerformerView],
    height: float,
    frames: tuple[int, int],
    progress: Progress | None = None,
    *,
    correlated: float = USUAL_CORRELATION,
) -> PerformerCalibration:
    """Solve for cameras from the keypoints of one performer.

    Parameters
    ----------
    views : sequence of PerformerView
        Two or more. If several people are in a view, the largest one there is used.
    height : float
        Height of the performer, metres, which gives the scale.
    frames : tuple of int
        First and last frame of the shot, in the shot's count.
    progress : callable, optional
    correlated : float
        How many neighbouring frames have the same error of the detector, and therefore count as one.

    Raises
    ------
    CaptureError
        The keypoints do not determine the cameras.
    CancelledError
        `progress` returned False.
    """
    if len(views) < 2:
        raise CaptureError("two views or more are needed to solve for cameras together", where="[[view]]")

    def check() -> None:
        report_progress(progress, "cameras", 0.3)

    check()
    seen = joint_sightings(views, frames, correlated)
    tried = [[_lens(view, share) for view in views] for share in TRIED_FOCALS]
    rigs = (_rig_by_limb(seen, lenses, limb, height, check) for lenses in tried for limb in SINGLE_BONES)
    starts = [_with_joints(rig, seen, height) for rig in rigs if rig is not None]
    if not starts:
        raise _undetermined(seen)
    start = min(starts, key=lambda scene: cost_of_joints(scene, seen, height))
    known = np.array([view.lens is not None for view in views])
    best = adjust_joints(start, seen, height, known_lens=known, cancel=check)
    rig = in_performers_world(best.scene)
    shown = np.isfinite(best.sizes).sum(axis=(1, 2))
    return PerformerCalibration(
        {
            view.camera: view.camera_at(
                rig.matrix(v) if view.lens is None else view.lens.matrix, rig.R_cam_world[v], rig.t_cam_world[v]
            )
            for v, view in enumerate(views)
        },
        {view.camera: float(np.nanmedian(sizes)) for view, sizes in zip(views, best.sizes, strict=True)},
        {view.camera: int(count) for view, count in zip(views, shown, strict=True)},
        dict(zip(LIMB_ENDS, best.scene.lengths.tolist(), strict=True)),
        {view.camera: float(share) for view, share in zip(views, best.focal_deviation, strict=True)},
    )


def _lens(view: PerformerView, share: float) -> Lens:
    """Return the lens with which initial cameras are found: the known one, or one of that focal length; without
    distortion.
    """
    matrix = view.matrix(share * max(view.size))
    return Lens(view.size, matrix[:1, 0], matrix, np.zeros(4))


def _rig_by_limb(seen: JointSightings, lenses: Sequence[Lens], limb: str, height: float, check: Cancel) -> Rig | None:
    """Initial cameras from one kind of limb, whose left and right are sticks of the same length."""
    ends = np.array([[JOINTS.index(name) for name in pair] for pair in LIMB_ENDS[limb]])
    F = len(seen.frames)
    points = np.concatenate([seen.points[:, :, pair] for pair in ends], axis=1)
    sigma = np.where(np.isfinite(points).all(axis=-1), _USUAL_NOISE, np.nan)
    apart = 10 * (F + 1) * np.arange(len(ends))
    tracks = Tracks((np.arange(F) + apart[:, None]).ravel(), points, sigma)
    # The two ends of a limb are known, so links that exchange them are wrong.
    links = [link for link in find_links(tracks, lenses, check) if not link.crossed]
    length = usual_lengths(height)[list(LIMB_ENDS).index(limb)]
    return first_rig(seen.cameras, tracks, lenses, links, length=float(length), cancel=check)


def _with_joints(rig: Rig, seen: JointSightings, height: float) -> JointScene:
    """Return the scene of these cameras with triangulated joints."""
    lines = rays(rig, seen.points.reshape(len(rig), -1, 2))
    joints = triangulated(rig.centres_world, lines).reshape(*seen.points.shape[1:3], 3)
    return JointScene(rig, joints, usual_lengths(height))


def _undetermined(seen: JointSightings) -> CaptureError:
    shown = (seen.confidence > 0).any(axis=2).sum(axis=1)
    counts = ", ".join(f"{name} {n}" for name, n in zip(seen.cameras, shown, strict=True))
    return CaptureError(
        f"the performer does not show where the cameras are; frames that another camera shows, too: {counts}",
        where="keypoints",
        todo=f"let the performer walk about where all cameras see them, for {MIN_LINK_FRAMES} frames and more",
    )
