"""Checking whether a shot's cameras fit one another and the key poses, and refining those that do not.

There are two kinds of evidence. If three or more views share 2D keypoints, each camera is compared with the others
(`core.fitting.keypoint_cameras`). On frames with a key pose of the whole body, the performers' outlines in each picture
are compared with the model's (`core.fitting.camera_refinement`). The deviation that a camera is allowed is estimated
from the shot: from the scatter of the keypoints, and from how exactly the outlines determine the camera.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..errors import CalibrationError
from ..formats.keypoint_files import read_shot_keypoints
from ..keypoints.keypoint_rays import Keypoints
from ..keypoints.observations import correlated_frames, performer_keypoints
from ..keypoints.view_agreement import without_midpoints
from ..runtime.progress import Progress, share
from ..runtime.threads import one_library_thread
from ..runtime.worker_memory import WorkerMemory
from ..runtime.worker_process import Show
from ..shot.shot import Shot
from ..tracking.footage_gaps import with_found_gaps
from ..tracking.journal import Journal
from ..tracking.reader import is_kept
from ..tracking.retracking import Excerpt, preview_segment, track_excerpts
from ..tracking.run_context import FirstPictures, RunContext, SolvedShot
from ..tracking.segments import whole_keys
from ..tracking.track_result import TrackResult
from .camera_refinement import RefinedCamera, Refinement, refine_cameras
from .flicker import FLICKER_FRAMES, MIN_FLICKER, flicker
from .footage_match import better_offset, footage_matches, shifted_background
from .key_frame_views import KeyFrameView, pictured_key_frames, read_key_frames
from .keypoint_cameras import PictureShift, contradictions
from .outline_fit import RefinementStage
from .shared_keypoints import CameraEstimate, SharedKeypoints
from .view_findings import CameraFit, FlickeringLight, FootageMatch, MovedCamera, ViewFinding

MAX_CHECKED_KEYS = 8
"""Largest number of key frames that cameras are compared with, evenly spaced over the shot."""
MAX_OFFSET_SPREAD = 4.0
"""Largest difference between offsets of all views that mean one thing, key poses that lag, frames: each is known to two
frames at most."""
EARLY_MISFITS = "footage that does not match"
"""Key with which these are shown, beside those of segments."""
EARLY_KEYS = 3
"""Number of key frames by which footage is compared with the key poses before the shot is tracked."""
CHECK_STAGES = (RefinementStage(0.25, 4.0, 4, learns_once=True), RefinementStage(0.10, 1.0, 4, learns_once=True))
"""Few stages: a camera that fits passes soon, and one that does not need not be corrected to be detected."""
CHECK_CONVERGED_PIXELS = 0.25
"""As `CONVERGED_PIXELS`, for these stages, pixels of the reduced frames: inexact key poses are off by pixels anyway."""


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


def early_frames(shot: Shot) -> frozenset[int]:
    """Return the shot frames whose pictures `early_misfits` compares: the first with key poses of the whole body, and
    the first of all.
    """
    return frozenset({*_early_keys(shot).tolist(), *range(min(FLICKER_FRAMES, shot.length))})


def _early_keys(shot: Shot) -> NDArray[np.int64]:
    return whole_keys(shot, 0, shot.length - 1)[:EARLY_KEYS]


@one_library_thread()
def early_misfits(shot: Shot, pictures: Sequence[Mapping[int, NDArray[np.uint8]]]) -> list[ViewFinding]:
    """Return the views whose light flickers, or whose footage does not match the first key poses, which is known before
    anything is tracked.

    Parameters
    ----------
    shot : Shot
    pictures : sequence of mappings
        Per view: rectified pictures by shot frame, including those of `early_frames`.
    """
    swings = [flicker([own[f] for f in range(min(FLICKER_FRAMES, shot.length))]) for own in pictures]
    flickering: list[ViewFinding] = [
        FlickeringLight(view.camera.name, swing)
        for view, swing in zip(shot.views, swings, strict=True)
        if swing > MIN_FLICKER
    ]
    frames = _early_keys(shot)
    if len(frames) < 2:
        return flickering
    rectified = replace(shot, views=tuple(replace(view, camera=view.camera.rectified()) for view in shot.views))
    views = pictured_key_frames(rectified, frames, pictures)
    off = [match for match in footage_matches(rectified, views, frames) if match.off]
    return flickering + [own for own in _explained(shot, frames, off, ()) if isinstance(own, FootageMatch)]


@one_library_thread()
def fit_by_key_poses(
    shot: Shot,
    pictures: Sequence[Mapping[int, NDArray[np.uint8]]] | None = None,
    progress: Progress | None = None,
) -> tuple[ViewFinding, ...]:
    """Compare the cameras with the key poses of the whole body, by the performers' outlines.

    Parameters
    ----------
    shot : Shot
    pictures : sequence of mappings, optional
        Per view: rectified pictures by shot frame, including those of `checked_frames`; read from the footage by
        default.
    progress : callable, optional

    Returns
    -------
    tuple of ViewFinding
        One per view that shows the performers clearly enough; none if there is no key pose of the whole body. For
        views whose footage does not match the key poses, although the camera is not off, that is said instead.

    Raises
    ------
    FootageError
        See `core.tracking.tracker.track`.
    CancelledError
    """
    frames = np.array(checked_frames(shot), dtype=np.int64)
    if not len(frames):
        return ()
    given = shot
    if pictures is None:
        views = read_key_frames(shot, frames, progress)
    else:
        shot = replace(shot, views=tuple(replace(view, camera=view.camera.rectified()) for view in shot.views))
        views = pictured_key_frames(shot, frames, pictures)
    try:
        found = refine_cameras(shot, progress, views=views, stages=CHECK_STAGES, settled=CHECK_CONVERGED_PIXELS).views
    except CalibrationError:  # no view shows the performers clearly
        found = ()
    fits = [
        CameraFit(one.shift, one.deviation, one.limit, one.camera.name, "key poses") for one in found if not one.lost
    ]
    matches = footage_matches(shot, views, frames)
    moved = _moved(shot, views, frames, matches, fits)
    rest = [fit for fit in fits if fit.camera not in moved]
    return (*moved.values(), *_explained(given, frames, [own for own in matches if own.camera not in moved], rest))


def _moved(
    shot: Shot,
    views: Sequence[KeyFrameView],
    frames: NDArray[np.int64],
    matches: Sequence[FootageMatch],
    fits: Sequence[CameraFit],
) -> dict[str, MovedCamera]:
    """Return the cameras that do not fit, or whose footage does not match, because they were moved during the shot."""
    found = {}
    off = {fit.camera for fit in fits if fit.off} | {match.camera for match in matches if match.off}
    for view, pictured in zip(shot.views, views, strict=True):
        name = view.camera.name
        if name in off:
            shift = shifted_background(shot, view, pictured, frames)
            if shift is not None:
                first = shot.frames[0]
                there = replace(shift, frames=(first + shift.frames[0], first + shift.frames[1]))
                found[name] = MovedCamera(name, there)
    return found


def _explained(
    shot: Shot, frames: NDArray[np.int64], matches: Sequence[FootageMatch], fits: Sequence[CameraFit]
) -> tuple[ViewFinding, ...]:
    """Return the cameras' fits, and what else explains that views do not show the key poses.

    A camera that can be corrected explains that its footage does not match. Another offset explains both; but where
    performers walk steadily, a camera that was turned looks like one that is late.
    """
    correctable = {fit.camera for fit in fits if fit.off}
    unlike = {match.camera: match for match in matches if match.off and match.camera not in correctable}
    views = {view.camera.name: view for view in shot.views}
    for match in matches:
        if match.camera in correctable or match.camera in unlike:
            offset = better_offset(shot, views[match.camera], frames)
            if offset is not None:
                unlike[match.camera] = replace(match, offset=offset)
    if len(matches) > 1 and len(unlike) == len(matches) and not _agree(unlike.values()):
        # The key poses are elsewhere, or of another movement: some offset always fits a little better.
        unlike = {name: without for name, own in unlike.items() if (without := replace(own, offset=None)).off}
    return (*unlike.values(), *(fit for fit in fits if fit.off or fit.camera not in unlike))


def _agree(matches: Iterable[FootageMatch]) -> bool:
    """Whether offsets that fit better are known of all of some views, and are about the same."""
    offsets = [match.offset for match in matches]
    known = [offset for offset in offsets if offset is not None]
    return len(known) == len(offsets) and max(known) - min(known) <= MAX_OFFSET_SPREAD


def camera_fits(shot: Shot, result: SolvedShot, progress: Progress | None = None) -> tuple[ViewFinding, ...]:
    """Compare the cameras of a solved shot with one another and with its key poses.

    Parameters
    ----------
    shot : Shot
    result : SolvedShot
        If it has the pictures of `checked_frames`, they are not read again.
    progress : callable, optional
    """
    shot = with_found_gaps(shot, result.gaps)
    keypoints = [own.factor.keypoints for own in result.observed.performers]
    shared = fit_by_keypoints(shot, keypoints) if keypoints else ()
    in_step, frames = shot.with_footage_offset(result.footage_offset), set(checked_frames(shot))
    kept = bool(result.pictures) and all(frames <= images.keys() for images in result.pictures)
    return (*shared, *fit_by_key_poses(in_step, result.pictures if kept else None, progress))


def for_camera_fits(shot: Shot, result: TrackResult | SolvedShot) -> SolvedShot:
    """Return what `camera_fits` needs of a result, which is small enough to be sent to another process."""
    frames = set(checked_frames(shot))
    pictures = tuple({f: image for f, image in kept.items() if f in frames} for kept in result.pictures)
    return SolvedShot(pictures, result.observed, result.footage_offset, result.gaps)


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
    chosen = np.linspace(0, len(keys) - 1, min(MAX_CHECKED_KEYS, len(keys))).round().astype(int)
    return [int(frame) for frame in keys[chosen]]


def refine_shot_cameras(shot: Shot, progress: Progress | None = None) -> Refinement:
    """Refine a shot's cameras, by keypoints and by key poses.

    Cameras that contradict the keypoints of the others are moved to agree with them. If no three views share keypoints,
    or the cameras then do not fit the key poses, all are refined by `refine_cameras`.

    Raises
    ------
    CalibrationError
        There are neither shared keypoints nor key poses; see `refine_cameras`.
    FootageError, KeypointError
        A file cannot be read.
    CancelledError
    """
    compared = _by_keypoints(shot)
    if compared is None:
        return refine_cameras(shot, progress)
    agreed = compared.applied(shot)
    if not any(fit.off for fit in fit_by_key_poses(agreed, progress=progress)):
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
        unknown = (np.nan, np.nan, np.nan)
        found.append(RefinedCamera(camera, shift, own.deviation, *unknown, clearness=1.0, limit=own.limit))
    return Refinement(tuple(found), np.zeros(0, dtype=np.int64))


def _compared(shot: Shot, performers: Sequence[Keypoints]) -> tuple[dict[int, PictureShift], CameraEstimate]:
    """Compare the cameras by keypoints, see `contradictions`."""
    own = [without_midpoints(keypoints) for keypoints in performers]
    cameras = [view.camera for view in shot.views]
    return contradictions(SharedKeypoints.of(own, cameras, correlated_frames(shot.settings, shot.fps)))
