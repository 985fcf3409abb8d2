"""Checking whether a shot's cameras fit one another and the key poses, and refining those that do not.

There are two kinds of evidence. If three or more views share 2D keypoints, each camera is compared with the others
(`camera_fits.keypoint_cameras`). On frames with a key pose of the whole body, the performers' outlines in each picture
are compared with the model's (`camera_fits.camera_refinement`). The deviation that a camera is allowed is estimated
from the shot: from the scatter of the keypoints, and from how exactly the outlines determine the camera.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..formats.keypoint_files import read_shot_keypoints
from ..keypoints.keypoint_rays import Keypoints
from ..keypoints.observations import correlated_frames, performer_keypoints
from ..keypoints.view_agreement import without_midpoints
from ..numerics.arrays import evenly_spaced
from ..runtime.processes.worker_memory import WorkerMemory
from ..runtime.processes.worker_process import Show
from ..runtime.progress import Progress, share
from ..runtime.threads import one_library_thread
from ..shot.segments import whole_keys
from ..shot.shot import Shot
from ..tracking.footage_corrections.footage_gaps import with_found_gaps
from ..tracking.footage_reading.reader import is_kept
from ..tracking.footage_reading.turned_cameras import calibrated_frame, with_early_turns, with_turns
from ..tracking.results.journal import Journal
from ..tracking.results.track_result import TrackResult
from ..tracking.retracking import Excerpt, preview_segment, track_excerpts
from ..tracking.scheduling.run_context import FirstPictures, RunContext, SolvedShot
from .camera_fits.camera_refinement import RefinedCamera, Refinement, refine_cameras
from .camera_fits.keypoint_cameras import PictureShift, contradictions
from .camera_fits.shared_keypoints import CameraEstimate, SharedKeypoints
from .checks.background_checks import followed_cameras, moved_camera, with_plain_backgrounds
from .checks.early_check import EARLY_MISFITS, early_frames, early_misfits
from .checks.footage_match import footage_matches
from .checks.misfit_causes import attributed_findings
from .checks.outline_check import outline_fits
from .checks.picture_findings import Strangers
from .checks.posed_views import posed_views
from .checks.stranger_check import strangers_in
from .checks.view_findings import CameraFit, MovedCamera, ViewFinding
from .key_frame_views import pictured_key_frames, read_key_frames

MAX_CHECKED_KEYS = 8
"""Largest number of key frames that cameras are compared with, evenly spaced over the shot."""


def fit_by_keypoints(shot: Shot, performers: Sequence[Keypoints]) -> tuple[CameraFit, ...]:
    """Compare the cameras with one another.

    Parameters
    ----------
    shot : Shot
    performers : sequence of Keypoints
        Every performer's keypoints on the frames of the shot, in the order of its views.

    Returns
    -------
    tuple of CameraFit
        One per view that shares enough keypoints with at least two others.
    """
    shifts, _ = _compared(shot, performers)
    names = [view.camera.name for view in shot.views]
    return tuple(CameraFit(s.shift, s.deviation, s.limit, names[v], "keypoints") for v, s in shifts.items())


@one_library_thread()
def fit_by_key_poses(
    shot: Shot,
    pictures: Sequence[Mapping[int, NDArray[np.uint8]]] | None = None,
    progress: Progress | None = None,
    *,
    followed: Sequence[MovedCamera] = (),
) -> tuple[ViewFinding, ...]:
    """Compare the cameras with the key poses of the whole body, by the performers' outlines.

    Parameters
    ----------
    shot : Shot
    pictures : sequence of mappings, optional
        Per view: rectified pictures by shot frame, including those of `checked_frames`; read from the footage by
        default.
    progress : callable, optional
    followed : sequence of MovedCamera, optional
        The shot's cameras that were found to turn, and do so in the shot.

    Returns
    -------
    tuple of ViewFinding
        Those that were found to turn, then one per view that shows the performers clearly enough; none of these if
        there is no key pose of the whole body. For views whose footage does not match the key poses, although the
        camera is not off, that is said instead.

    Raises
    ------
    FootageError
        See `core.tracking.tracker.track`.
    CancelledError
    """
    frames = np.array(checked_frames(shot), dtype=np.int64)
    if not len(frames):
        return (*followed,)
    given = shot
    if pictures is None:
        views = read_key_frames(shot, frames, progress)
    else:
        shot = replace(shot, views=tuple(replace(view, camera=view.camera.rectified()) for view in shot.views))
        views = pictured_key_frames(shot, frames, pictures)
    posed = posed_views(shot, views, frames)
    moved = [own for view in posed if (own := moved_camera(view)) is not None]
    rest = [fit for fit in outline_fits(shot, views, progress) if fit.camera not in {own.camera for own in moved}]
    findings = attributed_findings(given.views, posed, footage_matches(posed, moved), rest)
    explained = {own.camera for own in (*moved, *findings) if own.off}
    strangers = strangers_in(posed, explained)
    return (*followed, *moved, *with_plain_backgrounds(findings, posed, followed), *strangers)


def camera_fits(shot: Shot, result: SolvedShot, progress: Progress | None = None) -> tuple[ViewFinding, ...]:
    """Compare the cameras of a solved shot with one another and with its key poses.

    Parameters
    ----------
    shot : Shot
    result : SolvedShot
        If it has the pictures of `checked_frames`, they are not read again.
    progress : callable, optional
    """
    frames = set(checked_frames(shot))
    pictures = result.pictures if result.pictures and all(frames <= own.keys() for own in result.pictures) else None
    still = with_found_gaps(shot, result.gaps)
    shot = with_turns(still, result.turns)
    keypoints = [own.factor.keypoints for own in result.observed.performers]
    shared = fit_by_keypoints(shot, keypoints) if keypoints else ()
    in_step = shot.with_footage_offset(result.footage_offset)
    followed = followed_cameras(still, result.turns)
    return (*shared, *fit_by_key_poses(in_step, pictures, progress, followed=followed))


def for_camera_fits(shot: Shot, result: TrackResult | SolvedShot) -> SolvedShot:
    """Return what `camera_fits` needs of a result, which is small enough to be sent to another process."""
    frames = set(checked_frames(shot))
    pictures = tuple({f: image for f, image in kept.items() if f in frames} for kept in result.pictures)
    return SolvedShot(pictures, result.observed, result.footage_offset, result.gaps, result.turns)


@dataclass(frozen=True, eq=False)
class CheckedTrack:
    """The results of a shot's tracked excerpts, and how well its cameras fit.

    Attributes
    ----------
    results : list of TrackResult
    fits : tuple of ViewFinding, or None
        None if only part of the shot was tracked: its cameras were not compared.
    """

    results: list[TrackResult]
    fits: tuple[ViewFinding, ...] | None


def track_and_check(
    shot: Shot,
    excerpts: Sequence[Excerpt],
    progress: Progress | None = None,
    *,
    journal: Journal | None = None,
    memory: WorkerMemory | None = None,
    show: Show | None = None,
    looking_at: int = 0,
) -> CheckedTrack:
    """Track excerpts of a shot, and compare its cameras if the whole shot is tracked.

    Parameters as of `track_excerpts` and `RunContext`; `show` is also called with `EARLY_MISFITS` and a list of
    ViewFinding, if there are any. The segment with the shot frame `looking_at`, which the user has
    on the screen, is shown first.

    Raises
    ------
    KFMocapError
        See `core.tracking.tracker.track`.
    """
    whole = len(excerpts) == 1 and (excerpts[0].first, excerpts[0].last) == (0, shot.length - 1)
    first = _first_pictures(shot, show, memory) if whole else None
    tracking = share(progress, 0.0, 0.9) if whole else progress
    if show is not None:
        preview_segment(shot, excerpts, looking_at, show, progress=progress, memory=memory)
    results = track_excerpts(shot, excerpts, tracking, run=RunContext(journal, memory, show, first_pictures=first))
    if not whole:
        return CheckedTrack(results, None)
    return CheckedTrack(results, camera_fits(shot, for_camera_fits(shot, results[0]), share(progress, 0.9, 1.0)))


def _first_pictures(shot: Shot, show: Show | None, memory: WorkerMemory | None) -> FirstPictures | None:
    """Return what shows early that footage does not match the key poses, unless the footage was tracked before."""
    if show is None or (memory is not None and all(is_kept(shot, view, memory) for view in shot.views)):
        return None

    def seen(pictures: Sequence[Mapping[int, NDArray[np.uint8]]]) -> None:
        if found := early_misfits(shot, pictures):
            show(EARLY_MISFITS, found)

    return FirstPictures(early_frames(shot), seen)


def checked_frames(shot: Shot) -> list[int]:
    """Return the key frames on which cameras are compared with the key poses, as shot frames."""
    keys = whole_keys(shot, 0, shot.length - 1)
    return [int(frame) for frame in keys[evenly_spaced(len(keys), MAX_CHECKED_KEYS)]]


def refine_shot_cameras(shot: Shot, progress: Progress | None = None) -> Refinement:
    """Refine a shot's cameras, by keypoints and by key poses.

    Cameras that contradict the keypoints of the others are moved to agree with them. If no three views share keypoints,
    or the cameras then do not fit the key poses, all are refined by `refine_cameras`. What is refined of cameras that
    are held in the hand (`with_early_turns`) is their pose on the frame on which they are as calibrated.

    Raises
    ------
    CalibrationError
        There are neither shared keypoints nor key poses; see `refine_cameras`.
    FootageError, KeypointError
        A file cannot be read.
    CancelledError
    """
    followed = with_early_turns(shot, checked_frames(shot))
    refined = _refined(followed, progress)
    return refined if followed is shot else refined.standing_as(shot, calibrated_frame(shot))


def _refined(shot: Shot, progress: Progress | None) -> Refinement:
    """Refine a shot's cameras, which have a pose for every frame if they move."""
    compared = _by_keypoints(shot)
    if compared is None:
        return refine_cameras(shot, progress)
    agreed = compared.applied(shot)
    if not any(fit.off and not isinstance(fit, Strangers) for fit in fit_by_key_poses(agreed, progress=progress)):
        return compared
    posed = refine_cameras(agreed, progress)
    pairs = zip(posed.views, compared.views, strict=True)
    views = [replace(end, shift=float(np.hypot(start.shift, end.shift))) for end, start in pairs]
    return replace(posed, views=tuple(views))


def _by_keypoints(shot: Shot) -> Refinement | None:
    """Move the cameras that contradict the others; None if none can be compared."""
    if sum(view.keypoints is not None for view in shot.views) < 3:
        return None
    shifts, estimate = _compared(shot, performer_keypoints(shot, read_shot_keypoints(shot)))
    if not shifts:
        return None
    moved = estimate.cameras([view.camera for view in shot.views])
    found = []
    for v, view in enumerate(shot.views):
        own = shifts.get(v, PictureShift(0.0, np.inf, np.inf))
        camera, shift = (moved[v], own.shift) if own.off else (view.camera, 0.0)
        found.append(RefinedCamera(camera, shift, own.deviation, clearness=1.0, limit=own.limit))
    return Refinement(tuple(found), np.zeros(0, dtype=np.int64))


def _compared(shot: Shot, performers: Sequence[Keypoints]) -> tuple[dict[int, PictureShift], CameraEstimate]:
    """Compare the cameras by keypoints, see `contradictions`."""
    own = [without_midpoints(keypoints) for keypoints in performers]
    cameras = [view.camera for view in shot.views]
    return contradictions(SharedKeypoints.of(own, cameras, correlated_frames(shot.settings, shot.fps)))
